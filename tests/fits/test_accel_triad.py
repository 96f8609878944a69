"""The triad over temperature: every entry a polynomial, higher orders and nuisance angles as
options, against vectors and against the length of gravity.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.spatial.transform import Rotation

from calibkit.fit.complex_step import derivative
from calibkit.instruments.accelerometer.equation import AXES, name_terms, read_terms
from calibkit.instruments.accelerometer.triad import solve_triad
from calibkit.numeric import attitude
from fits.triad_dwells import WHITE, collect, recipe

AUTHORITY = json.loads((Path(__file__).parents[1] / "authorities" / "accel_k.json").read_text())
ROWS = np.array(AUTHORITY["rows"])
TEMPERATURE, ANGLES, INDICATION = ROWS[:, 0], ROWS[:, 1:3], ROWS[:, 3:]
MIDDLE, HALF = 52.5, 72.5  # °C
MAPPED = (TEMPERATURE - MIDDLE) / HALF
NOISE_G = 2e-5
SIZES = {"k": 5e-3, "z": 5e-3, "c": 5e-3, "n": 1e-4, "tilt": 2e-3, "fixture": 1e-2}
PLAIN = recipe(loss="least_squares", errors=WHITE)


def of_orders(scale, cross, zero, **options):
    """Terms whose orders of temperature are those of all axes."""
    return name_terms((scale,) * 3, (zero,) * 3, (cross,) * 3, **options)


EVERYTHING = of_orders(
    2, 1, 2, triangular=True, second_order=True, third_order=True, tilt=True, fixture=True
)


def drawn(terms, seed):
    """Parameters for mapped temperature, of the size that triads have."""
    size = np.array([SIZES[kind] for kind in terms.kind]) * 0.3**terms.power
    return terms.start() + size * np.random.default_rng(seed).normal(size=size.size)


def indications(terms, p, gravity, noise_seed=None):
    """Indications [n, 3] that the equation corrects to gravity [n, 3], by fixed-point iteration,
    with noise where a seed is given.
    """
    indication = gravity.copy()
    for _ in range(60):
        indication = indication - (terms.corrected(p, indication, MAPPED) - gravity)
    if noise_seed is None:
        return indication
    return indication + np.random.default_rng(noise_seed).normal(0.0, NOISE_G, gravity.shape)


def solved(indication, terms, spec=PLAIN, *, loss="least_squares", **options):
    """Terms fitted to indications at the temperatures and attitudes of the worked example."""
    dwells = collect(indication, TEMPERATURE, ANGLES, **options)
    return solve_triad(dwells, terms, spec, loss=loss)


def tool_rotation():
    """Rotations [n, 3, 3] from the table's base to the tool."""
    inclination, toolface = np.radians(ANGLES).T
    turns = Rotation.from_euler("ZY", -np.column_stack([toolface, inclination]))
    return turns.as_matrix()


def scores(triad, truth):
    """Errors over standard uncertainties, for mapped temperature."""
    return (triad.fit.parameters - truth) / np.sqrt(np.diag(triad.fit.covariance))


def test_equation_written_out_in_loops():
    """(1) and (2), entry by entry, in powers of °C."""
    coefficients = {"k_x0": 1.01, "k_x1": 2e-5, "k_y0": 0.99, "k_z0": 1.0, "z_x0": 1e-3}
    coefficients |= {"z_y1": 2e-5, "z_z3": 1e-9, "c_xy": 3e-3, "d_zx": 1e-6}
    coefficients |= {"n_x_xx": 1e-5, "n_y_yz": -2e-5, "n_z_zzz": 3e-5}
    rows = []
    for t, indicated in zip(TEMPERATURE, INDICATION, strict=True):
        a = {}
        for i, G in zip("xyz", indicated, strict=True):
            k = sum(coefficients.get(f"k_{i}{n}", 0.0) * t**n for n in range(4))
            z = sum(coefficients.get(f"z_{i}{n}", 0.0) * t**n for n in range(4))
            a[i] = G * k - z
        row = []
        for i in "xyz":
            g = a[i]
            for j in "xyz":
                c = coefficients.get(f"c_{i}{j}", 0.0) + coefficients.get(f"d_{i}{j}", 0.0) * t
                g -= c * a[j]
            for name, value in coefficients.items():
                if name.startswith(f"n_{i}_"):
                    g += value * np.prod([a[j] for j in name[4:]])
            row.append(g)
        rows.append(row)
    p = np.array(list(coefficients.values()))
    corrected = read_terms(tuple(coefficients)).corrected(p, INDICATION, TEMPERATURE)
    np.testing.assert_allclose(corrected, rows, atol=1e-14)  # g


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=10, deadline=None)
def test_derivatives_are_those_of_central_differences(seed):
    """The Jacobian of the equation agrees with differences to 1e-8."""
    p = drawn(EVERYTHING, seed)
    slopes = derivative(lambda q: EVERYTHING.corrected(q, INDICATION[:30], MAPPED[:30]), p)
    for k, step in enumerate(1e-5 * np.eye(len(p))):
        above, below = (
            EVERYTHING.corrected(at, INDICATION[:30], MAPPED[:30]) for at in (p + step, p - step)
        )
        np.testing.assert_allclose(slopes[..., k], (above - below) / 2e-5, atol=1e-8)


