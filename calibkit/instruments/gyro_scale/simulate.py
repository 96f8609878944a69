"""Simulated campaigns of gyros on a rate table, by name: one gyro over temperature, two on one base
about the axis of each, three about each axis of their base at several temperatures. The table
accelerates between rates, turns unevenly and rotates with the earth; the gyros are slightly
nonlinear.

    F = K (1 + k_T ΔT) (ω + r sin(2π ω/P) + a |ω|/2 + b + b_T ΔT)                            (1)
    ω = u_3 (dθ/dt + ω_E sin φ) + ω_E cos φ (u_1 cos θ − u_2 sin θ)                          (2)

F indication, ω rate about the input axis u, which a filter of the first order lags, ΔT = T − 25 °C,
r and P the ripple of the closed loop, a the asymmetry, b the bias; θ angle of the table, ω_E the
earth's rate, φ the latitude. Counts are whole, with white noise.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Self

import numpy as np

from calibkit.numeric.arrays import Array
from calibkit.numeric.constants import DPH_PER_DPS, EARTH_RATE_DPH
from calibkit.simulate import noise
from calibkit.simulate.campaign import Campaign

EARTH_RATE_DPS = EARTH_RATE_DPH / DPH_PER_DPS
REFERENCE_DEGC = 25.0
RATES_DPS = (1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 80.0, 100.0)
"""Rates that the table holds in each direction [°/s]."""
DECIMALS = {
    "time_s": 1,
    "table_rate_dps": 6,
    "table_angle_deg": 4,
    "temp_case_degc": 2,
    "gyro_x_lsb": 1,
    "gyro_a_lsb": 1,
    "gyro_b_lsb": 1,
}
FINE = 10
"""Integration steps of the simulated motion per sampling interval."""
AXES = ("a_about_a", "b_about_a", "b_about_b", "a_about_b")
"""Keys <gyro>_about_<table axis> of the input axes of both gyros in both runs."""
GYROS = ("x", "y", "z")
TRIAD_RATES_DPS = (2.0, 5.0, 10.0, 20.0, 40.0, 60.0, 80.0, 100.0)
"""Rates that the table holds in each direction about each of three axes [°/s]."""


@dataclass(frozen=True, slots=True)
class RateGyro:
    """Constants of one gyro on the table.

    Attributes
    ----------
    K : scale factor at 25 °C without the terms below [1/s/(°/s)].
    axis : input axis, a unit vector: two components that turn with the table, and the one along
        the table axis.
    K_per_degc : relative change of the scale factor [1/°C].
    ripple_dps : amplitude of the error of the closed loop's phase ramp [°/s].
    asymmetry : relative difference of the scale factors of positive and negative rates.
    noise_lsb : standard deviation of one sample [1/s].
    lag_s : time constant of the output filter.

    """

    K: float
    axis: tuple[float, float, float]
    K_per_degc: float
    ripple_dps: float
    ripple_period_dps: float
    asymmetry: float
    bias_dps: float
    bias_dps_per_degc: float
    noise_lsb: float
    lag_s: float

    def indicate(self, rate_dps: Array, temp_degc: Array | float) -> Array:
        """Noise-free static indication [1/s] at a rate [°/s] about the input axis, by (1)."""
        warmer = np.asarray(temp_degc) - REFERENCE_DEGC
        ripple = np.sin(2.0 * np.pi * rate_dps / self.ripple_period_dps)
        bent_dps = rate_dps + self.ripple_dps * ripple + 0.5 * self.asymmetry * np.abs(rate_dps)
        indicated_dps = bent_dps + self.bias_dps + self.bias_dps_per_degc * warmer
        return np.asarray(self.K * (1.0 + self.K_per_degc * warmer) * indicated_dps)

    def best_line(
        self, table: "TurnedTable", rates_dps: Sequence[float], temp_degc: float
    ) -> tuple[float, float]:
        """Slope [1/s/(°/s)] and intercept [1/s] of the noise-free least-squares line over table
        rates.
        """
        rates = np.array(rates_dps)
        vertical = EARTH_RATE_DPS * np.sin(np.radians(table.latitude_deg))
        # over a whole revolution the horizontal part of the earth's rate averages to zero, to first
        # order
        F = self.indicate((rates + vertical) * self.axis[2], temp_degc)
        slope, intercept = np.polyfit(rates, F, 1)
        return float(slope), float(intercept)

    @classmethod
    def draw(
        cls,
        rng: np.random.Generator,
        *,
        axis: tuple[float, float, float] = (0.0, 0.0, 1.0),
        noise_lsb: float = 3.0,
    ) -> Self:
        """Draw a closed-loop gyro of a few ppm nonlinearity."""
        return cls(
            K=10000.0 * (1.0 + rng.normal(0.0, 0.01)),
            axis=axis,
            K_per_degc=rng.normal(0.0, 1.0) * 10e-6,
            ripple_dps=rng.uniform(0.5e-4, 2e-4),
            ripple_period_dps=rng.uniform(25.0, 60.0),
            asymmetry=rng.normal(0.0, 1.0) * 1e-6,
            bias_dps=rng.normal(0.0, 1.0) / DPH_PER_DPS,
            bias_dps_per_degc=rng.normal(0.0, 0.01) / DPH_PER_DPS,
            noise_lsb=noise_lsb,
            lag_s=rng.uniform(0.02, 0.1),
        )


@dataclass(frozen=True, slots=True)
class TurnedTable:
    """Constants of a rate table with a vertical axis and of its room.

    Attributes
    ----------
    unevenness : relative amplitude of the rate's variation within a revolution.
    interval_s : sampling interval [s].
    warming_degc : total warming of the case [°C], from the first sample to the steady state.

    """

    latitude_deg: float = 34.2
    acceleration_dps2: float = 20.0
    unevenness: float = 1e-5
    interval_s: float = 0.5
    shortest_hold_s: float = 30.0
    start_angle_deg: float = 0.0
    warming_degc: float = 0.2
    warming_s: float = 1200.0


def run(
    gyros: Mapping[str, RateGyro],
    table: TurnedTable,
    rates_dps: Sequence[float],
    start_degc: float,
    rng: np.random.Generator,
) -> dict[str, Array]:
    """Log columns of the table turning through held rates [°/s], at rest before the first and after
    the last, with one column per gyro: whole counts in each sampling interval over its length.
    """
    from scipy.signal import lfilter

    corners, corner_rates = [0.0, 3.0], [0.0, 0.0]
    for rate in (*rates_dps, 0.0):
        begin = corners[-1] + abs(rate - corner_rates[-1]) / table.acceleration_dps2
        # hold time beyond a whole revolution, for settling
        hold_s = max(table.shortest_hold_s, 6.0 + 1.02 * (360.0 / abs(rate))) if rate else 3.0
        corners += [begin, begin + hold_s]
        corner_rates += [rate, rate]
    step = table.interval_s / FINE
    count = int(np.floor(corners[-1] / table.interval_s)) * FINE
    time = np.arange(count + 1) * step
    nominal_dps = np.interp(time, corners, corner_rates)
    nominal = np.radians(table.start_angle_deg + _integral(nominal_dps, step))
    uneven = table.unevenness * (np.sin(nominal) + 0.4 * np.cos(2.0 * nominal))
    angle_deg = table.start_angle_deg + _integral(nominal_dps * (1.0 + uneven), step)

    end_s, logged_deg = time[FINE::FINE], angle_deg[::FINE]
    case = start_degc + table.warming_degc * (1.0 - np.exp(-end_s / table.warming_s))
    encoder = logged_deg + rng.normal(0.0, 2e-5, logged_deg.size)
    columns = {
        "time_s": end_s,
        "table_rate_dps": np.diff(logged_deg) / table.interval_s,
        "table_angle_deg": np.remainder(encoder.round(DECIMALS["table_angle_deg"])[1:], 360.0),
        "temp_case_degc": noise.reading(case, 0.01, 0.01, rng),
    }
    # (2) in the middle of each fine step
    middle = np.radians(0.5 * (angle_deg[1:] + angle_deg[:-1]))
    latitude = np.radians(table.latitude_deg)
    axial_dps = np.diff(angle_deg) / step + EARTH_RATE_DPS * np.sin(latitude)
    level_dps = EARTH_RATE_DPS * np.cos(latitude)
    for name, gyro in gyros.items():
        u_1, u_2, u_3 = gyro.axis
        across_dps = u_1 * level_dps * np.cos(middle) - u_2 * level_dps * np.sin(middle)
        rate_dps = across_dps + u_3 * axial_dps
        keep = np.exp(-step / gyro.lag_s)
        lagging = lfilter([1.0 - keep], [1.0, -keep], rate_dps - rate_dps[0]) + rate_dps[0]
        F = gyro.indicate(lagging, np.repeat(case, FINE)).reshape(-1, FINE).mean(axis=1)
        noisy = F + gyro.noise_lsb * rng.normal(0.0, 1.0, F.size)
        columns[name] = noise.pulses(noisy, 1.0 / table.interval_s)
    return columns


def _integral(rate: Array, step: float) -> Array:
    """Integral [k + 1] of a rate [k + 1] from its first value, by the trapezoidal rule."""
    return np.concatenate(([0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1])) * step))


def turn(
    gyros: Mapping[str, RateGyro],
    table: TurnedTable,
    rates_dps: Sequence[float],
    start_degc: float,
    rng: np.random.Generator,
) -> tuple[dict[str, Array], float, dict[str, tuple[float, float]]]:
    """Log columns of gyros by name, mean case temperature [°C], and the best straight line of each
    gyro at it.
    """
    columns = {f"gyro_{name}_lsb": gyro for name, gyro in gyros.items()}
    log = run(columns, table, rates_dps, start_degc, rng)
    degc = float(np.mean(log["temp_case_degc"]))
    return log, degc, {name: g.best_line(table, rates_dps, degc) for name, g in gyros.items()}


def both_ways(rates_dps: Sequence[float] = RATES_DPS) -> tuple[float, ...]:
    """Rates in increasing order in one direction, then in the other."""
    return (*rates_dps, *(-rate for rate in rates_dps))


def tilted(degrees: float, direction_deg: float) -> tuple[float, float, float]:
    """Unit vector at an angle [°] to the table axis, in a direction [°] about it."""
    tilt, azimuth = np.radians(degrees), np.radians(direction_deg)
    x, y = np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth)
    return float(x), float(y), float(np.cos(tilt))


def rate_table(
    seed: int, *, room_runs: int = 3, temperatures_degc: Sequence[float] = (-40.0, 0.0, 60.0)
) -> Campaign:
    """Simulate rate-table logs of one gyro: repeated runs at 25 °C, then one at each other
    temperature.

    Parameters
    ----------
    seed : what gyro, table and noise are drawn from.
    room_runs : runs at 25 °C, for repeatability.
    temperatures_degc : of the other runs [°C].

    Returns
    -------
    Logs `room_1.csv` … and `at_-40.csv` …; truth with the gyro's constants and each run's best
    straight line.

    """
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    gyro = RateGyro.draw(rng, axis=tilted(rng.uniform(0.0, 0.3), rng.uniform(0.0, 360.0)))
    table = TurnedTable(interval_s=1.0, start_angle_deg=rng.uniform(0.0, 360.0))
    planned = {f"room_{k + 1}.csv": REFERENCE_DEGC for k in range(room_runs)}
    planned |= {f"at_{degc:.0f}.csv": degc for degc in temperatures_degc}
    rates = both_ways()
    logs: dict[str, dict[str, Array]] = {}
    lines: dict[str, dict[str, object]] = {}
    for name, degc in planned.items():
        logs[name], mean, of_gyro = turn({"x": gyro}, table, rates, degc, rng)
        K, F0 = of_gyro["x"]
        lines[name] = {"temp_case_degc": mean, "gyro_x_lsb": {"K": K, "F0": F0}}
    truth = {
        "procedure": "rate_table",
        "seed": seed,
        "gyro": asdict(gyro),
        "table": asdict(table),
        "rates_dps": rates,
        "logs": lines,
    }
    return Campaign(logs, DECIMALS, truth)


def pair(
    seed: int,
    *,
    alpha_deg: float | None = None,
    noise_lsb: float = 3.0,
    rates_dps: Sequence[float] | None = None,
    ideal: bool = False,
    table: TurnedTable | None = None,
) -> Campaign:
    """Simulate `table_axis_a.csv` and `table_axis_b.csv`, each with both gyros.

    Parameters
    ----------
    seed : what gyros, table and noise are drawn from.
    alpha_deg : angle of B's input axis to the table axis of the first run [°]; near 90° by default.
    noise_lsb : standard deviation of one sample [1/s].
    rates_dps : signed rates that the table holds, in order; 11 each way by default.
    ideal : straight-line gyros mounted without error: what the fitted model can represent exactly.
    table : the table and its place.

    Returns
    -------
    Truth: constants, axes, and for each model of the coefficient file the best straight line at its
    run's temperature; `gamma` and `alpha_deg` from the axes, `N` and `epsilon` from the lines.

    """
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    alpha = 90.0 + float(rng.normal(0.0, 1.0)) * 0.3 if alpha_deg is None else alpha_deg
    # of a gyro's input axis against the table axis nominally its own [°]
    mounting = np.zeros(2) if ideal else rng.uniform(0.0, 0.02, 2)
    tilts = (mounting[0], alpha, mounting[1], alpha)
    # by gyro and run: each run has its own orientation about its table axis
    directions = {
        name: tilted(tilt, direction_deg)
        for name, tilt, direction_deg in zip(AXES, tilts, rng.uniform(0.0, 360.0, 4), strict=True)
    }
    gyros = {name: RateGyro.draw(rng, noise_lsb=noise_lsb) for name in ("a", "b")}
    if ideal:
        for name, gyro in gyros.items():
            straight = replace(gyro, ripple_dps=0.0, asymmetry=0.0)
            gyros[name] = replace(straight, K_per_degc=0.0, bias_dps_per_degc=0.0)
    rates = both_ways() if rates_dps is None else tuple(rates_dps)
    stand = table or TurnedTable(start_angle_deg=rng.uniform(0.0, 360.0))
    logs: dict[str, dict[str, Array]] = {}
    lines: dict[str, dict[str, float]] = {}
    for axis in ("a", "b"):
        mounted = {g: replace(gyros[g], axis=directions[f"{g}_about_{axis}"]) for g in ("a", "b")}
        log, degc, of_gyros = turn(mounted, stand, rates, REFERENCE_DEGC, rng)
        logs[f"table_axis_{axis}.csv"] = log
        for g, (K, F0) in of_gyros.items():
            lines[f"{g}_about_{axis}"] = {"K": K, "F0": F0, "temp_case_degc": degc}
    gamma = float(np.cos(np.radians(alpha)))
    truth = {
        "procedure": "gyro_pair",
        "seed": seed,
        "gyros": {name: asdict(gyro) for name, gyro in gyros.items()},
        "axes": directions,
        "table": asdict(stand),
        "rates_dps": rates,
        "models": lines,
        "alpha_deg": alpha,
        "gamma": gamma,
        "N": lines["b_about_b"]["K"] / lines["a_about_a"]["K"],
        "epsilon": lines["b_about_a"]["K"] / lines["a_about_a"]["K"],
        "side": "same" if gamma >= 0.0 else "opposite",
    }
    return Campaign(logs, DECIMALS, truth)


def triad(
    seed: int,
    *,
    temperatures_degc: Sequence[float] = (-40.0, 0.0, 25.0, 60.0),
    withheld_degc: Sequence[float] = (40.0,),
    rates_dps: Sequence[float] | None = None,
    noise_lsb: float = 3.0,
) -> Campaign:
    """Logs `about_x_25.csv` … of three gyros, all logged in every log, and
    `withheld/about_x_40.csv` … not to be fitted.

    Parameters
    ----------
    seed : what gyros, axes, table and noise are drawn from.
    temperatures_degc : of the chamber on the table [°C]; a log about each axis at each.
    withheld_degc : temperatures of runs for validation [°C].
    rates_dps : signed rates that the table holds, in order; 8 each way by default.
    noise_lsb : standard deviation of one sample [1/s].

    Returns
    -------
    Truth: constants, and at each temperature the sensitivities (best straight line of each gyro
    about each axis), the input axes and the angles between them [°].

    """
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    # input axes are up to 0.3° off the base axes that they are named after
    tilts = np.tan(np.radians(0.3)) * rng.uniform(-1.0, 1.0, (3, 3)) / np.sqrt(2.0)
    axes = _normalise(np.eye(3) + tilts * (1.0 - np.eye(3)))
    # and turn by up to 0.02° over 100 °C
    turns = np.radians(0.02) * rng.uniform(-1.0, 1.0, (3, 3))
    gyros = {name: RateGyro.draw(rng, noise_lsb=noise_lsb) for name in GYROS}
    table = TurnedTable(interval_s=1.0, start_angle_deg=rng.uniform(0.0, 360.0))
    rates = both_ways(TRIAD_RATES_DPS) if rates_dps is None else tuple(rates_dps)
    logs: dict[str, dict[str, Array]] = {}
    truths: dict[str, dict[str, list[list[float]]]] = {}
    for degc in (*temperatures_degc, *withheld_degc):
        folder = "" if degc in temperatures_degc else "withheld/"
        warmer = (degc - REFERENCE_DEGC) / 100.0
        # input axes turn with temperature, a little more the warmer it is
        directions = _normalise(axes + turns * (warmer * (1.0 + 0.15 * warmer)))
        sensitivity = np.zeros((3, 3))
        for axis, name in enumerate(GYROS):
            # in table axes: two components that turn with the table, and one along its axis
            table_directions = np.roll(directions, 2 - axis, axis=1).tolist()
            mounted = {
                g: replace(gyro, axis=tuple(direction))
                for (g, gyro), direction in zip(gyros.items(), table_directions, strict=True)
            }
            log, _, lines = turn(mounted, table, rates, degc, rng)
            logs[f"{folder}about_{name}_{degc:.0f}.csv"] = log
            sensitivity[:, axis] = [K for K, _ in lines.values()]
        cosines = np.clip(directions @ directions.T, -1.0, 1.0)
        truths[f"{degc:.0f}"] = {
            "sensitivity": sensitivity.tolist(),
            "axes": directions.tolist(),
            "angles_deg": np.degrees(np.arccos(cosines)).tolist(),
        }
    truth = {
        "procedure": "gyro_triad",
        "seed": seed,
        "gyros": {name: asdict(gyro) for name, gyro in gyros.items()},
        "table": asdict(table),
        "rates_dps": rates,
        "at": truths,
    }
    decimals = DECIMALS | {f"gyro_{g}_lsb": 1 for g in GYROS}
    return Campaign(logs, decimals, truth)


def _normalise(vectors: Array) -> Array:
    """Rows of vectors [3, 3] scaled to unit length."""
    return np.array([vector / np.linalg.norm(vector) for vector in vectors])


CAMPAIGNS = {"gyro_pair": pair, "gyro_triad": triad, "rate_table": rate_table}
