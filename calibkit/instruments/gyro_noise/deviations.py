"""Records of sensors at rest → Allan deviation, noise terms, wavelet deviation and bias stability,
and gyro_noise.json.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibkit import check, units
from calibkit.arrays import Array
from calibkit.coefficients import Condition, Figure, StageResult
from calibkit.errors import FitError
from calibkit.frame import Finding, Log, Remark, values
from calibkit.instruments.gyro_noise import forms
from calibkit.instruments.gyro_noise.recipe import GyroNoiseRecipe
from calibkit.instruments.gyro_noise.sensors import ACCELEROMETER, Sensor, find_sensor
from calibkit.numeric.noise import allan, allan_fit

CASE = "temp_case_degc"
STEADY_DEGC = 2.0
"""Change of the case temperature [°C] up to which a record counts as one of noise."""
OFF_GRID = 0.25
"""Share of the sampling interval by which a sample may be off its place."""
LONGEST_GRID = 1 << 27
"""Places of a grid, gaps included, above which the times cannot be right."""


@dataclass(frozen=True, slots=True)
class _Record:
    """One sensor's indication [n] in one log, in the unit of its noise, on an even grid, NaN where
    samples are missing.
    """

    log: str
    column: str
    interval_s: float
    rate: Array

    @property
    def name(self) -> str:
        """Log, and column where it is not the only gyro's."""
        return self.log if self.column == "gyro_dph" else f"{self.column}.{self.log}"

    @property
    def sensor(self) -> Sensor:
        """Kind of sensor."""
        return find_sensor(self.column)

    def estimate_noise(self, recipe: GyroNoiseRecipe) -> "NoiseFigures":
        """Curves, terms and bias stability of one record; what a record is too short for is flagged
        and left out.
        """
        spec = recipe.noise
        try:
            curve = allan.overlapping(
                self.rate,
                self.interval_s,
                spacing=spec.spacing,
                points=spec.points,
                probability=spec.probability,
            )
            terms = allan_fit.fit_noise(curve, self.sensor.laws)
            wavelet = allan.wavelet_deviation(
                self.rate, self.interval_s, wavelet=spec.wavelet, probability=spec.probability
            )
        except FitError as error:
            raise FitError(f"{self.name}: {error.message}", hint=error.hint) from None
        stability, flags = [], [f"{self.name}: {flag}" for flag in terms.flags]
        for block_s in spec.bias_stability_s:
            try:
                stability.append(allan.bias_stability(self.rate, self.interval_s, block_s=block_s))
            except FitError as error:
                flags.append(f"{self.name}: no bias stability over {block_s:g} s: {error.message}")
        missing = int(np.isnan(self.rate).sum())
        if missing:
            flags.append(
                f"{self.name}: {missing} of {self.rate.size} samples"
                f" ({missing / self.rate.size:.1%}) are missing; averages across them are left out"
            )
        flags += [
            Remark(f"{self.name}: {term.name} ({term.symbol}) not observable: {term.reason}")
            for term in terms.not_observable
        ]
        mean = float(np.nanmean(self.rate))
        return NoiseFigures(
            self, curve, wavelet, terms, tuple(stability), mean, missing, tuple(flags)
        )


@dataclass(frozen=True, slots=True)
class NoiseFigures:
    """Deviations, noise terms and bias stability of one record."""

    record: _Record
    curve: allan.DeviationCurve
    wavelet: allan.DeviationCurve
    terms: allan_fit.NoiseFit
    stability: tuple[allan.BiasStability, ...]
    mean: float
    missing: int
    flags: tuple[str, ...]


def find_faults(log: Log, recipe: GyroNoiseRecipe) -> list[Finding]:
    """What is wrong with a log; missing rates and gaps in time are gaps and no faults."""
    spec = recipe.noise
    early = [
        *check.find_too_few_rows(log, spec.min_rows),
        *check.find_missing_values(log, ["time_s"]),
    ]
    if any(finding.refused for finding in early):
        return early
    found = [*early, *check.find_unordered_times(log)]
    for column in spec.columns:
        rate = values(log.frame, column)
        present = rate[~np.isnan(rate)]
        if present.size < spec.min_rows or np.isinf(present).any():
            found.append(
                Finding(
                    f"{log.file}: column '{column}'",
                    f"{present.size} rates{', some infinite' if np.isinf(present).any() else ''}",
                    f"at least {spec.min_rows} finite ones",
                    "record for longer, or lower [noise] min_rows",
                )
            )
        elif np.ptp(present) == 0.0:
            found += check.find_constant_columns(log, [column])
        else:
            of_gyro = find_sensor(column) is not ACCELEROMETER
            implausible = check.find_implausible_rates(log, column) if of_gyro else []
            if of_gyro:
                found += implausible or check.magnitude.check_noise_unit(log, column)
            if present.size == rate.size and not implausible:
                # only without missing rates are the rows an even series
                found += check.series.check_indication(log, column, units.column_unit(column))
    accelerations = [name for name in spec.columns if find_sensor(name) is ACCELEROMETER]
    if accelerations and not any(finding.refused for finding in found):
        found += check.magnitude.check_gravity_unit(
            replace(log, frame=log.frame.dropna(subset=accelerations)), accelerations
        )
    if not any(finding.refused for finding in found):
        found += check.magnitude.check_sampling_unit(log)
    return [*found, *_steady(log)]


