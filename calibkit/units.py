"""The field's units: one table, and the conversions between units of one dimension."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING

from calibkit.errors import RecipeError, UsageError, did_you_mean
from calibkit.numeric.constants import STANDARD_GRAVITY_MPS2

if TYPE_CHECKING:
    from collections.abc import Iterable

    from calibkit.numeric.arrays import Array


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit: base value = (value + shift) · factor / divisor, in the base unit of its dimension.

    Factor and divisor are kept apart so that a value of few digits converts to the nearest float64:
    12345 ms is 12.345 s.
    """

    dimension: str
    factor: float = 1.0
    divisor: float = 1.0
    shift: float = 0.0

    @property
    def size(self) -> float:
        """A difference of one in this unit, in the base unit."""
        return self.factor / self.divisor


_PI = math.pi

TABLE: dict[str, Unit] = {
    "s": Unit("time"),
    "ms": Unit("time", 1.0, 1e3),
    "us": Unit("time", 1.0, 1e6),
    "ns": Unit("time", 1.0, 1e9),
    "min": Unit("time", 60.0),
    "h": Unit("time", 3600.0),
    "d": Unit("time", 86400.0),
    "degC": Unit("temperature"),
    "K": Unit("temperature", shift=-273.15),
    "degF": Unit("temperature", 5.0, 9.0, -32.0),
    "deg/h": Unit("angular rate"),
    "deg/s": Unit("angular rate", 3600.0),
    "mdeg/s": Unit("angular rate", 18.0, 5.0),
    "mdeg/h": Unit("angular rate", 1.0, 1e3),
    "deg/min": Unit("angular rate", 60.0),
    "rad/s": Unit("angular rate", 648000.0, _PI),
    "mrad/s": Unit("angular rate", 648.0, _PI),
    "urad/s": Unit("angular rate", 0.648, _PI),
    "rad/h": Unit("angular rate", 180.0, _PI),
    "arcsec/s": Unit("angular rate"),
    "rpm": Unit("angular rate", 21600.0),
    "deg": Unit("angle"),
    "mdeg": Unit("angle", 1.0, 1e3),
    "rad": Unit("angle", 180.0, _PI),
    "mrad": Unit("angle", 0.18, _PI),
    "urad": Unit("angle", 0.00018, _PI),
    "arcmin": Unit("angle", 1.0, 60.0),
    "arcsec": Unit("angle", 1.0, 3600.0),
    "rev": Unit("angle", 360.0),
    "g": Unit("acceleration"),
    "mg": Unit("acceleration", 1.0, 1e3),
    "ug": Unit("acceleration", 1.0, 1e6),
    "m/s^2": Unit("acceleration in SI"),
    "mm/s^2": Unit("acceleration in SI", 1.0, 1e3),
    "cm/s^2": Unit("acceleration in SI", 1.0, 1e2),
    "1/s": Unit("count rate"),
    "1/ms": Unit("count rate", 1e3),
    "1/min": Unit("count rate", 1.0, 60.0),
    "1/h": Unit("count rate", 1.0, 3600.0),
    "1/sample": Unit("count per sample"),
    "1": Unit("count"),
    "V": Unit("voltage"),
    "mV": Unit("voltage", 1.0, 1e3),
    "uV": Unit("voltage", 1.0, 1e6),
    "mA": Unit("current", 1.0, 1e3),
    "A": Unit("current"),
    "ohm": Unit("resistance"),
}
"""Spelling → unit; the base units are s, °C, °/h, °, g (local), m/s², 1/s, 1/sample, 1, V, A, Ω."""

