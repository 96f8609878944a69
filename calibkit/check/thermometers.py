"""Case and chamber air: whether they are read in one unit and sign, and which of the two is which.

On a ramp the case follows the air behind a lag, and in time it moves as far: case − air = offset +
(gain − 1) · air − lag · rate with a gain of 1 and a positive lag. A gain of 9/5 or 5/9 with the
zero point of °F is a unit, a negative lag an exchange.
"""

import re
from collections.abc import Mapping

import numpy as np

from calibkit.arrays import Array
from calibkit.check import lead
from calibkit.frame import Finding, Log, Severity, values

SPAN_DEGC = 5.0
"""Change of temperature from which rates and slopes tell units apart."""
APART_DEGC = 20.0
"""Difference [°C] of case and air that no self-heating keeps up in a soak."""
STILL_DEGC = 0.3
"""Change [°C] within a fiftieth of a log below which a temperature stands still."""
FAHRENHEIT, ZERO_DEGF = 1.8, 32.0
GAIN, OFFSET_DEGF = 0.12, 15.0
"""Relative deviation of the gain from 9/5, and deviation of the zero point [°F], up to which they
are those of °F.

On 400 simulated ramps of 1 to 10 °C/min in one unit the gain is 0.91 to 1 (air over case: 1 to
1.05): a lag of more than one node is no pure delay.
"""
LEAST_LEAD_DEGC = 2.0
"""Lead of the case over the air [°C] that noisy thermometers do not show."""
SURE = 0.5
"""Correlation of the lead with the rate from which it is one; on the same ramps, exchanged, it is
0.8 and more.
"""
ORDERED = 0.3
"""Relative deviation of a measured rate from the recipe's that a chamber may have."""
_NUMBER = re.compile(r"\d+(?:\.\d+)?")
AGREE = 0.06
"""Relative deviation of measured rates from 9/5 of those that were ordered, up to which all are
that.
"""


