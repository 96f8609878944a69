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
from typing import Any

import numpy as np

from calibkit.errors import CoefficientError, OutputError
from calibkit.firmware import exact, facts
from calibkit.firmware.export import FirmwareRun
from calibkit.firmware.steps import Sum
from calibkit.numeric.constants import STANDARD_GRAVITY_MPS2

DEGREE = 3
ARDUPILOT_SCALE = 10**6
POINTS = 33
ROUNDINGS = Fraction(12, 2**24)
"""Largest relative error of each term in single precision: three roundings of T − reference, three
products, four sums, the scale of ArduPilot and its product.
"""
UNDERFLOW = Fraction(1, 2**140)
SIGN = (
    "signs         angular rate and specific force along these axes, forward, right, down: at rest"
    " and level accel z reads -1 g; a column that is positive along gravity needs sign = -1 in the"
    " recipe"
)
LARGEST_ERROR = 1e-3
"""Of the correction's span: a printed polynomial that is off by more is refused."""
CHANNEL = re.compile(r"(gyro|accel)_([xyz])_(?:dph|g)")
SI = {"gyro": Fraction(np.pi / 180.0 / 3600.0), "accel": Fraction(STANDARD_GRAVITY_MPS2)}
"""Sensor → 1 °/h in rad/s, 1 g in m/s²."""
UNIT = {"gyro": "rad/s", "accel": "m/s^2"}
Values = Mapping[str, float]
"""Parameter → value, as printed."""


@dataclass(frozen=True, slots=True)
class _ParameterChannel:
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

    channels: tuple[_ParameterChannel, ...]
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
    powers: Callable[[_ParameterChannel, Values], exact.Poly]
    """Printed coefficients of what it subtracts on one axis, in powers of T − reference."""
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


def _px4_powers(channel: _ParameterChannel, values: Values) -> exact.Poly:
    """X0, X1, X2, X3."""
    stem, axis = _px4_stem(channel), "xyz".index(channel.axis)
    return tuple(Fraction(values.get(f"{stem}_X{k}_{axis}", 0.0)) for k in range(DEGREE + 1))


def _px4_stem(channel: _ParameterChannel) -> str:
    """What the names of a sensor's parameters begin with."""
    return f"TC_{'G' if channel.sensor == 'gyro' else 'A'}0"


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


def _ardupilot_name(channel: _ParameterChannel, power: int) -> str:
    """Name of the coefficient of a power."""
    letters = "GYR" if channel.sensor == "gyro" else "ACC"
    return f"INS_TCAL1_{letters}{power}_{channel.axis.upper()}"


def _ardupilot_powers(channel: _ParameterChannel, values: Values) -> exact.Poly:
    """0, C1, C2, C3 in its unit."""
    coefficients = (Fraction(values[_ardupilot_name(channel, k)]) for k in range(1, DEGREE + 1))
    return (Fraction(0), *(c / ARDUPILOT_SCALE for c in coefficients))


PX4 = _Pilot(
    "px4",
    "PX4",
    _px4_lines,
    _px4_powers,
    (
        (
            "model         offset = X0 + X1 d + X2 d^2 + X3 d^3, d = T - TREF; corrected = reading"
            " - offset; degree at most 3"
        ),
        "axes          x, y, z of the topics sensor_gyro and sensor_accel: before SENS_BOARD_ROT",
        SIGN,
        "temperature   that of the same topics, which the sensor itself measures",
        ("instances     sensor 0; for another one write its number for the 0 in TC_G0_ and TC_A0_"),
        (
            "identity      set TC_G0_ID and TC_A0_ID to the sensors' device identifiers: without"
            " them PX4 uses none of this"
        ),
        "reboot        after loading: PX4 reads TC_G_ENABLE and TC_A_ENABLE at its start only",
    ),
)
ARDUPILOT = _Pilot(
    "ardupilot",
    "ArduPilot",
    _ardupilot_lines,
    _ardupilot_powers,
    (
        (
            "model         (C1 d + C2 d^2 + C3 d^3) / 1e6, d = T - 35 degC, is subtracted from the"
            " reading; degree at most 3"
        ),
        (
            "constant      none: the offset at the temperature of the offset calibration is that"
            " calibration's (INS_GYR1_CALTEMP, INS_ACC1_CALTEMP); calibrate offsets once"
        ),
        "axes          x, y, z of the IMU: before AHRS_ORIENTATION",
        SIGN,
        "temperature   that which the IMU itself measures",
        "instances     the first IMU; of the others INS_TCAL2_, INS_TCAL3_",
        "reboot        after loading: ArduPilot enables the correction at its start",
    ),
    Fraction(35),
    relative=True,
)
PILOTS = {pilot.name: pilot for pilot in (PX4, ARDUPILOT)}


