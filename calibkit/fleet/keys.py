"""The key figures of a run: what a laboratory compares from device to device, by procedure."""

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from calibkit.records.coefficients import Model, Record
from calibkit.records.store import StoredRun


@dataclass(frozen=True, slots=True)
class KeyFigure:
    """One number of a run; figures of one identity (all but the two numbers) stand in one column of
    the table.
    """

    name: str
    """stage.model.coefficient or stage.figure, or the acceptance limit's name."""
    form: str
    """Of the model; empty for what is no coefficient. Coefficients of different forms are never
    compared.
    """
    unit: str
    limit: float | None
    """Acceptance limit, where the figure has one."""
    value: float
    standard_uncertainty: float
    dof: float = math.inf
    """Degrees of freedom of the standard uncertainty."""

    @property
    def identity(self) -> tuple[str, str, str]:
        """What figures of different devices share when they are the same quantity."""
        return self.name, self.form, self.unit


def select_key_figures(
    run: StoredRun, names: Sequence[str], reference_temp_degc: float
) -> tuple[KeyFigure, ...]:
    """Key figures of a run: what is tested against acceptance limits, then coefficients and figures
    whose whole names match one of the patterns `names`.
    """
    key_figures = [
        KeyFigure(
            f"acceptance: {entry['name']}", "", entry["unit"], entry["limit"], entry["value"], 0.0
        )
        for entry in run.document["acceptance"]
    ]
    key_figures += [
        figure
        for _, record in sorted(run.records.items())
        for figure in _all_figures(record, reference_temp_degc)
        if any(re.fullmatch(pattern, figure.name) for pattern in names)
    ]
    return tuple({figure.identity: figure for figure in key_figures}.values())


def _all_figures(record: Record, reference_temp_degc: float) -> Iterator[KeyFigure]:
    """Every coefficient of every model with its residual, then every figure of a stage."""
    for model in record.models:
        name = f"{record.stage}.{model.name}"
        if model.form == "polynomial/1":
            yield from _bias(name, model, reference_temp_degc)
        for entry in model.coefficients:
            yield KeyFigure(
                f"{name}.{entry.name}",
                model.form,
                entry.unit,
                None,
                entry.value,
                entry.standard_uncertainty,
                model.dof_of(entry) or math.inf,
            )
        yield KeyFigure(
            f"{name}.residual_rms", model.form, model.residual_unit, None, model.residual_rms, 0.0
        )
    for entry in record.figures:
        yield KeyFigure(
            f"{record.stage}.{entry.name}",
            "",
            entry.unit,
            None,
            entry.value,
            entry.standard_uncertainty,
            entry.effective_dof or math.inf,
        )


def _bias(name: str, model: Model, reference_temp_degc: float) -> Iterator[KeyFigure]:
    """Bias at the reference temperature, where that was measured: single coefficients of the powers
    of a raw temperature cannot be compared.
    """
    for column, (low, high) in model.valid.items():
        if not column.endswith("_degc") or not low <= reference_temp_degc <= high:
            continue
        powers = reference_temp_degc ** np.arange(len(model.coefficients))
        variance = max(powers @ np.array(model.covariance) @ powers, 0.0)
        yield KeyFigure(
            f"{name} at {reference_temp_degc:g} degC",
            model.form,
            model.residual_unit,
            None,
            float(powers @ np.array([entry.value for entry in model.coefficients])),
            float(np.sqrt(variance)),
            min(map(model.dof_of, model.coefficients)) or math.inf,
        )
