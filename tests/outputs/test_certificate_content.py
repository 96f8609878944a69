"""What a certificate states: rounding, type A and B, decision rules, values from the covariance,
the strict profile.
"""

import datetime as dt
import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy import stats

import kept
from calibkit.certificate import (
    checklist,
    conformity,
    profile,
    quantities,
    stated,
    tables,
    uncertainty,
)
from calibkit.certificate.results import Result, Uncertainty, round_result
from calibkit.certificate.words import Words
from calibkit.errors import RecipeError
from calibkit.recipe import TypeB
from calibkit.records.coefficients import Coefficient, Model, Record
from calibkit.records.sensitivities import Sensitivity


def of_type(uncertainty, kind):
    """Standard uncertainty of type A or B alone."""
    return math.hypot(*(c.contribution for c in uncertainty.contributions if c.kind == kind))


def result(value, expanded=None, *, unit="ppm", interval=None):
    """A result with an expanded uncertainty of k = 2."""
    u = (
        None
        if expanded is None
        else Uncertainty((), expanded / 2.0, math.inf, 2.0, expanded, 0.9545)
    )
    return Result("stage.model.name", "x", Words("x"), value, unit, u, interval)


@pytest.mark.parametrize(
    ("value", "u", "shown"),
    [
        (12.3456, 0.0996, ("12.35", "0.10", 0)),
        (9958.6476, 0.0357, ("9958.648", "0.036", 0)),
        (-9.1456e-11, 3.307e-10, ("-0.9", "3.3", -10)),
        (1.23456789e8, 4.4e3, ("1.234568", "0.000044", 8)),
        (-0.0004, 0.12, ("0.00", "0.12", 0)),
        (0.0, 0.5, ("0.00", "0.50", 0)),
    ],
)
def test_value_and_uncertainty_are_printed_to_the_same_place(value, u, shown):
    """Two significant digits of U, the value to its place; one power of ten for both where they are
    far from 1.
    """
    found = round_result(value, u)
    assert (found.value, found.uncertainty, found.exponent) == shown


@given(st.floats(-1e12, 1e12), st.floats(1e-15, 1e9))
def test_printed_numbers_read_back_within_half_of_their_last_digit(value, u):
    """What stands on paper is the value to half a unit of the last place, which is at most a
    twentieth of U.
    """
    found = round_result(value, u)
    back = float(found.value) * 10.0**found.exponent
    assert abs(back - value) <= 0.0501 * u + 1e-12 * abs(value)


def limits(lower, upper, rule="guarded", unit="ppm"):
    """A specification of the result."""
    return profile.Specification(result="stage.*", unit=unit, lower=lower, upper=upper, rule=rule)


@pytest.mark.parametrize(
    ("value", "guarded", "simple", "four_way"),
    [
        (7.0, "pass", "pass", "pass"),
        (8.0, "pass", "pass", "pass"),
        (8.0001, "fail", "pass", "conditional pass"),
        (10.0, "fail", "pass", "conditional pass"),
        (10.0001, "fail", "fail", "conditional fail"),
        (12.0, "fail", "fail", "conditional fail"),
        (12.0001, "fail", "fail", "fail"),
        (-8.0, "pass", "pass", "pass"),
        (-12.5, "fail", "fail", "fail"),
    ],
)
def test_decision_rules_split_a_tolerance_of_ten_with_an_uncertainty_of_two(
    value, guarded, simple, four_way
):
    """Acceptance limit 8, tolerance limit 10, rejection limit 12; compared unrounded."""
    for rule, verdict in (("guarded", guarded), ("simple", simple), ("four_way", four_way)):
        assert conformity._judge(result(value, 2.0), -10.0, 10.0, rule)[0] == verdict, rule


def test_no_statement_is_possible_where_the_uncertainty_exceeds_the_tolerance_or_is_unknown():
    """U = 11 on ± 10, and a descriptor: whatever the value and the rule."""
    for rule in ("guarded", "simple", "four_way"):
        assert conformity._judge(result(0.0, 11.0), -10.0, 10.0, rule)[0] == "no statement possible"
        assert conformity._judge(result(0.0), -10.0, 10.0, rule)[0] == "no statement possible"


def test_a_magnitude_is_judged_by_the_upper_end_of_its_interval():
    """[0, 3.1] against at most 3 is no guarded pass, against at most 3.2 it is; U above the limit:
    no statement.
    """
    magnitude = result(1.5, 2.0, interval=(0.0, 3.1))
    assert conformity._judge(magnitude, None, 3.0, "guarded")[0] == "fail"
    assert conformity._judge(magnitude, None, 3.2, "guarded")[0] == "pass"
    assert conformity._judge(magnitude, None, 1.4, "guarded")[0] == "no statement possible"


