"""The benchmark of readability counts what it says it counts."""

import json

import pytest

from conftest import ROOT, load_script

CORE = '''"""A core."""

# a comment on a line of its own
def level(rows):
    """Mean of rows."""
    found = [row for row in rows]  # a comment behind code
    return sum(found)
'''


@pytest.fixture(scope="module")
def benchmark():
    """Return the benchmark's command."""
    return load_script(ROOT / "benchmarks" / "readability.py")


def test_a_small_tree_is_counted_and_drawn_from(benchmark, tmp_path, capsys):
    """Two modules of which one is in the scope: every row of the table is what a reader counts."""
    (tmp_path / "fit").mkdir()
    (tmp_path / "fit" / "core.py").write_text(CORE, encoding="utf-8")
    (tmp_path / "other.py").write_text("class A:\n    pass\n", encoding="utf-8")
    benchmark.main(["--root", str(tmp_path), "--json"])
    measured = json.loads(capsys.readouterr().out)
    table, folders = measured["table"], measured["folders"]
    assert folders["scope: fit"] == folders["scope"] == {"statements": 5, "expressions": 10}
    assert folders["all"] == {"statements": 7, "expressions": 10}
    assert (table["lines"], table["lines of a function, max"]) == (9, 4)
    assert table["comment lines %"] == pytest.approx(200.0 / 9)
    assert table["docstring lines %"] == pytest.approx(200.0 / 9)
    assert table["comprehensions in 1,000 statements"] == pytest.approx(1000.0 / 7)
    assert table["names without content %"] == pytest.approx(100.0 / 3)  # of rows, found, row
    benchmark.main(["--root", str(tmp_path), "--sample", "5", "--least", "4"])
    assert capsys.readouterr().out == "fit/core.py\n"