def test_everything_at_once_comes_out_of_one_fit():
    """Polynomial entries, higher orders, tilt and fixture are all within 4 u, and the residual is
    the noise.
    """
    truth = drawn(EVERYTHING, 1)
    tilt, turn = (truth[EVERYTHING.kind == kind] for kind in ("tilt", "fixture"))
    down = np.array([*tilt, 1.0]) / np.linalg.norm([*tilt, 1.0])
    gravity = (tool_rotation() @ down) @ Rotation.from_rotvec(turn).as_matrix()
    indicated = indications(EVERYTHING, truth, gravity, 2)
    options = dict.fromkeys(("second_order", "third_order", "tilt", "fixture"), True)
    spec = recipe(loss="least_squares", errors=WHITE, affine=options)
    triad = solved(indicated, EVERYTHING, spec)
    assert np.max(np.abs(scores(triad, truth))) < 4.0
    assert np.sqrt(np.mean(triad.noise**2)) == pytest.approx(NOISE_G, rel=0.06)
    assert triad.fit.condition < 30.0
    mapped = EVERYTHING.corrected(triad.fit.parameters, indicated, MAPPED)
    raw = EVERYTHING.corrected(triad.to_degrees @ triad.fit.parameters, indicated, TEMPERATURE)
    np.testing.assert_allclose(raw, mapped, atol=1e-13)  # g


def test_tilt_is_an_error_of_the_table_unless_it_is_fitted():
    """A base tilted by 0.1° is kept as an error, so that the cross-axis terms hold it in U; as a
    nuisance it comes out itself.
    """
    tilt = np.array([1.7e-3, -0.9e-3])  # rad
    down = np.array([*tilt, 1.0]) / np.linalg.norm([*tilt, 1.0])
    terms = of_orders(3, 1, 3)
    truth = drawn(terms, 14)
    indicated = indications(terms, truth, tool_rotation() @ down, 3)
    triad = solved(indicated, terms)
    kept = {size.error.name: size.value for size in triad.fit.shared}
    assert 0.5e-3 < kept["table tilt"] < 4e-3  # rad
    assert np.max(np.abs(scores(triad, truth))) < 4.0
    assert triad.noise == pytest.approx(np.full(3, NOISE_G), rel=0.15)
    spec = recipe(loss="least_squares", errors=WHITE, affine={"tilt": True})
    triad = solved(indicated, of_orders(3, 1, 3, tilt=True), spec)
    u = np.sqrt(np.diag(triad.fit.covariance))[-2:]
    assert np.all(np.abs(triad.fit.parameters[-2:] - tilt) < 4.0 * u)
    assert np.all(u < 1e-5)  # rad


FACES = np.array([(0, 0), (180, 0), (90, 0), (90, 90), (90, 180), (90, -90)], dtype=float)


def faces(seed, *, outliers):
    """Six faces at seven temperatures, each face set up about 0.01° wrong, the same way every time,
    and the matrix of the triad.
    """
    rng = np.random.default_rng(seed)
    angles, temperature = np.tile(FACES, (7, 1)), np.repeat(np.linspace(-40.0, 85.0, 7), 6)
    turned = Rotation.from_rotvec(np.tile(rng.normal(0.0, 1.75e-4, (6, 3)), (7, 1)))
    matrix = np.eye(3) + 1e-3 * rng.normal(size=(3, 3))
    zero = np.outer((temperature - 22.5) / 62.5, 1e-3 * rng.normal(size=3))
    indicated = turned.apply(attitude.gravity_vector(*angles.T)) @ matrix.T + zero
    indicated += rng.normal(0.0, NOISE_G, (42, 3))
    if outliers:
        indicated[11, 1] += 0.05
    return collect(indicated, temperature, angles), matrix


@pytest.mark.parametrize("seed", range(8))
def test_faces_that_are_set_up_wrong_are_kept_and_named_as_what_they_are(seed):
    """The robust fit drops no face: its axes are within 700 µrad as those of least squares, though
    one outliers dwell is among them; that dwell is the first suspect, and hardly another is one.
    """
    for terms in (of_orders(1, 0, 1), of_orders(3, 1, 3)):
        dwells, matrix = faces(seed, outliers=seed > 3)
        triad = solve_triad(dwells, terms, recipe(), loss="robust")
        named = dict(zip(terms.names, triad.fit.parameters, strict=True))
        cross = [[named.get(f"c_{i}{j}", 0.0) for j in AXES] for i in AXES]
        scale = np.array([named[f"k_{i}0"] for i in AXES])
        sensitivity = np.linalg.inv(np.eye(3) - cross) / scale[:, None]
        assert np.max(np.abs(sensitivity - matrix)) < 7e-4
        assert triad.suspects[:1] == ((11,) if seed > 3 else ())
        assert len(triad.suspects) <= 2
