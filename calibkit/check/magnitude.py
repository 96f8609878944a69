"""Units and signs that the size of the numbers gives away, and indications that were compensated
before.
"""

import re
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from calibkit.check.content import finding_at_row, finding_of_column
from calibkit.errors import advise_exclude
from calibkit.numeric import anomalies, chunks, dispersion, segments
from calibkit.numeric.arrays import Array
from calibkit.numeric.constants import STANDARD_GRAVITY_MPS2
from calibkit.recipe import Recipe
from calibkit.records.frame import Finding, Log, values

QUIETEST_DPH = 0.02
"""Span [°/h] that the indication of no logged gyro stays within: its white noise alone is wider."""
QUIETEST_MEAN_DPH = 0.1
"""Indication [°/h] of a still gyro below which so small a span is another unit's: the earth's rate
alone is larger.
"""
SLOWEST_SAMPLING_S = 100.0
"""Interval [s] at which nobody records the noise of a gyro."""
FASTEST_DPH = 36_000.0
"""Bias [°/h] that no gyro at rest has: 10 °/s."""
SPAN_DEGC = 5.0
"""Change of temperature from which rates and slopes distinguish units."""
SLOWEST_DEGC_MIN, FASTEST_DEGC_MIN = 0.03, 30.0
"""Rates at which chambers do not change."""
G_OF_UNIT = {"m/s^2": STANDARD_GRAVITY_MPS2, "mg": 1000.0, "ug": 1e6}
"""Length of gravity in units that are taken for g."""
ALIKE_LOGS = 3
"""Other logs that a log's drift is compared with, at least."""
ALIKE = 0.5
"""Largest deviation of their slopes, of their median, up to which they agree: where slow and fast
ramps differ by more, a log that differs is none that was compensated.
"""
COMPENSATED_SHARE = 0.4
"""Share of the others' slope below which a log looks compensated; on 64 simulated ramps it is 0.77
to 1.25.
"""
PARTS = 100
"""Block means of a log that are compared with the drift taken off it."""
APART, WIDER = 4.0, 2.0
"""Distance of the levels of turned logs, in widths of either group and in spans within a log."""
OPPOSITE = 0.25
"""Share of that distance that the mean levels of both groups may add up to: else they are no
opposites.
"""
MILLISECONDS = 'time looks like milliseconds: state it, [columns.time_s] unit = "ms"'
"""Advice where a clock runs a thousand times too fast."""
COMPENSATED = re.compile(
    r"comp(?!are|ass|ute|onent|lete)|correct|补偿|修正|校正|kompens|korrig", re.IGNORECASE
)
"""Words in a column's name that say it was corrected before."""


def check_gyro_unit(log: Log, column: str) -> list[Finding]:
    """A gyro at rest whose indication is too small or too large for °/h."""
    data = values(log.frame, column)
    low, high = chunks.extremes_of_present(data)
    sampled = np.abs(anomalies.sample(data))
    span, level = high - low, dispersion.median(sampled[~np.isnan(sampled)])
    if 0.0 < span < QUIETEST_DPH:
        words = (
            f"all {data.size} rows lie within {span:.2g} deg/h",
            "the noise of a gyro",
            f'the log looks like deg/s or rad/s: state it, [columns.{column}] unit = "deg/s"',
        )
    elif level > FASTEST_DPH:
        words = (
            f"an indication of {level:.3g} deg/h at rest",
            f"a bias below {FASTEST_DPH:g} deg/h",
            f"state the log's unit in [columns.{column}]: counts are not deg/h",
        )
    else:
        return []
    # finding unit: a gyro at rest indicates too much or too little for °/h
    return [finding_at_row(log, 0, column, *words, "unit", severity="warn", figure=span)]


def check_noise_unit(log: Log, column: str) -> list[Finding]:
    """A gyro in a record of noise whose indication is too small or too large for °/h; what is
    missing is left out.

    Its noise alone may be that of a quiet gyro: the span shows °/s only where the whole indication
    is that small too.
    """
    low, high = chunks.extremes_of_present(values(log.frame, column))
    if high - low < QUIETEST_DPH and max(high, -low) > QUIETEST_MEAN_DPH:
        return []
    return check_gyro_unit(log, column)


def check_sampling_unit(log: Log) -> list[Finding]:
    """A clock whose unit makes a record of noise one sample in minutes."""
    step = log.steps.usual
    if step < SLOWEST_SAMPLING_S:
        return []
    # finding unit: samples of a record are minutes apart: a clock in another unit
    return [
        finding_of_column(
            log,
            "time_s",
            f"a sample every {step:g} s",
            expected="a gyro sampled faster",
            advice=MILLISECONDS,
            name="unit",
            figure=step,
        )
    ]


