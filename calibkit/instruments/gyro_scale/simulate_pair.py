"""Two gyros on one base: the table is turned about gyro A's reference axis, then about gyro B's own
axis.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace

import numpy as np

from calibkit.arrays import Array
from calibkit.instruments.gyro_scale import simulate_rate_table
from calibkit.simulate.campaign import Campaign

START_DEGC = 25.0
AXES = ("a_about_a", "b_about_a", "b_about_b", "a_about_b")
"""Keys <gyro>_about_<table axis> of the input axes of both gyros in both runs."""
LARGEST_MOUNTING_ERROR_DEG = 0.02
"""Largest angle between a gyro's input axis and the table axis nominally its own [°]."""


def linear(gyro: simulate_rate_table.RateGyro) -> simulate_rate_table.RateGyro:
    """The same gyro with a straight-line response and no temperature terms."""
    return replace(gyro, K_per_degc=0.0, ripple_dps=0.0, asymmetry=0.0, bias_dps_per_degc=0.0)


def campaign(
    seed: int,
    *,
    alpha_deg: float | None = None,
    noise_lsb: float = 3.0,
    rates_dps: Sequence[float] | None = None,
    ideal: bool = False,
    table: simulate_rate_table.Table | None = None,
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
        name: simulate_rate_table.tilted(tilt, about)
        for name, tilt, about in zip(AXES, tilts, rng.uniform(0.0, 360.0, 4), strict=True)
    }
    gyro = simulate_rate_table.RateGyro
    drawn = {name: gyro.draw(rng, noise_lsb=noise_lsb) for name in ("a", "b")}
    gyros = {name: linear(gyro) for name, gyro in drawn.items()} if ideal else drawn
    rates = simulate_rate_table.both_ways() if rates_dps is None else tuple(rates_dps)
    stand = table or simulate_rate_table.Table(start_angle_deg=rng.uniform(0.0, 360.0))
    logs, lines = _turn(gyros, directions, stand, rates, rng)
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


def _turn(
    gyros: Mapping[str, simulate_rate_table.RateGyro],
    directions: Mapping[str, tuple[float, float, float]],
    table: simulate_rate_table.Table,
    rates: Sequence[float],
    rng: np.random.Generator,
) -> tuple[dict[str, dict[str, Array]], dict[str, dict[str, float]]]:
    """Logs of the runs about both table axes, and the best straight line of each gyro in each."""
    logs: dict[str, dict[str, Array]] = {}
    lines: dict[str, dict[str, float]] = {}
    for axis in ("a", "b"):
        mounted = {g: replace(gyros[g], axis=directions[f"{g}_about_{axis}"]) for g in ("a", "b")}
        columns = simulate_rate_table.run(
            {f"gyro_{g}_lsb": gyro for g, gyro in mounted.items()}, table, rates, START_DEGC, rng
        )
        logs[f"table_axis_{axis}.csv"] = columns
        degc = float(np.mean(columns["temp_case_degc"]))
        for g, gyro in mounted.items():
            slope, intercept = gyro.best_line(table, rates, degc)
            lines[f"{g}_about_{axis}"] = {"K": slope, "F0": intercept, "temp_case_degc": degc}
    return logs, lines
