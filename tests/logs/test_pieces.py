"""A log that is looked at in pieces tells what the same log tells when it is read whole."""

import numpy as np
import pytest

from calibkit import instruments, recipe
from calibkit.check import chunked, examination
from calibkit.commands import pipeline

FILE = "ramp_heating_05.csv"


@pytest.fixture
def small(monkeypatch):
    """Make pieces of 1,000 rows and thinned logs of at most 2,700."""
    monkeypatch.setattr(chunked, "CHUNK", 1000)
    monkeypatch.setattr(chunked, "KEPT", 2700)


def both(folder, overrides=()):
    """Return what is said of the log read whole, and in pieces."""
    spec = instruments.parse_recipe(recipe.find("fog_thermal", overrides))
    procedure = instruments.find(spec.procedure)
    return [
        examination.examine_log(procedure, spec, folder, FILE, largest=largest).report
        for largest in (1 << 40, 0)
    ]


def planted(folder, changes):
    """Write the simulated ramp with rows changed: column → {row: change}."""
    lines = pipeline.simulated("fog_thermal", 3).files()[FILE].decode().splitlines()
    for row, column, change in changes:
        fields = lines[row + 1].split(",")
        fields[column] = f"{float(fields[column]) + change:.3f}"
        lines[row + 1] = ",".join(fields)
    (folder / FILE).write_text("\n".join(lines) + "\n", encoding="utf-8")


def test_a_healthy_log_says_nothing_in_pieces_either(small, tmp_path):
    """Facts and digest agree exactly, the ramp's rate within 1 %, and no piece gives a false
    alarm.
    """
    planted(tmp_path, [])
    whole, pieced = both(tmp_path)
    assert pieced.findings == whole.findings == ()
    assert pieced.sha256 == whole.sha256
    for name in ("rows", "duration_s", "rate_hz", "gaps"):
        assert getattr(pieced.facts, name) == pytest.approx(getattr(whole.facts, name), rel=1e-12)
    assert [(c.low, c.high) for c in pieced.facts.columns] == [
        (c.low, c.high) for c in whole.facts.columns
    ]
    for a, b in zip(pieced.facts.occupancy, whole.facts.occupancy, strict=True):
        assert a.share == pytest.approx(b.share, abs=1e-12)
    rates = [
        [held.level for held in report.held if held.kind == "ramp"] for report in (pieced, whole)
    ]
    np.testing.assert_allclose(*rates, rtol=0.01)
    assert any("looked at in pieces" in note for note in pieced.notes)


@pytest.mark.parametrize(
    ("changes", "name", "line"),
    [
        ([(2500, 3, 15.0)], "spike", 2502),
        ([(3000, 0, -1.0)], "clock", 3002),
        ([(999, 0, -1.0), (1000, 0, -1.5)], "clock", None),
        ([(4000, 1, 900.0)], "range", 4002),
    ],
)
def test_faults_are_found_at_their_line_in_any_piece(changes, name, line, small, tmp_path):
    """A fault in a later piece, or where two pieces meet, is found at its own line as in the whole
    log.
    """
    planted(tmp_path, changes)
    for report in both(tmp_path):
        named = [finding for finding in report.findings if finding.name == name]
        assert named, (report.findings, name)
        assert line is None or line in [finding.line for finding in named]


def test_a_gap_between_two_pieces_is_seen(small, tmp_path):
    """Rows lost where two pieces meet are a gap of that length."""
    planted(tmp_path, [])
    lines = (tmp_path / FILE).read_text(encoding="utf-8").splitlines()
    (tmp_path / FILE).write_text("\n".join([*lines[:1001], *lines[1102:]]) + "\n", encoding="utf-8")
    for report in both(tmp_path):
        gap = next(finding for finding in report.findings if finding.name == "gap")
        assert gap.refused
        assert gap.figure == pytest.approx(102.0)
        assert gap.line == 1002


def test_what_needs_the_rows_before_is_read_whole(small, tmp_path):
    """Accumulated counts and other formats are never cut into pieces."""
    planted(tmp_path, [])
    wrapped = ("columns.gyro_dph={from='gyro_dph', wraps_at=65536.0}",)
    _, pieced = both(tmp_path, wrapped)
    assert not any("in pieces" in note for note in pieced.notes)
