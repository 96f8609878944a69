"""What check says of all logs of a campaign together: the same as fit does."""

import shutil

import pytest

from calibkit import recipe
from calibkit.commands import inspection
from conftest import ROOT

DATA = ROOT / "datasets"


@pytest.fixture
def two_ramps(tmp_path):
    """Return a folder with the ramps of ±10 °C/min alone."""
    folder = tmp_path / "logs"
    folder.mkdir()
    for way in ("heating", "cooling"):
        shutil.copy(DATA / "fog_thermal" / f"ramp_{way}_10.csv", folder)
    return folder


def test_check_and_fit_say_the_same_of_two_ramps(two_ramps, tmp_path, calibkit):
    """Ramps of ±10 °C/min are two good logs and determine nothing: exit 3 of both, with what to
    measure.
    """
    found = calibkit("check", "fog_thermal", "--data", two_ramps)
    call = ("fit", "fog_thermal", "--data", two_ramps, "--serial", "S-1")
    fitted = calibkit(*call, "--out", tmp_path / "runs")
    assert found.out.startswith(
        "2 of 2 logs ok\nA fit of these logs would export nothing: exit code 3.\n"
    )
    assert (found.code, fitted.code) == (3, 3)
    assert not (tmp_path / "runs" / "S-1").exists()
    last = found.out.split("This campaign determines: ")[1]
    assert last.startswith("nothing\n")
    for words in (last, fitted.err):
        assert "no family of models can be determined" in words
        assert "measure 3 ramps or more" in words


def test_a_whole_campaign_is_judged_with_its_models(calibkit):
    """Eight ramps: the models that fit would write, and its verdict; also as JSON."""
    found = calibkit("check", "fog_thermal", "--data", DATA / "fog_thermal", "--json")
    assert found.code == 0
    judged = found.json["campaign"]
    assert (judged["exports"], judged["verdict"], judged["exit_code"]) == (True, "accepted", 0)
    assert judged["determines"][-1] == "drift_rate (drift)"


@pytest.mark.parametrize(
    "procedure", ["gyro_pair", "gyro_triad", "rate_table", "gyro_noise", "inclinometer"]
)
def test_every_procedure_is_judged(procedure):
    """The sample logs of each are determined and exported."""
    source = recipe.find(procedure)
    judged = inspection.check(source, DATA / procedure).judgement
    assert judged.exports
    assert judged.determines
    assert judged.outcome == "A fit of these logs would be accepted."
