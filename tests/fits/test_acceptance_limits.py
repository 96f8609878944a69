"""Acceptance limits of every instrument: the figure that is compared, the recipe's limit as it is
stated, and the side on which the limit lies.
"""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from calibkit import instruments, recipe
from calibkit.instruments.accelerometer import corrections as triad_errors, forms
from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.recipe import _AccelAcceptance
from calibkit.instruments.bias import fog_thermal as fog
from calibkit.instruments.bias.compensate import LogFigures
from calibkit.instruments.bias.recipe import _FogAcceptance
from calibkit.instruments.gyro_noise import figures as noise_figures
from calibkit.instruments.gyro_noise.recipe import ACCELEROMETER, GYRO, NoiseAcceptance
from calibkit.instruments.gyro_scale import flags
from calibkit.instruments.gyro_scale.recipe import (
    PairAcceptance,
    RateTableAcceptance,
    TriadAcceptance,
)
from calibkit.instruments.inclinometer import solve as angle_limits
from calibkit.instruments.inclinometer.recipe import _InclinometerAcceptance
from calibkit.numeric.thermal.left_out import NoiseSplit
from calibkit.recipe.type_b import TypeB
from calibkit.records.coefficients import Figure

RECIPES = Path(__file__).parents[2] / "recipes"
LIMIT = 0.5
NEAR = 0.4999
"""Just within a limit of 0.5; the same distance beyond it is 0.5001."""

UNTURNED = {
    "standard_uncertainty": np.full(3, 0.1),
    "noise": np.full(3, 0.1),
    "stated": np.zeros(3),
    "by_turn": np.ones(3),
}
"""Uncertainties of three stations of gyros that are not turned."""


def fog_log(*, before=4.0, after=0.25, gain=1.0):
    """Figures of one compensated log."""
    split, output = NoiseSplit(after, 0.0, 0.0), np.zeros(0)
    return LogFigures("ramp.csv", before, after, split, gain, 0.0, after, (), output)


def fog_drift(value, **limits):
    """Fit of two logs, the worse with this drift rms."""
    figures = [fog_log(after=0.1), fog_log(after=value)]
    return fog_fit(figures, **limits)


def fog_gain(value, **limits):
    """Fit of two logs, the worse with a rate gain below 1 by this much."""
    return fog_fit([fog_log(), fog_log(gain=1.0 - value)], **limits)


def fog_fit(figures, share=0.25, **limits):
    """Criteria of a fit in recursive mode."""
    model = SimpleNamespace(mode="recursive", exported=True)
    reduction = "drift reduction on withheld ramps", 1.0 / share
    return fog_judged(figures, limits, model=model, reduction=reduction)


def fog_judged(figures, limits, *, model=None, reduction=None, **logs):
    """Criteria within limits; without a model no gain is judged."""
    spec = SimpleNamespace(acceptance=_FogAcceptance(**limits))
    model = model or SimpleNamespace(mode="recursive", exported=False)
    return fog.judge(spec, model, figures, reduction, **logs)


def fog_over_noise(value, **limits):
    """Criteria of two logs whose drift rms is this many times the noise in both together."""
    return fog_judged([fog_log()], limits, over_noise=[(5.0 * value, 3.0), (0.0, 4.0)])


def fog_withheld(value, **limits):
    """Fit that left this share of the raw drift on withheld ramps."""
    return fog_fit([fog_log()], share=value, **limits)


def fog_unseen(value, **limits):
    """Validation of two logs with a drift rms of 1 before and this after."""
    return fog_judged([fog_log()], limits, reduction=("drift reduction", 1.0 / value))


def fog_covered(value, **limits):
    """Validation of two logs, of whose 300 and 100 means this share lies within the uncertainty."""
    shares = ((300, value + 0.1), (100, value - 0.3))
    covered = {
        f"{count}.csv": {
            "means_of_100_s": count,
            "share_within_expanded_uncertainty": share,
            "rms_error_over_uncertainty": 1.0,
            "largest_rms_error_over_uncertainty": 1.25,
        }
        for count, share in shares
    }
    criteria = fog_judged([fog_log()], limits, covered=covered)
    return [one for one in criteria if one.set_by == "recipe"]


def triad_stand(**limits):
    """Criteria of corrected dwells; the keyword `figures` changes what was found."""
    figures = {"inclination": 0.1, "toolface": 0.1, "residual": 0.1} | limits.pop("figures")
    sizes = {
        "inclination_max_deg": figures["inclination"],
        "toolface_max_deg": 9.0,
        "toolface_sin_max_deg": figures["toolface"],
    }
    found = triad_errors.DwellErrors(np.full((1, 3), figures["residual"]), sizes)
    return found.judge_errors(SimpleNamespace(acceptance=_AccelAcceptance(**limits)))