def test_a_specification_of_no_result_or_in_another_unit_is_refused():
    """With the closest key, and with both units."""
    with pytest.raises(RecipeError, match=r"did you mean 'stage\.model\.name'"):
        conformity.judge_results(
            [profile.Specification(result="stage.model.nam", unit="ppm", upper=1.0)],
            [result(1.0)],
            "simple",
        )
    with pytest.raises(RecipeError, match=r"in 'deg', stage\.model\.name in 'ppm'"):
        conformity.judge_results([limits(None, 1.0, unit="deg")], [result(1.0)], "simple")


MODEL = Model(
    "curve",
    "polynomial/1",
    (
        Coefficient("p0", 100.0, "g", 0.5),
        Coefficient("p1", -2.0, "g/degC", 0.03),
        Coefficient("p2", 0.01, "g/degC^2", 0.001),
    ),
    ((0.25, -0.01, 0.0001), (-0.01, 0.0009, -0.00002), (0.0001, -0.00002, 0.000001)),
    12,
    0.1,
    "g",
    {"temp_case_degc": (-20.0, 60.0)},
)
RECORD = Record("bias", "S", 1, "", "2026-11-21", "calibkit", "0", (), (), (MODEL,))


# p(T − δ): what the fit gives where every temperature reads δ too high
SHIFTED = (
    Sensitivity(
        "temp_case_degc",
        "offset",
        {f"bias.{MODEL.name}.p0": 2.0, f"bias.{MODEL.name}.p1": -0.02},
    ),
)


def at(temperature, *terms):
    """Value of the curve at a temperature, as it is stated."""
    context = stated.Stated({"bias.json": RECORD}, uncertainty.TypeBTerms(terms), (), 25.0, SHIFTED)
    column = stated.TEMPERATURE
    curve = quantities.Quantity(
        *("value", RECORD.stage, MODEL.name, Words("value"), "g"),
        (quantities.ranged(MODEL, column),),
        quantities.polynomial(MODEL, quantities.numbered("p", MODEL), column),
    )
    return quantities.state(context, curve, {column: temperature})


@pytest.mark.parametrize("temperature", [-20.0, 0.0, 25.0, 60.0])
def test_a_value_at_a_temperature_has_the_uncertainty_that_the_covariance_gives(temperature):
    """Loop-only twin of u² = Σ_ij T^i T^j C_ij, expanded with Student's factor for 12 degrees of
    freedom.
    """
    value = sum(c.value * temperature**k for k, c in enumerate(MODEL.coefficients))
    variance = sum(
        temperature ** (i + j) * MODEL.covariance[i][j] for i in range(3) for j in range(3)
    )
    found = at(temperature)
    assert found.value == pytest.approx(value, rel=1e-14)
    assert found.uncertainty.standard_uncertainty == pytest.approx(math.sqrt(variance), rel=1e-12)
    assert found.uncertainty.coverage_factor == pytest.approx(stats.t.ppf(0.97725, 12), rel=1e-12)


def test_a_thermometer_enters_with_the_slope_of_the_curve_at_each_temperature():
    """u_B = |dp/dT|·u(T), by a central difference of the curve; the type A part stays what it
    was.
    """
    term = TypeB(
        name="thermometer", quantity="temp_case_degc", unit="degC", standard_uncertainty=0.3
    )
    for temperature in (-20.0, 10.0, 60.0):
        slope = (at(temperature + 0.5).value - at(temperature - 0.5).value) / 1.0
        found = at(temperature, term).uncertainty
        assert of_type(found, "B") == pytest.approx(abs(slope) * 0.3, rel=1e-9)
        assert of_type(found, "A") == pytest.approx(
            at(temperature).uncertainty.standard_uncertainty, rel=1e-12
        )
        assert found.standard_uncertainty == pytest.approx(
            math.hypot(of_type(found, "A"), of_type(found, "B")), rel=1e-12
        )


def test_a_term_on_a_result_is_converted_to_its_unit_and_another_dimension_is_refused():
    """3″ half width on an angle in degrees is 3/3600/√3 degrees; kelvins on it are an error."""
    term = TypeB(name="axes", quantity="alpha_deg", unit="arcsec", half_width=3.0)
    found = uncertainty.TypeBTerms((term,)).uncertainty(
        ("x.alpha_deg", "alpha_deg"), 90.0, "deg", ((Words("fit"), 1e-9, 20.0),), {}
    )
    assert of_type(found, "B") == pytest.approx(3.0 / 3600.0 / math.sqrt(3.0), rel=1e-12)
    wrong = TypeB(name="axes", quantity="alpha_deg", unit="K", half_width=3.0)
    with pytest.raises(RecipeError):
        uncertainty.TypeBTerms((wrong,)).uncertainty(
            ("alpha_deg",), 90.0, "deg", ((Words("fit"), 1e-9, 20.0),), {}
        )