def check_time_unit(
    log: Log, column: str, quantity: str, slowest: float = SLOWEST_DEGC_MIN
) -> list[Finding]:
    """A clock whose unit makes a temperature change at a rate that no chamber has; `slowest`
    [°C/min] is that of what the column measures.
    """
    thinned = slice(None, None, len(log.frame) // 20_000 + 1)
    time, data = values(log.frame, "time_s")[thinned], values(log.frame, column)[thinned]
    if time.size < 100 or np.ptp(data) < 2.0 * SPAN_DEGC:
        return []
    window = float(time[-1] - time[0]) / 50.0
    fastest = float(np.quantile(np.abs(segments.causal_slope(time, data, window)), 0.98))
    if fastest > FASTEST_DEGC_MIN:
        advice = 'time looks like minutes or hours: state it, [columns.time_s] unit = "min"'
    elif fastest < slowest:
        advice = MILLISECONDS
    else:
        return []
    # finding unit: a temperature changes as in no chamber: a clock in another unit
    return [
        finding_of_column(
            log,
            "time_s",
            f"{quantity} changes by {np.ptp(data):.3g} °C at up to {fastest:.2g} °C/min",
            f"{slowest:g} to {FASTEST_DEGC_MIN:g} °C/min",
            advice,
            "unit",
            fastest,
        )
    ]


def check_gravity_unit(log: Log, axes: Sequence[str]) -> list[Finding]:
    """A triad at rest whose length is not one g in most rows, or one or two axes that show more:
    another unit. Rows in which a value is missing are left out.
    """
    lengths = np.sqrt(sum(values(log.frame, axis) ** 2 for axis in axes))
    usual = dispersion.median(lengths[~np.isnan(lengths)])
    if (0.8 if len(axes) == 3 else 0.0) <= usual < 1.25:
        return []
    unit = next((unit for unit, g in G_OF_UNIT.items() if 0.8 < usual / g < 1.25), None)
    advice = (
        f'it looks like {unit}: state it, [columns.{axes[0]}] unit = "{unit}"'
        if unit
        else "state the log's unit"
    )
    observation = f"{', '.join(axes)} have a length of {usual:.4g} g in most rows"
    # finding unit: the indications of a triad at rest are not one g long
    return [finding_of_column(log, axes[0], observation, "1 g", advice, "unit", usual)]


def check_gyro_sign(log: Log, column: str, rate: str) -> list[Finding]:
    """A gyro whose counts fall while the table turns faster."""
    data, table_rate = values(log.frame, column), values(log.frame, rate)
    if any(low == high for low, high in (log.extremes(column), log.extremes(rate))):
        return []
    x, y = data - data.mean(), table_rate - table_rate.mean()
    correlation = float(x @ y / np.sqrt((x @ x) * (y @ y)))
    if correlation > -0.9:
        return []
    # finding sign: counts of a gyro fall while the table turns faster
    return [
        finding_of_column(
            log,
            column,
            f"its counts fall while the table rate rises (correlation {correlation:.3f})",
            expected="counts that rise with the rate",
            advice=(
                f"state sign = -1 in [columns.{column}] or [columns.{rate}] where that is not the"
                " gyro's own sense"
            ),
            name="sign",
            figure=correlation,
        )
    ]


def find_compensated_names(log: Log, recipe: Recipe, columns: Sequence[str]) -> list[Finding]:
    """Indications whose own name in the log states that they were corrected before: never
    compensate twice.
    """
    findings = []
    for column in columns:
        source = recipe.columns[column].source if column in recipe.columns else column
        if COMPENSATED.search(source):
            # finding double_compensation: a column is called compensated
            finding = Finding(
                f"{log.file}:1: column '{column}'",
                f"its column in the log is called '{source}'",
                expected="an indication as it was measured",
                advice=(
                    "map the column that was not compensated; a log that was must not be"
                    " compensated twice"
                ),
                severity="warn",
                name="double_compensation",
                line=1,
                column=column,
            )
            findings.append(finding)
    return findings


def fit_drift_slope(case: Array, indication: Array) -> float:
    """Slope [°/h/K] of an indication [n, °/h] over the case temperature [n, °C] by least squares; 0
    where it stands still.
    """
    temperature_deviation = case - case.mean()
    power = float(temperature_deviation @ temperature_deviation)
    return float(temperature_deviation @ indication) / power if power > 0.0 else 0.0


def find_compensated_logs(slopes: Mapping[str, float]) -> list[tuple[str, Finding]]:
    """Logs whose drift over temperature is missing, or the other way round, while that of all
    others agrees.

    Of one instrument the slopes [°/h/K] of at least four logs are compared, each with the median of
    the others.
    """
    findings = []
    for file, slope in slopes.items():
        other_slopes = np.array([value for name, value in slopes.items() if name != file])
        if other_slopes.size < ALIKE_LOGS:
            continue
        usual = float(np.median(other_slopes))
        agree = float(np.max(np.abs(other_slopes - usual))) < ALIKE * abs(usual)
        if agree and slope / usual < COMPENSATED_SHARE:
            opposite = "its sign may be the other (sign = -1 in [columns.gyro_dph]), or "
            # finding double_compensation: a log does not drift as the others of the gyro do
            finding = Finding(
                f"{file}: column 'gyro_dph'",
                f"the indication moves by {slope:.3g} deg/h/°C, that of the other logs by"
                f" {usual:.3g}",
                expected="logs of one gyro to drift alike",
                advice=(
                    f"{opposite if slope / usual < -COMPENSATED_SHARE else ''}it may have been"
                    " compensated before: never compensate twice; take the log as it was measured,"
                    f" or leave it out: {advise_exclude(file)}"
                ),
                severity="warn",
                name="double_compensation",
                figure=slope / usual,
                column="gyro_dph",
            )
            findings.append((file, finding))
    return findings


def measure_level(indication: Array) -> tuple[float, float]:
    """Median of PARTS block means of an indication [n, °/h], and what they span."""
    means = _part_means(indication, min(PARTS, indication.size))
    return float(np.median(means)), float(np.ptp(means))


def _part_means(column: Array, count: int) -> Array:
    """Means of `count` parts of a column [n]."""
    edges = np.linspace(0, column.size, count + 1).astype(np.int64).tolist()
    return np.array([column[a:b].mean() for a, b in pairwise(edges)])


def find_turned_logs(levels: Mapping[str, tuple[float, float]]) -> list[tuple[str, Finding]]:
    """Logs of one gyro at rest that indicate the opposite of the others: its sign was turned in
    them. `levels` is log file → level and span [°/h] as `measure_level` gives them.

    No turn-on bias takes a gyro from its rate to the opposite one. The fewer logs are named.
    """
    groups = [
        [file for file, (level, _) in levels.items() if way * level > 0.0] for way in (1.0, -1.0)
    ]
    if min(map(len, groups)) < 2 or sum(map(len, groups)) < len(levels):
        return []
    positive, negative = (np.array([levels[file][0] for file in group]) for group in groups)
    distance = float(positive.mean() - negative.mean())
    width = max(float(np.ptp(positive)), float(np.ptp(negative)))
    span = max(span for _, span in levels.values())
    if distance <= max(APART * width, WIDER * span):
        return []
    if abs(positive.mean() + negative.mean()) >= OPPOSITE * distance:
        return []
    minority, majority = sorted(groups, key=len)
    # finding sign: logs of a gyro at rest indicate the opposite rate of the others
    return [
        (
            file,
            Finding(
                f"{file}: column 'gyro_dph'",
                f"it indicates {levels[file][0]:+.3g} deg/h at rest, {majority[0]}"
                f" {levels[majority[0]][0]:+.3g} ({len(minority)} logs against {len(majority)})",
                expected="logs of one gyro that indicate the same rate at rest",
                advice=(
                    "its sign was turned between these logs: see which are right, and state"
                    " sign = -1 in [columns.gyro_dph] for logs that are fitted apart, or turn"
                    f" the others' values, or leave them out: {advise_exclude(file)}"
                ),
                severity="refuse",
                name="sign",
                figure=levels[file][0],
                column="gyro_dph",
            ),
        )
        for file in minority
    ]


def flag_missing_drift(file: str, predicted: Array, indication: Array) -> list[str]:
    """Flag for a log [n, °/h] that does not show the drift [n, °/h] that is about to be taken off
    it.

    The indication is compared with the prediction by a straight line through a hundred block means.
    """
    if predicted.size < 10 * PARTS:
        return []
    x, y = (_part_means(column, PARTS) for column in (predicted, indication))
    power = float(np.sum((x - x.mean()) ** 2))
    if power == 0.0:
        return []
    gain = fit_drift_slope(x, y)
    residual = y - y.mean() - gain * (x - x.mean())
    # blocks of one log are not independent: a tenth of them counts
    uncertainty = float(np.sqrt(np.mean(residual**2) * 10.0 / power))
    if gain + 3.0 * uncertainty > COMPENSATED_SHARE:
        return []
    why = "it may have been compensated before, and must not be twice"
    if gain < -COMPENSATED_SHARE:
        why = "its sign is the other: state sign = -1 in [columns.gyro_dph]"
    return [
        (
            f"{file}: the log follows the drift of this run's model with a gain of {gain:.2f} ±"
            f" {3.0 * uncertainty:.2f}, expected 1: {why}; or it is another gyro's"
        )
    ]