def triad_unseen(value, temperature=25.0, terms=()):
    """Criterion of four unseen dwells that err by this along x, where u is 5 µg: 3 of the residual
    and 4 of the zero of x, which they share.
    """
    names = [f"m_{i}{j}0" for i in "xyz" for j in "xyz"] + [f"b_{i}0" for i in "xyz"]
    values = [*np.eye(3).ravel(), 0.0, 0.0, 0.0]
    covariance = np.zeros((12, 12))
    covariance[9, 9] = 16e-12
    model = forms.AFFINE.write(
        "triad",
        [
            (name, number, "g" if name[0] == "b" else "1")
            for name, number in zip(names, values, strict=True)
        ],
        covariance,
        dof=10**9,
        residual_rms=3e-6,
        residual_unit="g",
        valid={"temp_case_degc": (20.0, 30.0)},
    )
    correction = triad_errors.Correction((model,))
    vectors = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0]])
    unknown, of_log = np.full(4, np.nan), np.zeros(4, dtype=np.int64)
    dwells = DwellSet(
        *(vectors, np.full(4, temperature), unknown, unknown, np.zeros((4, 3))),
        *(unknown, of_log, (), ()),
    )
    residual = np.column_stack([np.full(4, value), np.zeros((4, 2))])
    found = triad_errors.DwellErrors(residual)
    return [found.judge_uncertainty("x", dwells, correction, terms)]


def triad_noise(value, **limits):
    """Criteria of unseen dwells whose residual is this many times the fit's of 0.1 g."""
    found = triad_errors.DwellErrors(np.full((2, 1), 0.1 * value))
    fitted = SimpleNamespace(models=[SimpleNamespace(residual_rms=0.1)])
    return found.judge_errors(SimpleNamespace(acceptance=_AccelAcceptance(**limits)), fitted)


def lines(value, **limits):
    """Criteria of two runs of a rate table, one of unknown noise, the other with this ratio."""
    lines = [SimpleNamespace(residual_over_noise=ratio) for ratio in (np.nan, value)]
    return flags.judge_noise(lines, RateTableAcceptance(**limits))


def station(*, angle="after", value=0.1, **limits):
    """Criteria of three stations: a good one, one with this error and one without a result."""
    columns = {name: np.array([0.1, 0.1, np.nan]) for name in ("inclination", "toolface", "before")}
    columns |= {"after": np.array([0.1, 0.1, np.nan]), **UNTURNED}
    columns[angle] = np.array([columns[angle][0], -value, np.nan])
    return angle_limits.AngleErrors(**columns).criteria(
        SimpleNamespace(acceptance=_InclinometerAcceptance(**limits))
    )


def azimuth_rms(value, **limits):
    """Criteria of three stations whose azimuths are off by 0.7 and 0.1 times the rms."""
    found = np.array([1.4 * value, 0.2 * value, np.nan])
    same = np.array([0.0, 0.0, np.nan])
    return angle_limits.AngleErrors(same, same, same, found, **UNTURNED).criteria(
        SimpleNamespace(acceptance=_InclinometerAcceptance(**limits))
    )


def noise(value, *, observed=True, sensor=GYRO, **limits):
    """Criteria of a record with one noise term, or whose deviation is 60 times this at 1 s."""
    term = SimpleNamespace(name=sensor.laws[1].name, value=value)
    curve = SimpleNamespace(
        upper=np.array([120.0, 60.0 * value, 120.0]), tau_s=np.array([0.5, 1.0, 2.0])
    )
    one = SimpleNamespace(
        name="gyro_x of still.csv",
        sensor=sensor,
        terms=SimpleNamespace(terms=(term,) if observed else ()),
        curve=curve,
        over_noise=1.0,
        stability=(SimpleNamespace(block_s=10.0, value=value),),
    )
    return noise_figures.criteria([one], NoiseAcceptance(**limits))


def runs(name):
    """Criteria of rate-table runs, of which the worse of two shows this figure."""

    def made(value, **limits):
        figures = [
            Figure(f"{name}.GJB 2426A.{gyro}", v, "", 0.0) for gyro, v in (("x", 0.1), ("y", value))
        ]
        return flags.judge_figures(figures, RateTableAcceptance(**limits))

    return made


def pair(value, **limits):
    """Criteria of a pair with this standard uncertainty of gamma and orthogonality error."""
    figures = [
        Figure("gamma", 0.0, "1", value),
        Figure("orthogonality_error_deg", -value, "deg", 9.0),
    ]
    return flags.judge_figures(figures, PairAcceptance(**limits))


