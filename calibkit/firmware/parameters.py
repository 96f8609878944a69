"""Parameter files of autopilots: what their thermal models can hold of a run, proven after rounding
and printing.

PX4 (temperature_compensation): T is brought into TMIN … TMAX, offset = X0 + X1 d + X2 d² + X3 d³
with d = T − TREF is subtracted; gyros in rad/s, accelerometers in m/s². ArduPilot
(AP_InertialSensor_TCal): T is brought into TMIN … TMAX, (C1 d + C2 d² + C3 d³)/1e6 with d = T − 35
°C is subtracted and that at the temperature of the offset calibration added; the same units. Both
calculate in single precision; neither corrects scale factors or anything that depends on
temperature rate.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

from calibkit.constants import DPH_PER_DPS, STANDARD_GRAVITY_MPS2
from calibkit.errors import CoefficientError, OutputError
from calibkit.firmware import c_text, exact
from calibkit.firmware.chain import Map

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from calibkit.firmware.export import Export

DEGREE = 3
ARDUPILOT_REFERENCE = Fraction(35)
ARDUPILOT_SCALE = 10**6
AXES = {"x": 0, "y": 1, "z": 2}
POINTS = 1001
LARGEST_ERROR = 1e-3
"""Of the correction's span: a printed polynomial that is off by more is refused."""
CHANNEL = re.compile(r"bias_(gyro|accel)_([xyz])_(?:dph|g)")
SEAL = re.compile(r"# sha256 of all lines above: ([0-9a-f]{64})\n\Z")


@dataclass(frozen=True, slots=True)
class Channel:
    """Bias of one axis as powers of T − reference, in the autopilot's unit, and over u as the run
    has it.
    """

    sensor: str
    axis: str
    powers: tuple[Fraction, ...]
    over_u: exact.Poly


@dataclass(frozen=True, slots=True)
class Thermal:
    """All channels of a run, their reference and range [°C]."""

    channels: tuple[Channel, ...]
    reference: Fraction
    limits: tuple[float, float]
    middle: Fraction
    half: Fraction


def _thermal(export: Export, reference: Fraction | None, pilot: str) -> Thermal:
    """Polynomials of a run about a reference temperature (the middle of the range without one); or
    why it has none.
    """
    structure, tables = export.chain.structure, export.chain.tables
    maps = [step for step in structure.steps if isinstance(step, Map)]
    names = [entry.name for entry in structure.inputs]
    if structure.forms != ("polynomial/1",) or names != ["temp_case_degc"] or len(maps) != 1:
        raise OutputError(
            f"{pilot} holds offsets that are polynomials of temperature and nothing else; this"
            f" run's chain is {', '.join(structure.forms)} of {', '.join(names)}",
            hint="export it with --target c or blob, or fit bias_temperature over temp_case_degc",
        )
    middle, reciprocal, low, high = tables[maps[0].table]
    about, half = _single(middle) if reference is None else reference, 1 / reciprocal
    channels = [
        _channel(output.name, tables[f"p_{output.name[5:]}"], pilot) for output in structure.outputs
    ]
    placed = tuple(
        Channel(
            c.sensor,
            c.axis,
            exact.mapped(c.over_u, (about - middle) * reciprocal, reciprocal),
            c.over_u,
        )
        for c in channels
    )
    limits = float(_single(middle + half * low)), float(_single(middle + half * high))
    return Thermal(placed, about, limits, middle, half)


def _channel(output: str, over_u: exact.Poly, pilot: str) -> Channel:
    """One axis in the autopilot's unit."""
    found = CHANNEL.fullmatch(output)
    if found is None:
        raise OutputError(
            f"{pilot}: '{output[5:]}' is no gyro or accelerometer of an axis x, y or z",
            hint="map it in [columns]",
        )
    if len(over_u) > DEGREE + 1:
        raise OutputError(
            f"{pilot}: {output[5:]} has degree {len(over_u) - 1}, at most {DEGREE} can be held",
            hint="fit it with order = 3 or less",
        )
    factor = (
        Fraction(np.pi / 180.0 / DPH_PER_DPS)
        if found.group(1) == "gyro"
        else Fraction(STANDARD_GRAVITY_MPS2)
    )
    return Channel(found.group(1), found.group(2), (), tuple(factor * c for c in over_u))