ALIASES: dict[str, str] = {
    **dict.fromkeys(("sec", "secs", "second", "seconds", "sek", "sekunden", "秒"), "s"),
    **dict.fromkeys(("msec", "millisecond", "milliseconds", "毫秒"), "ms"),
    **dict.fromkeys(("µs", "μs", "usec", "microseconds", "微秒"), "us"),
    **dict.fromkeys(("minute", "minutes", "minuten", "分", "分钟"), "min"),
    **dict.fromkeys(("hr", "hrs", "hour", "hours", "std", "stunden", "小时", "时"), "h"),
    **dict.fromkeys(("days", "tage", "天"), "d"),
    **dict.fromkeys(
        (
            "°C",
            "℃",
            "C",
            "degc",
            "deg C",
            "deg_C",
            "deg. C",
            "° C",
            "º C",
            "ºC",
            "celsius",
            "Celsius",
        ),
        "degC",
    ),
    **dict.fromkeys(("摄氏度", "度C", "grad C", "Grad C", "Grad Celsius", "oC"), "degC"),
    **dict.fromkeys(("kelvin", "Kelvin", "开", "开尔文"), "K"),
    **dict.fromkeys(
        ("°F", "℉", "F", "degf", "deg F", "fahrenheit", "Fahrenheit", "华氏度"), "degF"
    ),
    **dict.fromkeys(
        (
            "°/h",
            "º/h",
            "deg/hr",
            "deg/hour",
            "dph",
            "(°)/h",
            "(deg)/h",
            "°/hr",
            "°h-1",
            "°·h⁻¹",
            "Grad/h",
        ),
        "deg/h",
    ),
    **dict.fromkeys(("度/小时", "度/时", "°/小时", "度/h", "(°)·h-1", "°/Std"), "deg/h"),
    **dict.fromkeys(
        ("°/s", "º/s", "deg/sec", "dps", "(°)/s", "(deg)/s", "°/sec", "°·s⁻¹", "Grad/s", "grad/s"),
        "deg/s",
    ),
    **dict.fromkeys(("度/秒", "°/秒", "度/s", "(°)·s-1"), "deg/s"),
    **dict.fromkeys(("°/min", "度/分", "(°)/min"), "deg/min"),
    **dict.fromkeys(("m°/s", "mdps"), "mdeg/s"),
    **dict.fromkeys(("rad/sec", "弧度/秒", "rad·s⁻¹", "rad·s-1"), "rad/s"),
    **dict.fromkeys(("rev/min", "r/min", "U/min"), "rpm"),
    **dict.fromkeys(("°", "º", "度", "degree", "degrees", "Grad", "grad"), "deg"),
    **dict.fromkeys(("弧度", "radian", "radians"), "rad"),
    **dict.fromkeys(("'", "′", "角分"), "arcmin"),
    **dict.fromkeys(('"', "″", "角秒", "as"), "arcsec"),
    **dict.fromkeys(("″/s", '"/s', "角秒/秒"), "arcsec/s"),
    **dict.fromkeys(("G", "gn", "g0", "重力加速度"), "g"),
    **dict.fromkeys(("mG",), "mg"),
    **dict.fromkeys(("µg", "μg", "uG"), "ug"),
    **dict.fromkeys(
        ("m/s²", "m/s2", "m/s/s", "m·s⁻²", "m·s-2", "米/秒²", "m/sec^2", "m/s**2"), "m/s^2"
    ),
    **dict.fromkeys(
        (
            "lsb",
            "LSB",
            "count",
            "counts",
            "cnt",
            "cts",
            "pulse",
            "pulses",
            "Impuls",
            "Impulse",
            "Imp",
            "脉冲",
            "脉冲数",
            "个",
        ),
        "1",
    ),
    **dict.fromkeys(
        (
            "lsb/s",
            "LSB/s",
            "counts/s",
            "count/s",
            "cps",
            "Hz",
            "pulses/s",
            "pulse/s",
            "Impulse/s",
            "Imp/s",
            "脉冲/秒",
            "p/s",
            "^/s",
        ),
        "1/s",
    ),
    **dict.fromkeys(
        ("lsb/sample", "counts/sample", "count/sample", "pulses/sample", "pulse/sample"), "1/sample"
    ),
    **dict.fromkeys(("Volt", "volt", "volts", "VDC", "V DC", "Vdc", "VAC", "伏"), "V"),
    **dict.fromkeys(("mVDC", "毫伏"), "mV"),
    **dict.fromkeys(("µV", "μV"), "uV"),
    **dict.fromkeys(("Ω", "OHM", "Ohm", "Ohms", "ohms", "欧姆", "\u2126"), "ohm"),
}

