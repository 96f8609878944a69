"""Parameter files of autopilots: what their thermal models can hold of a run, checked after
rounding and printing.

PX4 (temperature_compensation): T is brought into TMIN … TMAX, offset = X0 + X1 d + X2 d² + X3 d³
with d = T − TREF is subtracted; gyros in rad/s, accelerometers in m/s². ArduPilot
(AP_InertialSensor_TCal): T is brought into TMIN … TMAX, (C1 d + C2 d² + C3 d³)/1e6 with d = T − 35
°C is subtracted and that at the temperature of the offset calibration added; the same units. Both
calculate in single precision; neither corrects scale factors or anything that depends on
temperature rate.
"""

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from calibkit.constants import STANDARD_GRAVITY_MPS2
from calibkit.errors import CoefficientError, OutputError
from calibkit.firmware import c_text, exact
from calibkit.firmware.chain import Sum
from calibkit.firmware.export import Export

DEGREE = 3
ARDUPILOT_SCALE = 10**6
POINTS = 1001
LARGEST_ERROR = 1e-3
"""Of the correction's span: a printed polynomial that is off by more is refused."""
CHANNEL = re.compile(r"(gyro|accel)_([xyz])_(?:dph|g)")
SI = {"gyro": Fraction(np.pi / 180.0 / 3600.0), "accel": Fraction(STANDARD_GRAVITY_MPS2)}
"""Sensor → 1 °/h in rad/s, 1 g in m/s²."""
Single: TypeAlias = NDArray[np.float32]
Values = Mapping[str, float]
"""Parameter → value, as printed."""


@dataclass(frozen=True, slots=True)
class _Channel:
    """Bias of one axis as powers of T − reference, in the autopilot's unit, and over u as the run
    has it.
    """

    sensor: str
    axis: str
    over_u: exact.Poly
    powers: exact.Poly = ()

    @property
    def name(self) -> str:
        """Sensor and axis."""
        return f"{self.sensor}_{self.axis}"


@dataclass(frozen=True, slots=True)
class _Thermal:
    """All channels of a run, their reference and range [°C], and the map of T to u."""

    channels: tuple[_Channel, ...]
    reference: Fraction
    limits: tuple[float, float]
    middle: Fraction
    half: Fraction


@dataclass(frozen=True, slots=True)
class _Pilot:
    """An autopilot: how it names its parameters and what it calculates with them."""

    name: str
    title: str
    lines: Callable[[_Thermal], list[str]]
    """Lines of its parameter file."""
    offset: Callable[[_Channel, Values, Single], Single]
    """What it subtracts on one axis at temperatures [°C], in single precision."""
    remarks: tuple[str, ...]
    reference: Fraction | None = None
    """Temperature [°C] that it counts from; None where it takes any, then the middle of the range.
    """
    relative: bool = False
    """Whether its offset is that of the offset calibration at one temperature: what counts is the
    difference from the offset there.
    """


def _px4_lines(thermal: _Thermal) -> list[str]:
    """PX4 parameters (tab-separated, as ground stations load them)."""
    lines = []
    limits = [
        ("TREF", _text(thermal.reference)),
        *zip(("TMIN", "TMAX"), map(_text, map(Fraction, thermal.limits)), strict=True),
    ]
    for sensor, letter in (("gyro", "G"), ("accel", "A")):
        channels = [c for c in thermal.channels if c.sensor == sensor]
        values = [
            (f"X{k}_{'xyz'.index(channel.axis)}", _text(c))
            for channel in channels
            for k, c in enumerate(channel.powers)
        ]
        if channels:
            lines.append(f"1\t1\tTC_{letter}_ENABLE\t1\t6")
            lines += [f"1\t1\tTC_{letter}0_{name}\t{text}\t9" for name, text in (*values, *limits)]
    return lines


def _px4_offset(channel: _Channel, values: Values, temperature: Single) -> Single:
    """X0 + X1 d + X2 d² + X3 d³ with d = T − TREF."""
    one, axis = np.float32, "xyz".index(channel.axis)
    stem = f"TC_{'G' if channel.sensor == 'gyro' else 'A'}0"
    d = temperature - one(values[f"{stem}_TREF"])
    c = [one(values.get(f"{stem}_X{k}_{axis}", 0.0)) for k in range(DEGREE + 1)]
    square = d * d
    return np.asarray(c[0] + c[1] * d + c[2] * square + c[3] * (square * d), dtype=one)


