"""JSON logs: which members are columns, and what is refused rather than read as something else."""

import json

import numpy as np
import pytest

from calibkit.errors import LogFormatError
from calibkit.readers import json_arrays
from calibkit.recipe.logs import Logs


def read(tmp_path, document, needed=("a", "b"), **logs):
    """Read a document, or the text of one, described by keys of [logs]."""
    text = document if isinstance(document, str) else json.dumps(document)
    (tmp_path / "log.json").write_text(text, encoding="utf-8")
    return json_arrays.read(
        tmp_path / "log.json", "log.json", Logs(files=("*",), format="json", **logs), set(needed)
    )


def columns(table):
    """Columns of a table as lists."""
    return {name: table.frame[name].tolist() for name in table.frame}


@pytest.mark.parametrize(
    ("document", "logs"),
    [
        ({"a": [1, 2, 3], "b": [4.5, 5, 6]}, {}),
        (
            {
                "about": "a log",
                "made": 7,
                "none": [],
                "a": [1, 2, 3],
                "b": [4.5, 5, 6],
                "names": ["p", "q", "r"],
            },
            {},
        ),
        ({"run": {"a": [1, 2, 3], "b": [4.5, 5, 6]}}, {}),
        ([{"a": 1, "b": 4.5}, {"b": 5, "a": 2}, {"a": 3, "b": 6}], {}),
        ([[1, 4.5], [2, 5], [3, 6]], {"names": ("a", "b")}),
        ({"m": [[1, 2, 3], [4.5, 5, 6]]}, {"names": ("a", "b")}),
        (
            {"m": [[1, 4.5], [2, 5], [3, 6]], "n": [[0, 0], [0, 0]]},
            {"names": ("a", "b"), "table": "m"},
        ),
    ],
)
def test_one_log_in_many_shapes_is_one_table(tmp_path, document, logs):
    """Lists by name, nested or not, records, rows and columns of a matrix: the same numbers."""
    assert columns(read(tmp_path, document, **logs)) == {"a": [1.0, 2.0, 3.0], "b": [4.5, 5.0, 6.0]}


def test_null_has_no_value_and_numbers_are_the_nearest_of_float64(tmp_path):
    """Digits as written; what float64 does not reach is infinite, which every check of a log
    refuses.
    """
    text = f'{{"a": [null, 0.1, 9007199254740993], "b": [1e999, -1{"0" * 5000}, 2]}}'
    found = columns(read(tmp_path, text))
    assert np.isnan(found["a"][0])
    assert found["a"][1:] == [0.1, 9007199254740992.0]
    assert found["b"] == [np.inf, -np.inf, 2.0]


@pytest.mark.parametrize(
    ("document", "logs", "fragment"),
    [
        ('{"a": [1, 2],\n"b": [4,', {}, "log.json:2: not JSON"),
        ("[" * 100_000, {}, "log.json: not JSON"),
        ('{"a": [1, 2], "b": [3, 4], "a": [5, 6]}', {}, "'a' stands twice"),
        ([{"a": 1, "b": 2}, {"b": 3}], {}, "record 2 has other keys than the first"),
        ({"a": [1, 2, 3], "b": [4, 5]}, {}, "columns of several lengths: a 3, b 2"),
        (
            {"g": {"a": [1, 2], "b": [3, 4]}, "h": {"a": [5, 6], "b": [7, 8]}},
            {},
            "arrays in 2 groups",
        ),
        ({"a": [1, 2]}, {"table": "q"}, "no numeric array 'q'; there are: a"),
        (
            {"m": [[1, 2, 3], [4, 5, 6]]},
            {"names": ("a",)},
            "'m' is a matrix of 2 × 3, the recipe names 1 columns",
        ),
        ({"a": ["x", "y"], "b": [[1, 2], [3]]}, {}, "no numeric arrays"),
    ],
)
def test_what_could_be_read_two_ways_is_refused(tmp_path, document, logs, fragment):
    """Nothing of a log is lost or overwritten without a word, and a damaged one is named with its
    line.
    """
    with pytest.raises(LogFormatError) as refused:
        read(tmp_path, document, **logs)
    assert fragment in str(refused.value)
