"""Simulated campaigns of gyros on a rate table, by name: one gyro over temperature, two on one base
about the axis of each, three about each axis of their base at several temperatures.
"""

from collections.abc import Sequence
from dataclasses import asdict, replace

import numpy as np

from calibkit.arrays import Array
from calibkit.instruments.gyro_scale import simulate_rate_table
from calibkit.instruments.gyro_scale.simulate_rate_table import (
    RateGyro,
    TurnedTable,
    both_ways,
    turn,
)
from calibkit.simulate.campaign import Campaign

START_DEGC = 25.0
AXES = ("a_about_a", "b_about_a", "b_about_b", "a_about_b")
"""Keys <gyro>_about_<table axis> of the input axes of both gyros in both runs."""
LARGEST_MOUNTING_ERROR_DEG = 0.02
"""Largest angle between a gyro's input axis and the table axis nominally its own [°]."""
GYROS = ("x", "y", "z")
LARGEST_MOUNTING_DEG = 0.3
"""Largest angle of an input axis from the base axis that it is named after [°]."""
LARGEST_TURN_DEG = 0.02
"""Largest rotation of an input axis over 100 °C [°]."""
RATES_DPS = (2.0, 5.0, 10.0, 20.0, 40.0, 60.0, 80.0, 100.0)
"""Rates that the table holds in each direction about each of three axes [°/s]."""


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
    mounting = np.zeros(2) if ideal else rng.uniform(0.0, LARGEST_MOUNTING_ERROR_DEG, 2)
    tilts = (mounting[0], alpha, mounting[1], alpha)
    # by gyro and run: each run has its own orientation about its table axis
    directions = {
        name: simulate_rate_table.tilted(tilt, direction_deg)
        for name, tilt, direction_deg in zip(AXES, tilts, rng.uniform(0.0, 360.0, 4), strict=True)
    }
    gyros = {name: RateGyro.draw(rng, noise_lsb=noise_lsb) for name in ("a", "b")}
    if ideal:
        gyros = {name: linear(gyro) for name, gyro in gyros.items()}
    rates = both_ways() if rates_dps is None else tuple(rates_dps)
    stand = table or TurnedTable(start_angle_deg=rng.uniform(0.0, 360.0))
    logs: dict[str, dict[str, Array]] = {}
    lines: dict[str, dict[str, float]] = {}
    for axis in ("a", "b"):
        mounted = {g: replace(gyros[g], axis=directions[f"{g}_about_{axis}"]) for g in ("a", "b")}
        log, degc, of_gyros = turn(mounted, stand, rates, START_DEGC, rng)
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
    return Campaign(logs, simulate_rate_table.DECIMALS, truth)


def linear(gyro: RateGyro) -> RateGyro:
    """The same gyro with a straight-line response and no temperature terms."""
    return replace(gyro, K_per_degc=0.0, ripple_dps=0.0, asymmetry=0.0, bias_dps_per_degc=0.0)


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
    tilts = np.tan(np.radians(LARGEST_MOUNTING_DEG)) * rng.uniform(-1.0, 1.0, (3, 3)) / np.sqrt(2.0)
    axes = _normalise(np.eye(3) + tilts * (1.0 - np.eye(3)))
    turns = np.radians(LARGEST_TURN_DEG) * rng.uniform(-1.0, 1.0, (3, 3))
    gyros = {name: RateGyro.draw(rng, noise_lsb=noise_lsb) for name in GYROS}
    table = TurnedTable(interval_s=1.0, start_angle_deg=rng.uniform(0.0, 360.0))
    rates = both_ways(RATES_DPS) if rates_dps is None else tuple(rates_dps)
    logs: dict[str, dict[str, Array]] = {}
    truths: dict[str, dict[str, list[list[float]]]] = {}
    for degc in (*temperatures_degc, *withheld_degc):
        folder = "" if degc in temperatures_degc else "withheld/"
        warmer = (degc - simulate_rate_table.REFERENCE_DEGC) / 100.0
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
    decimals = simulate_rate_table.DECIMALS | {f"gyro_{g}_lsb": 1 for g in GYROS}
    return Campaign(logs, decimals, truth)


def _normalise(vectors: Array) -> Array:
    """Rows of vectors [3, 3] scaled to unit length."""
    return np.array([vector / np.linalg.norm(vector) for vector in vectors])


CAMPAIGNS = {"gyro_pair": pair, "gyro_triad": triad, "rate_table": simulate_rate_table.campaign}
