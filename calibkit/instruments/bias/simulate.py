"""Simulated static inertial unit in a chamber that is swept through its range in one log.

Heat goes from the thermometer on the board through a wall to the sensors: a chain of layers, not
the two lags that are fitted. The bias of a channel is a polynomial of the temperature of the
sensor, the stress of the temperature difference across the wall, and a term of the rate there.
"""

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.instruments.bias import simulate_fog
from calibkit.numeric.arrays import Array
from calibkit.numeric.constants import SECONDS_PER_MINUTE
from calibkit.simulate import noise
from calibkit.simulate.campaign import Campaign
from calibkit.simulate.chamber import Chamber, Programme, follow_with_lag

if TYPE_CHECKING:
    from numpy.typing import NDArray

SWEEP_DEGC = (52.0, -18.0, 74.0, 36.0)
RATE_DEGC_MIN = 1.5
SOAK_S = 1200.0
LAYERS = 8
EVERY_S = 2
"""Rows are logged every two seconds."""
SIZES = {
    "gyro_x_dph": (30.0, 1.5, 0.3),
    "gyro_y_dph": (20.0, 1.5, 0.3),
    "gyro_z_dph": (40.0, 1.5, 0.3),
    "accel_x_g": (2e-3, 4e-5, 5e-6),
    "accel_y_g": (1e-3, 4e-5, 5e-6),
    "accel_z_g": (3e-3, 4e-5, 5e-6),
}
"""Channel → size of its drift over 50 °C, white noise of a second and flicker noise."""
DECIMALS = {"temp_case_degc": 4, **{name: 3 if "gyro" in name else 7 for name in SIZES}}
REFERENCE_DEGC = 25.0
ATTITUDE_G = {"accel_x_g": 0.0, "accel_y_g": 0.0, "accel_z_g": 1.0}


@dataclass(frozen=True, slots=True)
class _Channel:
    """Constants of one channel, in its unit."""

    bias: float
    powers: tuple[float, float, float]
    """Of z = (T − 25 °C)/50 °C."""
    stress: float
    """By the difference across the wall [1/°C]."""
    rate: float
    """By the rate of the sensor [1/(°C/min)]."""
    rate_by_temperature: float
    """The same, times z."""
    white: float
    flicker: float


def _programme() -> Programme:
    """Sweep with soaks at its ends."""
    time, degc = [0.0, SOAK_S], [SWEEP_DEGC[0]] * 2
    for end in SWEEP_DEGC[1:]:
        time.append(time[-1] + abs(end - degc[-1]) / RATE_DEGC_MIN * SECONDS_PER_MINUTE)
        time.append(time[-1] + SOAK_S)
        degc += [end, end]
    return Programme(tuple(time), tuple(degc), RATE_DEGC_MIN)


def _layers(board: Array, diffusion_s: float) -> Array:
    """Temperatures [n, LAYERS] at 1 Hz of a wall that is heated from one side, from equilibrium:
    dx/dt = M x + k e₁ T_board, of which each eigenvector follows the board with its own lag.
    """
    # between layers; the time of diffusion through the whole wall goes by its square
    k = LAYERS**2 / diffusion_s
    M = k * (np.eye(LAYERS, k=1) + np.eye(LAYERS, k=-1) - 2.0 * np.eye(LAYERS))
    # no heat leaves at the far side, where the sensors are
    M[-1, -1] = -k
    eigenvalues, eigenvectors = np.linalg.eigh(M)
    # the board keeps its temperature over a second
    held = np.append(board[0], board[:-1])
    followed = [follow_with_lag(held, lag_s) - board[0] for lag_s in -1.0 / eigenvalues]
    modes = -k * eigenvectors[0] / eigenvalues * np.column_stack(followed)
    return np.asarray(modes @ eigenvectors.T + board[0])


def _draw(name: str, rng: np.random.Generator) -> _Channel:
    """Constants of one channel."""
    size, white, flicker = SIZES[name]
    linear, square, cubic = rng.normal(0.0, (1.0, 0.4, 0.15)) * size
    return _Channel(
        rng.normal(0.0, 3.0) * size,
        (float(linear), float(square), float(cubic)),
        rng.normal(0.0, 0.04) * size,
        rng.normal(0.0, 0.15) * size,
        rng.normal(0.0, 0.08) * size,
        white,
        flicker,
    )


def true_drift(channel: _Channel, layers: Array) -> Array:
    """Bias [n] relative to rest at the reference temperature."""
    inner = layers[:, -1]
    z = (inner - REFERENCE_DEGC) / 50.0
    rate = np.gradient(inner) * SECONDS_PER_MINUTE
    first, second, third = channel.powers
    static = first * z + second * z**2 + third * z**3
    rate_drift = (channel.rate + channel.rate_by_temperature * z) * rate
    return np.asarray(static + channel.stress * (layers[:, 0] - inner) + rate_drift)


def campaign(seed: int) -> Campaign:
    """Simulate one sweep of six channels, one thermometer, in one log."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, 18]))
    time, set_degc = _programme().set_points()
    # the thermometer on the board follows the air of the chamber
    air, lag_s = Chamber().air(set_degc, rng), rng.uniform(120.0, 400.0)
    board = follow_with_lag(air, lag_s)
    diffusion_s = rng.uniform(400.0, 1500.0)
    layers = _layers(board, diffusion_s)
    rows = slice(None, None, EVERY_S)
    columns: dict[str, NDArray[Any]] = {
        "time_s": time[rows].astype(np.int64),
        "temp_case_degc": noise.reading(board, 0.0625, 0.02, rng)[rows],
    }
    truth: dict[str, object] = {}
    for name in SIZES:
        channel = _draw(name, rng)
        drift = true_drift(channel, layers)
        random = rng.normal(0.0, channel.white, time.size)
        random += noise.flicker(channel.flicker, time.size, rng)
        indication = ATTITUDE_G.get(name, 0.0) + channel.bias + drift + random
        columns[name] = indication.reshape(-1)[rows]
        truth[name] = asdict(channel) | {"drift": np.round(drift[::60], 8).tolist()}
    facts = {
        "procedure": "thermal",
        "seed": seed,
        "lag_of_thermometer_s": lag_s,
        "diffusion_s": diffusion_s,
        "sweep_degc": SWEEP_DEGC,
        "drift_reference": "drift is that of the sensor at rest at 25 degC, less bias and noise",
        "time_s": time[::60].tolist(),
        "board_degc": np.round(board[::60], 3).tolist(),
        "channels": truth,
    }
    return Campaign({"sweep.csv": columns}, DECIMALS, facts)


CAMPAIGNS = {"fog_thermal": simulate_fog.campaign, "thermal": campaign}
