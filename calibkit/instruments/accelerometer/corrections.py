"""Models of a run → corrected indications of a triad with their uncertainty, and the errors of
dwells under a correction: of inclination and toolface, what a recipe accepts of them, and how
tables and a validation.json state them.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from calibkit.errors import CoefficientError, FrameError
from calibkit.fit.unseen import unseen
from calibkit.instruments.accelerometer import forms
from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.equation import AXES
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.numeric import attitude, gum
from calibkit.numeric.arrays import Array, Mask
from calibkit.numeric.constants import SECONDS_PER_HOUR
from calibkit.numeric.dispersion import rms
from calibkit.recipe import type_b
from calibkit.recipe.type_b import RELATIVE, TypeB
from calibkit.records.coefficients import Criterion, Model, Record, StageResult, at_most, over_u
from calibkit.records.forms import Form, Inputs, within_ranges
from calibkit.report.summary import number
from calibkit.report.table import Column, Table, number_or_none

COMPENSATIONS = {"k": "accel_k", "affine": "accel_affine"}
"""Compensation of a recipe → stage whose models correct the indications."""
MIXED = "compensation = 'kq' is no longer supported, expected 'affine' or 'k'"
IN_STEAD = "'affine' corrects scale, zero and angles together; K and Q stay in their files"
"""Why a recipe with the mixed compensation of 0.2 is not fitted, and what to state for it."""
FIELDS = {
    "inclination_deg": "inclination",
    "toolface_deg": "toolface",
    forms.TEMPERATURE: "temperature",
}
"""Input → array of the dwells that its error shifts."""


@dataclass(frozen=True, slots=True)
class Correction:
    """Correction of a triad's indications by the models of a stage: one of the triad, or one of
    each axis.
    """

    models: tuple[Model, ...]

    @property
    def form(self) -> Form:
        """Form of all its models."""
        return forms.BY_NAME[self.models[0].form]

    def readings(self, indication: Array, temperature: Array) -> tuple[Inputs, Mask]:
        """Inputs of the models at indications [n, 3, g]; temperatures [n, °C] are clamped to the
        range of the calibration. Also returns which [n] were.
        """
        return within_ranges(self.models[0], forms.inputs(indication, temperature))

    def __call__(self, indication: Array, temperature: Array) -> Array:
        """Corrected components [n, 3, g] of indications [n, 3, g] at temperatures [n, °C]."""
        readings, _ = self.readings(indication, temperature)
        return np.column_stack([self.form.evaluate(model, readings) for model in self.models])

    def slopes(self, readings: Inputs) -> list[Array]:
        """Derivatives [n, 3, p] of the corrected components by the coefficients, model by model."""
        by_model = [self.form.gradient(model, readings) for model in self.models]
        if len(by_model) == 1:
            return by_model
        of_axes = np.eye(len(AXES))[:, :, None]
        return [axis * slopes[:, None] for axis, slopes in zip(of_axes, by_model, strict=True)]

    def uncertainty(self, unseen_dwells: DwellSet) -> tuple[Array, Array]:
        """Type A uncertainty of corrected components [n, 3, g] of a log of its own: errors that its
        dwells share [n, 3, k, g], and variances [n, 3, g²] of those that they do not.

        Raises FrameError where an error grows with time and the log tells none.
        """
        indication, time = unseen_dwells.indication, unseen_dwells.time
        readings, _ = self.readings(indication, unseen_dwells.temperature)
        shared, independent = [], np.zeros_like(indication)
        for model, slopes in zip(self.models, self.slopes(readings), strict=True):
            shared.append(slopes @ gum.square_root(np.array(model.covariance)))
        for axis, letter in enumerate(AXES):
            model = self.models[axis % len(self.models)]
            # where the fit has a noise of each axis, it is that
            noise = {p.name: p.value for p in model.parameters}
            independent[:, axis] += noise.get(f"noise_{letter}", model.residual_rms) ** 2
            if self.form.further is not None:
                independent[:, axis] += self.form.further(model, readings) ** 2
            for part in model.components:
                # by one unit: in proportion to the indication, to the time, or the same in all
                size = np.full(len(indication), part.value)
                if part.unit == "1":
                    size *= indication[:, axis]
                elif part.unit.endswith("/h"):
                    if not np.isfinite(time).all():
                        raise FrameError(
                            f"{unseen_dwells.place[0]}: no time_s, expected one: the"
                            f" {part.effect} of the {part.group}, {part.value:.3g} {part.unit},"
                            " grows with time",
                            hint="log time_s",
                        )
                    size *= (time - time.mean()) / SECONDS_PER_HOUR
                if part.unit == "rad":  # gravity moves at right angles to itself
                    size *= np.sqrt(np.clip(1.0 - indication[:, axis] ** 2, 0.0, None))
                if part.group == "attitude":  # which a log seldom repeats
                    independent[:, axis] += size**2
                else:
                    shared.append(size[:, None, None] * np.eye(3)[axis][:, None])
        return np.concatenate(shared, axis=2), independent

    def by_term(self, dwells: DwellSet, term: TypeB) -> Array:
        """Errors [n, 3, g] of corrected dwells against the reference for one standard uncertainty
        of a type B term: on the reference's angles, the thermometer, an indication or a
        coefficient; 0 of any other.
        """
        indication, temperature = dwells.indication, dwells.temperature
        shifted_inputs = {}
        if term.quantity in FIELDS:
            name = FIELDS[term.quantity]
            shifted_inputs[name] = getattr(dwells, name) + term.u_of(0.0)
        elif term.quantity in forms.COMPONENTS:
            axis, shifted = forms.COMPONENTS.index(term.quantity), indication.copy()
            of_one = indication[:, axis] if term.unit in RELATIVE else 1.0
            shifted[:, axis] += term.u_of(1.0) * of_one
            shifted_inputs["indication"] = shifted
        if shifted_inputs:
            shifted_dwells = replace(dwells, **shifted_inputs)
            by_input = self(shifted_dwells.indication, shifted_dwells.temperature) - self(
                indication, temperature
            )
            # without angles, lengths do not depend on them
            return by_input + np.nan_to_num(shifted_dwells.reference - dwells.reference)
        result = term.result or term.quantity
        by_model = self.slopes(self.readings(indication, temperature)[0])
        for model, slopes in zip(self.models, by_model, strict=True):
            for j, c in enumerate(model.coefficients):
                if result in {c.name, f"{model.name}.{c.name}"}:
                    return slopes[:, :, j] * type_b.combine_terms(
                        (term,), (result,), c.value, c.unit
                    )
        return np.zeros_like(indication)


def find_stage(compensation: str) -> str:
    """Stage of a compensation; raises CoefficientError for the mixed one of 0.2."""
    if compensation == "kq":
        raise CoefficientError(MIXED, hint=IN_STEAD)
    return COMPENSATIONS[compensation]


def find_correction(compensation: str, stages: Iterable[Record | StageResult]) -> Correction:
    """Correction that a recipe names, from the stages of a run or of a fit; raises CoefficientError
    for a missing stage, and for the mixed compensation of 0.2.
    """
    stage_name = find_stage(compensation)
    for stage in stages:
        if stage.stage == stage_name:
            return Correction(stage.models)
    raise CoefficientError(
        f"the run holds no {stage_name}.json", hint="it is not a run of accelerometer"
    )


@dataclass(frozen=True, slots=True)
class DwellErrors:
    """Errors of n dwells against the reference; those of toolface grow as 1/sin(inclination), and
    stand only within a range of inclination.
    """

    residual: Array
    """Residuals of the components [n, 3, g], or of the magnitude of gravity [n, 1, g]."""
    figures: Mapping[str, float] = field(default_factory=dict)
    """Key in a validation.json → root mean square or largest size [°] of the attitude's errors; of
    toolface times sin(inclination), which hardly depends on the range, too. NaN where no dwell lies
    in it; empty where the magnitude of gravity is the only reference.
    """
    inclination_deg: Array = field(default_factory=lambda: np.zeros(0))
    """[n], indicated minus reference [°]."""
    toolface_deg: Array = field(default_factory=lambda: np.zeros(0))
    """[n], indicated minus reference in (−180, 180] [°], NaN outside the range."""

    @classmethod
    def compare(
        cls, dwells: DwellSet, spec: AccelerometerRecipe, correction: Correction | None = None
    ) -> Self:
        """Errors of dwells against the reference attitudes or the magnitude of gravity, for raw
        indications or, where a correction is given, for corrected components.
        """
        vector = dwells.indication
        if correction is not None:
            vector = correction(vector, dwells.temperature)
        if spec.reference.kind == "magnitude":
            return cls(np.linalg.norm(vector, axis=1)[:, None] - 1.0)
        return cls.of_vectors(vector, dwells.inclination, dwells.toolface, spec.toolface_range_deg)

    @classmethod
    def of_vectors(
        cls,
        vector: Array,
        inclination_deg: Array,
        toolface_deg: Array,
        inclination_range_deg: tuple[float, float] = (10.0, 170.0),
    ) -> Self:
        """Errors of gravity vectors [n, 3] against reference angles [n] [°]."""
        low, high = inclination_range_deg
        residual = vector - attitude.gravity_vector(inclination_deg, toolface_deg)
        tilt = attitude.inclination(vector) - inclination_deg
        inside = (inclination_deg >= low) & (inclination_deg <= high)
        roll = np.where(inside, attitude.wrapped(attitude.toolface(vector) - toolface_deg), np.nan)
        scaled = roll * np.sin(np.radians(inclination_deg))
        largest = [
            float(np.fmax.reduce(np.abs(errors), initial=np.nan)) for errors in (tilt, roll, scaled)
        ]
        figures = {
            "inclination_rms_deg": rms(tilt),
            "inclination_max_deg": largest[0],
            "toolface_rms_deg": rms(roll[inside]),
            "toolface_max_deg": largest[1],
            "toolface_sin_max_deg": largest[2],
        }
        return cls(residual, figures, tilt, roll)

    @property
    def residual_rms_g(self) -> float:
        """Root mean square of the residual [g]."""
        return rms(self.residual)

    def judge_errors(
        self, spec: AccelerometerRecipe, correction: Correction | None = None
    ) -> tuple[Criterion, ...]:
        """Criteria of the acceptance limits on the corrected dwells; of unseen dwells, whose
        correction is given, also how much larger their errors are than those of the fitted ones.
        """
        limits, residual = spec.acceptance, self.residual_rms_g
        tested: list[tuple[str, float, float | None, str]] = []
        if self.figures:
            tilt, scaled = (
                self.figures[key] for key in ("inclination_max_deg", "toolface_sin_max_deg")
            )
            times_sine = "largest toolface error times sin(inclination)"
            tested += [
                ("largest inclination error", tilt, limits.max_inclination_error_deg, "deg"),
                (times_sine, scaled, limits.max_toolface_error_sin_deg, "deg"),
            ]
        tested.append(("residual rms", residual, limits.max_residual_rms_g, "g"))
        if correction is not None:
            # the fitted dwells would be compared with themselves, which no limit can find
            fitted = rms([model.residual_rms for model in correction.models])
            ratio = residual / fitted if fitted > 0.0 else 0.0
            over_fit = "residual over that of the fit"
            tested.append((over_fit, ratio, limits.max_residual_over_noise, "1"))
        return tuple(
            at_most(name, value, limit, unit)
            for name, value, limit, unit in tested
            if limit is not None
        )

    def judge_uncertainty(
        self, name: str, dwells: DwellSet, correction: Correction, terms: Sequence[TypeB] = ()
    ) -> Criterion:
        """Criterion that the errors of unseen, corrected dwells are as large as their uncertainty
        states, whose parts of the coefficients and of type B terms they share.
        """
        shared, independent = correction.uncertainty(dwells)
        by_terms = [correction.by_term(dwells, term) for term in terms]
        shared = np.concatenate([shared, *(part[:, :, None] for part in by_terms)], axis=2)
        if self.residual.shape[1] == 1:  # lengths: along the corrected vector
            vector = correction(dwells.indication, dwells.temperature)
            unit = vector / np.linalg.norm(vector, axis=1)[:, None]
            shared = np.einsum("ni,nik->nk", unit, shared)[:, None]
            independent = np.sum(unit**2 * independent, axis=1)[:, None]
        # fewest degrees of freedom of a coefficient, and of the residuals
        models = correction.models
        of_coefficients = min(model.dof_of(c) for model in models for c in model.coefficients)
        comparison = unseen(
            self.residual.ravel(),
            shared.reshape(self.residual.size, -1),
            independent.ravel(),
            dof=(max(of_coefficients, 1.0), max(min(model.dof for model in models), 1.0)),
        )
        return over_u(f"{name}: rms error", comparison.to_object())


def tabulate_errors(
    errors: Mapping[str, DwellErrors], spec: AccelerometerRecipe, title: str
) -> Table:
    """Table of errors, a row for each correction; toolface with its inclination range."""
    low, high = spec.toolface_range_deg
    heads: list[str | Column] = ["", Column("residual rms [µg]", ".1f")]
    if spec.reference.kind == "attitude":
        heads += [
            "inclination rms, max [°]",
            f"toolface rms, max [°], {low:g}-{high:g}°",
            "max toolface·sin(incl.) [°]",
        ]
    rows: list[tuple[str | float, ...]] = []
    for name, of_dwells in errors.items():
        angles = [number(figure, 3) for figure in of_dwells.figures.values()]
        cells = [", ".join(angles[:2]), ", ".join(angles[2:4]), *angles[4:]] if angles else []
        rows.append((name, 1e6 * of_dwells.residual_rms_g, *cells))
    return Table(title, tuple(heads), tuple(rows))


def list_errors(errors: DwellErrors, spec: AccelerometerRecipe) -> dict[str, object]:
    """JSON object of the errors of one log; the toolface with its inclination range."""
    entries: dict[str, object] = {"residual_rms_g": errors.residual_rms_g}
    if errors.figures:
        entries |= {name: number_or_none(x) for name, x in errors.figures.items()}
        entries["toolface_inclination_range_deg"] = list(spec.toolface_range_deg)
    return entries