def runs_unseen(value, **limits):
    """Criteria of unseen runs, of which the worse has this scale-factor error and nonlinearity."""
    stands = [
        {"scale_factor_error_ppm": -v, "nonlinearity_full_scale_ppm": v} for v in (0.1, value)
    ]
    return flags.judge_unseen(stands, RateTableAcceptance(**limits))


def axes(value, **limits):
    """Criteria of two gyros whose axes are 90° less this apart, known to this."""
    figures = [
        Figure("angle_deg.x_y", 90.0 - value, "deg", value),
        Figure("orthogonality_error_deg.x_y", value, "deg", value),
        Figure("angle_deg.x_y.at_60", 90.0, "deg", 0.1),
        Figure("orthogonality_error_deg.x_y.at_60", 0.0, "deg", 0.1),
    ]
    return flags.judge_figures(figures, TriadAcceptance(**limits))


def axes_unseen(value, **limits):
    """Criteria of an unseen run about one axis with these errors after compensation."""
    after = {
        "rate_error_max_ppm_of_full_scale": value,
        "cross_axis_max_ppm_of_full_scale": value,
    }
    return flags.judge_unseen([after], TriadAcceptance(**limits))


def limited(key, make):
    """Criteria for a value with the limit 0.5 on a key of the recipe."""
    return lambda value: make(value, **{key: LIMIT})


SHAPE, SENSITIVITY = "nonlinearity_full_scale", "temperature_sensitivity"
AT_MOST = {
    "largest drift rms after": ("deg/h", limited("max_drift_rms_dph", fog_drift)),
    "rate gain off 1 by": ("1", limited("rate_gain_tolerance", fog_gain)),
    "residual over noise": ("1", limited("max_residual_over_noise", fog_over_noise)),
    "largest inclination error": (
        "deg",
        lambda v: triad_stand(figures={"inclination": v}, max_inclination_error_deg=LIMIT),
    ),
    "largest toolface error times sin(inclination)": (
        "deg",
        lambda v: triad_stand(figures={"toolface": v}, max_toolface_error_sin_deg=LIMIT),
    ),
    "residual rms": (
        "g",
        lambda v: triad_stand(figures={"residual": v}, max_residual_rms_g=LIMIT),
    ),
    "triad: residual over that of the fit": ("1", limited("max_residual_over_noise", triad_noise)),
    "runs: residual over noise": ("1", limited("max_residual_over_noise", lines)),
    "azimuth rms": ("deg", limited("max_azimuth_rms_deg", azimuth_rms)),
    "largest azimuth error": (
        "deg",
        lambda v: station(angle="after", value=v, max_azimuth_error_deg=LIMIT),
    ),
    "inclinometer: largest inclination error": (
        "deg",
        lambda v: station(angle="inclination", value=v, max_inclination_error_deg=LIMIT),
    ),
    "largest toolface error": (
        "deg",
        lambda v: station(angle="toolface", value=v, max_toolface_error_deg=LIMIT),
    ),
    "angle_random_walk of gyro_x of still.csv": (
        "deg/sqrt(h)",
        limited("max_angle_random_walk", noise),
    ),
    "angle_random_walk of gyro_x of still.csv (not observable: at most)": (
        "deg/sqrt(h)",
        lambda v: noise(v, observed=False, max_angle_random_walk=LIMIT),
    ),
    "velocity_random_walk of gyro_x of still.csv": (
        "ug/sqrt(Hz)",
        lambda v: noise(v, sensor=ACCELEROMETER, max_velocity_random_walk=LIMIT),
    ),
    "bias stability over 10 s of gyro_x of still.csv": (
        "deg/h",
        limited("max_bias_stability_dph", noise),
    ),
    "nonlinearity over full scale": ("ppm", limited("max_nonlinearity_ppm", runs(SHAPE))),
    "asymmetry": ("ppm", limited("max_asymmetry_ppm", runs("asymmetry"))),
    "repeatability": ("ppm", limited("max_repeatability_ppm", runs("repeatability"))),
    "temperature sensitivity": (
        "ppm/degC",
        limited("max_temperature_sensitivity_ppm_degc", runs(SENSITIVITY)),
    ),
    "standard uncertainty of gamma": ("1", limited("max_gamma_uncertainty", pair)),
    "pair: orthogonality error": ("deg", limited("max_orthogonality_error_deg", pair)),
    "scale-factor error": ("ppm", limited("max_scale_factor_error_ppm", runs_unseen)),
    "unseen: nonlinearity over full scale": (
        "ppm",
        limited("max_nonlinearity_ppm", runs_unseen),
    ),
    "orthogonality error": ("deg", limited("max_orthogonality_error_deg", axes)),
    "standard uncertainty of an angle": ("deg", limited("max_angle_uncertainty_deg", axes)),
    "rate error": ("ppm", limited("max_rate_error_ppm", axes_unseen)),
    "rate across the turned axis": ("ppm", limited("max_cross_axis_ppm", axes_unseen)),
}
"""Name of a criterion (where two instruments share it, with the instrument before it) → its unit,
and how it is made for a value that may be at most 0.5.
"""


