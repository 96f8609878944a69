"""A campaign of gyros that was run by a plan, with the errors of runs that it assumes."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.constants import DPH_PER_DPS
from calibkit.instruments.gyro_scale import forms, simulate_rate_table
from calibkit.instruments.gyro_scale.numeric import planned
from calibkit.instruments.gyro_scale.numeric.gjb_figures import PPM
from calibkit.planning.linear import read_sizes
from calibkit.planning.proposal import WITHHELD
from calibkit.simulate.campaign import Campaign

if TYPE_CHECKING:
    from collections.abc import Mapping

    from calibkit.arrays import Array
    from calibkit.instruments.gyro_scale.recipe import GyroTriadRecipe, RateTableRecipe
    from calibkit.planning.schedule import Schedule

MOUNTED_RAD = 3e-3
"""Standard deviation of the angles of simulated input axes to those of their base."""


def campaign(
    spec: RateTableRecipe | GyroTriadRecipe,
    schedule: Schedule,
    document: Mapping[str, Any],
    seed: int,
) -> Campaign:
    """Logs of gyros on a table that was run by a schedule, with the errors of runs that the plan
    assumes, and their truth.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    gyros = {f"gyro_{name}_lsb": simulate_rate_table.RateGyro.draw(rng) for name in spec.gyros}
    directions = np.eye(3)[: len(gyros)] + rng.normal(0.0, MOUNTED_RAD, (len(gyros), 3))
    table = simulate_rate_table.Table(
        interval_s=1.0, shortest_hold_s=float(document["settings"]["hold_s"])
    )
    size = read_sizes(document, planned.UNITS)
    scale, zero = size["run", "scale"] / PPM, size["run", "zero"]
    tilts = np.radians(rng.normal(0.0, size[planned.MOUNTING], (3, 3)))
    logs: dict[str, dict[str, Array]] = {}
    held = schedule.recorded("rate")
    for log in dict.fromkeys(one.log for one in held):
        own = [one for one in held if one.log == log]
        axis = spec.find_axis(log.removeprefix(WITHHELD))
        seen = _mount(directions, axis, tilts) if axis else np.eye(3)[[2] * len(gyros)]
        moved = {
            name: replace(
                gyro,
                axis=tuple((direction / np.linalg.norm(direction)).tolist()),
                K=gyro.K * (1.0 + rng.normal(0.0, scale)),
                bias_dps=gyro.bias_dps + rng.normal(0.0, zero) / DPH_PER_DPS,
            )
            for (name, gyro), direction in zip(gyros.items(), seen, strict=True)
        }
        degc = own[0].set_degc - table.warming_degc / 2.0
        rates = [one.table_rate_dps for one in own]
        logs[log] = simulate_rate_table.run(moved, table, rates, degc, rng)
    drawn = {name: asdict(gyro) for name, gyro in gyros.items()}
    truth = {"seed": seed, "plan": document["sha256"], "gyros": drawn}
    truth |= {"directions": directions.tolist(), "tilts_rad": tilts.tolist()}
    return Campaign(logs, simulate_rate_table.DECIMALS | dict.fromkeys(gyros, 1), truth)


def _mount(directions: Array, axis: str, tilts: Array) -> Array:
    """Input axes [g, 3] in axes of a table that turns the base about one of its own, which is
    mounted with a tilt of its own [3, 3] [rad]: two components that turn, and one along the table.
    """
    at = forms.AXES.index(axis)
    turned = directions + np.cross(directions, tilts[at])
    return np.asarray(np.roll(turned, 2 - at, axis=1), dtype=np.float64)