def _steady(log: Log) -> list[Finding]:
    """Flag a case whose temperature moved: drift is then in every figure of the longer averaging
    times.
    """
    if CASE not in log.frame.columns or not np.isfinite(values(log.frame, CASE)).any():
        return []
    case = values(log.frame, CASE)
    moved = float(np.nanmax(case) - np.nanmin(case))
    if moved <= STEADY_DEGC:
        return []
    return [
        Finding(
            f"{log.file}: column '{CASE}'",
            f"the case moved by {moved:.1f} °C",
            f"at most {STEADY_DEGC:g} °C in a record of noise",
            "hold the temperature, or read the longer averaging times as drift",
            severity="warn",
            name="unsteady_temperature",
        )
    ]


def read_records(log: Log, columns: Sequence[str]) -> list[_Record]:
    """Indications of a log on an even grid; raises FitError where the samples do not lie on one."""
    time = values(log.frame, "time_s")
    off = np.diff(time)
    usual = float(np.median(off))
    off /= usual
    whole = np.round(off)
    off -= whole
    np.abs(off, out=off)
    worst = int(np.argmax(off))
    if off[worst] > OFF_GRID or not np.all(whole >= 1.0) or float(whole.sum()) > LONGEST_GRID:
        step = float(time[worst + 1] - time[worst])
        raise FitError(
            f"{log.file}:{log.line(worst + 1)}: a step of {step:g} s, expected"
            f" a multiple of {usual:g} s",
            hint="an Allan deviation wants even sampling; resampling would change it",
        )
    steps, gapless = int(whole.sum()), bool(np.all(whole == 1.0))
    place = None if gapless else np.concatenate(([0], np.cumsum(whole.astype(np.int64))))
    interval = float((time[-1] - time[0]) / steps)
    found = []
    for column in columns:
        own, shown = units.column_unit(column), find_sensor(column).unit
        rate = units.convert(values(log.frame, column), own, shown)
        if place is not None:
            on_grid = np.full(steps + 1, np.nan)
            on_grid[place] = rate
            rate = on_grid
        found.append(_Record(log.name, column, interval, rate))
    return found


def result(found: Sequence[NoiseFigures], flags: Sequence[str], probability: float) -> StageResult:
    """gyro_noise.json: figures named quantity.log (or quantity.column.log); a term that is not
    observable is a flag. The probability of the deviations' limits is a condition.
    """
    return StageResult(
        "gyro_noise",
        figures=tuple(figure for one in found for figure in _figures(one)),
        flags=tuple(flags),
        conditions=(Condition(forms.PROBABILITY, probability, "1"),),
    )


def _figures(one: NoiseFigures) -> Iterator[Figure]:
    """Figures of one record."""
    name, sensor = one.record.name, one.record.sensor
    yield Figure(forms.term_name(sensor.mean, name), one.mean, sensor.unit, 0.0)
    for term in one.terms.terms:
        called = forms.term_name(term.name, name)
        yield Figure(called, term.value, term.unit, term.standard_uncertainty, term.dof)
    for entry in one.stability:
        called = forms.term_name(f"bias_stability_{entry.block_s:g}_s", name)
        u = stability_uncertainty(entry)
        # n − 1 block means, were they independent and normal
        yield Figure(called, entry.value, sensor.unit, u, entry.blocks - 1.0)
    for kind, curve in zip(forms.KINDS, (one.curve, one.wavelet), strict=True):
        points = np.column_stack([curve.tau_s, curve.deviation, curve.dof]).tolist()
        for tau, deviation, dof in points:
            called, u = forms.Deviation(kind, tau, name).name, deviation / np.sqrt(2.0 * dof)
            yield Figure(called, deviation, sensor.unit, float(u), dof)


def stability_uncertainty(entry: allan.BiasStability) -> float:
    """Standard uncertainty of a standard deviation of n values in its unit, σ/√(2(n − 1))."""
    return float(entry.value / np.sqrt(2.0 * (entry.blocks - 1)))
