"""What a plan of runs assumes from an earlier run, and the runs that are measured already."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibkit.constants import DPH_PER_DPS
from calibkit.errors import FitError, UsageError
from calibkit.instruments.gyro_scale import forms, table_runs
from calibkit.instruments.gyro_scale.numeric.planned import Holds
from calibkit.numeric.dispersion import rms
from calibkit.recipe.tables import ErrorComponent

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from calibkit.coefficients import Record, StageResult
    from calibkit.frame import Log
    from calibkit.instruments.gyro_scale.recipe import (
        GyroPairRecipe,
        GyroTriadRecipe,
        RateTableRecipe,
    )
    from calibkit.planning.equipment import Device

OFF_LINE = "linearity_error_rms."
"""Figures of what held rates are off the line of their run begin with this [°/s]."""
ACROSS = 0.1
"""Scale factor, relative to the largest, below which a gyro was turned across its axis alone."""
DOF = 20.0
"""Degrees of freedom of what an earlier run found."""


def read_run(
    records: Mapping[str, Record | StageResult],
) -> dict[tuple[str, str], ErrorComponent]:
    """Shared errors of a run: of the runs where they were seen, and the response at a rate, with
    the noise of the holds in it; UsageError for a run of no gyro on a table.
    """
    found = records.get(forms.SCALE_FILE)
    off = [one.value for one in found.figures if one.name.startswith(OFF_LINE)] if found else []
    if found is None or not off:
        raise UsageError(
            "that run has no scale factor of a gyro on a rate table",
            hint="name a run of rate_table, gyro_triad or gyro_pair",
        )
    seen = {
        (one.group, one.effect): (one.value, one.unit)
        for model in found.models
        for one in model.components
        if one.value > one.standard_uncertainty
    }
    seen["rate", "response"] = rms(off) * DPH_PER_DPS, "deg/h"
    return {
        (group, effect): ErrorComponent(group=group, effect=effect, value=value, unit=unit, dof=DOF)
        for (group, effect), (value, unit) in seen.items()
    }


def measure_runs(
    spec: RateTableRecipe | GyroTriadRecipe | GyroPairRecipe, logs: Sequence[Log], device: Device
) -> dict[str, Holds]:
    """Table axis → holds of its measured runs, with their noise; FitError for a log that a fit
    refuses, or without temperature.
    """
    runs = [(spec.find_axis(log.file), table_runs.fit_run(spec, log)) for log in logs]
    for _, run in runs:
        if not np.isfinite(run.plateaus.temp_degc).all():
            raise FitError(
                f"{run.log.file}: no case temperature, expected one to plan what is missing",
                hint="map it under [columns.temp_case_degc], or plan without --have",
            )
    K = np.max([np.abs(run.scales.K) for _, run in runs], axis=0) if runs else np.ones(1)
    # a gyro that was never turned about its own axis is taken to be like the others
    K = np.where(ACROSS * K.max() < K, K, K.max())
    unknown = device.noise * float(np.sqrt(device.noise_s / min(device.dwell_s)))
    found: dict[str, Holds] = {}
    for axis, run in runs:
        held = run.plateaus
        noise = np.sqrt(np.mean((held.standard_uncertainty / K) ** 2, axis=1))
        # of a log of one row per hold no noise is known
        noise = np.where(np.isfinite(noise) & (noise > 0.0), noise, unknown)
        run_of = np.zeros(noise.size, dtype=np.int64)
        own = Holds.of(held.rate_dps, run_of, held.temp_degc, held.hours, noise)
        found[axis] = found[axis].join(own) if axis in found else own
    return found