def px4(export: Export) -> bytes:
    """PX4 parameters (tab-separated, as ground stations load them)."""
    thermal = _thermal(export, None, "PX4")
    lines: list[str] = []
    for sensor, letter in (("gyro", "G"), ("accel", "A")):
        channels = [c for c in thermal.channels if c.sensor == sensor]
        if not channels:
            continue
        lines.append(f"1\t1\tTC_{letter}_ENABLE\t1\t6")
        for channel in channels:
            lines += [
                f"1\t1\tTC_{letter}0_X{k}_{AXES[channel.axis]}\t{_text(c)}\t9"
                for k, c in enumerate(channel.powers)
            ]
        values = (
            ("TREF", thermal.reference),
            ("TMIN", thermal.limits[0]),
            ("TMAX", thermal.limits[1]),
        )
        lines += [
            f"1\t1\tTC_{letter}0_{name}\t{_text(Fraction(value))}\t9" for name, value in values
        ]
    extra = (
        (
            "model         offset = X0 + X1 d + X2 d^2 + X3 d^3, d = T - TREF; corrected = reading"
            " - offset; degree at most 3"
        ),
        (
            "identity      set TC_G0_ID and TC_A0_ID to the sensors' device identifiers: without"
            " them PX4 uses none of this"
        ),
    )
    return _sealed(export, thermal, lines, extra, "px4")


def ardupilot(export: Export) -> bytes:
    """ArduPilot parameters (name, comma, value)."""
    thermal = _thermal(export, ARDUPILOT_REFERENCE, "ArduPilot")
    lines = ["INS_TCAL1_ENABLE,1"]
    lines += [
        f"INS_TCAL1_T{name},{_text(Fraction(value))}"
        for name, value in zip(("MIN", "MAX"), thermal.limits, strict=True)
    ]
    for channel in thermal.channels:
        letters = "GYR" if channel.sensor == "gyro" else "ACC"
        for k in range(1, DEGREE + 1):
            c = channel.powers[k] if k < len(channel.powers) else Fraction(0)
            lines.append(
                f"INS_TCAL1_{letters}{k}_{channel.axis.upper()},{_text(c * ARDUPILOT_SCALE)}"
            )
    extra = (
        (
            "model         (C1 d + C2 d^2 + C3 d^3) / 1e6, d = T - 35 degC, is subtracted from the"
            " reading; degree at most 3"
        ),
        (
            "constant      none: the offset at the temperature of the offset calibration is that"
            " calibration's"
        ),
    )
    return _sealed(export, thermal, lines, extra, "ardupilot")


def _single(value: Fraction) -> Fraction:
    """Nearest number of single precision."""
    return Fraction(float(np.float32(float(value))))


def _text(value: Fraction) -> str:
    """Number in single precision with nine significant digits."""
    return f"{float(_single(value)):.9g}"


def _sealed(
    export: Export, thermal: Thermal, lines: Sequence[str], extra: Sequence[str], pilot: str
) -> bytes:
    """The whole file: facts, error after printing, vectors, parameters, digest."""
    errors = _errors(thermal, _values(lines), pilot)
    stated = {name: f"{error:.1e}" for name, error in errors.items()}
    vectors = {
        f"{c.sensor}_{c.axis}": {
            "u": [str(x) for x in c.over_u],
            "largest_error": stated[f"{c.sensor}_{c.axis}"],
        }
        for c in thermal.channels
    }
    head = [
        *(line for line in c_text.facts(export) if not line.startswith(("error bound", "     "))),
        (
            "unit          gyros in rad/s, accelerometers in m/s^2"
            f" (1 g = {STANDARD_GRAVITY_MPS2} m/s^2),"
            " temperatures in degC"
        ),
        *extra,
        *(
            f"after print   {name}: off by at most {error} over the range"
            for name, error in stated.items()
        ),
        json.dumps(
            {
                "pilot": pilot,
                "middle": str(thermal.middle),
                "half": str(thermal.half),
                "channels": vectors,
            },
            sort_keys=True,
        ),
    ]
    text = "\n".join([*(f"# {line}".rstrip() for line in head), *lines]) + "\n"
    return f"{text}# sha256 of all lines above: {_sha(text)}\n".encode("ascii")


def _sha(text: str) -> str:
    """Digest of a text."""
    import hashlib

    return hashlib.sha256(text.encode()).hexdigest()


def _values(lines: Sequence[str]) -> dict[str, float]:
    """Parameter → value, as printed."""
    found = {}
    for line in lines:
        fields = line.split("\t")
        name, value = (fields[2], fields[3]) if len(fields) > 1 else line.split(",")
        found[name] = float(value)
    return found


