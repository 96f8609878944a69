"""A campaign of each procedure with the errors of its equipment, and the truth of its results.

`PROCEDURES` is by recipe: a function of a number and the errors drawn, that returns logs and truth.
Errors of columns are put into the logs by `certificate_coverage`; those of the site and of the
table's axes are put into the campaign, or into the truth where the results stand for it directly.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from calibkit import instruments, recipe
from calibkit.certificate.stated import Stated
from calibkit.certificate.uncertainty import TypeBTerms
from calibkit.instruments.accelerometer import (
    certificate as triads,
    dwells,
    published,
    simulate as triad,
    simulate_magnitude as tumble,
)
from calibkit.instruments.accelerometer.fit import fit_triad
from calibkit.instruments.bias import simulate as sweep, simulate_fog as fog
from calibkit.instruments.gyro_noise import simulate as static
from calibkit.instruments.gyro_scale import simulate
from calibkit.instruments.inclinometer import simulate as tool
from calibkit.records.coefficients import Identity
from calibkit.records.frame import Log

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from calibkit.certificate.results import Result

    Frames = dict[str, pd.DataFrame]
    Truth = Callable[[Result], float | None]

LATITUDE_DEG, ROOM_DEGC = 34.2, 25.0


@dataclass(frozen=True)
class Errors:
    """Errors of the equipment in one campaign, in the unit of the quantity's name."""

    of: Mapping[str, float] = field(default_factory=dict)
    """Quantity that is no column → sum of its errors."""

    def __getitem__(self, quantity: str) -> float:
        return self.of.get(quantity, 0.0)


def _frames(logs: Mapping[str, Mapping[str, Any]]) -> Frames:
    """Logs that are fitted."""
    return {name: pd.DataFrame(dict(c)) for name, c in logs.items() if "withheld" not in name}


def _degc(result: Result) -> float:
    """Temperature that a result is stated at [°C]."""
    return next(value for name, value, _ in result.at if name == "temp_case_degc")


def _gyro(stated: Any) -> simulate.RateGyro:  # noqa: ANN401 (a JSON object)
    """Gyro of a truth."""
    return simulate.RateGyro(**stated | {"axis": tuple(stated["axis"])})


def rate_table(number: int, _: Errors) -> tuple[Frames, Truth]:
    """One gyro at four temperatures: K and F0 there."""
    made = simulate.rate_table(number)
    stated: Any = made.truth
    gyro, table = _gyro(stated["gyro"]), simulate.TurnedTable(**stated["table"])

    def truth(result: Result) -> float | None:
        terms = [k for k, name in enumerate(("K", "F0")) if f".gyro_x.{name}" in result.quantity]
        if not terms or not result.at:
            return None
        return gyro.best_line(table, stated["rates_dps"], _degc(result))[terms[0]]

    return _frames(made.logs), truth


def gyro_pair(number: int, errors: Errors) -> tuple[Frames, Truth]:
    """Two gyros about two axes: K, N, ε, γ and α."""
    made = simulate.pair(number)
    stated: Any = made.truth
    alpha = stated["alpha_deg"] + errors["alpha_deg"]
    gamma = float(np.cos(np.radians(alpha)))
    found = {
        "gyro_scale.a_about_a.K": stated["models"]["a_about_a"]["K"],
        "gyro_scale.b_about_b.K": stated["models"]["b_about_b"]["K"],
        "gyro_orthogonality.pair.N": stated["N"],
        "gyro_orthogonality.pair.epsilon": stated["epsilon"]
        + stated["N"] * (gamma - stated["gamma"]),
        "gyro_orthogonality.pair.gamma": gamma,
        "gyro_orthogonality.pair.alpha_deg": alpha,
    }
    return _frames(made.logs), lambda result: found.get(result.key)


def gyro_triad(number: int, errors: Errors) -> tuple[Frames, Truth]:
    """Three gyros about three axes: sensitivities and angles at 25 °C."""
    made = simulate.triad(number)
    stated: Any = made.truth
    at, table = stated["at"]["25"], simulate.TurnedTable(**stated["table"])
    found = {}
    for k, g in enumerate("xyz"):
        found[f"gyro_orthogonality.triad.S_{g}{g}"] = at["sensitivity"][k][k]
        direction = np.roll(at["axes"], 2 - k, axis=1)[k].tolist()
        mounted = replace(_gyro(stated["gyros"][g]), axis=tuple(direction))
        line = mounted.best_line(table, stated["rates_dps"], ROOM_DEGC)
        found[f"gyro_scale.{g}_about_{g}.K_over_temperature.value@25"] = line[0]
        for other in range(k + 1, 3):
            key = f"gyro_orthogonality.angle_deg.{g}_{'xyz'[other]}"
            found[key] = at["angles_deg"][k][other] + errors["angle_deg"]
    return _frames(made.logs), lambda result: found.get(result.key)


def accelerometer(number: int, _: Errors) -> tuple[Frames, Truth]:
    """A triad on a table: what a fit to the same dwells without noise and errors gives."""
    noisy = triad.campaign(number)
    exact = {"noise_g": 0.0, "table_noise_deg": 0.0, "thermometer_noise_degc": 0.0}
    # of dwells without an error no size of one is estimated
    settings = ('loss="least_squares"', "errors.groups=[]")
    spec: Any = instruments.parse_recipe(recipe.find("accelerometer", settings))
    (columns,) = triad.campaign(number, **exact).logs.values()
    frame = pd.DataFrame(dict(columns))
    log = Log("positions", "positions.csv", "", len(frame), frame)
    held = dwells.collect_dwells([log], spec)
    _, results = fit_triad(held, spec)
    identity = Identity("S", 1, "2026-11-21", "calibkit", "0" * 64, ())
    records = {one.file: one.as_record(identity, "") for one in results}
    degc = (-20.0, 0.0, 25.0, 50.0, 75.0, 100.0, 125.0)
    blocks = triads.blocks(Stated(records, TypeBTerms(()), degc, spec.reference_temp_degc))
    values = {one.key: one.value for block in blocks for one in block.results}
    found = {key: value for key, value in values.items() if "@" in key or ".Q" in key}
    return _frames(noisy.logs), lambda result: found.get(result.key)


