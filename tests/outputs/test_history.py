"""Records over time: what moved and by how much of its uncertainty, which run holds when, whether
the chain is whole.
"""

import math
import shutil

import numpy as np
import pytest

from calibkit import instruments
from calibkit.errors import CoefficientError
from calibkit.history import difference, timeline
from calibkit.numeric import change
from calibkit.records import store
from kept import keep, model

EVERY = {
    name: form
    for one in instruments.REGISTRY
    for name, form in instruments.model_forms(one).items()
}


def FORMS(procedure):  # noqa: N802 (a constant of these runs, which are of no procedure)
    """Forms of every procedure."""
    return EVERY


def runs_of(tmp_path, *units):
    """Load one run a unit of keyword arguments, all of one serial."""
    return [store.load(keep(tmp_path, *unit.pop("models"), **unit)) for unit in units]


def between(tmp_path, old, new, **unit):
    """Difference of two runs of one model each."""
    return difference.compare_runs(
        *runs_of(tmp_path, {"models": [old], **unit}, {"models": [new], **unit}), FORMS
    )


def test_a_difference_is_stated_in_units_and_in_its_standard_uncertainty(tmp_path):
    """10.0 ± 0.3 and 10.9 ± 0.4 differ by 0.9, which is 1.8 u; 1.1 is 2.2 u and has moved."""
    old = model({"K": (10.0, "1/deg", 0.3), "F0": (1.0, "1/s", 0.3)})
    new = model({"K": (10.9, "1/deg", 0.4), "F0": (2.1, "1/s", 0.4)})
    found = between(tmp_path, old, new)
    K, F0 = found.numbers
    assert (K.verdict, F0.verdict) == ("held", "moved")
    assert K.difference == pytest.approx(0.9, abs=1e-12)
    assert K.standard_uncertainty == pytest.approx(0.5, abs=1e-12)
    assert (K.in_u, F0.in_u) == (pytest.approx(1.8, abs=1e-12), pytest.approx(2.2, abs=1e-12))


def test_what_cannot_be_judged_is_not_judged(tmp_path):
    """Without an uncertainty, in another unit, or in one run only, a number gets no 2 u verdict."""
    old = model(
        {"a": (1.0, "1", 0.0), "b": (1.0, "1", 0.1), "c": (1.0, "1", 0.1), "e": (5.0, "1", 0.0)}
    )
    new = model(
        {"a": (2.0, "1", 0.0), "b": (9.0, "ppm", 0.1), "d": (1.0, "1", 0.1), "e": (5.0, "1", 0.0)}
    )
    found = between(tmp_path, old, new)
    verdicts = {entry.name: entry.verdict for entry in found.numbers}
    expected = {
        "a": "no uncertainty",
        "b": "not comparable",
        "c": "gone",
        "e": "equal",
        "d": "appeared",
    }
    assert verdicts == expected
    assert difference.tabulate_changes(found).title == "what changed"


@pytest.mark.parametrize(
    ("old", "new", "note"),
    [
        (
            {"form": "gyro-scale/1"},
            {"form": "polynomial/1"},
            "form gyro-scale/1 became polynomial/1",
        ),
        (
            {"form": "accel-q/1", "parameters": [("temperature", 25.0, "degC")]},
            {"form": "accel-q/1", "parameters": [("temperature", 20.0, "degC")]},
            "temperature 25 became 20",
        ),
        (
            {"form": "fog-drift-rate/1", "parameters": [("interval", 10.0, "s")]},
            {"form": "fog-drift-rate/1"},
            "interval 10 became nan",
        ),
    ],
)
def test_another_equation_or_another_chosen_parameter_is_another_quantity(tmp_path, old, new, note):
    """Coefficients of another form, or per another interval, are listed but not held against each
    other.
    """
    values = {"K": (10.0, "1", 0.1), "L": (10.0, "1", 0.1)}
    found = between(tmp_path, model(values, **old), model(values, **new))
    assert note in found.notes[0].note
    assert found.count("not comparable") == 2