def render(export: FirmwareRun, pilot: _Pilot) -> bytes:
    """Parameter file of a run: facts, error after printing, polynomials, parameters, digest;
    OutputError where the autopilot cannot hold its corrections.
    """
    thermal = _thermal(export, pilot)
    lines = pilot.lines(thermal)
    error_texts = {}
    for name, (printed, rounded, span) in _errors(thermal, _values(lines), pilot).items():
        # `not <=` so that an error that is no number is refused too
        if not (error := printed + rounded) <= LARGEST_ERROR * span:
            raise OutputError(
                f"{name.replace('_', ' ')}: single precision leaves an error of {error:.1e} of"
                f" {span:.1e}",
                hint="export it with --target c",
            )
        error_texts[name] = f"{exact.round_to(error, 2, up=True):.1e}"
    proof = {
        "pilot": pilot.name,
        "middle": str(thermal.middle),
        "half": str(thermal.half),
        "channels": {
            c.name: {"u": [str(x) for x in c.over_u], "bound": error_texts[c.name]}
            for c in thermal.channels
        },
    }
    head = [
        *facts.list_facts(export, bounds=False),
        (
            "unit          gyros in rad/s, accelerometers in m/s^2 (1 g = 9.80665 m/s^2),"
            " temperatures in degC"
        ),
        *pilot.remarks,
        *(
            f"error bound   {name}: {error} {UNIT[name.partition('_')[0]]}, after printing, in"
            " single precision, from TMIN to TMAX"
            for name, error in error_texts.items()
        ),
        json.dumps(proof, sort_keys=True),
    ]
    text = "\n".join([*(f"# {line}".rstrip() for line in head), *lines]) + "\n"
    return facts.seal(text, comment="# {}").encode("ascii")


def _thermal(export: FirmwareRun, pilot: _Pilot) -> _Thermal:
    """Polynomials of a run about the autopilot's reference temperature; or why it has none."""
    structure, tables = export.structure, export.chain.tables
    columns = {c.output: c.column for c in export.chain.corrections if not c.product}
    sums = {step.name: step.terms for step in structure.steps if isinstance(step, Sum)}
    over_u = {}
    for output in structure.outputs:
        terms = sums.get(output.source, ())
        if output.name in columns and len(terms) == 1:
            over_u[columns[output.name]] = tables[terms[0].table]
    names = [entry.name for entry in structure.inputs]
    if names != ["temp_case_degc"] or len(over_u) < len(structure.outputs) or structure.has_memory:
        raise OutputError(
            f"{pilot.title} holds offsets that are polynomials of temperature and nothing else;"
            f" this run's chain is {', '.join(structure.forms)} of {', '.join(names)}",
            hint="export it with --target c or blob, or fit bias_temperature over temp_case_degc",
        )
    middle, reciprocal, low, high = tables[structure.maps[0].table]
    # where the autopilot lets one choose, the middle: smallest powers, smallest roundings
    reference, half = pilot.reference or _single(middle), 1 / reciprocal
    channels = []
    for column, polynomial in over_u.items():
        channel = _channel(column, polynomial, pilot.title)
        powers = exact.mapped(channel.over_u, (reference - middle) * reciprocal, reciprocal)
        channels.append(replace(channel, powers=powers))
    # rounded inwards, the autopilot would clamp within the fitted range
    limits = _outwards(middle + half * low, -np.inf), _outwards(middle + half * high, np.inf)
    return _Thermal(tuple(channels), reference, limits, middle, half)


def _channel(column: str, over_u: exact.Poly, title: str) -> _ParameterChannel:
    """One axis in the autopilot's unit."""
    match = CHANNEL.fullmatch(column)
    if match is None:
        raise OutputError(
            f"{title}: '{column}' is no gyro or accelerometer of an axis x, y or z",
            hint="map it in [columns]",
        )
    if len(over_u) > DEGREE + 1:
        raise OutputError(
            f"{title}: {column} has degree {len(over_u) - 1}, at most {DEGREE} can be held",
            hint="fit it with order = 3 or less",
        )
    sensor, axis = match.groups()
    return _ParameterChannel(sensor, axis, exact.scale(over_u, SI[sensor]))


