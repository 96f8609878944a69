"""Three gyros on one base that the table turns about each axis of the base, at several
temperatures.
"""

from collections.abc import Sequence
from dataclasses import asdict, replace

import numpy as np

from calibkit.arrays import Array
from calibkit.instruments.gyro_scale import simulate_rate_table
from calibkit.simulate.campaign import Campaign

GYROS = ("x", "y", "z")
LARGEST_MOUNTING_DEG = 0.3
"""Largest angle of an input axis from the base axis that it is named after [°]."""
LARGEST_TURN_DEG = 0.02
"""Largest rotation of an input axis over 100 °C [°]."""
RATES_DPS = (2.0, 5.0, 10.0, 20.0, 40.0, 60.0, 80.0, 100.0)


def _normalise(vectors: Array) -> Array:
    """Rows of vectors [3, 3] scaled to unit length."""
    return np.array([vector / np.linalg.norm(vector) for vector in vectors])


def campaign(
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
    tilts = np.tan(np.radians(LARGEST_MOUNTING_DEG)) * rng.uniform(-1.0, 1.0, (3, 3)) / np.sqrt(2.0)
    axes = _normalise(np.eye(3) + tilts * (1.0 - np.eye(3)))
    turns = np.radians(LARGEST_TURN_DEG) * rng.uniform(-1.0, 1.0, (3, 3))
    gyros = [simulate_rate_table.RateGyro.draw(rng, noise_lsb=noise_lsb) for _ in GYROS]
    table = simulate_rate_table.Table(interval_s=1.0, start_angle_deg=rng.uniform(0.0, 360.0))
    rates = simulate_rate_table.both_ways(RATES_DPS) if rates_dps is None else tuple(rates_dps)
    logs: dict[str, dict[str, Array]] = {}
    truths: dict[str, dict[str, list[list[float]]]] = {}
    for degc in (*temperatures_degc, *withheld_degc):
        folder = "" if degc in temperatures_degc else "withheld/"
        warmer = (degc - simulate_rate_table.REFERENCE_DEGC) / 100.0
        runs, truths[f"{degc:.0f}"] = _turn(
            gyros,
            _normalise(axes + turns * (warmer * (1.0 + 0.15 * warmer))),
            table,
            rates,
            degc,
            rng,
        )
        logs |= {f"{folder}about_{name}_{degc:.0f}.csv": run for name, run in runs.items()}
    truth = {
        "procedure": "gyro_triad",
        "seed": seed,
        "gyros": {g: asdict(gyro) for g, gyro in zip(GYROS, gyros, strict=True)},
        "table": asdict(table),
        "rates_dps": rates,
        "at": truths,
    }
    decimals = simulate_rate_table.DECIMALS | {f"gyro_{g}_lsb": 1 for g in GYROS}
    return Campaign(logs, decimals, truth)


def _turn(
    gyros: Sequence[simulate_rate_table.RateGyro],
    directions: Array,
    table: simulate_rate_table.Table,
    rates: Sequence[float],
    degc: float,
    rng: np.random.Generator,
) -> tuple[dict[str, dict[str, Array]], dict[str, list[list[float]]]]:
    """Log columns of the runs about each axis at one temperature [°C], for gyros with input axes
    along `directions` [3, 3], and the true lines.
    """
    runs: dict[str, dict[str, Array]] = {}
    lines = np.zeros((3, 3))
    for axis, name in enumerate(GYROS):
        # in table axes: two components that turn with the table, and one along its axis
        seen = np.roll(directions, 2 - axis, axis=1).tolist()
        mounted = {
            f"gyro_{g}_lsb": replace(gyro, axis=tuple(direction))
            for g, gyro, direction in zip(GYROS, gyros, seen, strict=True)
        }
        runs[name] = simulate_rate_table.run(mounted, table, rates, degc, rng)
        case = float(np.mean(runs[name]["temp_case_degc"]))
        lines[:, axis] = [gyro.best_line(table, rates, case)[0] for gyro in mounted.values()]
    cosines = np.clip(directions @ directions.T, -1.0, 1.0)
    return runs, {
        "sensitivity": lines.tolist(),
        "axes": directions.tolist(),
        "angles_deg": np.degrees(np.arccos(cosines)).tolist(),
    }
