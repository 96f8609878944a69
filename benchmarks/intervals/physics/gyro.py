"""Gyros on a rate table: faults that move scale factors, their ratio, and the axes.

A log has one row per held rate, the mean over the hold. The truth is the device's own: its scale
factor without the error of a run, or the best straight line over the held rates of one whose
response is bent.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from intervals.physics.campaigns import Applied, Campaign, Fault, Truth

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

PPM, EARTH_DPS, LATITUDE_DEG, ROOM_DEGC = 1e-6, 15.041 / 3600.0, 34.2, 25.0
RATES_DPS = np.linspace(-100.0, 100.0, 17)
HOLD_S, WARMING_S = 40.0, 300.0
NOISE_DPS, LOW_NOISE_DPS = 2.6e-4, 5e-5
"""Of the mean over a held rate; scale factors of one run are known to 1 and to 0.2 ppm."""
MISALIGNED_RAD = 3e-3
OPEN_LOOP_PER_DEGC = -4e-4
"""Relative change of the scale factor of an open-loop gyro: light source and detector drift."""
LEFT_BY_FIFTH_ORDER_DPS = 0.05
"""Largest error of a compensated rate: `apply` states no uncertainty of it, and a polynomial of
fifth order whose coefficients follow temperature leaves 0.03 °/s of a sine to ± 150 °/s.
"""
GYROS = "xyz"
N, K, K_CURVE, CROSS, BIAS = "N", "K", "K(T)", "misalignment", "bias"


@dataclass(frozen=True)
class Gyro:
    """Constants of a gyro whose response is a sine."""

    K: float
    """Slope at rest at 25 °C [1/s/(°/s)]."""
    axis: Array
    """Input axis [3], a unit vector."""
    per_degc: float
    """Relative change of K [1/°C]."""
    per_degc2: float
    """Relative bend of K [1/°C²]."""
    bias_dps: float
    bias_per_degc: float
    """Change of the bias [°/s/°C]."""
    top_dps: float = np.inf
    """Rate Ω0 of the response F = K Ω0 sin(Ω/Ω0) at 25 °C; infinite where F = K Ω."""
    top_per_degc: float = 0.0
    """Relative change of Ω0 [1/°C]."""

    def scale(self, degc: Any) -> Any:  # noqa: ANN401 (a number or an array)
        """Slope at rest at temperatures [1/s/(°/s)]."""
        warm = degc - ROOM_DEGC
        return self.K * (1.0 + self.per_degc * warm + self.per_degc2 * warm**2)

    def indication(self, rate_dps: Array, degc: Array) -> Array:
        """Indication [n] [1/s] at rates about the input axis and temperatures [n]."""
        warm = degc - ROOM_DEGC
        rate = rate_dps + self.bias_dps + self.bias_per_degc * warm
        if np.isfinite(self.top_dps):
            top = self.top_dps * (1.0 + self.top_per_degc * warm)
            rate = top * np.sin(rate / top)
        return np.asarray(self.scale(degc) * rate)

    def best_slope(self, rates_dps: Array, degc: float) -> float:
        """Slope of the least-squares line over table rates at one temperature."""
        indication = self.indication(rates_dps, np.full(rates_dps.size, degc))
        return float(np.polyfit(rates_dps, indication, 1)[0])


def draw(rng: np.random.Generator, axis: Array, **response: float) -> Gyro:
    """A gyro with an axis of any length."""
    return Gyro(
        10_000.0 * (1.0 + rng.normal(0.0, 0.01)),
        axis / np.linalg.norm(axis),
        rng.normal(0.0, 10e-6),
        0.0,
        rng.normal(0.0, 1.0) / 3600.0,
        rng.normal(0.0, 0.01) / 3600.0,
        **response,
    )


def log_run(
    rng: np.random.Generator,
    gyros: Mapping[str, Gyro],
    turned: Array,
    degc: Array | float = ROOM_DEGC,
    *,
    rates_dps: Array = RATES_DPS,
    scale_error: Mapping[str, Array | float] | None = None,
    zero_dps: Mapping[str, Array | float] | None = None,
    noise_dps: float = NOISE_DPS,
    interval_s: float = HOLD_S,
) -> pd.DataFrame:
    """Log of a table that turns about an axis [3] in space through rates in the order given.

    Parameters
    ----------
    degc : case temperature of the held rates, [n] or one [°C].
    scale_error : gyro → relative error of its scale factor in this run, [n] or one.
    zero_dps : gyro → error of its bias in this run, [n] or one [°/s].
    noise_dps : standard deviation of a row, the mean over a held rate [°/s].
    interval_s : time from row to row.

    """
    degc = np.broadcast_to(np.asarray(degc, dtype=np.float64), rates_dps.shape)
    frame = {"time_s": interval_s * (np.arange(rates_dps.size) + 0.5)}
    frame |= {"table_rate_dps": rates_dps, "temp_case_degc": degc}
    rate = rates_dps + EARTH_DPS * np.sin(np.radians(LATITUDE_DEG))
    for name, gyro in gyros.items():
        zero = (zero_dps or {}).get(name, 0.0)
        indication = gyro.indication(rate * float(gyro.axis @ turned) + zero, degc)
        indication = indication * (1.0 + np.asarray((scale_error or {}).get(name, 0.0)))
        noise = gyro.K * noise_dps * rng.normal(size=rate.size)
        frame[f"gyro_{name}_lsb"] = indication + noise
    return pd.DataFrame(frame)


def _recipe(procedure: str, **tables: object) -> dict[str, object]:
    """Recipe of logs with one row per held rate."""
    return {
        "procedure": procedure,
        "logs": {"files": ["*.csv"]},
        "site": {"latitude_deg": LATITUDE_DEG},
        "plateaus": {"one_row": True},
        **tables,
    }


def _pair(rng: np.random.Generator, size: float) -> Campaign:
    """Two gyros, a run about the axis of each; scale factors repeat to `size` ppm."""
    alpha = np.radians(90.0 + rng.normal(0.0, 0.2))
    axes = {"a": np.array([0.0, 0.0, 1.0]), "b": np.array([np.sin(alpha), 0.0, np.cos(alpha)])}
    gyros = {name: draw(rng, axis) for name, axis in axes.items()}
    logs = {}
    for name, axis in axes.items():
        errors = dict(zip(gyros, size * PPM * rng.normal(size=2), strict=True))
        logs[f"{name}.csv"] = log_run(rng, gyros, axis, scale_error=errors, noise_dps=LOW_NOISE_DPS)
    recipe = _recipe("gyro_pair", pair={"axis_a": "a.csv", "axis_b": "b.csv"})
    return Campaign(recipe, logs, [Truth(N, "pair.N", gyros["b"].K / gyros["a"].K)])


def _draw_triad(rng: np.random.Generator) -> dict[str, Gyro]:
    """Three gyros nearly along the axes of their base."""
    axes = np.eye(3) + rng.normal(0.0, MISALIGNED_RAD, (3, 3))
    return {name: draw(rng, axis) for name, axis in zip(GYROS, axes, strict=True)}


def _log_triad(
    rng: np.random.Generator,
    gyros: Mapping[str, Gyro],
    degc: Sequence[float],
    *,
    scale_ppm: float = 0.0,
    zero_dph: float = 0.0,
) -> dict[str, pd.DataFrame]:
    """A run about each axis of the base at each temperature; scale factors and biases repeat to
    given standard deviations.
    """
    logs = {}
    for number, soak_degc in enumerate(degc):
        for name, axis in zip(GYROS, np.eye(3), strict=True):
            errors = dict(zip(gyros, scale_ppm * PPM * rng.normal(size=3), strict=True))
            zeros = dict(zip(gyros, zero_dph / 3600.0 * rng.normal(size=3), strict=True))
            logs[f"about_{name}_{number}.csv"] = log_run(
                rng,
                gyros,
                axis,
                soak_degc,
                scale_error=errors,
                zero_dps=zeros,
                noise_dps=LOW_NOISE_DPS,
            )
    return logs


def _triad_recipe() -> dict[str, object]:
    """Recipe of a triad."""
    return _recipe("gyro_triad", axes={name: [f"about_{name}*.csv"] for name in GYROS})


def _triad(rng: np.random.Generator, size: float) -> Campaign:
    """One run about each axis; scale factors repeat to `size` ppm."""
    gyros = _draw_triad(rng)
    logs = _log_triad(rng, gyros, (ROOM_DEGC,), scale_ppm=size)
    truth = [Truth(K, f"scale_factor.{name}", gyro.K) for name, gyro in gyros.items()]
    return Campaign(_triad_recipe(), logs, truth)


def _three_runs(rng: np.random.Generator, size: float) -> Campaign:
    """Three runs about each axis; scale factors repeat to `size` ppm, biases to 0.1 × size °/h."""
    gyros = _draw_triad(rng)
    logs = _log_triad(rng, gyros, (ROOM_DEGC,) * 3, scale_ppm=size, zero_dph=0.1 * size)
    truth = [Truth(K, f"scale_factor.{name}", gyro.K) for name, gyro in gyros.items()]
    for name, gyro in gyros.items():
        truth.append(Truth(BIAS, f"bias.{name}", 3600.0 * gyro.bias_dps))
    return Campaign(_triad_recipe(), logs, truth)


def _twelve_runs(rng: np.random.Generator) -> Campaign:
    """Runs of a triad about three axes at four temperatures."""
    gyros = _draw_triad(rng)
    logs = _log_triad(rng, gyros, (-40.0, 0.0, ROOM_DEGC, 60.0))
    truth = [
        Truth(CROSS, f"misalignment.{name}{axis}{suffix}", float(gyro.axis[k]))
        for suffix in ("", ".at_-40", ".at_0", ".at_60")
        for name, gyro in gyros.items()
        for k, axis in enumerate(GYROS)
        if name != axis
    ]
    return Campaign(_triad_recipe(), logs, truth)


def _sign(rng: np.random.Generator, size: float) -> Campaign:
    """Twelve runs of a triad; with a size of 1 the sign of y is turned in one about x."""
    campaign = _twelve_runs(rng)
    campaign.logs["about_x_3.csv"]["gyro_y_lsb"] *= 1.0 - 2.0 * size
    return campaign


def _swapped(rng: np.random.Generator, size: float) -> Campaign:
    """Twelve runs of a triad; with a size of 1 x and y are swapped in one about z."""
    campaign = _twelve_runs(rng)
    if size:
        log = campaign.logs["about_z_3.csv"]
        log[["gyro_x_lsb", "gyro_y_lsb"]] = log[["gyro_y_lsb", "gyro_x_lsb"]].to_numpy()
    return campaign


def _warming(rng: np.random.Generator, size: float) -> Campaign:
    """Three runs from a cold start, rates rising; the scale factor rises by `size` ppm."""
    gyro = draw(rng, np.eye(3)[2])
    falling = np.exp(-HOLD_S * (np.arange(RATES_DPS.size) + 0.5) / WARMING_S)
    errors = {"x": -size * PPM * falling}
    logs = {
        f"run_{k}.csv": log_run(rng, {"x": gyro}, gyro.axis, scale_error=errors) for k in range(3)
    }
    at_end = 1.0 - size * PPM * np.exp(-HOLD_S * RATES_DPS.size / WARMING_S)
    return Campaign(_recipe("rate_table"), logs, [Truth(K, "gyro_x.K", gyro.K * float(at_end))])


def _over_temperature(
    rng: np.random.Generator,
    gyro: Gyro,
    degc: Sequence[float],
    errors: Array,
    at_degc: Sequence[float],
) -> Campaign:
    """A run at each temperature, with a relative error of its scale factor; K(T) by evaluate."""
    logs = {
        f"run_{k}.csv": log_run(rng, {"x": gyro}, gyro.axis, soak_degc, scale_error={"x": error})
        for k, (soak_degc, error) in enumerate(zip(degc, errors.tolist(), strict=True))
    }
    truth = [Truth(K_CURVE, ".K_x", float(gyro.scale(t)), {"temp_case_degc": t}) for t in at_degc]
    return Campaign(_recipe("rate_table"), logs, truth)


def _setting(rng: np.random.Generator, size: float) -> Campaign:
    """Eight runs, three at room temperature; that at 60 °C has another setting, by `size` ppm."""
    degc = (-40.0, -20.0, 0.0, *(ROOM_DEGC,) * 3, 40.0, 60.0)
    errors = PPM * rng.normal(size=len(degc))
    errors[-1] += size * PPM
    return _over_temperature(rng, draw(rng, np.eye(3)[2]), degc, errors, (-20.0, 20.0, 60.0))


def _fahrenheit(rng: np.random.Generator, size: float) -> Campaign:
    """The same runs; with a size of 1 the thermometer of that at 40 °C is logged in °F."""
    campaign = _setting(rng, 0.0)
    campaign.logs["run_6.csv"]["temp_case_degc"] += size * (32.0 + 0.8 * 40.0)
    return campaign


def _curve(rng: np.random.Generator, size: float) -> Campaign:
    """Six runs that repeat to 1 ppm; K(T) bends by `size` ppm over half the range."""
    degc = np.linspace(-40.0, 60.0, 6)
    gyro = replace(draw(rng, np.eye(3)[2]), per_degc2=size * PPM / 50.0**2)
    errors = PPM * rng.normal(size=degc.size)
    return _over_temperature(rng, gyro, degc.tolist(), errors, (-40.0, 60.0))


def _open_loop(rng: np.random.Generator, size: float) -> Campaign:
    """Six runs to ± 150 °/s of a gyro whose response is bent by `size` % there, the temperature
    drifting by 3 °C in each.
    """
    rates = 1.5 * RATES_DPS
    # 1 − sin(u)/u = u²/6 at u = Ω/Ω0
    top = {"top_dps": 150.0 / np.sqrt(0.06 * size), "top_per_degc": 2e-4} if size else {}
    gyro = replace(draw(rng, np.eye(3)[2], **top), per_degc=OPEN_LOOP_PER_DEGC)
    logs, truth = {}, []
    for k, start_degc in enumerate(np.linspace(-40.0, 60.0, 6).tolist()):
        degc = start_degc + 3.0 * (1.0 - np.exp(-np.arange(rates.size) / 6.0))
        logs[f"run_{k}.csv"] = log_run(rng, {"x": gyro}, gyro.axis, degc, rates_dps=rates)
    for t in (-20.0, 20.0, 60.0):
        slope = gyro.best_slope(rates, t)
        truth.append(Truth(K_CURVE, ".K_x", slope, {"temp_case_degc": t}))
    degc = 10.0 + 3.0 * (1.0 - np.exp(-np.arange(rates.size) / 6.0))
    applied = Applied(
        "apply",
        log_run(rng, {"x": gyro}, gyro.axis, degc, rates_dps=rates),
        "gyro_x_dps",
        rates,
        LEFT_BY_FIFTH_ORDER_DPS,
        {},
    )
    return Campaign(_recipe("rate_table", response="auto"), logs, truth, applied)


RUNS_APART = "contradict|either|off what the other"
REPEAT = "within these runs|run-to-run|repeat each run"
_pairs, _triads = partial(Fault, "gyro pair"), partial(Fault, "gyro triad")
_tables = partial(Fault, "rate table")
FAULTS = (
    _pairs("scale factors that repeat", 2.0, "ppm", _pair, REPEAT),
    _pairs("scale factors that repeat", 8.0, "ppm", _pair, REPEAT),
    _triads("scale factors that repeat", 8.0, "ppm", _triad, REPEAT),
    _triads("three runs an axis that repeat", 5.0, "ppm", _three_runs, REPEAT),
    _triads(
        "sign of a cross axis in one log of twelve",
        1.0,
        "",
        _sign,
        "sign of|contradict|off what the other",
    ),
    _triads("two gyros swapped in one of twelve logs", 1.0, "", _swapped, f"swap|{RUNS_APART}"),
    _tables("scale factor that warms up", 200.0, "ppm", _warming, "warm|transient"),
    _tables(
        "a run with another setting",
        2000.0,
        "ppm",
        _setting,
        "contradict|either|off what the other runs",
    ),
    _tables("thermometer of a run in °F", 1.0, "", _fahrenheit, f"°F|degF|{RUNS_APART}"),
    _tables("K(T) bent", 5.0, "ppm", _curve, "bends"),
    _tables("open-loop response", 3.0, "%", _open_loop, "respon|bent"),
)
