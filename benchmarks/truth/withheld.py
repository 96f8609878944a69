"""Drift on a temperature ramp that was withheld, by the truth of simulated gyros: autopilots'
models, least squares, calibkit.
"""

from __future__ import annotations

import statistics
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import drift_peers
import numpy as np
from speed import peers
from speed.page import table

from calibkit.instruments.bias import simulate_fog as fog
from calibkit.numeric import intervals
from calibkit.simulate.chamber import Chamber
from truth.product import DATE, calibkit

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

FIRST_SEED = 84_100
SPIKES = 0.005
BLOCK_S = 10.0
AUTOPILOT = "ardupilot-methodic-configurator"


def spiked(log: fog.SimulatedLog, rng: np.random.Generator) -> fog.SimulatedLog:
    """A log with 0.5 % of its indications thrown off by 2 to 50 °/h."""
    indication = np.array(log.columns["gyro_dph"], dtype=np.float64)
    hit = rng.random(indication.size) < SPIKES
    indication[hit] += rng.choice((-1.0, 1.0), hit.sum()) * rng.uniform(2.0, 50.0, hit.sum())
    return replace(log, columns={**log.columns, "gyro_dph": indication})


def write(path: Path, log: fog.SimulatedLog) -> None:
    """Write a log as comma-separated text."""
    values = np.column_stack(
        [np.asarray(values, dtype=np.float64) for values in log.columns.values()]
    )
    np.savetxt(path, values, "%.4f", ",", header=",".join(log.columns), comments="")


def slope(time_s: Array, temperature: Array) -> Array:
    """Temperature rate [°C/min] at block means, over a minute about each: more than a causal
    instrument could know.
    """
    reach = 3
    at = np.arange(time_s.size)
    low, high = np.maximum(at - reach, 0), np.minimum(at + reach, time_s.size - 1)
    return np.asarray(60.0 * (temperature[high] - temperature[low]) / (time_s[high] - time_s[low]))


def plain(logs: Sequence[fog.SimulatedLog]) -> Callable[[fog.SimulatedLog], Array]:
    """Plain least squares of T⁰…T³ times rate⁰…rate² on block means, nothing left out of them."""

    def columns(log: fog.SimulatedLog) -> Array:
        case = means(log, log.columns["temp_case_degc"])
        t, r = (case - 10.0) / 50.0, slope(means(log, log.columns["time_s"]), case) / 10.0
        return np.column_stack([t**i * r**j for i in range(4) for j in range(3)])

    indication = np.concatenate([means(log, log.columns["gyro_dph"]) for log in logs])
    powers = np.linalg.lstsq(
        np.concatenate([columns(log) for log in logs]), indication, rcond=None
    )[0]
    return lambda log: np.asarray(columns(log) @ powers)


def compensated(folder: Path, logs: dict[str, fog.SimulatedLog]) -> dict[str, Array]:
    """What `calibkit fit` and `calibkit apply` take off each withheld log, as block means."""
    (folder / "logs").mkdir(parents=True)
    for name, log in logs.items():
        if not name.startswith("withheld/"):
            write(folder / "logs" / name, log)
    calibkit(
        "fit",
        "fog_thermal",
        "--data",
        folder / "logs",
        "--serial",
        "G",
        "--out",
        folder / "runs",
        *DATE,
    )
    taken = {}
    for name, log in logs.items():
        if name.startswith("withheld/"):
            file, out = folder / Path(name).name, folder / f"out_{Path(name).name}"
            write(file, log)
            calibkit("apply", "G", "--runs", folder / "runs", "--data", file, "--out", out)
            with out.open(encoding="utf-8") as stream:
                at = stream.readline().strip().split(",").index("gyro_dph")
            after = np.loadtxt(out, delimiter=",", skiprows=1, usecols=at)
            before = np.loadtxt(
                file, delimiter=",", skiprows=1, usecols=list(log.columns).index("gyro_dph")
            )
            taken[name] = means(log, before - after)
    return taken


def means(log: fog.SimulatedLog, values: Array) -> Array:
    """Block means of a value at every sample of a log."""
    time_s = np.asarray(log.columns["time_s"], dtype=np.float64)
    return intervals.Intervals.find(time_s, BLOCK_S).means(np.asarray(values, dtype=np.float64))


