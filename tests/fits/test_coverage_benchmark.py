"""The benchmark of coverage runs, and judges what it is for."""

import importlib.util
import sys

import numpy as np
import pandas as pd
import pytest

from conftest import ROOT


@pytest.fixture(scope="module")
def benchmark():
    """Return the benchmark's command and the module that judges rows."""
    folder = ROOT / "benchmarks"
    # under another name: the library that measures the suite is called coverage too
    spec = importlib.util.spec_from_file_location("coverage_command", folder / "coverage.py")
    command = importlib.util.module_from_spec(spec)
    sys.modules["coverage_command"] = command
    spec.loader.exec_module(command)
    yield command, importlib.import_module("intervals.rows")
    sys.path.remove(str(folder))
    del sys.modules["coverage_command"]


@pytest.mark.slow
def test_a_few_campaigns_of_every_instrument_give_rows_and_a_page(benchmark, tmp_path, capsys):
    """Two campaigns of each procedure without shared errors: every row has campaigns and a finite
    width, stands in page and CSV, and is not simulated again.
    """
    command, _ = benchmark
    page, results = tmp_path / "coverage.md", tmp_path / "rows.jsonl"
    page.write_text(f"# Title\n{command.BEGIN}\nold\n{command.END}\n", encoding="utf-8")
    asked = ["--sets", "2", "--results", str(results), "--page", str(page), "--only", "'none'"]
    command.main([*asked, "--only", "groups=5"])
    command.main([*asked, "--only", "gyro_pair"])
    command.main([*asked, "--only", "gyro_triad"])
    first = [line for line in capsys.readouterr().out.splitlines() if "×" in line]
    command.main(["--sets", "0", "--results", str(results), "--page", str(page)])
    again = [line for line in capsys.readouterr().out.splitlines() if "×" in line]
    assert sorted(again) == sorted(first)
    rows = [row for found in command.kept(results).values() for row in found]
    assert {row.instrument for row in rows} == set(command.INSTRUMENTS)
    assert all(row.campaigns == 2 and row.width > 0.5 for row in rows)
    text = page.read_text(encoding="utf-8")
    assert "old" not in text
    assert all(row.quantity in text for row in rows)
    written = pd.read_csv(page.with_suffix(".csv"))
    assert written["quantity"].tolist() == [row.quantity for row in rows]
    assert written["width"].to_numpy() == pytest.approx([row.width for row in rows], rel=1e-4)


def outcomes(rows, *, covered, width, of=1000, warned=False):
    """Outcomes of campaigns of which some are covered."""
    inside = [np.array([float(k < covered)]) for k in range(of)]
    return [rows.Outcome({"K": one}, {"K": np.array([width])}, warned) for one in inside]


@pytest.mark.parametrize(
    ("case", "made", "faults"),
    [
        ({}, {"covered": 950, "width": 1.5}, []),
        ({}, {"covered": 880, "width": 1.5}, ["coverage"]),
        ({}, {"covered": 950, "width": 1.7}, ["width"]),
        ({"given": True}, {"covered": 1000, "width": 1.2}, ["coverage", "width"]),
        ({"between": 2}, {"covered": 1000, "width": 9.0}, ["no warning"]),
        ({"between": 2}, {"covered": 1000, "width": 9.0, "warned": True}, []),
    ],
)
def test_a_row_fails_where_its_binomial_interval_or_its_width_is_outside(
    benchmark, case, made, faults
):
    """Limits of coverage, width, and the warning of few groups."""
    _, rows = benchmark
    whole = rows.Case("accelerometer", "K", "zero of a soak", 1.0, 7, **case)
    (row,) = rows.judge(whole, outcomes(rows, **made))
    assert row.faults == faults


def test_a_refused_campaign_fails_its_row(benchmark):
    """One of 1,001 refused, with an error of the noise and 7 soaks; with 3 times the noise it is
    printed only.
    """
    _, rows = benchmark
    made = [*outcomes(rows, covered=950, width=1.0), rows.Outcome({}, {}, refused="no")]
    for ratio, faults in ((1.0, ["refused"]), (3.0, [])):
        (row,) = rows.judge(rows.Case("accelerometer", "K", "zero of a soak", ratio, 7), made)
        assert row.faults == faults
        assert "1 refused" in row.cell


def test_half_widths_with_known_components_are_those_of_generalised_least_squares(benchmark):
    """The mean of nine dwells in three soaks: sqrt(1/9 + 4/3) of zeros of 2."""
    exact = importlib.import_module("intervals.exact")
    soak = np.repeat(np.eye(3), 3, axis=0)
    (found,) = exact.half_widths(np.ones((9, 1)), 2.0 * soak, 1.0, np.ones((1, 1)))
    assert found == pytest.approx(1.959963984540054 * np.sqrt(1.0 / 9.0 + 4.0 / 3.0), rel=1e-12)