def _ardupilot_lines(thermal: _Thermal) -> list[str]:
    """ArduPilot parameters (name, comma, value)."""
    lines = ["INS_TCAL1_ENABLE,1"]
    for name, limit in zip(("TMIN", "TMAX"), thermal.limits, strict=True):
        lines.append(f"INS_TCAL1_{name},{_text(Fraction(limit))}")
    for channel in thermal.channels:
        powers = (*channel.powers, *[Fraction(0)] * DEGREE)
        lines += [
            f"{_ardupilot_name(channel, k)},{_text(powers[k] * ARDUPILOT_SCALE)}"
            for k in range(1, DEGREE + 1)
        ]
    return lines


def _ardupilot_name(channel: _Channel, power: int) -> str:
    """Name of the coefficient of a power."""
    letters = "GYR" if channel.sensor == "gyro" else "ACC"
    return f"INS_TCAL1_{letters}{power}_{channel.axis.upper()}"


def _ardupilot_offset(channel: _Channel, values: Values, temperature: Single) -> Single:
    """(C1 d + C2 d² + C3 d³)/1e6 with d = T − 35 °C."""
    one = np.float32
    d = temperature - one(35.0)
    c = [one(values[_ardupilot_name(channel, k)]) for k in (1, 2, 3)]
    return np.asarray((c[0] + (c[1] + c[2] * d) * d) * d * one(1e-6), dtype=one)


PX4 = _Pilot(
    "px4",
    "PX4",
    _px4_lines,
    _px4_offset,
    (
        (
            "model         offset = X0 + X1 d + X2 d^2 + X3 d^3, d = T - TREF; corrected = reading"
            " - offset; degree at most 3"
        ),
        (
            "identity      set TC_G0_ID and TC_A0_ID to the sensors' device identifiers: without"
            " them PX4 uses none of this"
        ),
    ),
)
ARDUPILOT = _Pilot(
    "ardupilot",
    "ArduPilot",
    _ardupilot_lines,
    _ardupilot_offset,
    (
        (
            "model         (C1 d + C2 d^2 + C3 d^3) / 1e6, d = T - 35 degC, is subtracted from the"
            " reading; degree at most 3"
        ),
        (
            "constant      none: the offset at the temperature of the offset calibration is that"
            " calibration's"
        ),
    ),
    Fraction(35),
    relative=True,
)
PILOTS = {pilot.name: pilot for pilot in (PX4, ARDUPILOT)}


def render(export: Export, pilot: _Pilot) -> bytes:
    """Parameter file of a run: facts, error after printing, polynomials, parameters, digest;
    OutputError where the autopilot cannot hold its corrections.
    """
    thermal = _thermal(export, pilot)
    lines = pilot.lines(thermal)
    stated = {}
    for name, (error, span) in _errors(thermal, _values(lines), pilot).items():
        if not error <= LARGEST_ERROR * span:
            raise OutputError(
                f"{name.replace('_', ' ')}: single precision leaves an error of {error:.1e} of"
                f" {span:.1e}",
                hint="export it with --target c",
            )
        stated[name] = f"{error:.1e}"
    proof = {
        "pilot": pilot.name,
        "middle": str(thermal.middle),
        "half": str(thermal.half),
        "channels": {
            c.name: {"u": [str(x) for x in c.over_u], "largest_error": stated[c.name]}
            for c in thermal.channels
        },
    }
    head = [
        *c_text.facts(export, bounds=False),
        (
            "unit          gyros in rad/s, accelerometers in m/s^2 (1 g = 9.80665 m/s^2),"
            " temperatures in degC"
        ),
        *pilot.remarks,
        *(
            f"after print   {name}: off by at most {error} over the range"
            for name, error in stated.items()
        ),
        json.dumps(proof, sort_keys=True),
    ]
    text = "\n".join([*(f"# {line}".rstrip() for line in head), *lines]) + "\n"
    return c_text.seal(text, comment="# {}").encode("ascii")


def _thermal(export: Export, pilot: _Pilot) -> _Thermal:
    """Polynomials of a run about the autopilot's reference temperature; or why it has none."""
    structure, tables = export.structure, export.chain.tables
    columns = {c.output: c.column for c in export.chain.corrections if not c.product}
    sums = {step.name: step.terms for step in structure.steps if isinstance(step, Sum)}
    over_u = {
        columns[output.name]: tables[terms[0].table]
        for output in structure.outputs
        if output.name in columns and len(terms := sums.get(output.source, ())) == 1
    }
    names = [entry.name for entry in structure.inputs]
    if names != ["temp_case_degc"] or len(over_u) < len(structure.outputs) or structure.has_memory:
        raise OutputError(
            f"{pilot.title} holds offsets that are polynomials of temperature and nothing else;"
            f" this run's chain is {', '.join(structure.forms)} of {', '.join(names)}",
            hint="export it with --target c or blob, or fit bias_temperature over temp_case_degc",
        )
    middle, reciprocal, low, high = tables[structure.maps[0].table]
    about, half = pilot.reference or _single(middle), 1 / reciprocal
    channels = []
    for column, polynomial in over_u.items():
        channel = _channel(column, polynomial, pilot.title)
        powers = exact.mapped(channel.over_u, (about - middle) * reciprocal, reciprocal)
        channels.append(replace(channel, powers=powers))
    limits = float(_single(middle + half * low)), float(_single(middle + half * high))
    return _Thermal(tuple(channels), about, limits, middle, half)


