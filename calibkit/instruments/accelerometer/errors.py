"""Errors of dwells under a correction: of inclination and toolface, what a recipe accepts of them,
and how tables, the first screen of a fit and a validation.json state them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from calibkit.arrays import Array
from calibkit.coefficients import Criterion, Figure, at_most, over_u
from calibkit.fit.unseen import unseen
from calibkit.instruments.accelerometer.coefficient_files import Correction
from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.instruments.accelerometer.shared_errors import angle_slopes
from calibkit.instruments.accelerometer.triad import Triad
from calibkit.numeric import attitude
from calibkit.numeric.dispersion import rms
from calibkit.recipe.type_b import TypeB
from calibkit.report.overview import KeyValue, Overview
from calibkit.report.summary import number
from calibkit.report.table import Column, Table, number_or_none


@dataclass(frozen=True, slots=True)
class AttitudeErrors:
    """Inclination and toolface errors of n dwells against a reference attitude; toolface errors
    grow as 1/sin(inclination), and stand only within a range of inclination.
    """

    inclination_deg: Array
    """[n], indicated minus reference [°]."""
    toolface_deg: Array
    """[n], indicated minus reference in (−180, 180] [°], NaN outside the range."""
    figures: Mapping[str, float]
    """Key in a validation.json → root mean square or largest size [°]; of toolface times
    sin(inclination), which hardly depends on the range, too. NaN where no dwell lies in it.
    """

    @classmethod
    def compare(
        cls,
        vector: Array,
        inclination_deg: Array,
        toolface_deg: Array,
        inclination_range_deg: tuple[float, float] = (10.0, 170.0),
    ) -> Self:
        """Errors of gravity vectors [n, 3] against reference angles [n] [°]."""
        low, high = inclination_range_deg
        tilt = attitude.inclination(vector) - inclination_deg
        inside = (inclination_deg >= low) & (inclination_deg <= high)
        roll = np.where(inside, attitude.wrapped(attitude.toolface(vector) - toolface_deg), np.nan)
        scaled = roll * np.sin(np.radians(inclination_deg))
        figures = {
            "inclination_rms_deg": rms(tilt),
            "inclination_max_deg": _largest(tilt),
            "toolface_rms_deg": rms(roll[inside]),
            "toolface_max_deg": _largest(roll[inside]),
            "toolface_sin_max_deg": _largest(scaled[inside]),
        }
        return cls(tilt, roll, figures)


@dataclass(frozen=True, slots=True)
class DwellErrors:
    """Errors of a set of dwells against the reference."""

    residual: Array
    """Residuals of the components [n, 3, g], or of the magnitude of gravity [n, 1, g]."""
    angles: AttitudeErrors | None
    """Attitude errors; None where the magnitude of gravity is the only reference."""
    noise_g: float = np.nan
    """Noise of a dwell by the fit of the correction [g]; NaN where nothing is corrected."""

    @property
    def residual_rms_g(self) -> float:
        """Root mean square of the residual [g]."""
        return rms(self.residual)

    def judge_errors(self, spec: AccelerometerRecipe) -> tuple[Criterion, ...]:
        """Criteria of the recipe's acceptance limits on the corrected dwells."""
        limits, residual = spec.acceptance, self.residual_rms_g
        tested: list[tuple[str, float, float | None, str]] = []
        if self.angles is not None:
            tilt = self.angles.figures["inclination_max_deg"]
            scaled = self.angles.figures["toolface_sin_max_deg"]
            times_sine = "largest toolface error times sin(inclination)"
            tested += [
                ("largest inclination error", tilt, limits.max_inclination_error_deg, "deg"),
                (times_sine, scaled, limits.max_toolface_error_sin_deg, "deg"),
            ]
        over_noise = residual / self.noise_g if self.noise_g > 0.0 else 0.0
        tested += [
            ("residual rms", residual, limits.max_residual_rms_g, "g"),
            ("residual over noise", over_noise, limits.max_residual_over_noise, "1"),
        ]
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
        if self.angles is None:  # lengths: along the corrected vector
            vector = correction(dwells.indication, dwells.temperature)
            unit = vector / np.linalg.norm(vector, axis=1)[:, None]
            shared = np.einsum("ni,nik->nk", unit, shared)[:, None]
            independent = np.sum(unit**2 * independent, axis=1)[:, None]
        comparison = unseen(
            self.residual.ravel(),
            shared.reshape(self.residual.size, -1),
            independent.ravel(),
            dof=correction.dof,
        )
        return over_u(f"{name}: rms error", comparison.to_object())

    @classmethod
    def compare(
        cls, dwells: DwellSet, spec: AccelerometerRecipe, correction: Correction | None = None
    ) -> Self:
        """Errors of dwells against the reference attitudes or the magnitude of gravity, for raw
        indications or, where a correction is given, for corrected components.
        """
        vector, noise = dwells.indication, np.nan
        if correction is not None:
            vector, noise = correction(vector, dwells.temperature), correction.noise_g
        if spec.reference.kind == "magnitude":
            return cls(np.linalg.norm(vector, axis=1)[:, None] - 1.0, None, noise)
        angles = AttitudeErrors.compare(
            vector, dwells.inclination, dwells.toolface, spec.toolface_range_deg
        )
        return cls(vector - dwells.reference, angles, noise)


