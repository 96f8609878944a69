"""Case and chamber air in one unit, one way round: told by gain, zero point and lag, or by the
rates that were ordered.
"""

import re

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from calibkit import recipe
from calibkit.check import thermometers
from calibkit.instruments.bias import simulate_fog as simulate
from calibkit.instruments.bias.ramps import COLUMNS
from calibkit.instruments.bias.recipe import FogThermalRecipe
from calibkit.logs import log_files
from conftest import write_log


def lagged(rate, lag, *, seconds=3000, offset=2.0):
    """Air that stays, climbs from −40 °C to 60 °C [°C/min], stays; a case behind it by one
    first-order lag [s]: a loop.
    """
    time = np.arange(0.0, seconds + 6000.0 / rate)
    air = np.clip(-40.0 + rate * (time - 600.0) / 60.0, -40.0, 60.0)
    case, level = np.empty_like(air), air[0]
    for k, warm in enumerate(air):
        level += (warm - level) / lag
        case[k] = level + offset
    return time, case, air


@settings(deadline=None, max_examples=40)
@given(st.sampled_from([1.0, 3.0, 10.0]), st.floats(60.0, 400.0))
def test_a_lag_is_found_and_changes_its_sign_with_the_columns(rate, lag):
    """Within a third of one first-order lag; whatever the unit of time, the sign and the swing stay
    what they are.
    """
    time, case, air = lagged(rate, lag)
    found, exchanged = (
        thermometers._fit_lead(time, case, air),
        thermometers._fit_lead(time, air, case),
    )
    assert found.lag_s == pytest.approx(lag, rel=0.35)
    assert found.correlation > 0.7
    assert exchanged.correlation < -0.7
    in_minutes = thermometers._fit_lead(time / 60.0, case, air)
    assert in_minutes.lag_s == pytest.approx(found.lag_s / 60.0, rel=1e-9)
    assert in_minutes.swing == pytest.approx(found.swing, rel=1e-9)


@pytest.fixture(scope="module")
def ramps():
    """Columns of the ramps of a simulated campaign by file."""
    found = {}
    for name, content in simulate.campaign(3).files().items():
        if name.startswith("ramp_") and name.endswith(".csv"):
            lines = content.decode().splitlines()
            rows = np.array([line.split(",") for line in lines[1:]], dtype=float)
            found[name] = dict(zip(lines[0].split(","), rows.T, strict=True))
    return found


def logs(ramps, folder, change):
    """Write the ramps, changed."""
    for name, columns in ramps.items():
        write_log(folder / name, **change(columns))
    return folder


def fahrenheit(columns):
    """Both temperatures in °F."""
    return columns | {
        name: columns[name] * 1.8 + 32.0 for name in ("temp_case_degc", "temp_env_degc")
    }


def exchanged(columns):
    """Case and air exchanged."""
    return columns | {
        "temp_case_degc": columns["temp_env_degc"],
        "temp_env_degc": columns["temp_case_degc"],
    }


def test_a_campaign_with_exchanged_columns_is_refused_log_by_log(ramps, tmp_path, calibkit):
    """At 1, 5, 8 and 10 °C/min, heating and cooling; the fit is refused with what to do."""
    data = logs(ramps, tmp_path / "logs", exchanged)
    outcome = calibkit("check", "fog_thermal", "--data", data, "--details")
    assert outcome.code == 3
    assert outcome.out.count("are swapped") == len(ramps)
    fitted = calibkit("fit", "fog_thermal", data=data, serial="S", out=tmp_path / "runs")
    assert fitted.code == 3
    assert "temp_case_degc and temp_env_degc are swapped" in fitted.err


@pytest.mark.parametrize("lag", [180.0, 300.0, 480.0])
@pytest.mark.parametrize("rate", [5.0, 8.0, 10.0])
@pytest.mark.parametrize("heating", [True, False])
def test_a_case_that_short_soaks_do_not_settle_is_not_told_as_degf(rate, lag, heating, tmp_path):
    """Soaks of 5 min: the case moves 0.5 to 0.9 as far as the air, as °C beside °F would; a case in
    °F is still found.
    """
    end = 600.0 + 6000.0 / rate
    time, case, air = (column[300 : int(end) + 300] for column in lagged(rate, lag, offset=0.0))
    if not heating:
        case, air = 20.0 - case, 20.0 - air
    spec = recipe.find("fog_thermal").table(FogThermalRecipe)
    for change, expected in ((lambda x: x, []), (lambda x: x * 1.8 + 32.0, ["unit"])):
        write_log(
            tmp_path / "a.csv",
            time_s=time,
            temp_case_degc=change(case),
            temp_env_degc=air,
            gyro_dph=np.zeros_like(time),
        )
        log = log_files.read_log(spec, tmp_path / "a.csv", "a.csv", COLUMNS)
        found = thermometers.check_pair(log, "temp_case_degc", "temp_env_degc")
        assert [finding.name for finding in found] == expected


def test_a_campaign_in_degf_is_told_by_the_rates_in_its_names(ramps, tmp_path, calibkit):
    """ramp_heating_05 at 9 °C/min, and so all: check and fit say °F. Under names without rates
    nothing tells.
    """
    some = {
        name: ramps[name]
        for name in ("ramp_cooling_10.csv", "ramp_heating_08.csv", "ramp_heating_10.csv")
    }
    data = logs(some, tmp_path / "logs", fahrenheit)
    assert (
        "and as much too fast in all 3 logs (9/5)"
        in calibkit("check", "fog_thermal", "--data", data).out
    )
    quick = ("--set", "drift.model=level", "--set", "denoise.enabled=false")
    fitted = calibkit("fit", "fog_thermal", *quick, data=data, serial="S", out=tmp_path / "runs")
    assert "all temperatures look like °F" in " ".join(fitted.out.split())
    unnamed = dict(zip(("a.csv", "b.csv", "c.csv"), some.values(), strict=True))
    data = logs(unnamed, tmp_path / "unnamed", fahrenheit)
    assert "°F" not in calibkit("check", "fog_thermal", "--data", data).out


