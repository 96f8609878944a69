"""Acceptance limits of every instrument: the figure that is compared, the recipe's limit as it is
stated, and the side on which the limit lies.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from calibkit.coefficients import Figure
from calibkit.instruments.accelerometer import errors as triad_errors
from calibkit.instruments.accelerometer.errors import AttitudeErrors
from calibkit.instruments.accelerometer.recipe import _AccelAcceptance
from calibkit.instruments.fog_thermal import instrument as fog
from calibkit.instruments.fog_thermal.compensate import LogFigures
from calibkit.instruments.fog_thermal.recipe import _Acceptance
from calibkit.instruments.gyro_noise import tables as noise_tables
from calibkit.instruments.gyro_noise.recipe import NoiseAcceptance
from calibkit.instruments.gyro_noise.sensors import ACCELEROMETER, GYRO
from calibkit.instruments.gyro_scale import acceptance
from calibkit.instruments.gyro_scale.recipe import (
    PairAcceptance,
    RateTableAcceptance,
    TriadAcceptance,
)
from calibkit.instruments.inclinometer import errors as angle_limits
from calibkit.instruments.inclinometer.recipe import _InclinometerAcceptance

LIMIT = 0.5
NEAR = 0.4999
"""Just within a limit of 0.5; the same distance beyond it is 0.5001."""


def fog_log(*, before=4.0, after=0.25, gain=1.0):
    """Figures of one compensated log."""
    return LogFigures("ramp.csv", before, after, gain, 0.0, after, ())


def fog_drift(value, **limits):
    """Fit of two logs, the worse with this drift rms."""
    figures = [fog_log(after=0.1), fog_log(after=value)]
    return fog_fit(figures, **limits)


def fog_gain(value, **limits):
    """Fit of two logs, the worse with a rate gain below 1 by this much."""
    return fog_fit([fog_log(), fog_log(gain=1.0 - value)], **limits)


def fog_fit(figures, share=0.25, **limits):
    """Criteria of a fit in recursive mode."""
    spec = SimpleNamespace(acceptance=_Acceptance(**limits))
    export = SimpleNamespace(
        share_of_raw=share, model=SimpleNamespace(mode="recursive", exported=True)
    )
    return fog._fit_criteria(spec, export, figures)


def fog_worse(value, **limits):
    """Fit of two logs, the worse with twice this drift left, in units of its drift before."""
    return fog_fit([fog_log(), fog_log(before=0.5, after=value)], **limits)


def fog_withheld(value, **limits):
    """Fit that left this share of the raw drift on withheld ramps."""
    return fog_fit([fog_log()], share=value, **limits)


def fog_unseen(value, **limits):
    """Validation of two logs with a drift rms of 1 before and this after."""
    spec = SimpleNamespace(acceptance=_Acceptance(**limits))
    return fog._validation_criteria(spec, [fog_log(before=1.0, after=value)] * 2)


def fog_covered(value, **limits):
    """Validation of two logs, of whose 300 and 100 means this share lies within the uncertainty."""
    spec = SimpleNamespace(acceptance=_Acceptance(**limits))
    shares = ((300, value + 0.1), (100, value - 0.3))
    logs = [
        {
            "uncertainty": {
                "means_of_100_s": count,
                "share_within_expanded_uncertainty": share,
            }
        }
        for count, share in shares
    ]
    return fog._covered(spec, logs)


def triad_stand(**limits):
    """Criteria of corrected dwells; the keyword `figures` changes what was found."""
    figures = {"inclination": 0.1, "toolface": 0.1, "residual": 0.1} | limits.pop("figures")
    none = np.zeros(0)
    errors = AttitudeErrors(
        none,
        none,
        (10.0, 170.0),
        0.1,
        figures["inclination"],
        0.1,
        9.0,
        figures["toolface"],
    )
    found = triad_errors.DwellErrors(np.full((1, 3), figures["residual"]), errors)
    return found.judge_errors(SimpleNamespace(acceptance=_AccelAcceptance(**limits)))


def triad_unseen(value):
    """Criterion of unseen dwells whose residual rms was 0.5 g before."""
    before, after = (triad_errors.DwellErrors(np.full((1, 3), r), None) for r in (0.5, value))
    return [before.judge_improvement(after)]


def station(*, unseen=False, angle="after", value=0.1, **limits):
    """Criteria of three stations: a good one, one with this error and one without a result."""
    columns = {name: np.array([0.1, 0.1, np.nan]) for name in ("inclination", "toolface", "before")}
    columns |= {"after": np.array([0.1, 0.1, np.nan]), "standard_uncertainty": np.full(3, 0.1)}
    columns[angle] = np.array([columns[angle][0], -value, np.nan])
    return angle_limits.AngleErrors(**columns).criteria(
        SimpleNamespace(acceptance=_InclinometerAcceptance(**limits)),
        unseen=unseen,
    )


def azimuth_rms(value, **limits):
    """Criteria of three stations whose azimuths are off by 0.7 and 0.1 times the rms."""
    found = np.array([1.4 * value, 0.2 * value, np.nan])
    same = np.array([0.0, 0.0, np.nan])
    return angle_limits.AngleErrors(same, same, same, found, np.ones(3)).criteria(
        SimpleNamespace(acceptance=_InclinometerAcceptance(**limits)),
        unseen=False,
    )


def noise(value, *, observed=True, sensor=GYRO, **limits):
    """Criteria of a record with one noise term, or whose deviation is 60 times this at 1 s."""
    term = SimpleNamespace(name=sensor.laws[1].name, value=value)
    curve = SimpleNamespace(
        upper=np.array([120.0, 60.0 * value, 120.0]), tau_s=np.array([0.5, 1.0, 2.0])
    )
    one = SimpleNamespace(
        record=SimpleNamespace(name="gyro_x of still.csv", sensor=sensor),
        terms=SimpleNamespace(terms=(term,) if observed else ()),
        curve=curve,
        stability=(SimpleNamespace(block_s=10.0, value=value),),
    )
    return noise_tables.criteria([one], NoiseAcceptance(**limits))


def runs(name):
    """Criteria of rate-table runs, of which the worse of two shows this figure."""

    def made(value, **limits):
        figures = [
            Figure(f"{name}.GJB 2426A.{gyro}", v, "", 0.0) for gyro, v in (("x", 0.1), ("y", value))
        ]
        return acceptance.judge_runs(figures, RateTableAcceptance(**limits))

    return made


def pair(value, **limits):
    """Criteria of a pair with this standard uncertainty of gamma and orthogonality error."""
    found = SimpleNamespace(
        standard_uncertainty=np.array([9.0, 9.0, value]), orthogonality_error_deg=-value
    )
    return acceptance.judge_pair(SimpleNamespace(found=found), (), PairAcceptance(**limits))


def runs_unseen(value, **limits):
    """Criteria of unseen runs, of which the worse has this scale-factor error and nonlinearity."""
    stands = [
        {"scale_factor_error_ppm": -v, "nonlinearity_full_scale_ppm": v} for v in (0.1, value)
    ]
    return acceptance.judge_unseen_lines(stands, RateTableAcceptance(**limits))


def axes(value, **limits):
    """Criteria of two gyros whose axes are 90° less this apart, known to this."""
    triad = SimpleNamespace(
        angles_deg=np.full((2, 2), 90.0 - value), angle_uncertainty_deg=np.full((2, 2), value)
    )
    fitted = SimpleNamespace(pairs=[(0, 1)], sets=(SimpleNamespace(triad=triad),))
    return acceptance.judge_triad(fitted, (), TriadAcceptance(**limits))


def axes_unseen(value, **limits):
    """Criteria of an unseen run about one axis with these errors after compensation."""
    after = {
        "rate_error_max_ppm_of_full_scale": value,
        "cross_axis_max_ppm_of_full_scale": value,
    }
    return acceptance.judge_unseen_base([{"after": after}], TriadAcceptance(**limits))


def limited(key, make):
    """Criteria for a value with the limit 0.5 on a key of the recipe."""
    return lambda value: make(value, **{key: LIMIT})


SHAPE, SENSITIVITY = "nonlinearity_full_scale", "temperature_sensitivity"
AT_MOST = {
    "largest drift rms after": ("deg/h", limited("max_drift_rms_dph", fog_drift)),
    "rate gain off 1 by": ("1", limited("rate_gain_tolerance", fog_gain)),
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


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("largest after/before of a log", fog_worse),
        ("largest after/before of a log", lambda v: fog_unseen(2.0 * v)),
        ("residual rms after/before", triad_unseen),
    ],
)
def test_no_log_may_come_out_worse_than_it_was(name, make):
    """Without any limit in the recipe: as bad as before is accepted, worse is not."""
    for value, passed in ((NEAR, True), (0.5, True), (0.5001, False)):
        (made,) = (one for one in make(value) if one.name == name)
        assert made.value == pytest.approx(2.0 * value)
        assert (made.limit, made.unit, made.passed) == (1.0, "1", passed)


def test_an_azimuth_may_be_worse_than_uncorrected_by_its_uncertainty():
    """Of two stations the excess over u is at most 2.2414, the normal quantile of 1 - 0.05/4."""
    quantile = 2.2414027276049473
    for excess, passed in ((quantile - 1e-6, True), (quantile + 1e-6, False)):
        made = station(unseen=True, angle="after", value=0.1 + 0.1 * excess)
        (one,) = (c for c in made if c.name == "azimuth worse than uncorrected, over its u")
        assert one.limit == pytest.approx(quantile, rel=1e-12)
        assert one.value == pytest.approx(excess, rel=1e-9)
        assert one.passed is passed


def test_the_rate_gain_has_a_limit_without_being_asked():
    """One part in a thousand, in the mode that has a gain, and for terms that are exported."""
    assert _Acceptance().rate_gain_tolerance == 1e-3
    for gain, passed in ((1.0009, True), (1.0011, False), (0.9989, False)):
        (one,) = (c for c in fog_fit([fog_log(gain=gain)]) if c.name == "rate gain off 1 by")
        assert (one.limit, one.passed) == (1e-3, passed)


@pytest.mark.parametrize(
    "made",
    [
        lambda: fog_unseen(9.0)[1:],
        lambda: fog_covered(0.0),
        lambda: triad_stand(figures={"inclination": 9.0, "toolface": 9.0, "residual": 9.0}),
        lambda: station(value=9.0),
        lambda: noise(9.0),
        lambda: runs(SHAPE)(9.0),
        lambda: pair(9.0),
        lambda: runs_unseen(9.0),
        lambda: axes(9.0),
        lambda: axes_unseen(9.0),
    ],
)
def test_a_limit_that_is_not_stated_is_not_tested(made):
    """Whatever the figures are."""
    assert list(made()) == []
