"""A north-seeking inclinometer read in four positions, with scale factors that vary with
temperature and biases that drift in time.
"""

from dataclasses import asdict, dataclass

import numpy as np

from calibkit.numeric import earth
from calibkit.numeric.arrays import Array, Integers
from calibkit.simulate.campaign import Campaign

REFERENCE_DEGC = 25.0
POSITIONS_DEG = np.array([0, 90, 180, 270])
DECIMALS = {
    "time_s": 1,
    "temp_case_degc": 2,
    "accel_x_g": 7,
    "accel_y_g": 7,
    "gyro_x_dph": 5,
    "gyro_y_dph": 5,
}
REFERENCE = ("inclination_deg", "toolface_deg", "azimuth_deg")
"""Columns of the reference attitude of withheld stations."""


Pair = dict[str, float]
"""Constants of one gyro and one accelerometer on one axis."""


@dataclass(frozen=True, slots=True)
class Tool:
    """An inclinometer and the timing of its readings."""

    pairs: tuple[Pair, Pair]
    index_deg: float = 0.01
    """Standard deviation of the four positions about their nominal angles [°]."""
    dwell_s: float = 60.0
    station_s: float = 600.0

    def stations(
        self,
        attitudes: Array,
        latitude_deg: float,
        temp_degc: Array,
        rng: np.random.Generator,
    ) -> tuple[dict[str, Array | Integers], Array]:
        """Log columns of n stations of attitudes [n, 3, °], four rows per station, and the true
        scale factors of both pairs [n, 2].
        """
        gravity = rotated(attitudes, np.array([0.0, 0.0, 1.0]))
        rate = rotated(attitudes, earth.north_east_down(latitude_deg))
        count = temp_degc.size
        true_deg = POSITIONS_DEG + self.index_deg * rng.normal(0.0, 1.0, (count, 4))
        numbers = np.arange(count)
        columns: dict[str, Array | Integers] = {
            "station": np.repeat(numbers + 1, 4),
            "position_deg": np.tile(POSITIONS_DEG, count),
            "time_s": (numbers[:, None] * self.station_s + np.arange(4) * self.dwell_s).ravel(),
            "temp_case_degc": np.repeat(temp_degc, 4),
        }
        # in-situ scale factors [n, 2]
        warmer = temp_degc - REFERENCE_DEGC
        scales = np.empty((count, 2))
        for j, pair in enumerate(self.pairs):
            wave = pair["s_wave"] * np.sin(2.0 * np.pi * warmer / pair["s_wave_degc"])
            repeat = pair["s_repeat"] * rng.normal(0.0, 1.0, count)
            scales[:, j] = pair["s"] + pair["s_per_degc"] * warmer + wave + repeat
        gyros = {}
        for j, (axis, pair) in enumerate(zip("xy", self.pairs, strict=True)):
            direction, tilt = 90.0 * j + true_deg + pair["axis_deg"], pair["axis_tilt_deg"]
            accel = resolve_along(gravity, direction, tilt) * (1.0 + pair["accel_scale"])
            accel += pair["accel_bias_g"]
            bias = pair["bias_dph"] + pair["bias_dph_per_degc"] * warmer
            walk = np.cumsum(pair["bias_walk_dph"] * rng.normal(0.0, 1.0, (count, 4)), axis=1)
            # against its accelerometer a gyro is turned in campaigns of a plan alone
            gyro_direction = direction + pair.get("gyro_turn_deg", 0.0)
            gyro = resolve_along(rate, gyro_direction, tilt) / scales[:, j, None]
            gyro += bias[:, None] + walk
            noise = rng.normal(0.0, 1.0, (2, count, 4))
            columns[f"accel_{axis}_g"] = (accel + pair["accel_noise_g"] * noise[0]).ravel()
            gyros[f"gyro_{axis}_dph"] = (gyro + pair["gyro_noise_dph"] * noise[1]).ravel()
        columns |= gyros
        return columns, scales


def draw_attitudes(
    count: int, inclination_deg: tuple[float, float], rng: np.random.Generator
) -> Array:
    """True attitudes [n, 3] of stations [°], columns of `REFERENCE`: inclination uniform over a
    range [°], toolface and azimuth uniform over the circle.
    """
    inclination = rng.uniform(*inclination_deg, count)
    toolface = rng.uniform(-180.0, 180.0, count)
    return np.column_stack([inclination, toolface, rng.uniform(0.0, 360.0, count)])


