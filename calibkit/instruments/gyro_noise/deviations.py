"""Records of sensors at rest → Allan deviation, noise terms, wavelet deviation and bias stability.

    σ²(τ) = ½ ⟨(ȳ_(k+1) - ȳ_k)²⟩ = Σ_j c_j τ^j, j = -2 … 2    Allan variance and its noise terms
    σ²(2^(j-1) τ₀) = 2 ⟨d_j²⟩                                 wavelet variance, of details d_j
    B_s² = Σ (ω̄_i - ω̄)²/(n - 1)                               bias stability, of means of 10 s

The indication of one sensor in a log is a record on an even grid, NaN where samples are missing. It
gives estimates (`estimate_noise`), and these the figures of gyro_noise.json (`list_figures`).
"""

from dataclasses import dataclass

import numpy as np

from calibkit import check, units
from calibkit.errors import FitError
from calibkit.instruments.gyro_noise import forms
from calibkit.instruments.gyro_noise.forms import FigureName
from calibkit.instruments.gyro_noise.recipe import (
    ACCELEROMETER,
    GyroNoiseRecipe,
    Sensor,
    find_sensor,
)
from calibkit.numeric import chunks, dispersion
from calibkit.numeric.arrays import Array, Integers
from calibkit.numeric.noise import allan, allan_fit
from calibkit.records.coefficients import Figure, Input
from calibkit.records.frame import Finding, Log, Remark, values

CASE = "temp_case_degc"
STEADY_DEGC = 2.0
"""Change of the case temperature [°C] up to which a record counts as one of noise."""
OFF_GRID = 0.25
"""Share of the sampling interval by which a sample may be off its place."""
MOST_MISSING = 1 << 27
"""Places of a grid without a row above which the times cannot be right."""
BLOCKS = 600
"""Means over a record that its figure shows, at least where it has as many samples."""


@dataclass(frozen=True, slots=True)
class NoiseFigures:
    """What one record shows, in the unit of its noise: the indication of a sensor in a log, on an
    even grid.
    """

    log: Input
    name: str
    column: str
    sensor: Sensor
    curve: allan.DeviationCurve
    """Allan deviation."""
    wavelet: allan.DeviationCurve
    """Wavelet deviation, which no drift enters."""
    terms: allan_fit.NoiseFit
    stability: tuple[allan.BiasStability, ...]
    mean: float
    over_noise: float
    """Standard deviation of all samples over that within parts of the record; 1 for white noise."""
    missing: int
    """Samples that are missing."""
    block: int
    """Samples in a mean of the figure over time."""
    block_means: Array
    """[k], of the indication."""
    flags: tuple[str, ...]