@pytest.mark.parametrize(("value", "u"), [(0.3, 0.5), (2.4, 0.44), (0.0, 1.0), (5.0, 0.1)])
def test_interval_of_a_magnitude_covers_what_its_folded_distribution_says(value, u):
    """The Monte Carlo interval holds 95.45 % of |N(value, u)|, by the exact distribution function,
    within 0.02 %.
    """
    low, high = stated.interval_of_magnitude(
        value, Uncertainty((), u, math.inf, 2.0, 2 * u, 0.9545)
    )
    folded = stats.foldnorm(abs(value) / u, scale=u)
    assert low >= 0.0
    assert folded.cdf(high) - folded.cdf(low) == pytest.approx(0.9545, abs=2e-4)


def test_ends_of_an_interval_are_printed_as_its_value_is():
    """The same power of ten and the same place: 1.2e−07 beside 1.234 × 10⁻⁷ was read as another
    number.
    """
    interval = (1.2e-7, 1.302e-7)
    assert tables.format_result(result(1.234e-7, 4e-9, interval=interval)) == (
        "1.234 × 10⁻⁷",
        "[1.200…1.302] × 10⁻⁷",
    )


WHOLE = """
[certificate]
number = "C-1"
[laboratory]
name = "L"
address = "A"
place_of_work = "P"
[customer]
name = "C"
address = "D"
[item]
type = "T"
maker = "M"
model = "O"
condition = "good"
[dates]
performed = 2026-11-12
[method]
name = "N"
revision = "1"
deviations = "none"
external_providers = "none"
[conditions]
chamber = "c"
laboratory_temperature = "t"
local_gravity = "g"
latitude = "l"
earth_rate = "e"
supply = "s"
warm_up = "w"
[[standard]]
name = "S"
certificate = "SC"
date = 2026-01-01
laboratory = "SL"
[authorised_by]
name = "X"
role = "Y"
[adjustment]
statement = "none"
"""


def parsed(text, tmp_path, *overrides):
    """Profile of a text."""
    path = tmp_path / "lab.toml"
    path.write_text(text, encoding="utf-8")
    return profile.load(path, overrides)[0]


def lacks(text, tmp_path, *overrides, issued=dt.date(2026, 11, 21), validated=False):
    """Keys of what a profile lacks."""
    stated_in = parsed(text, tmp_path, *overrides)
    found = checklist.list_missing(stated_in, (), issued, validated=validated)
    return [item.key for item in found]


def test_a_whole_profile_lacks_nothing_and_each_line_left_out_is_missed(tmp_path):
    """Drop any one line of a complete profile and exactly that item is missing."""
    assert lacks(WHOLE, tmp_path) == []
    lines = WHOLE.strip().splitlines()
    for k, line in enumerate(lines):
        if "=" in line and line != 'name = "S"':
            key = line.split(" = ")[0]
            found = lacks("\n".join(lines[:k] + lines[k + 1 :]), tmp_path)
            assert len(found) == 1, line
            assert found[0].endswith(f".{key}"), line


@pytest.mark.parametrize(
    ("override", "key"),
    [
        ("dates.performed=2026-11-22", "dates.performed"),
        (
            'standard=[{name="S", certificate="c", date=2026-11-20, laboratory="l"}]',
            "standard.date",
        ),
        (
            (
                'standard=[{name="S", certificate="c", date=2025-01-01, laboratory="l",'
                " valid_until=2026-01-01}]"
            ),
            "standard.valid_until",
        ),
        ("certificate.amends=C-0", "certificate.changes"),
    ],
)
def test_what_cannot_be_true_makes_a_draft(tmp_path, override, key):
    """Issued before the work, a standard calibrated after it or expired, an amendment of nothing,
    blanks for a name.
    """
    assert lacks(WHOLE, tmp_path, override) == [key]


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("[laboratory]\nnmae = 'x'", "lab.toml:2: unknown key 'laboratory.nmae'"),
        ("[dates]\nperformed = 'soon'", "lab.toml:2: dates.performed: 'soon' is not a date"),
        ("[certificate]\nnumber = 'A'\namends = 'A'", "needs a number of its own"),
        ("[[specification]]\nresult = 'x'\nunit = 'g'", "neither a lower nor an upper limit"),
        (
            "[[specification]]\nresult = 'x'\nunit = 'g'\nupper = 1.0\nrule = 'gaurded'",
            "did you mean 'guarded'",
        ),
        ("[[standard]]\ncertificate = 'x'", "lab.toml:1: standard.0: a standard needs a name"),
        ("[item", "not TOML"),
    ],
)
def test_a_fault_in_a_profile_is_named_with_its_line(tmp_path, line, said):
    """Strict: unknown keys, ill-typed values and impossible combinations are errors, with file and
    line.
    """
    with pytest.raises(RecipeError, match=said.replace("[", r"\[").replace(".", r"\.")):
        parsed(line, tmp_path)