def test_shared_logs_two_instruments_and_a_rejected_run_are_flagged(tmp_path):
    """What keeps a difference from being a change of the instrument stands above the numbers."""
    first = store.load(keep(tmp_path, model({"K": (1.0, "1", 0.1)}), logs=("aa", "bb")))
    second = store.load(
        keep(tmp_path, model({"K": (1.0, "1", 0.1)}), logs=("bb", "cc"), verdict="rejected")
    )
    other = store.load(keep(tmp_path, model({"K": (1.0, "1", 0.1)}), serial="S-2"))
    flags = difference.compare_runs(first, second, FORMS).flags
    assert flags[0].startswith("1 of 3 logs are in both runs")
    assert flags[1] == "S-1@r002 was rejected"
    assert difference.compare_runs(first, other, FORMS).flags == ("two instruments: S-1 and S-2",)


@pytest.fixture
def three_years(tmp_path):
    """Return a folder with three runs of S-1, a year apart, K falling by 0.1 a year."""
    for year, K in ((2022, 10.0), (2023, 9.9), (2024, 9.8)):
        values = {"K": (K, "1/deg", 0.02), "F0": (1.0, "1/s", 0.1)}
        keep(tmp_path, model(values), date=f"{year}-01-01", figures=[("N", 3.0 + K, "1", 0.1)])
    return tmp_path


@pytest.mark.parametrize(
    ("date", "expected"),
    [
        ("2022-01-01", "r001"),
        ("2022-12-31", "r001"),
        ("2023-01-01", "r002"),
        ("2099-01-01", "r003"),
    ],
)
def test_a_serial_at_a_date_is_the_run_in_force_then(three_years, date, expected):
    """The newest effective date that has come decides, on the day itself too."""
    assert store.find(f"S-1@{date}", three_years).name == expected


def test_a_rejected_run_is_never_in_force_and_a_later_one_of_the_same_day_replaces(tmp_path):
    """Of two runs of a day the newer holds; a run without a verdict can, a rejected one never."""
    values = model({"K": (1.0, "1", 0.1)})
    for date, verdict in (
        ("2022-01-01", "accepted"),
        ("2022-01-01", "no verdict"),
        ("2023-01-01", "rejected"),
    ):
        keep(tmp_path, values, date=date, verdict=verdict)
    assert store.find("S-1@2024-01-01", tmp_path).name == "r002"
    found = timeline.Timeline.read("S-1", tmp_path)
    assert [found.in_force[n][0] for n in (1, 2, 3)] == ["", "2022-01-01", ""]
    assert "S-1@r003 was rejected: it is never in force by date" in found.flags


def test_a_run_stays_in_force_beside_one_of_another_procedure(tmp_path):
    """The gyro of a device does not take the place of its accelerometer."""
    values = model({"K": (1.0, "1", 0.1)})
    keep(tmp_path, values, date="2022-01-01", procedure="accelerometer", stage="accel_k")
    keep(tmp_path, values, date="2023-01-01")
    keep(tmp_path, values, date="2024-01-01")
    found = timeline.Timeline.read("S-1", tmp_path)
    assert found.in_force == {
        1: ("2022-01-01", ""),
        2: ("2023-01-01", "2024-01-01"),
        3: ("2024-01-01", ""),
    }
    assert any(flag.startswith("runs of several procedures: ") for flag in found.flags)


def test_a_revision_that_holds_from_before_the_one_it_supersedes_is_flagged(tmp_path):
    """A back-dated revision does not silently take the place of the newer date."""
    values = model({"K": (1.0, "1", 0.1)})
    keep(tmp_path, values, date="2024-01-01")
    keep(tmp_path, values, date="2023-01-01")
    assert store.find("S-1@2024-06-01", tmp_path).name == "r001"
    assert any(
        "S-1@r002 holds from 2023-01-01, before" in flag
        for flag in timeline.Timeline.read("S-1", tmp_path).flags
    )


def test_a_missing_revision_breaks_the_chain(three_years, calibkit):
    """With r002 gone its place is named, what r003 supersedes cannot be checked, and the exit code
    is 4.
    """
    shutil.rmtree(three_years / "S-1" / "r002")
    found = timeline.Timeline.read("S-1", three_years)
    assert not found.sound
    assert found.breaks[0] == "r002 is missing"
    assert found.breaks[1].startswith("r003: what it supersedes cannot be checked")
    outcome = calibkit("history", "S-1", "--runs", three_years)
    assert outcome.code == 4
    assert "chain broken: r002 is missing" in outcome.out


