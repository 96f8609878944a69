"""Comma-separated logs with texts or faults: read whole or not at all."""

import pytest

from calibkit.errors import LogFormatError
from calibkit.readers import registry
from calibkit.recipe.logs import Logs


def read(tmp_path, content):
    """Read bytes as the log x.csv whose columns a and b are needed."""
    path = tmp_path / "x.csv"
    path.write_bytes(content)
    logs = Logs.model_validate({"files": ["*"], "format": "csv"})
    return registry.read(path, "x.csv", logs, {"a", "b"})


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "x.csv: the file is empty"),
        (b"a,b\n", "x.csv: a header but no rows"),
        (b"a,b\n1,2\n3\n", "x.csv:3: 1 fields, expected 2"),
        (b"a,b\n1,2\n3,x\n", "x.csv:3: column 'b': found 'x', expected a number"),
        (b"a,b\n1,1_0\n", "x.csv:2: column 'b': found '1_0'"),
        (b"a;b\n1;2\n", "separate columns with commas"),
        (b"a,a\n1,2\n", "column 'a' stands twice"),
        (b"a,\n1,2\n", "column 2 has no name"),
        (b"1,2\n3,4\n", "numbers where the column names should be"),
        (b"a,b\n1,2\xff\n", "x.csv:2: byte 0xff is not UTF-8"),
        (b"a,b\n1,2\n3,\r4\n", "x.csv:3: a carriage return inside the line"),
        (
            b"a,b\n1.00,2.00\n1.00,3.00\n1.00,2.0",
            "x.csv:4: the last number '2.0' has 1 decimals and no line end",
        ),
    ],
)
def test_a_log_that_cannot_be_read_whole_is_refused_with_its_place(tmp_path, content, message):
    """What is wrong is named with file, line and column."""
    with pytest.raises(LogFormatError) as refused:
        read(tmp_path, content)
    assert message in str(refused.value)


def test_a_last_line_without_end_is_kept_and_said(tmp_path):
    """A last line without a line end is kept when nothing shows that it is cut, and noted."""
    table = read(tmp_path, b"a,b\n1,2\n3,4")
    assert table.frame["b"].tolist() == [2.0, 4.0]
    assert "no line end" in table.notes[0]