def propagate_uncertainty(
    triad: Triad, dwells: DwellSet, toolface_range_deg: tuple[float, float]
) -> tuple[Figure, ...]:
    """Largest standard uncertainties (type A) of inclination and toolface over the dwells, by the
    coefficients and the residual of a triad.

    The toolface uncertainty is multiplied by sin(inclination) and limited to the inclination range.
    """
    t, terms, indication = triad.mapped(dwells.temperature), triad.terms, dwells.indication
    vector = terms.corrected(triad.fit.parameters, indication, t)
    slopes = attitude_slopes(vector)
    by_coefficients = triad.fit.of(
        lambda p: np.sum(slopes * terms.corrected(p, indication, t), axis=2)
    ).u
    by_residual = triad.residual_rms * np.linalg.norm(slopes, axis=2)
    u_inclination, u_toolface_sin = np.degrees(np.hypot(by_coefficients, by_residual))
    tilt = attitude.inclination(vector)
    inside = (tilt >= toolface_range_deg[0]) & (tilt <= toolface_range_deg[1])
    by_angle = (("inclination", u_inclination), ("toolface_sin", u_toolface_sin[inside]))
    return tuple(
        Figure(f"{name}_standard_uncertainty_max", float(u.max()), "deg", 0.0)
        for name, u in by_angle
        if u.size
    )


def attitude_slopes(vector: Array) -> Array:
    """Derivatives [2, n, 3] [rad] by gravity vectors [n, 3] of inclination, and of toolface times
    sin(inclination), which has one at the poles too.
    """
    angles = np.radians([attitude.inclination(vector), attitude.toolface(vector)])
    return np.asarray(np.stack(angle_slopes(*angles)) / np.linalg.norm(vector, axis=1)[:, None])


def _largest(values: Array) -> float:
    return float(np.max(np.abs(values))) if values.size else float("nan")


def tabulate_errors(
    errors: Mapping[str, DwellErrors], spec: AccelerometerRecipe, title: str
) -> Table:
    """Table of errors, a row for each correction; toolface with its inclination range."""
    if spec.reference.kind == "magnitude":
        lengths = tuple(
            (name, 1e6 * of_dwells.residual_rms_g) for name, of_dwells in errors.items()
        )
        return Table(title, ("", Column("| |G| - g | rms [µg]", ".1f")), lengths)
    low, high = spec.toolface_range_deg
    heads = (
        "",
        Column("residual rms [µg]", ".1f"),
        "inclination rms, max [°]",
        f"toolface rms, max [°], {low:g}-{high:g}°",
        "max toolface·sin(incl.) [°]",
    )
    rows: list[tuple[str | float, ...]] = []
    for name, of_dwells in errors.items():
        if of_dwells.angles is not None:
            figures = [number(figure, 3) for figure in of_dwells.angles.figures.values()]
            pairs = ", ".join(figures[:2]), ", ".join(figures[2:4])
            rows.append((name, 1e6 * of_dwells.residual_rms_g, *pairs, figures[4]))
    return Table(title, heads, tuple(rows))


def list_errors(errors: DwellErrors, spec: AccelerometerRecipe) -> dict[str, object]:
    """JSON object of the errors of one log; the toolface with its inclination range."""
    entries: dict[str, object] = {"residual_rms_g": errors.residual_rms_g}
    if errors.angles is not None:
        entries |= {name: number_or_none(x) for name, x in errors.angles.figures.items()}
        entries["toolface_inclination_range_deg"] = list(spec.toolface_range_deg)
    return entries


def summarize_errors(
    raw: DwellErrors, corrected: DwellErrors, correction: str, table: Table, of_which: str
) -> Overview:
    """First screen of dwells before and after a correction."""
    before, after = (1e6 * errors.residual_rms_g for errors in (raw, corrected))
    sentence = (
        f"Residual of {len(raw.residual)} dwells{of_which} (rms): {before:.0f} µg before,"
        f" {after:.0f} µg after the {correction} correction."
    )
    facts = []
    values = [
        KeyValue("residual rms, before", before, "µg"),
        KeyValue("residual rms, after", after, "µg"),
    ]
    if raw.angles is not None and corrected.angles is not None:
        tilt = corrected.angles.figures["inclination_max_deg"]
        facts.append(
            f"Largest inclination error: {raw.angles.figures['inclination_max_deg']:.3f}° before,"
            f" {tilt:.3f}° after; largest toolface error times sin(inclination):"
            f" {corrected.angles.figures['toolface_sin_max_deg']:.3f}° after."
        )
        values.append(KeyValue("largest inclination error, after", tilt, "°"))
    if corrected.noise_g > 0.0:
        noise = 1e6 * corrected.noise_g
        facts.append(f"Noise of the dwells alone gives {noise:.0f} µg.")
        values.append(KeyValue("noise of the dwells", noise, "µg"))
    return Overview(sentence, tuple(facts), tuple(values), table)
