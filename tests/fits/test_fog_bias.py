"""The mean rate of a gyro told into the earth's part and the bias, turn-on biases, and hysteresis,
in a run of fog_thermal.
"""

import json

import numpy as np
import pytest

from calibkit import instruments, recipe
from calibkit.errors import RecipeError
from calibkit.instruments.bias import certificate
from calibkit.numeric import earth
from calibkit.records import store
from calibkit.results.evaluation import RunResults

PLACE = ("--set", "site.latitude_deg=34.2", "--set", "input_axis.elevation_deg=90.0")
LATITUDE = """
[[type_b]]
name = "map"
quantity = "latitude_deg"
unit = "deg"
standard_uncertainty = 0.5

[[type_b]]
name = "thermometer"
quantity = "temp_case_degc"
unit = "degC"
standard_uncertainty = 0.5
"""


@pytest.fixture(scope="module")
def run(campaign, tmp_path_factory):
    """Return the folder of a run with the site and the axis given, and the latitude uncertain by
    0.5°.
    """
    from calibkit.commands import pipeline
    from calibkit.instruments import silent

    out = tmp_path_factory.mktemp("runs")
    source = recipe.Source(
        "mine.toml", recipe.find("fog_thermal").text + LATITUDE, (PLACE[1], PLACE[3])
    )
    return pipeline.fit(source, campaign, "F", out, "2026-11-21", silent).run.folder


def figures(folder):
    """Figures of drift_rate.json by name, and the file."""
    document = json.loads((folder / "drift_rate.json").read_text(encoding="utf-8"))
    return {figure["name"]: figure for figure in document["figures"]}, document


def truth(campaign):
    """Truth of the campaign."""
    return json.loads((campaign / "truth.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("elevation", "azimuth", "rate"),
    [
        (90.0, 0.0, 15.041067 * np.sin(np.radians(34.0))),
        (-90.0, 77.0, -15.041067 * np.sin(np.radians(34.0))),
        (0.0, 0.0, 15.041067 * np.cos(np.radians(34.0))),
        (0.0, 90.0, 0.0),
        (34.0, 0.0, 15.041067),
    ],
)
def test_an_axis_sees_its_part_of_the_earth(elevation, azimuth, rate):
    """At 34°: up, down, north, east, and along the polar axis, to 1e-12 °/h."""
    assert float(earth.along_axis(34.0, elevation, azimuth)) == pytest.approx(
        rate, abs=1e-9 if rate else 1e-12
    )


@pytest.mark.parametrize(
    ("elevation", "azimuth"), [(90.0, 0.0), (-90.0, 77.0), (0.0, 0.0), (0.0, 90.0), (20.0, 200.0)]
)
@pytest.mark.parametrize("latitude", [-90.0, -33.0, 0.0, 34.2, 89.0])
def test_the_part_of_the_earth_changes_with_latitude_as_differences_say(
    latitude, elevation, azimuth
):
    """Central differences of 0.01° agree with the derivative to 1e-8 °/h/°."""
    ahead, behind = (
        earth.along_axis(latitude + step, elevation, azimuth) for step in (0.005, -0.005)
    )
    found, *_ = earth.along_axis_slopes(latitude, elevation, azimuth)
    assert float(found) == pytest.approx(float(ahead - behind) / 0.01, abs=1e-8)


def test_the_earth_is_told_from_the_bias_where_place_and_axis_are_given(run, campaign):
    """Mean rate less 8.454 °/h is the gyro's own bias within three standard uncertainties; both
    stand as conditions.
    """
    found, document = figures(run)
    gyro = truth(campaign)["gyro"]
    assert found["earth_rate_along_input_axis"]["value"] == pytest.approx(
        gyro["input_rate_dph"], abs=1e-6
    )
    bias = found["bias_at_reference"]
    assert abs(bias["value"] - gyro["bias_dph"]) < 3.0 * bias["standard_uncertainty"] < 0.06
    assert {c["name"]: c["value"] for c in document["conditions"]} == {
        "latitude": 34.2,
        "input_axis_elevation": 90.0,
    }


def test_without_a_model_on_levels_no_rate_at_rest_is_stated(calibkit, campaign, tmp_path):
    """The published scheme: the logs' means hold their drift; neither mean rate nor bias, and the
    run says why.
    """
    outcome = calibkit(
        *("fit", "fog_thermal", "--data", campaign, "--serial", "F", "--out", tmp_path),
        *PLACE,
        *("--set", "drift.order=2", "--set", "acceptance={}"),
    )
    assert outcome.code == 0, outcome.err
    found, document = figures(tmp_path / "F/r001")
    assert not {"mean_rate_at_reference", "bias_at_reference"} & set(found)
    assert any("no rate at rest and no bias are stated" in flag for flag in document["flags"])


def test_an_uncertain_latitude_makes_the_bias_uncertain(run):
    """0.5° at 34.2° are 0.5 π/180 · 15.04 cos 34.2° = 0.109 °/h, combined with type A."""
    document = json.loads((run / "run.json").read_text(encoding="utf-8"))
    (entry,) = [
        e for e in document["uncertainty"] if e["result"] == "drift_rate: bias_at_reference"
    ]
    parts = {part["name"]: part["standard_uncertainty"] for part in entry["components"]}
    assert parts["map"] == pytest.approx(
        0.5 * np.pi / 180.0 * 15.041067 * np.cos(np.radians(34.2)), rel=1e-12
    )
    assert entry["standard_uncertainty"] == pytest.approx(
        np.linalg.norm(list(parts.values())), rel=1e-12
    )
    assert {"coefficients", "model error", "map", "thermometer"} == set(parts)


def test_run_and_certificate_state_one_uncertainty_of_the_bias(run):
    """Type B terms of the latitude and of the thermometer included."""
    found = store.load(run)
    (entry,) = [
        e for e in found.document["uncertainty"] if e["result"] == "drift_rate: bias_at_reference"
    ]
    (printed,) = [
        result
        for block in certificate.blocks(RunResults.read(found).basis)
        for table in block.tables
        for result in getattr(table, "results", ())
        if result.quantity == "drift_rate.bias_at_reference"
    ]
    assert printed.uncertainty.expanded_uncertainty == pytest.approx(
        entry["expanded_uncertainty"], rel=1e-6
    )


def test_an_axis_that_is_not_vertical_needs_its_azimuth():
    """A horizontal axis sees the earth by its azimuth: without it the recipe is refused."""
    with pytest.raises(RecipeError, match="azimuth_deg is needed"):
        instruments.parse_recipe(recipe.find("fog_thermal", ("input_axis.elevation_deg=0.0",)))