def polynomial_drift(log: fog.SimulatedLog, rng_seed: int) -> fog.SimulatedLog:
    """The log of a gyro whose drift is a polynomial of case temperature and rate: the very model of
    plain least squares.
    """
    case = log.heat.case
    rate = np.gradient(case) * 60.0
    factors = np.random.default_rng([rng_seed, 8]).uniform(0.5, 1.0, 6) * np.array(
        [1.0, 0.3, -0.5, 0.6, 0.3, -0.2]
    )
    t, r = (case - 10.0) / 50.0, rate / 10.0
    drift = np.column_stack([t, t**2, t**3, r, r * t, r**2 * t]) @ factors
    indication = np.asarray(log.columns["gyro_dph"], dtype=np.float64) - log.drift + drift
    return replace(log, drift=drift, columns={**log.columns, "gyro_dph": indication})


def withheld(seed: int, python: Path, *, hit: bool, physical: bool) -> dict[str, list[float]]:
    """Drift rms [°/h] by truth of what each model leaves of each withheld ramp of a gyro."""
    made = fog.logs(
        fog.FogGyro.draw(seed), fog.programmes((1.0, 5.0, 10.0), (8.0,)), seed, Chamber()
    )
    if not physical:
        made = {name: polynomial_drift(log, seed) for name, log in made.items()}
    rng = np.random.default_rng([seed, 6])
    made = {
        name: spiked(log, rng) if hit and not name.startswith("withheld/") else log
        for name, log in made.items()
    }
    fitted = {name: log for name, log in made.items() if not name.startswith("withheld/")}
    powers, even = drift_peers.packaged(python, fitted)[0], drift_peers.cubic(fitted)
    product = plain(list(fitted.values()))
    with tempfile.TemporaryDirectory() as name:
        own = compensated(Path(name), made)
    left: dict[str, list[float]] = {}
    for name, log in made.items():
        if name.startswith("withheld/"):
            truth = means(log, log.drift)
            case = means(log, log.columns["temp_case_degc"])
            found = {
                "uncompensated": np.zeros_like(truth),
                "cubic in T on an even temperature grid (PX4's model)": even(case),
                "cubic in T, ardupilot-methodic-configurator (packaged)": powers(case),
                "plain least squares, T³ × rate²": product(log),
                "calibkit": own[name],
            }
            for key, drift in found.items():
                left.setdefault(key, []).append(float(np.std(truth - drift)))
    return left


def measured(units: int, environments: Path) -> str:
    """Tables of what models leave of withheld ramps, with and without spikes, of two kinds of
    gyros.
    """
    python = peers.environment(AUTOPILOT, environments)
    kinds = {
        True: "Gyros that are physical, of no fitted family (heat flow, Shupe effect, hysteresis):",
        False: (
            "Gyros whose drift is a polynomial of case temperature and rate, which is the model of"
            " plain least squares:"
        ),
    }
    what = (
        (
            f"{units} simulated gyros of each kind are fitted on ±1, ±5, ±10 °C/min and judged on"
            f" ±8 °C/min: rms over {2 * units}"
        ),
        "withheld ramps of the true drift less what the model takes off, mean removed, in °/h.",
        f"Spikes: {SPIKES:.1%} of the fitted samples are thrown off by 2 to 50 °/h.",
    )
    tables = [
        f"{title}\n\n{_table(units, python, physical=physical)}"
        for physical, title in kinds.items()
    ]
    return "\n\n".join([" ".join(what), *tables])


def _table(units: int, python: Path, *, physical: bool) -> str:
    """Table of one kind of gyros."""
    results: dict[bool, dict[str, list[float]]] = {False: {}, True: {}}
    for hit, pooled in results.items():
        for seed in range(FIRST_SEED, FIRST_SEED + units):
            for key, values in withheld(seed, python, hit=hit, physical=physical).items():
                pooled.setdefault(key, []).extend(values)
    rows = [
        [
            key,
            *(
                f"{most(found[key]):.3g}"
                for found in results.values()
                for most in (statistics.median, max)
            ),
        ]
        for key in results[False]
    ]
    return table(("model", "median", "largest", "with spikes: median", "largest"), rows)