COLUMN_UNITS: dict[str, str] = {
    "s": "s",
    "degc": "degC",
    "dph": "deg/h",
    "dps": "deg/s",
    "deg": "deg",
    "g": "g",
    "lsb": "1",
}
"""Last word of a column name → unit that the column is in."""


def column_unit(column: str) -> str:
    """Unit that the last word of a column's name states; a gyro's `lsb` is counts per second."""
    unit = COLUMN_UNITS.get(column.rsplit("_", 1)[-1], "1")
    return "1/s" if column.startswith("gyro") and unit == "1" else unit


def known(spelling: str) -> str:
    """Return the table's spelling of a unit, or raise RecipeError with the closest known one."""
    unit = ALIASES.get(spelling, spelling)
    if unit in TABLE:
        return unit
    known_units = f"known units: {', '.join(TABLE)}"
    raise RecipeError(
        f"unknown unit '{spelling}'",
        hint=did_you_mean(spelling, [*TABLE, *ALIASES], known_units),
    )


def _a(dimension: str) -> str:
    """A dimension with its article."""
    return f"{'an' if dimension[0] in 'aeiou' else 'a'} {dimension}"


def convert(values: Array, source: str, target: str, *, gravity_mps2: float | None = None) -> Array:
    """Convert values [any shape] from one unit to another of the same dimension.

    m/s² and local g convert into each other only when the local gravity [m/s²] is given: which g is
    meant is a fact of the site, never a constant. Raises RecipeError for units of different
    dimensions.
    """
    a, b = TABLE[known(source)], TABLE[known(target)]
    si = "acceleration in SI"
    if {a.dimension, b.dimension} == {"acceleration", si}:
        if gravity_mps2 is None:
            raise RecipeError(
                f"'{source}' to '{target}' needs the local gravity",
                hint="give [site] gravity_mps2, or latitude and height",
            )
        base = values * a.factor / a.divisor
        return (
            (base / gravity_mps2 if a.dimension == si else base * gravity_mps2)
            * b.divisor
            / b.factor
        )
    if a.dimension != b.dimension:
        raise RecipeError(
            f"'{source}' is {_a(a.dimension)}, '{target}' {_a(b.dimension)}",
            hint="state the log's own unit",
        )
    if a == b:
        return values
    # of K and °C: a sum alone, without the roundings of a factor
    if (a.factor, a.divisor) == (b.factor, b.divisor):
        return values + (a.shift - b.shift)
    return (values + a.shift) * a.factor / a.divisor * b.divisor / b.factor - b.shift


ANGLE_MARKS = ("°", "′", "″")
"""Units of plane angle, which follow their number without a space."""
MARKS = {
    "": "",
    "1": "",
    "deg": "°",
    "degC": "°C",
    "arcsec": "″",
    "m/s^2": "m/s²",
    "ug": "µg",
    "deg/sqrt(h)": "°/√h",
    "ug/sqrt(Hz)": "µg/√Hz",
    "mg/sqrt(h)": "mg/√h",
    "mg*s": "mg·s",
}
"""Printed form of units, and of parts of compound units, that differ from their spelling in files.
"""
POWERS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
SHARES = {"%": 1e-2, "ppm": 1e-6, "ppb": 1e-9}
"""Units that are a share of the quantity itself."""
_MADE_OF: dict[str, tuple[float, dict[str, int]]] = {
    "angular rate": (1.0 / TABLE["h"].size, {"angle": 1, "time": -1}),
    "acceleration in SI": (1.0 / STANDARD_GRAVITY_MPS2, {"acceleration": 1}),
    "count rate": (1.0, {"time": -1}),
    "count per sample": (1.0, {"sample": -1}),
    "count": (1.0, {}),
}
"""Dimension → size of its base unit, and what it is made of, where that is not itself."""
_POWER = re.compile(r"(.+?)\^?([1-9²³])")
_LIMIT = re.compile(
    r"\s*(?P<name>.+?)\s*<=\s*(?P<value>\+?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(?P<unit>.*?)\s*"
)