def _errors(thermal: Thermal, values: Mapping[str, float], pilot: str) -> dict[str, float]:
    """Largest difference [rad/s, m/s²] of what the autopilot makes of the printed parameters from
    the run's own chain.
    """
    errors = {}
    for channel in thermal.channels:
        exactly, found = evaluated(thermal, channel, values, pilot)
        error, span = float(np.max(np.abs(found - exactly))), float(np.ptp(exactly))
        if not error <= LARGEST_ERROR * span:
            raise OutputError(
                f"{channel.sensor} {channel.axis}: single precision leaves an error of {error:.1e}"
                f" of {span:.1e}",
                hint="export it with --target c",
            )
        errors[f"{channel.sensor}_{channel.axis}"] = error
    return errors


def evaluated(
    thermal: Thermal, channel: Channel, values: Mapping[str, float], pilot: str
) -> tuple[np.ndarray, np.ndarray]:
    """Correction of one axis over the range, exactly and as the autopilot calculates it in single
    precision.
    """
    one = np.float32
    temperature = np.linspace(*thermal.limits, POINTS).astype(one)
    u = (temperature.astype(np.float64) - float(thermal.middle)) / float(thermal.half)
    exactly = np.polynomial.polynomial.polyval(u, [float(c) for c in channel.over_u])
    letters = {"gyro": ("G", "GYR"), "accel": ("A", "ACC")}[channel.sensor]
    if pilot == "px4":
        d = temperature - one(values[f"TC_{letters[0]}0_TREF"])
        names = [f"TC_{letters[0]}0_X{k}_{AXES[channel.axis]}" for k in range(DEGREE + 1)]
        c = [one(values.get(name, 0.0)) for name in names]
        square = d * d
        return exactly, (c[0] + c[1] * d + c[2] * square + c[3] * (square * d)).astype(np.float64)
    d = temperature - one(35.0)
    c = [one(values[f"INS_TCAL1_{letters[1]}{k}_{channel.axis.upper()}"]) for k in (1, 2, 3)]
    found = ((c[0] + (c[1] + c[2] * d) * d) * d * one(1e-6)).astype(np.float64)
    # the constant is the offset calibration's: both are held against their own value at the middle
    return exactly - exactly[POINTS // 2], found - found[POINTS // 2]


def verify(name: str, content: bytes) -> str:
    """Check a parameter file's digest and what its numbers give against the chain that it states;
    returns what it is.
    """
    try:
        text = content.decode("ascii")
    except UnicodeDecodeError:
        raise CoefficientError(
            f"{name}: not a text that calibkit wrote", hint="export it again"
        ) from None
    seal = SEAL.search(text)
    if seal is None or _sha(text[: seal.start()]) != seal.group(1):
        raise CoefficientError(
            f"{name}: its digest is not that of its content", hint="it was changed after the export"
        )
    lines = text[: seal.start()].splitlines()
    try:
        stated = json.loads(next(line[2:] for line in lines if line.startswith("# {")))
        values = _values([line for line in lines if not line.startswith("#")])
        channels = tuple(_stated(key, entry) for key, entry in stated["channels"].items())
        ends = [
            values[key] for key in sorted(values, reverse=True) if key.endswith(("TMIN", "TMAX"))
        ][:2]
        middle, half = Fraction(stated["middle"]), Fraction(stated["half"])
        thermal = Thermal(channels, Fraction(0), (ends[0], ends[1]), middle, half)
        for channel, entry in zip(channels, stated["channels"].values(), strict=True):
            exactly, found = evaluated(thermal, channel, values, stated["pilot"])
            if (
                not float(np.max(np.abs(found - exactly)))
                <= 1.06 * float(entry["largest_error"]) + 1e-300
            ):
                raise CoefficientError(
                    f"{name}: {channel.sensor} {channel.axis} is off", hint="export it again"
                )
    except (StopIteration, ValueError, KeyError, IndexError, TypeError) as error:
        raise CoefficientError(
            f"{name}: cannot be read: {error!r}", hint="export it again"
        ) from None
    device = next((line[16:] for line in lines if line.startswith("# device")), "a unit")
    mark = c_text.mark(line[2:] for line in lines if line.startswith("#"))
    return f"{stated['pilot']} parameters of {device}, {len(channels)} channels recomputed{mark}"


def _stated(key: str, entry: Mapping[str, Sequence[str]]) -> Channel:
    """Channel that a file states."""
    sensor, _, axis = key.partition("_")
    return Channel(sensor, axis, (), tuple(Fraction(x) for x in entry["u"]))
