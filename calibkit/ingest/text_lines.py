"""A text log written again line by line: fields replaced and added, every other character kept."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from calibkit import units
from calibkit.readers import encoding as encodings
from calibkit.readers.sniff import Dialect

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from calibkit.arrays import Integers
    from calibkit.recipe.logs import Logs

STATUS = "status"
"""Column that says why a row is not corrected."""
_NO_VALUE, _NO_STATUS = "nan", "ok"
"""What stands for an empty field where blanks part the columns."""


@dataclass(frozen=True, slots=True)
class TextLines:
    """Lines of a text log in its dialect; `rows` are the numbers of its rows among them, from 0."""

    dialect: Dialect
    lines: tuple[str, ...]
    line_end: str
    byte_order_mark: bytes
    rows: Integers

    @classmethod
    def cut(cls, data: bytes, file: str, logs: Logs, rows: Integers) -> TextLines | None:
        """Lines of a log's bytes; None where its columns have widths instead of a delimiter.

        Raises LogFormatError for what is no text in a dialect.
        """
        text, encoding = encodings.decode(data, file, logs.text.encoding)
        dialect = Dialect.recognise(text, encoding, file, logs.text, logs.names)
        if dialect.delimiter == "fixed":
            return None
        mark = next((mark for mark, _ in encodings.MARKS if data.startswith(mark)), b"")
        line_end = "\r\n" if "\r\n".encode(encoding) in data else "\n"
        return cls(dialect, tuple(text.split("\n")), line_end, mark, rows)

    def write(
        self,
        replaced: Mapping[int, Sequence[str | None]],
        added: Mapping[str, Sequence[str]],
        status: Sequence[str],
        renamed: Mapping[str, str],
    ) -> bytes:
        """Bytes of the log with numbers of some columns replaced row by row (None keeps a field),
        with columns of numbers and the status, where there is one, behind; columns may be renamed.
        """
        lines, last = list(self.lines), [self._quote(text) for text in status]
        for row, line in enumerate(self.rows.tolist()):
            fields = {}
            for k, texts in replaced.items():
                text = texts[row]
                if text is not None:
                    fields[k] = self._number(text)
            added_fields = [self._number(texts[row]) for texts in added.values()]
            lines[line] = self._edit(lines[line], fields, (*added_fields, *last[row : row + 1]))
        for line, fields, names in self._edit_header((*added, *[STATUS][: len(last)]), renamed):
            lines[line] = self._edit(lines[line], fields, names)
        text = self.line_end.join(lines)
        return self.byte_order_mark + text.encode(self.dialect.encoding)

    def _number(self, text: str) -> str:
        """A number with the log's decimal mark; where blanks part columns no field may be empty."""
        if not text and self.dialect.delimiter == "space":
            return _NO_VALUE
        return text.replace(".", self.dialect.decimal)

    def _quote(self, text: str) -> str:
        """A status as one field."""
        if self.dialect.delimiter == "space":
            return text.replace(" ", "_") or _NO_STATUS
        return f'"{text}"' if self.dialect.delimiter in text else text

    def _edit_header(
        self, names: Sequence[str], renamed: Mapping[str, str]
    ) -> Iterable[tuple[int, dict[int, str], list[str]]]:
        """Changes of the lines of names and of units: the line, fields by column, fields behind."""
        first = self.dialect.first_line - 1
        lines_above = [line for line in range(first) if self.lines[line].strip()]
        header = lines_above[len(lines_above) - self.dialect.header_lines :]
        if not header:
            return
        fields = {k: renamed[name] for k, name in enumerate(self.dialect.names) if name in renamed}
        yield header[0], fields, list(names)
        if len(header) == 2:
            bracket = re.search(r"[\[(]", self.lines[header[1]])
            brackets = {"[": "[{}]", "(": "({})"}[bracket.group()] if bracket else "{}"
            words = [units.column_unit(name) if name != STATUS else "" for name in names]
            yield header[1], {}, [brackets.format(word) if word else "-" for word in words]

    def _edit(self, line: str, fields: Mapping[int, str], added_fields: Sequence[str]) -> str:
        """A line with fields replaced and added behind."""
        mark = self.dialect.delimiter
        if mark == "space":
            spans = list(re.finditer(r"(?:(?<!\S)[+-] +(?=[\d.,]))?\S+", line))
            for k in sorted(fields, reverse=True):
                line = line[: spans[k].start()] + fields[k] + line[spans[k].end() :]
            return " ".join((line.rstrip(), *added_fields))
        parts = _split(line, mark)
        for k, text in fields.items():
            parts[k] = text
        parts += [""] * (len(self.dialect.columns) - len(parts))
        return mark.join((*parts, *added_fields))


def _split(line: str, mark: str) -> list[str]:
    """Fields of a line between delimiters, as they are written."""
    if '"' not in line:
        return line.split(mark)
    return re.split(re.escape(mark) + r'(?=(?:[^"]*"[^"]*")*[^"]*$)', line)