def _single(value: Fraction) -> Fraction:
    """Nearest number of single precision."""
    return Fraction(float(np.float32(float(value))))


def _outwards(limit: Fraction, to: float) -> float:
    """Nearest number of single precision that is not within a limit."""
    nearest = _single(limit)
    inside = nearest > limit if to < 0 else nearest < limit
    if inside:
        return float(np.nextafter(np.float32(float(nearest)), np.float32(to)))
    return float(nearest)


def _text(value: Fraction) -> str:
    """Number in single precision with nine significant digits."""
    return f"{float(_single(value)):.9g}"


def _values(lines: Sequence[str]) -> dict[str, float]:
    """Parameter → value, as printed."""
    values = {}
    for line in lines:
        fields = line.split("\t")
        name, value = (fields[2], fields[3]) if len(fields) > 1 else line.split(",")
        values[name] = float(value)
    return values


def _errors(
    thermal: _Thermal, values: Values, pilot: _Pilot
) -> dict[str, tuple[float, float, float]]:
    """Bounds [rad/s, m/s²] over the range of how far the printed polynomial of each channel is from
    the run's own, and of what single precision adds; and the span of the run's own.
    """
    low, high = map(Fraction, thermal.limits)
    widest = max(abs(low - thermal.middle), abs(high - thermal.middle)) / thermal.half
    u = np.linspace(-float(widest), float(widest), POINTS)
    # of a difference of offsets at two temperatures the constant drops out, and either may be off
    first, sides = (1, 2) if pilot.relative else (0, 1)
    errors = {}
    for channel in thermal.channels:
        reference = pilot.reference or Fraction(values[f"{_px4_stem(channel)}_TREF"])
        printed = pilot.powers(channel, values)
        over_u = exact.mapped(printed, thermal.middle - reference, thermal.half)
        difference = exact.add(over_u, exact.scale(channel.over_u, Fraction(-1)))[first:]
        furthest = max(abs(low - reference), abs(high - reference))
        errors[channel.name] = (
            float(sides * _largest(difference, widest) * widest**first),
            float(sides * ROUNDINGS * _largest(printed, furthest) + UNDERFLOW),
            float(np.ptp(np.polynomial.polynomial.polyval(u, [*map(float, channel.over_u)]))),
        )
    return errors


def _largest(polynomial: exact.Poly, reach: Fraction) -> Fraction:
    """Bound of a polynomial from −reach to reach."""
    return exact.value([abs(c) for c in polynomial], reach)


def verify(name: str, content: bytes) -> str:
    """Check a parameter file's digest and its numbers against the chain that it states; returns
    what it is.
    """
    lines = facts.unseal(content, name).splitlines()
    try:
        proof = json.loads(next(line[2:] for line in lines if line.startswith("# {")))
        values = _values([line for line in lines if not line.startswith("#")])
        errors = _errors(_stated(proof, values), values, PILOTS[proof["pilot"]])
        for channel, (printed, rounded, _) in errors.items():
            bound = float(proof["channels"][channel]["bound"])
            if not printed + rounded <= bound + 1e-300:
                raise CoefficientError(
                    f"{name}: {channel.replace('_', ' ')} is off", hint="export it again"
                )
    except (StopIteration, ValueError, KeyError, IndexError, TypeError) as error:
        raise CoefficientError(
            f"{name}: cannot be read: {error!r}", hint="export it again"
        ) from None
    device = next((line[16:] for line in lines if line.startswith("# device")), "a unit")
    mark = facts.verdict_mark(line[2:] for line in lines if line.startswith("#"))
    return f"{proof['pilot']} parameters of {device}, {len(errors)} channels recomputed{mark}"


def _stated(proof: Mapping[str, Any], values: Values) -> _Thermal:
    """Channels, range and map that a file states."""
    channels = []
    for name, entry in proof["channels"].items():
        sensor, _, axis = name.partition("_")
        channels.append(_ParameterChannel(sensor, axis, tuple(Fraction(x) for x in entry["u"])))
    low, high = (
        next(value for key, value in values.items() if key.endswith(end))
        for end in ("TMIN", "TMAX")
    )
    middle, half = Fraction(proof["middle"]), Fraction(proof["half"])
    return _Thermal(tuple(channels), Fraction(0), (low, high), middle, half)
