"""Type B terms: what a recipe or a laboratory's profile may state, and what each result has of
it.
"""

import json
import math

import numpy as np
import pytest

from calibkit import instruments, recipe
from calibkit.errors import CoefficientError, RecipeError
from calibkit.numeric import gum
from calibkit.recipe import type_b

GOOD = 'procedure = "fog_thermal"\n[logs]\nfiles = ["*.csv"]\n'
TERM = '[[type_b]]\nname = "thermometer"\nquantity = "temp_case_degc"\nunit = "degC"\n'


def terms(text):
    """Terms of a recipe with these lines behind it."""
    return instruments.parse_recipe(recipe.Source("r.toml", GOOD + text)).type_b


@pytest.mark.parametrize(
    ("lines", "u"),
    [
        ("half_width = 0.3", 0.3 / math.sqrt(3.0)),
        ('half_width = 0.3\ndistribution = "triangular"', 0.3 / math.sqrt(6.0)),
        ('half_width = 0.3\ndistribution = "arcsine"', 0.3 / math.sqrt(2.0)),
        ("standard_uncertainty = 0.3", 0.3),
        ("expanded_uncertainty = 0.3\ncoverage_factor = 2", 0.15),
    ],
)
def test_each_way_to_state_a_term_gives_the_standard_uncertainty_of_the_gum(lines, u):
    """Limits are divided by √3, √6 or √2, an expanded uncertainty by its coverage factor (JCGM 100,
    4.3).
    """
    (term,) = terms(TERM + lines)
    assert term.u == pytest.approx(u, rel=1e-15)


@pytest.mark.parametrize(
    ("lines", "fault"),
    [
        ("", "states none; state one of"),
        (
            "half_width = 0.1\nstandard_uncertainty = 0.1",
            "states standard_uncertainty and half_width",
        ),
        ("expanded_uncertainty = 0.1", "coverage_factor belongs to expanded_uncertainty"),
        ('half_width = 0.1\ndistribution = "normal"', "a normal distribution has no half_width"),
        ("half_width = 0.1\nsensitivity = 2.0", "a sensitivity and the result that it leads to"),
        ("half_widht = 0.1", "did you mean 'half_width'?"),
        ("half_width = 0.1\n" + TERM + "half_width = 0.1", "stands twice"),
    ],
)
def test_a_term_that_says_too_little_or_too_much_is_refused_with_its_line(lines, fault):
    """Nothing is guessed about an uncertainty: two statements, none, or a misspelt one are
    faults.
    """
    with pytest.raises(RecipeError, match=r"r\.toml:\d+: ") as refused:
        terms(TERM + lines)
    assert fault in str(refused.value)


def test_a_unit_of_another_dimension_is_refused():
    """A case temperature is not uncertain by volts or degrees an hour."""
    for unit in ("V", "deg/h"):
        with pytest.raises(RecipeError, match=unit):
            terms(
                TERM.replace("degC", unit, 1).replace(f"temp_case_{unit}", "temp_case_degc")
                + "half_width = 0.1"
            )


def test_an_error_of_the_time_base_is_a_share_of_the_time():
    """One in seconds was taken as a share of one: 1 ms as 1,000 ppm of every rate."""
    line = TERM.replace("temp_case_degc", "time_s").replace("degC", "s") + "half_width = 0.001"
    with pytest.raises(RecipeError, match=r"'thermometer' is in 's'.*state it in ppm or %"):
        terms(line)
    assert terms(line.replace('"s"', '"ppm"'))[0].u == pytest.approx(0.001 / math.sqrt(3.0))


def test_units_of_a_term_are_converted_as_differences():
    """1 K is 1 °C and not −272.15; 1 °F is 5/9 °C; 1 ppm of a rate of 200 °/s is 0.0002 °/s; 10 mg
    of 1 g is 0.01 g.
    """
    wanted = {"K": 1.0, "degF": 5.0 / 9.0}
    for unit, u in wanted.items():
        (term,) = terms(TERM.replace('"degC"', f'"{unit}"') + "standard_uncertainty = 1.0")
        assert term.u_of(25.0) == pytest.approx(u, rel=1e-12)
    rate = type_b.TypeB(name="r", quantity="table_rate_dps", unit="ppm", standard_uncertainty=1.0)
    assert rate.u_of(-200.0) == pytest.approx(2e-4, rel=1e-12)
    tilt = type_b.TypeB(name="a", quantity="accel_x_g", unit="mg", standard_uncertainty=10.0)
    assert tilt.u_of(1.0) == pytest.approx(0.01, rel=1e-12)