def accelerometer_magnitude(number: int, _: Errors) -> tuple[Frames, Truth]:
    """A triad turned by hand: scale factors and Q; biases wander from the start of the log, at
    which alone the truth states them.
    """
    made = tumble.campaign(number)
    stated: Any = made.truth
    scale, axes = np.array(stated["k"]), published.axes_from_angles(np.array(stated["Q"]))
    matrix = np.linalg.inv(scale[:, None] * axes)
    found = {f"accel_q.triad.Q{k + 1}": stated["Q"][k] for k in range(3)}
    for k, axis in enumerate("xyz"):
        found[f"accel_affine.triad.k_{axis}@25"] = float(matrix[k, k])
    return _frames(made.logs), lambda result: found.get(result.key)


def inclinometer(number: int, errors: Errors) -> tuple[Frames, Truth]:
    """Two pairs in four positions at 36 stations: s(T)."""
    made = tool.campaign(number, latitude_deg=LATITUDE_DEG + errors["latitude_deg"])
    stated: Any = made.truth
    pairs = dict(zip("xy", stated["tool"]["pairs"], strict=True))

    def truth(result: Result) -> float | None:
        if ".s@" not in result.key:
            return None
        pair, warmer = pairs[result.quantity.split(".")[1]], _degc(result) - tool.REFERENCE_DEGC
        wave = pair["s_wave"] * np.sin(2.0 * np.pi * warmer / pair["s_wave_degc"])
        return float(pair["s"] + pair["s_per_degc"] * warmer + wave)

    return _frames(made.logs), truth


def fog_thermal(number: int, errors: Errors) -> tuple[Frames, Truth]:
    """A gyro on ramps: bias at 25 °C and drift at rest."""
    made = fog.campaign(number, runs=fog.programmes(withheld=()))
    stated: Any = made.truth
    gyro = stated["gyro"]

    def truth(result: Result) -> float | None:
        if result.quantity == "drift_rate.drift.bias":
            return float(gyro["bias_dph"] + gyro["input_rate_dph"] + errors[result.quantity])
        if result.quantity != "drift_rate.drift.drift":
            return None
        powers = np.array([0.0, *gyro["static_dph"]])
        return float(np.polynomial.polynomial.polyval(_degc(result) - ROOM_DEGC, powers))

    return _frames(made.logs), truth


def thermal(number: int, _: Errors) -> tuple[Frames, Truth]:
    """Six channels against one thermometer: bias at rest."""
    made = sweep.campaign(number)
    stated: Any = made.truth

    def truth(result: Result) -> float | None:
        _, name, what = result.quantity.split(".")
        if what != "bias" or not result.at:
            return None
        own = stated["channels"][name]
        z = (_degc(result) - sweep.REFERENCE_DEGC) / 50.0
        static = sum(power * z**k for k, power in enumerate(own["powers"], 1))
        return float(sweep.ATTITUDE_G.get(name, 0.0) + own["bias"] + static)

    return _frames(made.logs), truth


def gyro_noise(number: int, _: Errors) -> tuple[Frames, Truth]:
    """A gyro at rest: angle random walk and bias instability."""
    made = static.campaign(number)
    stated: Any = made.truth
    found = {
        "gyro_noise.angle_random_walk.static": stated["terms"]["N"],
        "gyro_noise.bias_instability.static": stated["terms"]["B"],
    }
    return _frames(made.logs), lambda result: found.get(result.key)


def bias_temperature(number: int, _: Errors) -> tuple[Frames, Truth]:
    """Five warm-ups of one gyro, whose bias is no polynomial: bias over temperature."""
    rng = np.random.default_rng([number, 20])
    slope, magnetic, elastic = rng.normal(0.0, (0.2, 10.0, 10.0))
    width = rng.uniform(100.0, 200.0)

    def bias(degc: Any) -> Any:  # noqa: ANN401 (a number or an array)
        warm = degc - ROOM_DEGC
        return slope * warm + magnetic * np.expm1(-warm / 120.0) + elastic * np.tanh(warm / width)

    logs = {}
    for k in range(5):
        start, time = 15.0 + (k > 0) * rng.uniform(0.0, 8.0), np.arange(300.0)
        degc = 51.0 - (51.0 - start) * np.exp(-time / 90.0)
        gyro = bias(degc) + rng.normal(0.0, 0.5) + rng.normal(0.0, 1.0, time.size)
        columns = {"time_s": time, "temp_case_degc": degc, "gyro_dph": gyro}
        logs[f"w{k}.csv"] = pd.DataFrame(columns)
    return logs, lambda result: float(bias(_degc(result))) if result.at else None


PROCEDURES: dict[str, Callable[[int, Errors], tuple[Frames, Truth]]] = {
    one.__name__: one
    for one in (
        *(accelerometer, accelerometer_magnitude, rate_table, gyro_pair, gyro_triad),
        *(inclinometer, fog_thermal, thermal, bias_temperature, gyro_noise),
    )
}
