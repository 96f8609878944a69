"""Triads calibrated with the errors that laboratories have: corrected vectors within their U."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import t

from calibkit.errors import FrameError, RecipeError
from calibkit.instruments.accelerometer import forms
from calibkit.instruments.accelerometer.corrections import Correction, DwellErrors
from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.findings import remark_on_dwells
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.numeric import attitude
from calibkit.recipe.tables import Errors
from calibkit.records.frame import Remark
from conftest import slow_after
from fits.triad_dwells import fit_triad

MANY = np.array([(0, 0), *((i, j) for i in (45, 90, 135) for j in range(0, 360, 45)), (180, 0)])
SIX = np.array([(0, 0), (180, 0), (90, 0), (90, 90), (90, 180), (90, -90)])
NOISE_G = 20e-6
SCALE, BIAS_G = np.array([1.003, 0.996, 1.001]), np.array([5e-3, -3e-3, 2e-3])


def recipe(**tables):
    """Recipe with the tables stated."""
    start = {"procedure": "accelerometer", "title": "a triad", "logs": {"files": ["a.csv"]}}
    return AccelerometerRecipe.model_validate(start | tables, strict=False)


PLAIN = recipe(loss="least_squares", affine={"enabled": False}, compensation="k")


def turned(vectors, rotation):
    """Vectors [n, 3] turned by small rotation vectors [n, 3] or [3] [rad]."""
    return vectors + np.cross(np.broadcast_to(rotation, vectors.shape), vectors)


def dwells(
    seed, *, spots=MANY, zero=0.0, index=0.0, set_up=0.0, tilt=0.0, eccentric=0.0, second=0.0
):
    """A triad of orthogonal axes at seven soaks: zeros of soaks [g], faces set up wrong [°], the
    triad set up wrong in its fixture about each axis [°], base tilted [°], encoders eccentric [°],
    second-order error [g/g²].
    """
    rng = np.random.default_rng(seed)
    soak = np.repeat(np.arange(7), len(spots))
    temperature = np.linspace(-40.0, 125.0, 7)[soak] + rng.normal(0.0, 0.2, len(soak))
    angle = np.tile(spots, (7, 1)).astype(float)
    stood = angle + eccentric * np.sin(np.radians(angle) + rng.uniform(0.0, 6.3, 2))
    theta, phi = np.radians(stood).T
    down = attitude.gravity_vector(*stood.T)
    north, east = np.radians(tilt) * rng.normal(size=2)
    down += north * np.column_stack(
        [np.cos(theta) * np.cos(phi), -np.cos(theta) * np.sin(phi), np.sin(theta)]
    )
    down += east * np.column_stack([np.sin(phi), np.cos(phi), np.zeros_like(phi)])
    faces = rng.normal(size=(len(spots), 3))
    faces *= np.radians(index) / np.linalg.norm(faces, axis=1)[:, None]
    down = turned(down, np.tile(faces, (7, 1)))
    down = turned(down, np.radians(set_up) * np.random.default_rng([seed, 1]).normal(size=3))
    indicated = SCALE * down + BIAS_G + second * down**2 + zero * rng.normal(size=(7, 3))[soak]
    indicated += NOISE_G * rng.normal(size=down.shape)
    unknown = np.full(len(soak), np.nan)
    return DwellSet(
        *(indicated, temperature, *angle.T, np.full(down.shape, np.nan), unknown),
        np.zeros(len(soak), dtype=np.int64),
        tuple(f"a.csv:{row}" for row in range(len(soak))),
        (),
    )


def inside(fitted, second):
    """Which corrected components of ±1 g along the axes at five temperatures lie within U, of a
    triad with a second-order error [g/g²].
    """
    vectors = np.tile(np.vstack([np.eye(3), -np.eye(3)]), (5, 1))
    at = forms.inputs(
        SCALE * vectors + BIAS_G + second * vectors**2,
        np.repeat([-30.0, 0.0, 40.0, 80.0, 115.0], 6),
    )
    found = []
    for axis, model in enumerate(fitted.k):
        slopes = forms.K.gradient(model, at)
        u = np.sqrt(np.einsum("np,pq,nq->n", slopes, np.array(model.covariance), slopes))
        dof = np.median([c.effective_dof for c in model.coefficients])
        found.append(
            np.abs(forms.K.evaluate(model, at) - vectors[:, axis]) <= t.ppf(0.975, dof) * u
        )
    return np.array(found)


@pytest.mark.parametrize(
    "errors",
    slow_after(
        1,
        [
            {"zero": 30e-6},
            {},
            {"index": 0.01, "spots": SIX},
            {"tilt": 0.01},
            {"eccentric": 0.05},
            {"second": 50e-6},
        ],
    ),
    ids=lambda errors: " ".join(map(str, errors)) or "none",
)
def test_the_truth_lies_within_u_whatever_dwells_share(errors):
    """40 campaigns, thirty vectors each: at least 88 % of the corrected components by K."""
    second = errors.get("second", 0.0)
    # Of an error that all dwells share a campaign has one drawing, all of which plain least squares
    # keeps: U, by t of so few degrees of freedom, then holds nearly every component.
    drawn_once = {"tilt", "eccentric", "second"} & set(errors)
    share = [
        np.mean(inside(fit_triad(dwells(seed, **errors), PLAIN), second)) for seed in range(40)
    ]
    assert np.mean(share) >= 0.88
    assert np.mean(share) <= (1.0 if drawn_once else 0.99)


LENGTHS = {"reference": {"kind": "magnitude"}, "k": {"enabled": False}, "loss": "least_squares"}
LENGTHS["affine"] = {"enabled": False}


def test_few_soaks_for_the_coefficients_of_an_axis_are_flagged():
    """A cubic zero at five soaks has one degree of freedom, at seven three: the flag says what is
    left and what to do, once.
    """
    for soaks, count in ((5, 1), (7, 0)):
        measured = dwells(3, zero=15e-6).without(range(26 * soaks, 182))
        flags = [f for f in fit_triad(measured, PLAIN).flags if "intervals are wide" in f]
        assert len(flags) == count
        assert all(
            "5 of them, less 4 coefficients of an axis, leave 1 degrees of freedom" in flag
            and "lower an order" in flag
            for flag in flags
        )


def test_a_set_up_of_which_nothing_is_known_is_flagged():
    """No dwell tells it from axes that are turned together; from lengths it does not matter."""
    flag = remark_on_dwells(dwells(0), PLAIN)[-1]
    assert 'group = "fixture", effect = "set-up"' in flag
    for remark in remark_on_dwells(dwells(0), recipe(**LENGTHS)):
        assert "set-up" not in remark


def test_a_drift_that_no_uncertainty_holds_is_a_doubt_not_a_remark():
    """Temperatures that only rise and no times: the drift of the zero is in no U."""
    rising = dwells(0)
    untimed = dataclasses.replace(rising, time=np.full(rising.time.size, np.nan))
    (doubt,) = [r for r in remark_on_dwells(untimed, PLAIN) if not isinstance(r, Remark)]
    assert "no time_s is logged" in doubt


def test_a_component_that_is_stated_narrows_the_interval():
    """15 µg given with 1,000 degrees of freedom: K4 has more of its own, and a smaller U."""
    measured = dwells(4, zero=15e-6)
    stated = [{"group": "soak", "effect": "zero", "value": 15.0, "unit": "ug", "dof": 1000.0}]
    known = PLAIN.model_validate(
        PLAIN.model_dump(by_alias=True) | {"errors": {"component": stated}}, strict=False
    )
    alone, given = (fit_triad(measured, spec).k[0].coefficients[4] for spec in (PLAIN, known))
    assert alone.effective_dof < 20.0
    assert given.effective_dof > 100.0


def test_a_single_soak_cannot_show_how_another_differs():
    """The flag names the zero of the soak."""
    measured = dwells(2)
    fitted = fit_triad(
        measured.without(range(26, 182)),
        recipe(k={"enabled": False}, affine={"scale_order": 0, "cross_order": 0, "bias_order": 0}),
    )
    assert any("with only one soak, how it repeats is unknown" in flag for flag in fitted.flags)


def drifting(seed, *, timed, back):
    """Zeros that drift by 5 µg/h while temperature rises from soak to soak, and returns or not."""
    measured = dwells(seed)
    hours = 2.0 * np.repeat(np.arange(7), 26) + np.tile(np.arange(26) / 30.0, 7)
    temperature = measured.temperature.copy()
    if back:
        temperature[-26:] = temperature[:26]
    return dataclasses.replace(
        measured,
        indication=measured.indication + 5e-6 * hours[:, None],
        temperature=temperature,
        time=3600.0 * hours if timed else measured.time,
    )


def with_drift():
    """Recipe that states a drift of 10 µg/h, and the fit of a triad by it."""
    stated = {"group": "session", "effect": "drift", "value": 1e-5, "unit": "g/h", "dof": 10.0}
    spec = PLAIN.model_copy(update={"errors": Errors(component=[stated])})
    return spec, fit_triad(drifting(1, timed=True, back=True), spec)


@pytest.mark.parametrize(
    ("hours", "off_g", "accepted"), [(100.0, 5e-4, True), (0.01, 5e-4, False), (0.01, 0.0, True)]
)
def test_a_drift_is_in_the_u_of_unseen_dwells_by_their_hours(hours, off_g, accepted):
    """A drift of 10 µg/h explains zeros that move by 0.5 mg in 100 hours, and not in 36 seconds."""
    spec, fitted = with_drift()
    correction = Correction(fitted.k)
    unseen = dwells(2)
    part = np.linspace(-0.5, 0.5, len(unseen.temperature))
    # zeros of the middle of the session that was fitted
    zero_g = 5e-6 * drifting(1, timed=True, back=True).time.mean() / 3600.0
    unseen = dataclasses.replace(
        unseen,
        indication=unseen.indication + zero_g + off_g * part[:, None],
        time=3600.0 * hours * (part + 0.5),
    )
    errors = DwellErrors.compare(unseen, spec, correction)
    assert errors.judge_uncertainty("a", unseen, correction).passed == accepted


def test_a_drift_is_not_added_to_dwells_without_time():
    """How much of 10 µg/h dwells have that tell no time is not known: refused."""
    _, fitted = with_drift()
    with pytest.raises(FrameError, match="no time_s, expected one: the drift of the session"):
        Correction(fitted.k).uncertainty(dwells(2))


def test_a_stated_error_that_the_logs_cannot_have_is_refused():
    """A drift without a clock."""
    stated = {"group": "session", "effect": "drift", "value": 1e-6, "unit": "g/h", "dof": 10.0}
    spec = recipe(errors={"component": [stated]})
    with pytest.raises(RecipeError, match="'drift' of group 'session'"):
        fit_triad(dwells(1), spec)