@pytest.mark.parametrize("name", AT_MOST)
@pytest.mark.parametrize(
    ("value", "passed"), [(NEAR, True), (LIMIT, True), (2.0 * LIMIT - NEAR, False)]
)
def test_a_limit_is_met_up_to_the_value_that_the_recipe_states(name, value, passed):
    """Of every instrument: just below, at, and just beyond the limit."""
    unit, make = AT_MOST[name]
    (made,) = (
        one for one in make(value) if one.name == name.rpartition(": ")[2] or one.name == name
    )
    assert made.value == pytest.approx(value, rel=1e-12)
    assert (made.limit, made.unit, made.passed) == (LIMIT, unit, passed)


@pytest.mark.parametrize("quantity", ["accel_x_g", "b_x0", "triad.b_x0"])
def test_what_is_known_of_a_triad_is_in_the_uncertainty_of_unseen_dwells(quantity):
    """12 µg of type B beside the 5 µg that the coefficients and the residual give."""
    term = TypeB(name="known", quantity=quantity, unit="g", standard_uncertainty=12e-6)
    (alone,), (both,) = triad_unseen(26e-6), triad_unseen(26e-6, terms=(term,))
    assert both.value == pytest.approx(alone.value * 5.0 / 13.0, rel=1e-3)
    assert (alone.passed, both.passed) == (False, True)


@pytest.mark.parametrize("name", sorted(path.stem for path in RECIPES.glob("*.toml")))
def test_every_shipped_recipe_limits_residuals_by_the_noise(name):
    """Of what the fit itself measures, so that the limit suits a coarse sensor and a fine one."""
    limits = instruments.parse_recipe(recipe.find(name)).acceptance
    assert limits.max_residual_over_noise


@pytest.mark.parametrize(
    ("name", "make", "least", "good", "equal", "bad"),
    [
        (
            "drift reduction on withheld ramps",
            lambda v: fog_withheld(v, min_reduction=4.0),
            4.0,
            0.2499,
            0.25,
            0.2501,
        ),
        (
            "drift reduction",
            lambda v: fog_unseen(v, min_reduction=4.0),
            4.0,
            0.2499,
            0.25,
            0.2501,
        ),
        (
            "share of 100 s means within their uncertainty",
            lambda v: fog_covered(v, min_share_within_uncertainty=0.5),
            0.5,
            0.5001,
            0.5,
            0.4999,
        ),
    ],
)
def test_a_least_value_is_met_from_the_value_that_the_recipe_states(
    name, make, least, good, equal, bad
):
    """Reductions and covered shares of the thermal drift: just above, at, and just short of the
    least value.
    """
    for value, passed in ((good, True), (equal, True), (bad, False)):
        (made,) = (one for one in make(value) if one.name == name)
        assert (made.limit, made.unit, made.passed) == (least, "1", passed)
        assert (made.value >= least) is passed


def test_errors_of_unseen_dwells_are_judged_by_their_uncertainty():
    """Twice u along one axis passes, a hundred times u is rejected, however small it is beside the
    raw indication, by a limit of calibkit's own.
    """
    for errors, passed in ((10e-6, True), (500e-6, False)):
        (made,) = triad_unseen(errors)
        assert made.value == pytest.approx(errors / 5e-6 / np.sqrt(3.0), rel=1e-9)
        assert (made.passed, made.set_by) == (passed, "calibkit")


def test_azimuth_errors_of_unseen_stations_are_judged_by_their_uncertainty():
    """Stations may err alike: up to 3.29 u all together, the normal quantile of 1 in 2000."""
    for error, passed in ((3.29, True), (3.30, False)):
        columns = {name: np.full(4, 0.1) for name in ("inclination", "toolface", "before")}
        columns |= {name: np.full(4, values[0]) for name, values in UNTURNED.items()}
        found = angle_limits.AngleErrors(**columns, after=np.full(4, 0.1 * error))
        found = found.judge_uncertainty("x")
        assert found.value == pytest.approx(error)
        assert found.passed is passed
