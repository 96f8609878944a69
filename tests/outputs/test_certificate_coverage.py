"""The benchmark of certificates' coverage runs, and judges what it is for."""

import sys

import numpy as np
import pytest

from conftest import ROOT, load_script


@pytest.fixture(scope="module")
def benchmark():
    """Return the benchmark's command."""
    folder = ROOT / "benchmarks"
    yield load_script(folder / "certificate_coverage.py")
    sys.path.remove(str(folder))


@pytest.mark.slow
def test_a_campaign_of_every_procedure_is_held_against_its_truth(benchmark, tmp_path, capsys):
    """One campaign each: every result that has a truth is within three U of it, and stands in the
    page; what is kept is not simulated again.
    """
    page, kept = tmp_path / "page.md", tmp_path / "rows.jsonl"
    page.write_text(f"{benchmark.BEGIN}\nold\n{benchmark.END}\n", encoding="utf-8")
    asked = ["--sets", "1", "--results", str(kept), "--page", str(page)]
    benchmark.main(asked)
    text = page.read_text(encoding="utf-8")
    assert "old" not in text
    outcomes = [benchmark.kept(kept, name) for name in benchmark.PROCEDURES]
    for name, found in zip(benchmark.PROCEDURES, outcomes, strict=True):
        assert f"| {name} |" in text
        assert found[0]
        assert max(abs(one) for ratios in found[0].values() for one in ratios) < 3.0, name
    shown = capsys.readouterr().out
    benchmark.main(asked)
    again = capsys.readouterr().out
    assert [line for line in shown.splitlines() if "%" in line] == [
        line for line in again.splitlines() if "%" in line
    ]


def test_a_row_fails_where_its_binomial_interval_lies_outside(benchmark):
    """95 of 100 and all of 200 pass, 85 of 100 and all of 2,000 fail, and so does a refusal."""

    def judged(covered, of):
        ratios = np.where(np.arange(of) < covered, 0.5, 1.5)
        return benchmark.judge("x", [{"K": [float(one)]} for one in ratios])[1]

    assert [judged(*one) for one in ((95, 100), (200, 200), (85, 100), (2000, 2000))] == [
        *(False, False),
        *(True, True),
    ]
    assert benchmark.judge("x", [{"K": [0.5]}, {"refused: why": []}])[1]