def _channel(column: str, over_u: exact.Poly, title: str) -> _Channel:
    """One axis in the autopilot's unit."""
    found = CHANNEL.fullmatch(column)
    if found is None:
        raise OutputError(
            f"{title}: '{column}' is no gyro or accelerometer of an axis x, y or z",
            hint="map it in [columns]",
        )
    if len(over_u) > DEGREE + 1:
        raise OutputError(
            f"{title}: {column} has degree {len(over_u) - 1}, at most {DEGREE} can be held",
            hint="fit it with order = 3 or less",
        )
    sensor, axis = found.groups()
    return _Channel(sensor, axis, exact.scale(over_u, SI[sensor]))


def _single(value: Fraction) -> Fraction:
    """Nearest number of single precision."""
    return Fraction(float(np.float32(float(value))))


def _text(value: Fraction) -> str:
    """Number in single precision with nine significant digits."""
    return f"{float(_single(value)):.9g}"


def _values(lines: Sequence[str]) -> dict[str, float]:
    """Parameter → value, as printed."""
    found = {}
    for line in lines:
        fields = line.split("\t")
        name, value = (fields[2], fields[3]) if len(fields) > 1 else line.split(",")
        found[name] = float(value)
    return found


def _errors(thermal: _Thermal, values: Values, pilot: _Pilot) -> dict[str, tuple[float, float]]:
    """Largest difference [rad/s, m/s²] over the range between what the autopilot calculates with
    the printed parameters and the run's own chain, and the span of the chain, of each channel.
    """
    temperature = np.linspace(*thermal.limits, POINTS).astype(np.float32)
    u = (temperature.astype(np.float64) - float(thermal.middle)) / float(thermal.half)
    errors = {}
    for channel in thermal.channels:
        exactly = np.polynomial.polynomial.polyval(u, [float(c) for c in channel.over_u])
        found = pilot.offset(channel, values, temperature).astype(np.float64)
        if pilot.relative:
            exactly, found = (offset - offset[POINTS // 2] for offset in (exactly, found))
        errors[channel.name] = float(np.max(np.abs(found - exactly))), float(np.ptp(exactly))
    return errors


def verify(name: str, content: bytes) -> str:
    """Check a parameter file's digest and its numbers against the chain that it states; returns
    what it is.
    """
    lines = c_text.unseal(content, name).splitlines()
    try:
        stated = json.loads(next(line[2:] for line in lines if line.startswith("# {")))
        values = _values([line for line in lines if not line.startswith("#")])
        errors = _errors(_stated(stated, values), values, PILOTS[stated["pilot"]])
        for channel, (error, _) in errors.items():
            if not error <= 1.06 * float(stated["channels"][channel]["largest_error"]) + 1e-300:
                raise CoefficientError(
                    f"{name}: {channel.replace('_', ' ')} is off", hint="export it again"
                )
    except (StopIteration, ValueError, KeyError, IndexError, TypeError) as error:
        raise CoefficientError(
            f"{name}: cannot be read: {error!r}", hint="export it again"
        ) from None
    device = next((line[16:] for line in lines if line.startswith("# device")), "a unit")
    mark = c_text.verdict_mark(line[2:] for line in lines if line.startswith("#"))
    return f"{stated['pilot']} parameters of {device}, {len(errors)} channels recomputed{mark}"


def _stated(stated: Mapping[str, Any], values: Values) -> _Thermal:
    """Channels, range and map that a file states."""
    channels = []
    for name, entry in stated["channels"].items():
        sensor, _, axis = name.partition("_")
        channels.append(_Channel(sensor, axis, tuple(Fraction(x) for x in entry["u"])))
    low, high = (
        next(value for key, value in values.items() if key.endswith(end))
        for end in ("TMIN", "TMAX")
    )
    middle, half = Fraction(stated["middle"]), Fraction(stated["half"])
    return _Thermal(tuple(channels), Fraction(0), (low, high), middle, half)