def check_pair(log: Log, case: str, air: str) -> list[Finding]:
    """Case and chamber air that do not move together, or do not meet in a soak, as one unit and
    sign do, or are exchanged.
    """
    (a_low, a_high), (b_low, b_high) = log.extremes(case), log.extremes(air)
    if b_high - b_low < 2.0 * SPAN_DEGC or a_high - a_low < SPAN_DEGC:
        return []
    a, b = values(log.frame, case), values(log.frame, air)
    thinned = slice(None, None, a.size // 20_000 + 1)
    together = float(np.corrcoef(a[thinned], b[thinned])[0, 1])
    if together < -0.5:
        advice = (
            f"a sign is wrong: state sign = -1 in [columns.{case}] or [columns.{air}], or see to"
            " the wiring"
        )
        return [
            _finding(
                log,
                case,
                "it falls while the chamber air rises",
                "both to rise together",
                advice,
                "sign",
                together,
            )
        ]
    found = lead.fit_lead(values(log.frame, "time_s"), a, b)
    return [*_unit(log, case, air, found), *_apart(log, case, air, a, b)][:1] or _exchanged(
        log, case, air, found
    )


def _unit(log: Log, case: str, air: str, found: lead.Lead) -> list[Finding]:
    """One of the two in °F: gain and zero point of the straight line between them."""
    of_case = found.gain, found.offset
    of_air = 1.0 / found.gain, -found.offset / found.gain
    for column, other, (gain, offset) in ((case, air, of_case), (air, case, of_air)):
        if abs(gain / FAHRENHEIT - 1.0) < GAIN and abs(offset - ZERO_DEGF) < OFFSET_DEGF:
            what = f"it moves by {gain:.3g} for each °C of '{other}' and is {offset:.3g} at 0 °C"
            advice = f'it is in °F: state it, [columns.{column}] unit = "degF"'
            return [_finding(log, column, what, "a gain of 1", advice, "unit", gain, refuse=True)]
    return []


def _apart(log: Log, case: str, air: str, a: Array, b: Array) -> list[Finding]:
    """A case that does not come to the air's temperature in a soak."""
    for of_case, of_air in _soaked(a, b):
        if abs(of_case - of_air) > APART_DEGC:
            found = f"{of_case:.4g} °C in a soak at {of_air:.4g} °C of '{air}'"
            advice = _fahrenheit(case, air, of_case, of_air)
            expected = "a case that comes to the air's temperature"
            return [_finding(log, case, found, expected, advice, "unit", of_case - of_air)]
    return []


def _exchanged(log: Log, case: str, air: str, found: lead.Lead) -> list[Finding]:
    """A case that runs ahead of the air that drives it."""
    if found.correlation > -SURE or found.swing < LEAST_LEAD_DEGC:
        return []
    what = (
        f"it runs ahead of the chamber air, by {found.swing:.1f} °C at the log's fastest"
        f" ({-found.lag_s:.3g} s)"
    )
    advice = f"{case} and {air} are swapped, in the log or in [columns]"
    return [
        _finding(
            log, case, what, "a case that lags behind", advice, "swapped", -found.lag_s, refuse=True
        )
    ]


def _soaked(case: Array, air: Array) -> list[tuple[float, float]]:
    """Means of case and air at the ends of a log where both stand still."""
    rows = max(20, case.size // 50)
    ends = (slice(0, rows), slice(case.size - rows, None))
    still = [end for end in ends if max(abs(_creep(case[end])), abs(_creep(air[end]))) < STILL_DEGC]
    return [(float(case[end].mean()), float(air[end].mean())) for end in still]


def _creep(values: Array) -> float:
    """Change of the mean from the first to the second half."""
    half = values.size // 2
    return float(values[half:].mean() - values[:half].mean())


def _fahrenheit(case: str, air: str, of_case: float, of_air: float) -> str:
    """Advice that names the column whose values are the other's in °F."""
    for column, value, other in ((case, of_case, of_air), (air, of_air, of_case)):
        if abs((value - ZERO_DEGF) / FAHRENHEIT - other) < APART_DEGC / 2.0:
            return f'it looks like °F: state it, [columns.{column}] unit = "degF"'
    return (
        f"one of them is in another unit or belongs to another sensor: see [columns.{case}] and"
        f" [columns.{air}]"
    )


def check_stated_rate(log: Log, air: str, said: float, measured: float) -> list[Finding]:
    """A ramp whose measured rate [°C/min] is not the one that the recipe gives."""
    if said and abs(measured / said - 1.0) <= ORDERED:
        return []
    advice = "correct the rate in [drift.rates_degc_min], or leave it out: it is measured then"
    if said and abs(measured / said / FAHRENHEIT - 1.0) <= AGREE:
        advice = (
            'the temperatures look like °F (9/5): state unit = "degF" of each in [columns]; or'
            " correct the rate"
        )
    what = f"the chamber air changes at {measured:+.3g} °C/min, the recipe says {said:+g}"
    return [_finding(log, air, what, "the rate that the recipe gives", advice, "unit", measured)]


def check_rates_in_names(measured: Mapping[str, float]) -> list[tuple[str, Finding]]:
    """Logs that are named after their rates and ran 9/5 times as fast; `measured` is log file →
    rate [°C/min].
    """
    numbers = {
        file: [float(text) for text in _NUMBER.findall(file.rsplit(".", 1)[0])] for file in measured
    }
    places = range(min(map(len, numbers.values()), default=0))
    rates = ({file: (numbers[file][k], rate) for file, rate in measured.items()} for k in places)
    return next(filter(None, map(_find_fahrenheit, rates)), [])


def _find_fahrenheit(rates: Mapping[str, tuple[float, float]]) -> list[tuple[str, Finding]]:
    """Logs whose chamber changed 9/5 times as fast as was ordered: all temperatures are in °F,
    which no other check can tell.

    `rates` holds log file → (ordered, measured) rate [°C/min]; at least two different ones must
    agree.
    """
    ratios = {file: abs(measured / said) for file, (said, measured) in rates.items() if said}
    different = {abs(said) for said, _ in rates.values()}
    if len(different) < 2 or any(
        abs(ratio / FAHRENHEIT - 1.0) > AGREE for ratio in ratios.values()
    ):
        return []
    file = next(iter(ratios))
    said, measured = rates[file]
    what = (
        f"{abs(measured):.3g} °C/min where {abs(said):g} was ordered, and as much too fast in all"
        f" {len(rates)} logs (9/5)"
    )
    advice = 'all temperatures look like °F: state unit = "degF" of each temperature in [columns]'
    expected = "the rates that the logs are named after"
    return [(file, Finding(file, what, expected, advice, "warn", "unit", figure=ratios[file]))]


def _finding(
    log: Log,
    column: str,
    what: str,
    expected: str,
    advice: str,
    name: str,
    figure: float,
    *,
    refuse: bool = False,
) -> Finding:
    """Finding about a column as a whole."""
    severity: Severity = "refuse" if refuse else "warn"
    return Finding(
        f"{log.file}: column '{column}'", what, expected, advice, severity, name, None, None, figure
    )