def test_terms_reach_a_result_by_their_quantity_by_the_procedure_or_by_their_own_sensitivity():
    """What reaches no result is named, and the combination is the root of the squared
    contributions.
    """
    stated = [
        type_b.TypeB(name="of itself", quantity="K", unit="ppm", standard_uncertainty=3.0),
        type_b.TypeB(
            name="by the procedure",
            quantity="temp_case_degc",
            unit="K",
            standard_uncertainty=0.1,
            dof=5.0,
        ),
        type_b.TypeB(
            name="stated",
            quantity="table_rate_dps",
            unit="ppm",
            standard_uncertainty=2.0,
            sensitivity=-1e-6,
            result="K",
        ),
        type_b.TypeB(
            name="elsewhere", quantity="gravity_mps2", unit="m/s^2", standard_uncertainty=1e-5
        ),
    ]
    applied = type_b.terms_of(stated, "K", 2.0, {"temp_case_degc": (30.0, 4e-6)})
    contributions = [c.sensitivity * c.standard_uncertainty for c in applied]
    assert contributions == pytest.approx([6e-6, 4e-7, -2e-6], rel=1e-12)
    combined = gum.combine(applied)
    assert combined.standard_uncertainty == pytest.approx(math.hypot(6e-6, 4e-7, 2e-6), rel=1e-12)
    assert [c.dof for c in applied] == [math.inf, 5.0, math.inf]


def test_terms_along_a_log_enter_by_a_thermometer_by_their_own_sensitivity_or_directly():
    """A drift of 3 °/h/°C moves with the thermometer by that, or by a stated sensitivity; shares of
    readings say nothing of a log.
    """
    stated = {"quantity": "temp_case_degc", "unit": "degC", "standard_uncertainty": 0.1}
    terms = [
        type_b.TypeB(name="thermometer", **stated, dof=9.0),
        type_b.TypeB(name="stated", **stated, sensitivity=5.0, result="gyro_dph"),
        type_b.TypeB(name="of another", **stated, sensitivity=5.0, result="accel_x_g"),
        type_b.TypeB(name="scale", quantity="gyro_dph", unit="ppm", standard_uncertainty=7.0),
        type_b.TypeB(name="gyro", quantity="gyro_dph", unit="deg/h", standard_uncertainty=0.2),
    ]
    case = np.linspace(-20.0, 60.0, 5)
    thermometers = {"temp_case_degc": lambda step: 3.0 * (case + step)}
    effects = type_b.effects_along(terms, "gyro_dph", case.size, thermometers)
    assert [(name, dof) for name, _, dof in effects] == [
        ("thermometer", 9.0),
        ("stated", math.inf),
        ("gyro", math.inf),
    ]
    for (_, effect, _), expected in zip(effects, (0.3, 0.5, 0.2), strict=True):
        assert effect == pytest.approx(np.full(case.size, expected), rel=1e-9)


def test_a_later_term_of_the_same_name_replaces_the_earlier_one():
    """A laboratory's profile may restate what a recipe said of the same equipment: it counts
    once.
    """
    old, new = (
        type_b.TypeB(name="t", quantity="K", unit="1", standard_uncertainty=u) for u in (1.0, 2.0)
    )
    (component,) = type_b.terms_of([old, new], "K", 1.0)
    assert component.standard_uncertainty == 2.0


def test_a_run_carries_its_terms_and_gives_them_back(calibkit, campaign, tmp_path):
    """run.json lists what the recipe stated; a quantity that is neither column nor result is
    refused by name.
    """
    text = recipe.find("fog_thermal").text
    path = tmp_path / "mine.toml"
    path.write_text(text + TERM + "half_width = 0.1\n", encoding="utf-8")
    assert (
        calibkit("fit", path, "--data", campaign, "--serial", "F", "--out", tmp_path / "runs").code
        == 0
    )
    document = json.loads((tmp_path / "runs/F/r001/run.json").read_text(encoding="utf-8"))
    assert type_b.loads(document["type_b"]) == terms(TERM + "half_width = 0.1\n")
    path.write_text(
        text + TERM.replace("temp_case_degc", "b00") + "half_width = 0.1\n", encoding="utf-8"
    )
    outcome = calibkit("fit", path, "--data", campaign, "--serial", "F", "--out", tmp_path / "runs")
    assert (outcome.code, "did you mean 'b0'?" in outcome.err) == (2, True)


def test_a_run_whose_terms_are_damaged_is_refused():
    """What stands in run.json is checked like a recipe."""
    with pytest.raises(CoefficientError, match="not a type B term"):
        type_b.loads([{"name": "x", "quantity": "K", "unit": "1"}])
