"""What a certificate prints, read back from its PDF, compared with the sheet that the attached
files give.

Rows of numbers are looked for in the order of printing, without blanks; a number with one more
digit, point or sign is another number. Words in scripts whose order changes when a PDF is read are
passed over.
"""

import re
import unicodedata
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Self

Segments = list[str | int]
"""Texts of cells that stand directly behind each other; of one that cannot be read back the most
characters that it may take.
"""

LARGEST_GAP = 1500
"""Characters that a text which cannot be read back may take, whatever its length."""
READ_BACK = 36
"""Further ones for each of its own: a letter is read back with its combining marks once for each of
them, and words are broken behind 36 characters.
"""
LIGATURES = {"ﬀ": "ff", "ﬁ": "fi", "ﬂ": "fl", "ﬃ": "ffi", "ﬄ": "ffl", "\u200b": " ", "\u00ad": ""}
PART_OF_NUMBER = frozenset("0123456789.−")
NUMBER = re.compile(r"[0-9.−…\[\]*×⁻⁰¹²³⁴-⁹ ]*[0-9][0-9.−…\[\]*×⁻⁰¹²³⁴-⁹ ]*|[0-9a-f\u200b]{64,}")
"""A cell that is a number, an interval or a digest, and no word."""


@dataclass(frozen=True, slots=True)
class _Text:
    """A PDF's text without blanks, and for each character whether a blank stands before it; pages
    apart.
    """

    characters: str
    after_blank: tuple[bool, ...]
    pages: tuple[str, ...]

    @classmethod
    def from_pages(cls, pages: Sequence[str]) -> Self:
        """Text of extracted pages."""
        text = "\n".join(map(_plain, pages))
        characters, after_blank, blank = [], [], True
        for character in text:
            if character == "_":
                continue
            if character.isspace():
                blank = True
                continue
            characters.append(character)
            after_blank.append(blank)
            blank = False
        return cls(
            "".join(characters), (*after_blank, True), tuple(compact(page) for page in pages)
        )

    def find(self, segments: Segments, start: int) -> int:
        """Where a row ends that begins at or behind `start`, or -1."""
        first, *following = segments
        assert isinstance(first, str)  # noqa: S101 (a row begins with text that can be read back)
        begin = self.characters.find(first, start)
        while begin >= 0:
            end = self._follow(begin, len(first), following)
            if end >= 0:
                return end
            begin = self.characters.find(first, begin + 1)
        return -1

    def _follow(self, begin: int, length: int, following: Segments) -> int:
        """End of a row, cells directly behind each other but for what may be anything; -1 where a
        number goes on.
        """
        end, gap = begin + length, 0
        is_separate = self._apart(begin) and self._apart(end)
        for segment in following:
            if isinstance(segment, int):
                gap += segment
                continue
            position = self.characters.find(segment, end, end + gap + len(segment))
            if position < 0:
                return -1
            end, gap = position + len(segment), 0
            is_separate = is_separate and self._apart(position) and self._apart(end)
        return end if is_separate else -1

    def _apart(self, place: int) -> bool:
        """Whether no number goes on over a place: a digit, point or sign directly before it and one
        directly behind.
        """
        if place in {0, len(self.characters)} or self.after_blank[place]:
            return True
        return not {self.characters[place - 1], self.characters[place]} <= PART_OF_NUMBER


def _plain(text: str) -> str:
    """Text with ligatures taken apart."""
    for ligature, letters in LIGATURES.items():
        text = text.replace(ligature, letters)
    return text


def compact(text: str) -> str:
    """Text without blanks, invisible marks, and the underscores that stand for subscripts."""
    return "".join(_plain(text).replace("_", "").split())


def _readable(text: str) -> bool:
    """Whether a text comes out of a PDF as it went in: Latin, Greek, Cyrillic, signs; no combining
    marks, no right-to-left.
    """
    return "[U+" not in text and all(
        (ord(c) < 0x530 or 0x2000 <= ord(c) < 0x2400 or c in LIGATURES)
        and not unicodedata.combining(c)
        and unicodedata.bidirectional(c) not in {"R", "AL", "AN"}
        for c in text
    )


