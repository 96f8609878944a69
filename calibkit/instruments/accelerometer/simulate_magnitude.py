"""A triad of MEMS accelerometers turned by hand into many positions: a log of rests and turns,
attitudes unknown.

The sensors are physical, not the model that is fitted: scale factors, biases and axes that are off,
second-order errors, white noise and a bias that wanders, and a hand that never lets a turn be
smooth. Indications are positive along gravity.
"""

import numpy as np

from calibkit.instruments.accelerometer import published
from calibkit.numeric.arrays import Array
from calibkit.simulate.campaign import Campaign

INTERVAL_S = 0.04
HOLD_S, TURN_S = 4.0, 1.2
DECIMALS = {"time_s": 2, "accel_x_g": 5, "accel_y_g": 5, "accel_z_g": 5}
NOISE_G, SHAKE_G, WALK_G = 2e-4, 3e-2, 2e-6
"""Standard deviations [g] of a sample at rest, of the hand's shaking during a turn, and of one step
of the bias's random walk.
"""
SIZES = (5e-3, 2e-2, 8e-3)
"""Standard deviations of relative scale factors, biases [g] and Q [rad]."""
SECOND_ORDER = 2e-5
"""Largest second-order error [g/g²]."""


def campaign(seed: int, *, positions: int = 24) -> Campaign:
    """Simulate a log of one triad in a number of positions, and a validation log of the same triad
    in half as many others.

    Parameters
    ----------
    seed : what triad, positions and noise are drawn from.
    positions : the six faces, roughly, and the rest in any direction.

    Returns
    -------
    `tumble.csv`, `withheld/tumble.csv`, and the truth: scale factors, biases, Q1, Q2, Q3 and the
    directions of gravity.

    """
    rng = np.random.default_rng(seed)
    scale, bias, q = (rng.normal(0.0, size, 3) for size in SIZES)
    scale += 1.0
    axes = published.axes_from_angles(q)
    second_order = rng.uniform(-SECOND_ORDER, SECOND_ORDER, 3)
    logs, attitudes = {}, {}
    for name, count in (("tumble.csv", positions), ("withheld/tumble.csv", positions // 2)):
        # six faces within a few degrees, the others in random directions
        faces = np.vstack((np.eye(3), -np.eye(3)))[:count]
        faces += rng.normal(0.0, 0.04, faces.shape)
        directions = np.vstack((faces, rng.normal(size=(max(count - 6, 0), 3))))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        # gravity along each sensor's own axis
        acting = path(rng, directions) @ axes.T
        walk = np.cumsum(rng.normal(0.0, WALK_G, acting.shape), axis=0)
        indicated = (
            scale * (acting + second_order * acting**2)
            + bias
            + walk
            + rng.normal(0.0, NOISE_G, acting.shape)
        )
        logs[name] = {
            "time_s": np.arange(len(acting)) * INTERVAL_S,
            **{f"accel_{axis}_g": indicated[:, k] for k, axis in enumerate("xyz")},
        }
        attitudes[name] = directions.tolist()
    truth = {
        "procedure": "accelerometer_magnitude",
        "seed": seed,
        "k": scale.tolist(),
        "b": bias.tolist(),
        "Q": q.tolist(),
        "second_order": second_order.tolist(),
        "units": {"k": "1", "b": "g", "Q": "rad", "second_order": "g/g^2"},
        "gravity": attitudes,
    }
    return Campaign(logs, DECIMALS, truth)


def path(rng: np.random.Generator, directions: Array, hold_s: float = HOLD_S) -> Array:
    """Gravity vectors [n, 3, g] in the triad's frame along the rests and the shaken turns between
    them.
    """
    hold, turn = round(hold_s / INTERVAL_S), round(TURN_S / INTERVAL_S)
    share = np.linspace(0.0, 1.0, turn, endpoint=False)[:, None]
    pieces = []
    for attitude, next_attitude in zip(directions, np.roll(directions, -1, axis=0), strict=True):
        pieces += [
            np.tile(attitude, (hold, 1)),
            attitude + (next_attitude - attitude) * share + rng.normal(0.0, SHAKE_G, (turn, 3)),
        ]
    return np.concatenate(pieces)