def estimate_noise(
    log: Log, source: Input, column: str, places: Integers, recipe: GyroNoiseRecipe
) -> NoiseFigures:
    """Curves, terms and bias stability of the record of a column of a log, whose rows stand at
    places [n] of an even grid (`place_on_grid`); what it is too short for is flagged and left out.
    """
    spec, sensor, time = recipe.noise, find_sensor(column), values(log.frame, "time_s")
    name = log.name if column == "gyro_dph" else f"{column}.{log.name}"
    interval_s = float((time[-1] - time[0]) / places[-1])
    # NaN where samples are missing
    rate = np.full(int(places[-1]) + 1, np.nan)
    rate[places] = units.convert(values(log.frame, column), units.column_unit(column), sensor.unit)
    try:
        curve = allan.overlapping(
            rate,
            interval_s,
            spacing=spec.spacing,
            points=spec.points,
            probability=spec.probability,
        )
        terms = allan_fit.fit_noise(curve, sensor.laws)
        wavelet = allan.wavelet_deviation(
            rate,
            interval_s,
            wavelet=spec.wavelet,
            probability=spec.probability,
        )
    except FitError as error:
        raise FitError(f"{name}: {error.message}", hint=error.hint) from None
    flags, stability = [*terms.flags], []
    for block_s in spec.bias_stability_s:
        try:
            stability.append(allan.bias_stability(rate, interval_s, block_s=block_s))
        except FitError as error:
            flags.append(f"no bias stability over {block_s:g} s: {error.message}")
    present = rate[~np.isnan(rate)]
    missing = rate.size - present.size
    if missing:
        flags.append(
            f"{missing} of {rate.size} samples ({missing / rate.size:.1%}) are missing; averages"
            " across them are left out"
        )
    unseen = [
        Remark(f"{name}: {term.name} ({term.symbol}) not observable: {term.reason}")
        for term in terms.not_observable
    ]
    block, scatter = max(1, rate.size // BLOCKS), float(np.std(present))
    return NoiseFigures(
        log=source,
        name=name,
        column=column,
        sensor=sensor,
        curve=curve,
        wavelet=wavelet,
        terms=terms,
        stability=tuple(stability),
        mean=float(present.mean()),
        over_noise=dispersion.over_noise(scatter, [dispersion.variances_within(present, present)]),
        missing=missing,
        block=block,
        block_means=chunks.block_means(rate, block),
        flags=(*(f"{name}: {flag}" for flag in flags), *unseen),
    )


def find_faults(log: Log, recipe: GyroNoiseRecipe) -> list[Finding]:
    """What is wrong with a log; missing rates and gaps in time are gaps and no faults."""
    spec = recipe.noise
    early = [
        *check.find_too_few_rows(log, spec.min_rows),
        *check.find_missing_values(log, ["time_s"]),
    ]
    if any(finding.refused for finding in early):
        return early
    findings = [*early, *check.find_unordered_times(log)]
    for column in spec.columns:
        rate = values(log.frame, column)
        low, high = chunks.extremes_of_present(rate)
        present = int(np.count_nonzero(~np.isnan(rate)))
        infinite = int(np.count_nonzero(np.isinf(rate)))
        if present < spec.min_rows or infinite:
            # finding unusable: too few finite values for a record of noise
            findings.append(
                Finding(
                    f"{log.file}: column '{column}'",
                    f"{present} rates{', some infinite' if infinite else ''}",
                    f"at least {spec.min_rows} finite ones",
                    "record for longer, or lower [noise] min_rows",
                )
            )
        elif low == high:
            findings += check.find_constant_columns(log, [column])
        else:
            of_gyro = find_sensor(column) is not ACCELEROMETER
            implausible = check.find_implausible_rates(log, column) if of_gyro else []
            if of_gyro:
                findings += implausible or check.magnitude.check_noise_unit(log, column)
            if present == rate.size and not implausible:
                # only without missing rates are the rows an even series
                findings += check.series.check_indication(log, column, units.column_unit(column))
    accelerations = [name for name in spec.columns if find_sensor(name) is ACCELEROMETER]
    if accelerations and not any(finding.refused for finding in findings):
        findings += check.magnitude.check_gravity_unit(log, accelerations)
    if not any(finding.refused for finding in findings):
        findings += check.magnitude.check_sampling_unit(log)
    if CASE in log.frame.columns:
        low, high = chunks.extremes_of_present(values(log.frame, CASE))
        if high - low > STEADY_DEGC:
            # drift is then in every figure of the longer averaging times
            # finding unsteady_temperature: the case moved during a record of noise
            findings.append(
                Finding(
                    f"{log.file}: column '{CASE}'",
                    f"the case moved by {high - low:.1f} °C",
                    f"at most {STEADY_DEGC:g} °C in a record of noise",
                    "hold the temperature, or read the longer averaging times as drift",
                    severity="warn",
                    name="unsteady_temperature",
                )
            )
    return findings


def place_on_grid(log: Log) -> Integers:
    """Places [n], from 0, of the rows of a log on the even grid that its time lies on; raises
    FitError where it lies on none.
    """
    time, usual = values(log.frame, "time_s"), log.steps.usual
    whole_steps = np.round(np.diff(time) / usual)
    off_grid = np.abs(np.diff(time) / usual - whole_steps)
    too_long = whole_steps.sum() > time.size + MOST_MISSING
    if off_grid.max() > OFF_GRID or whole_steps.min() < 1.0 or too_long:
        worst = int(np.argmax(off_grid))
        step = float(time[worst + 1] - time[worst])
        raise FitError(
            f"{log.file}:{log.line(worst + 1)}: a step of {step:g} s, expected"
            f" a multiple of {usual:g} s",
            hint="an Allan deviation wants even sampling; resampling would change it",
        )
    return np.append(0, np.cumsum(whole_steps.astype(np.int64)))


def list_figures(noise: NoiseFigures) -> list[Figure]:
    """Figures of one record for gyro_noise.json, named quantity.log (or quantity.column.log), the
    mean first; none of a term that is not observable.
    """
    record, unit = noise.name, noise.sensor.unit
    # the mean has no uncertainty of its own: the noise terms say how it wanders
    figures = [Figure(str(FigureName(noise.sensor.mean, record)), noise.mean, unit, 0.0)]
    for term in noise.terms.terms:
        name, u = FigureName(term.name, record), term.standard_uncertainty
        figures.append(Figure(str(name), term.value, term.unit, u, term.dof))
    for entry in noise.stability:
        # n − 1 block means, were they independent and normal
        name, u = (
            FigureName(f"bias_stability_{entry.block_s:g}_s", record),
            entry.standard_uncertainty,
        )
        figures.append(Figure(str(name), entry.value, unit, u, entry.blocks - 1.0))
    for kind, curve in zip(forms.KINDS, (noise.curve, noise.wavelet), strict=True):
        points = np.column_stack([curve.tau_s, curve.deviation, curve.dof]).tolist()
        for tau, deviation, dof in points:
            # of a variance with a χ² of these degrees of freedom
            name, u = FigureName(kind, record, tau), float(deviation / np.sqrt(2.0 * dof))
            figures.append(Figure(str(name), deviation, unit, u, dof))
    return figures