def _take_apart(spelling: str) -> tuple[float, dict[str, int]]:
    """Size of a difference of one in a unit or a quotient of units, and powers of its dimensions;
    RecipeError for an unknown part.
    """
    parts = [part.strip() for part in spelling.split("/")]
    # m/s^2 is one unit, m/s^2/h a quotient
    heads = ("/".join(parts[:count]) for count in range(len(parts), 0, -1))
    head = next((head for head in heads if head in TABLE or head in ALIASES), parts[0])
    size, powers = 1.0, dict[str, int]()
    for number, part in enumerate([head, *parts[head.count("/") + 1 :]]):
        is_unit = part in TABLE or part in ALIASES
        raised = None if is_unit else _POWER.fullmatch(part)
        name, digit = (raised[1], raised[2]) if raised else (part, "1")
        power = {"²": 2, "³": 3}.get(digit) or int(digit)
        power *= -1 if number else 1
        if name in SHARES:
            size *= SHARES[name] ** power
            continue
        unit = TABLE[known(name)]
        of_base, made_of = _MADE_OF.get(unit.dimension, (1.0, {unit.dimension: 1}))
        size *= (unit.size * of_base) ** power
        for dimension, times in made_of.items():
            powers[dimension] = powers.get(dimension, 0) + times * power
    return size, {dimension: power for dimension, power in powers.items() if power}


def difference_factor(source: str, target: str) -> float:
    """Factor from a difference in one unit to one in another, of units and quotients of units
    (ug/h, ppm/degC); of temperatures the scales' zeros do not matter, and g is standard gravity,
    as local gravity would change an uncertainty by half a percent.

    Raises RecipeError with the units that are accepted for one of another kind.
    """
    (a, of_source), (b, of_target) = _take_apart(source), _take_apart(target)
    if of_source == of_target:
        return a / b
    raise RecipeError(
        f"'{source}' is not of the kind of '{target}'", hint=f"state it in {_alike(target)}"
    )


def parse_limit(text: str, option: str) -> tuple[str, float, str]:
    """Name, value and unit (empty where none is stated) of a text `name<=value unit`, the value
    above 0; UsageError, which names the option of the command, for another text.
    """
    match = _LIMIT.fullmatch(text)
    value = float(match["value"]) if match else 0.0
    if match is None or not 0.0 < value < math.inf:
        raise UsageError(
            f"{option} '{text}' is no limit", hint="write name<=value unit, as 'drift<=0.1 deg/h'"
        )
    return match["name"], value, ALIASES.get(match["unit"], match["unit"])


def parse_limits(texts: Iterable[str], option: str) -> dict[str, tuple[float, str]]:
    """Name → value and unit of texts as of `parse_limit`; UsageError for two on one name."""
    limits: dict[str, tuple[float, str]] = {}
    for text in texts:
        name, value, unit = parse_limit(text, option)
        if name in limits:
            raise UsageError(f"{option}: two limits on {name}", hint="state one")
        limits[name] = value, unit
    return limits


def _alike(target: str) -> str:
    """Units of the kind of a unit, by the parts of its quotient: "g, mg, ug per s, ms, us"."""
    parts = [target] if target in TABLE else target.split("/")
    lists = []
    for part in parts:
        name = part.partition("^")[0]
        _, made_of = _take_apart(name)
        same_kind = [name, *(unit for unit in (*TABLE, *SHARES) if _take_apart(unit)[1] == made_of)]
        lists.append(", ".join(dict.fromkeys(same_kind)) if made_of else ", ".join((name, *SHARES)))
    return " per ".join(lists)


def scaled(values: Array, factor: float, *, offset: float = 0.0) -> Array:
    """Values [any shape] times a factor that is meant as its decimal digits say, plus an offset.

    The factor is taken as the fraction of two whole numbers that its shortest decimal text is:
    whole counts of 0.0001 become the float64 nearest to the true product, which a multiplication by
    the float64 next to 0.0001 does not.
    """
    if factor != 1.0:
        exact = Fraction(repr(float(factor)))
        # larger whole numbers are no exact float64
        if max(abs(exact.numerator), exact.denominator) >= 1 << 53:
            values = values * factor
        else:
            values = values * float(exact.numerator) / float(exact.denominator)
    return values + offset if offset else values