def test_a_rate_of_the_recipe_that_the_log_does_not_show_is_flagged(ramps, tmp_path, calibkit):
    """10 °C/min in the recipe, 18 in the log: °F; 4 in the recipe, 10 in the log: another rate; 10
    and 10: nothing.
    """
    (name,) = (name for name in ramps if name == "ramp_heating_10.csv")
    for change, said, words in (
        (fahrenheit, 10.0, "the temperatures look like °F (9/5)"),
        (dict, 4.0, "correct the rate in [drift.rates_degc_min]"),
        (dict, 10.0, ""),
    ):
        data = logs({name: ramps[name]}, tmp_path / f"{said}{change.__name__}", change)
        outcome = calibkit(
            "check", "fog_thermal", data=data, set=f"drift.rates_degc_min.ramp_heating_10={said}"
        )
        assert ("the recipe says" in outcome.out) == bool(words)
        assert words in outcome.out


def test_a_name_that_ends_in_another_unit_needs_its_unit_stated(ramps, tmp_path, calibkit):
    """temp_case_degf mapped without a unit was taken in °C: refused with the line to write; with
    the unit it is read.
    """
    name = "ramp_heating_05.csv"
    columns = fahrenheit(ramps[name])
    columns = {
        {"temp_case_degc": "case_degF", "temp_env_degc": "air_fahrenheit"}.get(k, k): v
        for k, v in columns.items()
    }
    write_log(tmp_path / "logs" / name, **columns)
    mapped = (
        '\n[columns.temp_case_degc]\nfrom = "case_degF"\n%s[columns.temp_env_degc]\nfrom ='
        ' "air_fahrenheit"\n%s'
    )
    text = recipe.find("fog_thermal").text
    for unit, refused in (("", True), ('unit = "degF"\n', False)):
        (tmp_path / "r.toml").write_text(text + mapped % (unit, unit), encoding="utf-8")
        outcome = calibkit("check", tmp_path / "r.toml", "--data", tmp_path / "logs")
        assert outcome.out.startswith("1 of 1 log ok") != refused
        assert ("its name says degF, it would be taken in degC" in outcome.out) == refused


def levels(**ends):
    """Log file → reading of its thermometer at these ends [°C]."""
    return {
        f"{name}.csv": [("temp_case_degc", *np.atleast_1d(pair)[[0, -1]])]
        for name, pair in ends.items()
    }


def in_degf(measured, *names):
    """The same, with some logs in °F."""
    return {
        file: [(c, 1.8 * low + 32.0, 1.8 * high + 32.0) for c, low, high in readings]
        if file.removesuffix(".csv") in names
        else readings
        for file, readings in measured.items()
    }


SETS = levels(T_m40=-39.2, T_0=0.7, T_25=26.1, T_60=61.3)
RAMPS = levels(a=(-38.1, 61.8), b=(-40.2, 60.4), c=(-38.4, 62.0), d=(-39.0, 61.0))
DATED = levels(
    d24_T20=20.3, d24_T60=61.0, d25_T20=20.4, d25_T60=60.8, d25_T40=41.0, room_1=25.0, room_33=25.1
)


@pytest.mark.parametrize(
    ("measured", "names"),
    [
        (SETS, ("T_60",)),
        (SETS, ("T_25", "T_60")),
        (SETS, ("T_0", "T_25", "T_60")),
        (DATED, ("d25_T20", "d25_T60", "d25_T40")),
        (RAMPS, ("c",)),
        (RAMPS, ("c", "d")),
    ],
)
def test_logs_in_degf_are_told_by_their_names_or_the_ends_of_others(measured, names):
    """Levels that are 1.8 x + 32 of what the names say, or ends that are those of another log in
    °F: each such log is refused, no other; in °C there is nothing to say.
    """
    assert thermometers.find_other_units(measured) == []
    told = thermometers.find_other_units(in_degf(measured, *names))
    assert {(file.removesuffix(".csv"), found.severity) for file, found in told} == {
        (name, "refuse") for name in names
    }


def test_a_thermometer_late_in_one_ramp_is_told_beside_the_ramp_alike(ramps, tmp_path, calibkit):
    """2.9 °C late at 5 °C/min: check and fit name both ramps and the size; sound ramps have no such
    flag.
    """
    some = {name: ramps[name] for name in ramps if "_05" in name or "_10" in name}
    late = "ramp_cooling_05.csv"
    time = some[late]["time_s"]
    case = np.interp(time - 60.0 * 2.9 / 5.0, time, some[late]["temp_case_degc"])
    quick = ("--set", "drift.model=level", "--set", "denoise.enabled=false", "--details")
    data = logs(some | {late: some[late] | {"temp_case_degc": case}}, tmp_path / "late", dict)
    told = r"ramp_cooling_05.csv: column 'temp_case_degc': it follows the air 2.[5-9] °C later"
    checked = calibkit("check", "fog_thermal", "--data", data, "--details")
    fitted = calibkit("fit", "fog_thermal", *quick, data=data, serial="S", out=tmp_path)
    for outcome in (checked, fitted):
        assert re.search(told.replace(" ", r"\s+"), outcome.out), outcome.out
    sound = calibkit("check", "fog_thermal", "--data", logs(some, tmp_path / "sound", dict))
    assert "later" not in sound.out