def test_a_validation_of_another_run_is_refused(tmp_path):
    """As-found and as-left results belong to the coefficients of the certificate."""
    from calibkit.certificate import run_files
    from calibkit.errors import CoefficientError
    from calibkit.records import sealed

    document = {
        "format": "calibkit-validation/2",
        "serial": "S",
        "revision": 1,
        "run_sha256": "other",
        "logs": [],
    }
    path = tmp_path / "v.json"
    path.write_text(sealed.seal(document), encoding="utf-8")
    run = SimpleNamespace(document={"sha256": "this"}, name="S@r001")
    with pytest.raises(CoefficientError, match="not of S@r001 as it is here"):
        run_files.AsFoundAsLeft.load(path, run)


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (9958.61, "9958.61"),
        (10.0, "10"),
        (-0.1, "−0.1"),
        (123456.789012, "123456.789012"),
        (1e-5, "1 × 10⁻⁵"),
        (2.5e22, "2.5 × 10²²"),
    ],
)
def test_a_stated_limit_is_printed_with_every_digit_that_was_stated(value, shown):
    """Five digits made 9958.6 of 9958.61: another limit than the one that was judged by."""
    assert tables.format_exact(value) == shown


def test_an_acceptance_limit_is_printed_to_one_place_more_than_u():
    """9958.61 + 0.056 is 9958.666, not 9958.7 beside the value 9958.678 that passes; a simple rule
    prints its limit as it is.
    """
    found = conformity.judge_results(
        [limits(9958.61, 9960.0)], [result(9958.678, 0.0562)], "guarded"
    )[0]
    assert found.verdict == "pass"
    assert [
        tables.format_acceptance(a, b, found.result)
        for a, b in zip(found.acceptance, (9958.61, 9960.0), strict=True)
    ] == [
        "9958.6662",
        "9959.9438",
    ]
    simple = conformity.judge_results(
        [limits(9958.61, None, "simple")], [result(9958.678, 0.0562)], "simple"
    )[0]
    assert (
        tables.format_acceptance(simple.acceptance[0], simple.specification.lower, simple.result)
        == "9958.61"
    )
    assert tables.format_limits("1", None) == "≥ 1"
    assert tables.format_limits(None, "2") == "≤ 2"
    assert tables.format_limits("1", "2") == "1 … 2"


@pytest.mark.parametrize(
    ("value", "limit", "shown"),
    [
        (0.99996, 1.0, "0.99996"),
        (1.00004, 1.0, "1.00004"),
        (0.16092, 1.0, "0.1609"),
        (100.04, 100.25, "100.04"),
        (12345.6789, 12345.7, "12345.68"),
        (9958.6149, 9958.61, "9958.615"),
        (0.1, 0.1, "0.1"),
        (-2e-7, 1e-3, "−2 × 10⁻⁷"),
        (math.inf, 1.0, "∞"),
    ],
)
def test_a_value_beside_its_limit_never_contradicts_the_decision(value, limit, shown):
    """Four digits made 1 of 0.99996 beside the limit 1: printed it lies on the side that it was
    judged to lie on.
    """
    assert tables.format_beside(value, limit, is_stated=True)[0] == shown


def test_a_result_has_the_degrees_of_freedom_of_the_coefficients_that_it_is_made_of():
    """A level whose uncertainty has 3 degrees of freedom has Student's factor, whatever
    the residual's degrees of freedom; a result that it is no part of is not.
    """
    model = kept.model({"K": (1000.0, "1/deg", 0.002), "F0": (0.004, "1/s", 3e-4, 3.0)}, dof=1000)

    def dof(row):
        ((_, _, found),) = quantities.Point(0.0, ((model, np.array(row)),)).type_a()
        return found

    assert dof([2.0, 0.0]) == pytest.approx(1000.0)
    assert dof([0.0, 2.0]) == pytest.approx(3.0)
    assert dof([1e-4, 1.0]) == pytest.approx(3.0, rel=1e-5)