_BRACKETED = re.compile(r"[(（\[<{]\s*([^()（）\[\]<>{}]*(?:\(°\)[^()]*)?)\s*[)）\]>}]\s*$")
_BEHIND = re.compile(r".*?(?:\s*[,，:：]\s*|\s+/\s+|\s+in\s+)(\S.*)$")


def parse_unit(text: str) -> str:
    """Unit of a text that is nothing but a unit, with or without brackets, or "" where it is none
    of the table's.
    """
    text = text.strip()
    inner = text[1:-1].strip() if text[:1] + text[-1:] in {"()", "（）", "[]", "<>", "{}"} else text
    for candidate in (text, inner, text.lower(), inner.lower()):
        unit = ALIASES.get(candidate, candidate)
        # "1" in brackets is a number of a column, no unit
        if unit in TABLE and (unit != "1" or candidate in ALIASES):
            return unit
    return ""


def as_stated(text: str) -> str:
    """Unit of a text that is nothing but a unit; the text itself where it is none that is known."""
    text = text.partition(" since ")[0].strip()  # netCDF counts times from an epoch
    return parse_unit(text) or text


def bracketed_text(name: str) -> str:
    """What stands in brackets behind a column's name, or ""."""
    match = _BRACKETED.search(name.strip())
    return match.group(1).strip() if match else ""


def unit_in_header(name: str) -> str:
    """Unit that a column's header states behind its name, or "" where it states none of the
    table's.

    In brackets (`gyro (deg/h)`, `温度(℃)`, `陀螺输出（°/h）`), behind a comma or a lone slash
    (`T / °C`), or as a last word that can be nothing else (`Temperatur °C`).
    """
    name = name.strip()
    if bracketed := bracketed_text(name):
        return parse_unit(bracketed)
    if suffix := _BEHIND.match(name):
        return parse_unit(suffix.group(1))
    last = name.rsplit(None, 1)[-1] if " " in name else ""
    return parse_unit(last) if any(mark in last for mark in "°℃℉/") else ""


def name_without_unit(name: str) -> str:
    """A column's header without the unit in brackets behind it."""
    bracketed = _BRACKETED.search(name.strip())
    return name.strip()[: bracketed.start()].strip() if bracketed else name.strip()


def with_unit(number: str, mark: str) -> str:
    """A number with its unit: ° ′ ″ of plane angle stand without a space, nothing for none."""
    return f"{number}{mark}" if mark in ANGLE_MARKS else f"{number} {mark}".strip()


def unit_mark(unit: str) -> str:
    """Unit as it is printed, with one solidus or brackets: 1/deg → 1/°, deg/h/degC^2 → (°/h)/°C²,
    1/s/degC → 1/(s·°C); nothing for a pure number.
    """
    if unit in MARKS:
        return MARKS[unit]
    first, *factors = map(_mark_factor, re.findall(r"(?:[^/()]|\([^()]*\))+", unit))
    divisors = [mark for mark in factors if mark != "1"]
    if not divisors and first == "1":
        return ""
    if len(divisors) > 1 and first != "1":
        first, divisors = f"({first}/{divisors[0]})", divisors[1:]
    if len(divisors) > 1:
        flat = (mark.strip("()") for mark in sorted(divisors, key=lambda mark: "/" in mark))
        divisors = [f"({'·'.join(flat)})"]
    return "/".join((first, *divisors))


def _mark_factor(factor: str) -> str:
    """One factor of a unit: degC^2 → °C², sqrt(h) → √h, (1)^2 → 1."""
    base, _, power = factor.replace("*", "·").partition("^")
    if base[-1].isdigit() and base != "1":
        base, power = base[:-1], base[-1]
    base = re.sub(r"^\((\w+)\)$", r"\1", re.sub(r"^sqrt\((\w+)\)$", r"√\1", base))
    if base == "1":
        return "1"
    return base.replace("degC", "°C").replace("deg", "°") + power.translate(POWERS)