def test_an_exchanged_revision_breaks_the_chain(three_years, tmp_path_factory):
    """r001 replaced by another whole run of the same serial and number no longer is what r002
    supersedes.
    """
    other = keep(
        tmp_path_factory.mktemp("other"), model({"K": (7.0, "1/deg", 0.02)}), date="2022-01-01"
    )
    shutil.rmtree(three_years / "S-1" / "r001")
    shutil.copytree(other, three_years / "S-1" / "r001")
    (fault,) = timeline.Timeline.read("S-1", three_years).breaks
    assert fault.startswith("r002: gyro_scale supersedes")
    assert "of r001" in fault


def test_a_damaged_revision_is_named_and_the_others_are_still_listed(three_years, calibkit):
    """One changed byte in r001: it is refused by name, r002 and r003 are shown, the exit code
    is 4.
    """
    path = three_years / "S-1" / "r001" / "gyro_scale.json"
    path.write_bytes(path.read_bytes().replace(b"10.0", b"10.1"))
    outcome = calibkit("history", "S-1", "--runs", three_years, "--json")
    assert outcome.code == 4
    assert outcome.json["ok"] is False
    assert [entry["revision"] for entry in outcome.json["revisions"]] == [2, 3]
    assert (
        "gyro_scale.json: not the file that run.json lists" in outcome.json["refused"][0]["reason"]
    )


def test_the_run_of_another_unit_under_a_serial_is_refused(three_years, calibkit):
    """A whole run folder of S-2 moved in as S-1's newest revision is not used as S-1's
    coefficients.
    """
    moved = keep(three_years, model({"K": (5.0, "1/deg", 0.02)}), serial="S-2")
    moved.rename(three_years / "S-1" / "r004")
    with pytest.raises(CoefficientError, match="says S-2 r1, expected S-1 r004"):
        store.find("S-1", three_years)
    assert calibkit("show", "S-1", "--runs", three_years).code == 4
    assert not timeline.Timeline.read("S-1", three_years).sound
    with pytest.raises(CoefficientError, match="says S-2"):
        keep(three_years, model({"K": (5.0, "1/deg", 0.02)}))


def test_the_slope_is_that_of_weighted_least_squares():
    """Slope and uncertainty agree with numpy's weighted polynomial fit, the latter widened by
    scatter, never narrowed.
    """
    years = np.array([2020.0, 2021.5, 2022.1, 2024.0])
    u = np.array([0.1, 0.2, 0.1, 0.3])
    values = np.array([1.0, 1.4, 1.3, 2.2])
    for size in (0.01, 10.0):
        found = change.trend(years, size * values, u)
        coefficients, covariance = np.polyfit(
            years - 2022.0, size * values, 1, w=1 / u, cov="unscaled"
        )
        left = (size * values - np.polyval(coefficients, years - 2022.0)) / u
        birge = math.sqrt(float(left @ left) / 2)
        assert found.slope == pytest.approx(coefficients[0], rel=1e-9)
        assert found.birge_ratio == pytest.approx(birge, rel=1e-9)
        expected = math.sqrt(covariance[0, 0]) * max(1.0, birge)
        assert found.standard_uncertainty == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    ("years", "u"), [([1.0, 2.0], [1.0, 1.0]), ([1.0, 1.0, 2.0], [1.0] * 3), ([1, 2, 3], [1, 0, 1])]
)
def test_no_slope_is_stated_from_two_dates_or_without_uncertainty(years, u):
    """Two dates always lie on a line, and a determination without uncertainty has no weight."""
    assert change.trend(np.array(years), np.zeros(len(years)), np.array(u)) is None


def test_runs_that_share_logs_are_one_determination(tmp_path):
    """A refit of the same logs is flagged and enters the slope once, as the newer run."""
    for revision, K in enumerate((10.0, 5.0, 9.8, 9.7), start=1):
        logs = ("same",) if revision in (2, 3) else (f"log{revision}",)
        keep(tmp_path, model({"K": (K, "1/deg", 0.02)}), date=f"202{revision}-01-01", logs=logs)
    found = timeline.Timeline.read("S-1", tmp_path)
    assert found.flags == (
        (
            "S-1@r003 was fitted to logs of S-1@r002 as well: one determination, not two; slopes"
            " take the newer"
        ),
    )
    assert timeline.independent_runs(found.runs) == {1, 3, 4}
