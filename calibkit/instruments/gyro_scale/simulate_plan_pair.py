"""A campaign of two gyros that was run by a plan, with the errors that it assumes."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.constants import DPH_PER_DPS
from calibkit.instruments.gyro_scale import simulate_pair, simulate_rate_table
from calibkit.instruments.gyro_scale.numeric import planned
from calibkit.instruments.gyro_scale.numeric.gjb_figures import PPM
from calibkit.instruments.gyro_scale.plan_pair import AXES, TEMPERATURE, UNITS
from calibkit.planning.linear import read_sizes
from calibkit.planning.proposal import WITHHELD
from calibkit.simulate.campaign import Campaign

if TYPE_CHECKING:
    from collections.abc import Mapping

    from calibkit.arrays import Array
    from calibkit.instruments.gyro_scale.recipe import GyroPairRecipe
    from calibkit.planning.schedule import Schedule


def campaign(
    spec: GyroPairRecipe, schedule: Schedule, document: Mapping[str, Any], seed: int
) -> Campaign:
    """Logs of two linear gyros about the axis of each, and N and the angle between them."""
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    size = read_sizes(document, UNITS)
    settings, simulated = document["settings"], simulate_rate_table
    table = simulated.Table(interval_s=1.0, shortest_hold_s=settings["hold_s"], warming_degc=0.0)
    gyros = {name: simulate_pair.linear(simulated.RateGyro.draw(rng)) for name in AXES}
    alpha = 90.0 + rng.normal(0.0, 0.3)
    held = schedule.recorded("rate")
    rates = np.unique([one.table_rate_dps for one in held])
    response = rng.normal(0.0, size["rate", "response"] / DPH_PER_DPS, (2, rates.size))
    # both gyros change with temperature alike
    per_degc = float(rng.normal(0.0, settings["coefficient_per_degc"]))
    logs: dict[str, dict[str, Array]] = {}
    for log in dict.fromkeys(one.log for one in held):
        axis = spec.find_axis(log.removeprefix(WITHHELD))
        moved = _mount(gyros, axis, alpha, size, rng)
        moved = {name: replace(gyro, K_per_degc=per_degc) for name, gyro in moved.items()}
        degc = held[0].set_degc + rng.normal(0.0, size[TEMPERATURE])
        planned_rates = [one.table_rate_dps for one in held if one.log == log]
        named = {f"gyro_{name}_lsb": gyro for name, gyro in moved.items()}
        made = simulate_rate_table.run(named, table, planned_rates, degc, rng)
        for k, (name, gyro) in enumerate(moved.items()):
            drift = rng.normal(0.0, size["run", "zero drift"]) / DPH_PER_DPS
            added = np.interp(made["table_rate_dps"] * gyro.axis[2], rates, response[k])
            added += drift * (made["time_s"] - made["time_s"].mean()) / 3600.0
            column = f"gyro_{name}_lsb"
            made[column] = np.round(made[column] + gyro.K * added)
        logs[log] = made
    # the best straight line over the rates takes its part of the response
    line = {name: 1.0 + np.polyfit(rates, response[k], 1)[0] for k, name in enumerate(AXES)}
    ratio = gyros["b"].K * line["b"] / (gyros["a"].K * line["a"])
    truth = {"seed": seed, "plan": document["sha256"]}
    truth["coefficients"] = {"pair": {"N": float(ratio), "alpha_deg": float(alpha)}}
    return Campaign(logs, simulate_rate_table.DECIMALS, truth)


def _mount(
    gyros: Mapping[str, simulate_rate_table.RateGyro],
    axis: str,
    alpha_deg: float,
    size: Mapping[tuple[str, str], float],
    rng: np.random.Generator,
) -> dict[str, simulate_rate_table.RateGyro]:
    """Gyros of a run about the axis of one of them, with the errors of mounting and run."""
    tilt = rng.normal(0.0, size[planned.MOUNTING], 2)
    turn = simulate_rate_table.tilted
    return {
        name: replace(
            gyro,
            axis=turn(
                float(np.hypot(*tilt)) if name == axis else alpha_deg + tilt[0],
                rng.uniform(0.0, 360.0),
            ),
            K=gyro.K * (1.0 + rng.normal(0.0, size["run", "scale"]) / PPM),
            bias_dps=gyro.bias_dps + rng.normal(0.0, size["run", "zero"]) / DPH_PER_DPS,
        )
        for name, gyro in gyros.items()
    }
