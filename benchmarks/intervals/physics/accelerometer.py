"""Triads on a table in a chamber, and turned by hand: faults that move K, Q and corrected vectors.

The truth of K0 … K9 is the plain least-squares fit of the published form to the same dwells
without noise and errors; that of Q, of biases and of corrected vectors is the device's own.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from intervals.physics import triad as physics
from intervals.physics.campaigns import Campaign, Fault, Truth
from intervals.physics.triad import ROOM_DEGC, SPOTS_DEG, Triad

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

AXES = "xyz"
SOAKS_DEGC = np.linspace(-40.0, 125.0, 7)
BETWEEN_DEGC = (-30.0, 0.0, 40.0, 80.0, 115.0)
"""Temperatures of corrected vectors that are compared with gravity."""
DWELL_S, SETTLING_S = 120.0, 1500.0
NOISE_G, MISALIGNED_RAD = 20e-6, 3e-3
ROOM = {"temp_case_degc": ROOM_DEGC}
UP = np.array([0.0, 0.0, 1.0])
K_CROSS, K_SCALE, K_ZERO, VECTOR, Q3 = "K8, K9", "K0", "K4", "corrected vector", "Q3"
NOISY, QUIET = "K of the noisy axis", "K of the quiet axes"
BIAS, SCALE = "bias", "scale factor"


def k_design(indication: Array, degc: Array, axis: int) -> Array:
    """Columns [n, 10] of the published form, by which K0 … K9 of an axis are multiplied.

    g_i = G_i (K0 + K1 t + K2 t² + K3 t³) − (K4 + K5 t + K6 t² + K7 t³) − K8 G_j − K9 G_k
    """
    powers = np.vander(degc, 4, increasing=True)
    cross = np.roll(indication, -axis - 1, axis=1)[:, :2]
    return np.hstack((indication[:, axis, None] * powers, -powers, -cross))


def fit_k(indication: Array, degc: Array, down: Array) -> Array:
    """K0 … K9 [3, 10] by plain least squares of the published form."""
    coefficients = []
    for axis in range(3):
        design = k_design(indication, degc, axis)
        # Columns in powers of °C differ by 1e6 in length.
        scale = np.linalg.norm(design, axis=0)
        coefficients.append(np.linalg.lstsq(design / scale, down[:, axis])[0] / scale)
    return np.array(coefficients)


def fit_q3(axes: Array) -> float:
    """Q3 = −y · e1 [rad], e1 along the axis of x."""
    return float(-axes[1] @ axes[0])


def on_table(
    rng: np.random.Generator,
    *,
    noise_g: Sequence[float] = (NOISE_G,) * 3,
    index_deg: float = 0.0,
    settling_g: float = 0.0,
    memory_g: float = 0.0,
    quantities: Sequence[str],
) -> Campaign:
    """Seven soaks of 26 attitudes, in the same order each time.

    Parameters
    ----------
    noise_g : standard deviation of the mean of a dwell, per axis [g].
    index_deg : standard deviation of the table's error about each axis, of an attitude [°].
    settling_g : zero at the beginning of a soak, which falls with 1,500 s [g].
    memory_g : zero by the gravity along each axis in the attitude before, per g [g].
    quantities : rows that the campaign is judged by.

    """
    triad = physics.draw(rng, np.eye(3) + rng.normal(0.0, MISALIGNED_RAD, (3, 3)))
    soak, spot = (a.ravel() for a in np.indices((SOAKS_DEGC.size, len(SPOTS_DEG))))
    degc = SOAKS_DEGC[soak] + rng.normal(0.0, 0.2, soak.size)
    down = physics.gravity(SPOTS_DEG[spot], UP)
    turn = np.radians(index_deg) * rng.normal(size=(len(SPOTS_DEG), 3))[spot]
    in_soak_s = DWELL_S * (spot + 0.5)
    sign = rng.choice((-1.0, 1.0), 3)
    zero = settling_g * sign * np.exp(-in_soak_s / SETTLING_S)[:, None]
    zero[1:] += memory_g * (down @ triad.axes.T)[:-1]
    nothing = np.zeros(zero.shape)
    clean = triad.indication(down, degc, nothing, nothing, np.zeros(3))
    moved = down + np.cross(turn, down)
    indication = triad.indication(moved, degc, zero, nothing, np.zeros(3))
    indication += np.asarray(noise_g) * rng.normal(size=indication.shape)
    frame = {"temp_case_degc": degc}
    frame |= dict(zip(("inclination_deg", "toolface_deg"), SPOTS_DEG[spot].T, strict=True))
    frame |= dict(zip((f"accel_{axis}_g" for axis in AXES), indication.T, strict=True))
    recipe = {
        "procedure": "accelerometer",
        "logs": {"files": ["positions.csv"]},
        "reference": {"kind": "attitude", "convention": "gravity"},
        "reference_temp_degc": ROOM_DEGC,
    }
    truth = [*_of_k(fit_k(clean, degc, down)), *_of_vectors(triad)]
    truth.append(Truth(Q3, "triad.Q3", fit_q3(triad.axes)))
    return Campaign(
        recipe,
        {"positions.csv": pd.DataFrame(frame)},
        [result for result in truth if result.quantity in quantities],
    )


def _of_k(coefficients: Array) -> list[Truth]:
    """Truths of the published coefficients, as several quantities."""
    names = {0: K_SCALE, 4: K_ZERO, 8: K_CROSS, 9: K_CROSS}
    truth = []
    for axis, row in zip(AXES, coefficients, strict=True):
        for k, value in enumerate(row.tolist()):
            key = f"accel_{axis}.K{k}"
            truth.append(Truth(NOISY if axis == "z" else QUIET, key, value))
            if k in names:
                truth.append(Truth(names[k], key, value))
    return truth


def _of_vectors(triad: Triad) -> list[Truth]:
    """Gravity in two opposite faces at each of some temperatures between the soaks."""
    truth = []
    for k, degc in enumerate(BETWEEN_DEGC):
        faces = np.outer((1.0, -1.0), np.eye(3)[k % 3])
        nothing = np.zeros(faces.shape)
        indication = triad.indication(faces, np.full(2, degc), nothing, nothing, np.zeros(3))
        for face, indicated in zip(faces, indication, strict=True):
            at = dict(zip((f"accel_{axis}_g" for axis in AXES), indicated.tolist(), strict=True))
            at["temp_case_degc"] = degc
            truth += [
                Truth(VECTOR, f".corrected_{axis}", float(component), at)
                for axis, component in zip(AXES, face, strict=True)
            ]
    return truth


def by_hand(
    rng: np.random.Generator,
    *,
    noise_g: float,
    second: float = 0.0,
    set_up_deg: float = 0.0,
    sessions: int = 1,
    session_zero_g: float = 0.0,
    attitudes: Array,
    quantities: Sequence[str],
) -> Campaign:
    """Attitudes that are not measured, at room temperature; a log is a session.

    Parameters
    ----------
    noise_g : standard deviation of the mean of a dwell [g].
    second : error of second order of each axis [g/g²].
    set_up_deg : standard deviation of the error of an attitude about each axis [°].
    session_zero_g : standard deviation of the zero of a session [g].
    attitudes : gravity [n, 3] in the intended attitudes [g].

    """
    triad = physics.draw(rng, np.eye(3) + np.tril(rng.normal(0.0, MISALIGNED_RAD, (3, 3)), -1))
    logs = {}
    for number in range(sessions):
        turn = np.radians(set_up_deg) * rng.normal(size=attitudes.shape)
        down = attitudes + np.cross(turn, attitudes)
        down /= np.linalg.norm(down, axis=1)[:, None]
        zero = np.broadcast_to(session_zero_g * rng.normal(size=3), down.shape)
        degc = np.full(len(down), ROOM_DEGC)
        indication = triad.indication(down, degc, zero, np.zeros(down.shape), np.full(3, second))
        indication += noise_g * rng.normal(size=indication.shape)
        frame = dict(zip((f"accel_{axis}_g" for axis in AXES), indication.T, strict=True))
        logs[f"session_{number}.csv"] = pd.DataFrame(frame)
    recipe: dict[str, Any] = {
        "procedure": "accelerometer",
        "logs": {"files": ["*.csv"]},
        "reference": {"kind": "magnitude", "convention": "gravity"},
        "affine": {"enabled": False},
    }
    # g = M G − b with G = S (A g + z): M = (S A)⁻¹, b = A⁻¹ z. With C below the diagonal, the
    # form a = k G − z, g = a − C a has k_i = M_ii; at G = 0 every form corrects to −b.
    matrix = np.linalg.inv(triad.scale[:, None] * triad.axes)
    bias = np.linalg.solve(triad.axes, triad.bias)
    at_rest = {f"accel_{axis}_g": 0.0 for axis in AXES}
    truth = []
    for k, axis in enumerate(AXES):
        truth.append(Truth(BIAS, f".corrected_{axis}", -float(bias[k]), at_rest | ROOM))
        key = f"triad.k_{axis}0|triad.m_{axis}{axis}0"
        truth.append(Truth(SCALE, key, float(matrix[k, k])))
    return Campaign(recipe, logs, [result for result in truth if result.quantity in quantities])


def _index(rng: np.random.Generator, size: float) -> Campaign:
    return on_table(rng, index_deg=size, quantities=(K_CROSS, VECTOR))


def _noise(rng: np.random.Generator, size: float) -> Campaign:
    noise_g = (NOISE_G, NOISE_G, size * NOISE_G)
    return on_table(rng, noise_g=noise_g, quantities=(NOISY, QUIET))


def _settling(rng: np.random.Generator, size: float) -> Campaign:
    quantities = (K_ZERO, K_CROSS, VECTOR)
    return on_table(rng, settling_g=size * 1e-6, quantities=quantities)


def _memory(rng: np.random.Generator, size: float) -> Campaign:
    quantities = (K_SCALE, K_CROSS, VECTOR)
    return on_table(rng, memory_g=size * 1e-6, quantities=quantities)


def _low_noise(rng: np.random.Generator, size: float) -> Campaign:
    return on_table(rng, noise_g=(size * 1e-6,) * 3, quantities=(Q3,))


def _second_order(rng: np.random.Generator, size: float) -> Campaign:
    spots = physics.gravity(SPOTS_DEG, UP)
    return by_hand(
        rng, noise_g=200e-6, second=size * 1e-6, attitudes=spots, quantities=(BIAS, SCALE)
    )


def _set_up(rng: np.random.Generator, size: float) -> Campaign:
    return by_hand(
        rng,
        noise_g=NOISE_G,
        set_up_deg=size,
        sessions=4,
        session_zero_g=100e-6,
        attitudes=np.vstack((np.eye(3), -np.eye(3))),
        quantities=(BIAS, SCALE),
    )


_row = partial(Fault, "accelerometer")
ONE_SOAK = "one soak cannot show how another differs"
SIX_FACES = f"{ONE_SOAK}|Q. is known to ±|ill-conditioned"
"""What six faces cannot determine where their attitudes are unknown."""
_magnitude = partial(Fault, "accelerometer by the length of gravity", by_design=ONE_SOAK)
FAULTS = (
    _row("index errors of the table", 0.01, "°", _index, "index|two weightings"),
    _row("index errors of the table", 0.03, "°", _index, "index|two weightings"),
    _row("noise of z beside x and y", 3.0, "×", _noise, "noise", sound=1.0),
    _row("zero that settles in each soak", 150.0, "µg", _settling, "settl|transient"),
    _row("noise of a physical sensor", 1.0, "µg", _low_noise, "second order", sound=20.0),
    _row("hysteresis of the last attitude", 100.0, "µg", _memory, "hysteresis|last attitude"),
    _magnitude("second order of the sensors", 300.0, "µg/g²", _second_order, "second order"),
    _magnitude(
        "six faces, error of the set-up", 1.0, "°", _set_up, "angle|set-up", by_design=SIX_FACES
    ),
    _magnitude(
        "six faces, error of the set-up", 2.0, "°", _set_up, "angle|set-up", by_design=SIX_FACES
    ),
)
