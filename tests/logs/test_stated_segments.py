"""Held conditions that a recipe states replace those found in the log."""

import pytest

from calibkit import instruments, recipe
from calibkit.commands import pipeline

PIN = '\n[[segment]]\nlog = "%s"\nkind = "%s"\nfrom_s = %s\nto_s = %s\n'


def examined(procedure, file, pins, folder):
    """Return what a procedure says of one simulated log with pinned segments."""
    (folder / file).write_bytes(pipeline.simulated(procedure, 3).files()[file])
    text = recipe.find(procedure).text + "".join(PIN % pin for pin in pins)
    spec = instruments.parse_recipe(recipe.Source("r.toml", text))
    module = instruments.find(spec.procedure)
    return module.faults(spec, module.read(spec, folder, file))


def test_a_pinned_ramp_has_the_rate_measured_in_it(tmp_path):
    """A ramp pinned from 700 s to 1700 s is one ramp of 5 °C/min within 1 %, all else is soak, and
    both say pinned.
    """
    found = examined(
        "fog_thermal", "ramp_heating_05.csv", [("ramp_heating_05", "ramp", 700.0, 1700.0)], tmp_path
    )
    assert [(part.kind, part.start, part.stop) for part in found.held] == [
        ("soak", 0, 700), ("ramp", 700, 1701), ("soak", 1701, 5401),
    ]  # fmt: skip
    assert found.held[1].level == pytest.approx(5.0, rel=0.01)
    assert all(part.pinned for part in found.held)


def test_a_segment_of_the_wrong_kind_or_place_is_refused(tmp_path):
    """A dwell in a chamber log, a segment behind the log's end: named with what was expected."""
    found = examined(
        "fog_thermal",
        "ramp_heating_05.csv",
        [("ramp_heating_05", "dwell", 700.0, 1700.0)],
        tmp_path,
    )
    assert any("expected 'soak' or 'ramp'" in str(finding) for finding in found.findings)
    found = examined(
        "fog_thermal",
        "ramp_heating_05.csv",
        [("ramp_heating_05", "ramp", 9000.0, 9100.0)],
        tmp_path,
    )
    assert any("the log goes from 0 s to 5400 s" in str(finding) for finding in found.findings)


def test_overlapping_segments_and_unknown_logs_are_recipe_errors(tmp_path, calibkit):
    """Two segments that overlap, and a segment of a log that is not there: exit 2."""
    (tmp_path / "ramp_heating_05.csv").write_bytes(
        pipeline.simulated("fog_thermal", 3).files()["ramp_heating_05.csv"]
    )
    base = recipe.find("fog_thermal").text
    for pins, words in (
        (
            [("ramp_heating_05", "ramp", 1.0, 9.0), ("ramp_heating_05", "soak", 5.0, 20.0)],
            "overlap",
        ),
        ([("ramp_heating_50", "ramp", 1.0, 9.0)], "no such log"),
    ):
        (tmp_path / "r.toml").write_text(
            base + "".join(PIN % pin for pin in pins), encoding="utf-8"
        )
        outcome = calibkit("check", tmp_path / "r.toml", "--data", tmp_path)
        assert outcome.code == 2
        assert words in outcome.err