def _segments(cells: Sequence[str], *, words: bool) -> Segments:
    """Cells of a row as texts that stand behind each other; without `words` those of numbers."""
    segments: Segments = []
    for cell in cells:
        if not _readable(cell) or not (words or not cell or NUMBER.fullmatch(cell)):
            segments.append(LARGEST_GAP + READ_BACK * len(cell))
        elif text := compact(cell):
            segments.append(text)
    while segments and isinstance(segments[0], int):
        del segments[0]
    return segments


def find_unprinted(
    sheet: dict[str, Any], pages: Sequence[str], *, words: bool
) -> tuple[list[str], int]:
    """Everything that the sheet holds and the pages do not, and how many rows were found; without
    `words` the numbers of its results and its digests alone, which every release prints alike.
    """
    text = _Text.from_pages(pages)
    missing = [*_marks(sheet, text), *(_facts(sheet, text) if words else ())]
    place, count, row_ends = 0, 0, set[int]()
    for section, cells in _rows(sheet, budgets=words):
        row = _segments(cells, words=words)
        if not row:
            continue
        end = text.find(row, place if words else 0)
        # names of another length lay tables out in another order: each row has a place of its own
        while end in row_ends:
            end = text.find(row, end)
        if end < 0:
            row_text = " ".join(cell for cell in cells if cell).replace("\u200b", "")
            missing.append(f"{section}: '{row_text[:90]}' is not printed")
        else:
            place, count = end, count + 1
            row_ends |= set() if words else {end}
    return missing, count


def _marks(sheet: dict[str, Any], text: _Text) -> Iterator[str]:
    """What stands on every page: the number; DRAFT, where the certificate is one."""
    marks = [sheet["number"], sheet["words"]["s_draft_line"] if sheet["draft"] else ""]
    for mark in filter(_readable, filter(None, marks)):
        absent = [str(k) for k, page in enumerate(text.pages, 1) if compact(mark) not in page]
        if absent:
            yield f"'{mark}' is not on page {', '.join(absent)}"


def _facts(sheet: dict[str, Any], text: _Text) -> Iterator[str]:
    """Laboratory, customer, item, method, conditions, person: each text somewhere on the pages."""
    body = "".join(_body(sheet, page) for page in text.pages)
    if _readable(sheet["rejected"]) and compact(sheet["rejected"]) not in body:
        yield f"'{sheet['rejected']}' is not printed"
    groups = [
        *sheet["parties"],
        sheet["item"],
        sheet["method"],
        sheet["conditions"],
        sheet["authorisation"],
    ]
    for label, value in (row for group in groups for row in group):
        if value.strip() and _readable(value) and compact(value) not in body:
            yield f"{label}: '{' '.join(value.split())[:60]}' is not printed"


def _body(sheet: dict[str, Any], page: str) -> str:
    """A page without its head and foot, which may stand in the middle of a text that goes on
    overleaf.
    """
    for head in (
        sheet["words"]["s_draft"],
        sheet["laboratory"],
        sheet["words"]["s_draft_line"],
        sheet["title"],
        sheet["number"],
    ):
        page = page.removeprefix(compact(head))
    foot = page.rfind(compact(sheet["words"]["s_only_item"]))
    return page if foot < 0 else page[:foot]


def _rows(sheet: dict[str, Any], *, budgets: bool) -> Iterator[tuple[str, list[str]]]:
    """Every row of numbers in the order of printing, with where it belongs; those of uncertainty
    budgets where they are asked for.
    """
    yield from (("principal results", row) for row in sheet["principal"]["rows"])
    for block in sheet["blocks"]:
        for table in block["tables"]:
            yield from ((block["file"], row) for row in table["rows"])
        yield block["file"], ["SHA-256", block["sha256"]]
    for table in sheet["as_found"]["tables"]:
        yield from ((table["title"], row) for row in table["rows"])
    if sheet["conformity"]["table"] is not None:
        yield from (("conformity", row) for row in sheet["conformity"]["table"]["rows"])
    for budget in sheet["budgets"]["budgets"] if budgets else ():
        yield f"budget of {budget['title']}", [budget["title"], budget["value"]]
        yield from ((f"budget of {budget['title']}", row) for row in budget["rows"])
        yield f"budget of {budget['title']}", budget["sum"]
    yield from (("digests", row) for row in (*sheet["data"]["files"], *sheet["data"]["logs"]))
    yield from (("digests", [note]) for note in sheet["data"]["notes"])