def draw(rng: np.random.Generator, *, gyro_noise_dph: float, ideal: bool) -> Pair:
    """Draw a sensor pair; an ideal one has only a scale factor, a constant bias and noise."""
    drift = 0.0 if ideal else 1.0
    return {
        # in-situ scale factor at 25 °C, by which the reading is multiplied
        "s": 1.0 + rng.normal(0.0, 1.0) * 3e-3,
        "s_per_degc": drift * rng.normal(0.0, 1.0) * 3e-5,
        # periodic departure of s from a straight line in temperature, amplitude and period
        "s_wave": drift * 1e-4,
        "s_wave_degc": rng.uniform(40.0, 70.0),
        # standard deviation of s from one station to the next
        "s_repeat": drift * 2e-5,
        "bias_dph": rng.normal(0.0, 1.0) * 0.3,
        "bias_dph_per_degc": drift * rng.normal(0.0, 1.0) * 2e-3,
        # standard deviation of the bias's change from one position to the next
        "bias_walk_dph": drift * 1e-3,
        # standard deviation of one reading
        "gyro_noise_dph": gyro_noise_dph,
        # relative scale error of the accelerometer
        "accel_scale": drift * rng.normal(0.0, 1.0) * 3e-5,
        "accel_bias_g": rng.normal(0.0, 1.0) * 1e-3,
        "accel_noise_g": 2e-5,
        # departure of the pair's axis from its nominal direction about the tool, and out of the
        # plane across it
        "axis_deg": drift * rng.normal(0.0, 1.0) * 5e-3,
        "axis_tilt_deg": drift * rng.normal(0.0, 1.0) * 5e-3,
    }


def rotated(attitudes: Array, north_east_down: Array) -> Array:
    """Vector [3] in the axes of the tool at attitudes [n, 3, °]: R_z(φ) R_y(θ) R_z(ψ), passive."""
    theta, phi, psi = np.radians(attitudes).T
    north, east, down = north_east_down
    x = north * np.cos(psi) + east * np.sin(psi)
    y = east * np.cos(psi) - north * np.sin(psi)
    x, z = x * np.cos(theta) - down * np.sin(theta), x * np.sin(theta) + down * np.cos(theta)
    return np.column_stack(
        (x * np.cos(phi) + y * np.sin(phi), y * np.cos(phi) - x * np.sin(phi), z)
    )


def resolve_along(vectors: Array, direction_deg: Array, tilt_deg: float) -> Array:
    """Components [n, 4] of vectors [n, 3] along a sensor axis at directions [n, 4] [°] about the
    tool axis, tilted out of the plane across the tool.
    """
    angle, tilt = np.radians(direction_deg), np.radians(tilt_deg)
    across_tool = vectors[:, :1] * np.cos(angle) + vectors[:, 1:2] * np.sin(angle)
    return np.asarray(across_tool * np.cos(tilt) + vectors[:, 2:] * np.sin(tilt), dtype=np.float64)


def campaign(
    seed: int,
    *,
    count: int = 36,
    latitude_deg: float = 34.2,
    inclination_deg: tuple[float, float] = (5.0, 50.0),
    temperature_degc: tuple[float, float] = (20.0, 120.0),
    gyro_noise_dph: float = 0.01,
    ideal: bool = False,
) -> Campaign:
    """Simulate `stations.csv`: random attitudes while the tool warms, two sensor pairs in four
    positions each.

    Parameters
    ----------
    seed : what tool, attitudes and noise are drawn from.
    count : stations.
    latitude_deg : of the place [°].
    inclination_deg, temperature_degc : ranges [°] and [°C].
    gyro_noise_dph : standard deviation of one reading [°/h].
    ideal : sensor pairs with a constant scale factor, constant bias and noise alone, in exact
        positions.

    Returns
    -------
    Truth: constants, and for each station attitude, temperature and the scale factors of both
    pairs.

    """
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    first, second = (draw(rng, gyro_noise_dph=gyro_noise_dph, ideal=ideal) for _ in range(2))
    tool = Tool((first, second), index_deg=0.0 if ideal else 0.01)
    logs: dict[str, dict[str, Array | Integers]] = {}
    truths: dict[str, dict[str, object]] = {}
    # the withheld stations are measured on another day, where the reference attitude is known
    days = {"": rng, "withheld/": np.random.default_rng(np.random.SeedSequence([seed, 1]))}
    for folder, day_rng in days.items():
        attitudes = draw_attitudes(count, inclination_deg, day_rng)
        degc = np.linspace(*temperature_degc, count) + day_rng.normal(0.0, 1.0, count)
        temperature = np.round(degc, 2)
        columns, scales = tool.stations(attitudes, latitude_deg, temperature, day_rng)
        angles = dict(zip(REFERENCE, attitudes.T, strict=True))
        truths[folder] = {
            "station": np.arange(1, count + 1).tolist(),
            **{name: angle.tolist() for name, angle in angles.items()},
            "temp_case_degc": temperature.tolist(),
            "s_x": scales[:, 0].tolist(),
            "s_y": scales[:, 1].tolist(),
        }
        if folder:
            columns |= {name: np.repeat(angle, 4) for name, angle in angles.items()}
        logs[f"{folder}stations.csv"] = columns
    truth: dict[str, object] = {
        "procedure": "inclinometer",
        "seed": seed,
        "latitude_deg": latitude_deg,
        "tool": asdict(tool),
        "stations": truths[""],
        "withheld": {name: truths["withheld/"][name] for name in ("s_x", "s_y")},
    }
    return Campaign(logs, DECIMALS | dict.fromkeys(REFERENCE, 4), truth)


CAMPAIGNS = {"inclinometer": campaign}
