"""Guesses at what a log's own columns are: names and units in three languages → canonical
columns.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from calibkit import units
from calibkit.records.frame import is_canonical

_TIME = (
    r"(^|/)(time|t|t_m?s|zeit|zeitstempel|timestamp|date.?time|datum|uhrzeit|elapsed|x_value|utc"
    r"|millis|micros|sec(onds?)?)([_ .].*)?$|[_ ](time|zeit|timestamp)$|时间|时刻"
)
_TEMPERATURE = r"temp|^t[_ .]?\d*$|thermo|^pt\d|温|℃|therm"
_BY_PLACE = _TEMPERATURE + r"|^(case|chamber|air|geh(ä|a|ae)use|kammer)$"
_SETPOINT = r"soll|set.?(point|value|temp)|^set\b|^sp\b|vorgabe|设定"
"""Words for what a chamber was told to do, which nobody measured."""
_AIR = r"env|air|chamb|amb|kammer|luft|umgeb|箱|环境|外|oven|^pv$|istwert|soll"
_CASE = r"case|gyro|geh(ä|a|ae)us|hous|body|shell|壳|内|sensor|imu|die|board|coil|dut|prüfling"
_TABLE = r"table|turn|tisch|转台|^cmd|command|stage|simulator|soll|vorgabe|set.?(rate|point)"
_RATE = r"rate|speed|omega|geschw|drehrate|速率|角速度|速度|^w[xyz]?$"
_ANGLE = r"angle|winkel|角度|角位|^pos|position"
_GYRO = r"gyr|fog|陀螺|kreisel|impuls|drehrate|^g[_ .]?[xyz]$|^w[xyz]$|omega|angular|rotation"
_COUNTED = r"impuls|pulses?|counts?|\blsb\b|脉冲"
"""Words that mean counts where no unit is stated."""
_ACCEL = r"acc|加速|加表|加计|beschl|^a[_ .]?[xyz]$|^f[_ .]?[xyz]$"
_WORDS: tuple[tuple[str, str], ...] = (
    ("station", r"^stat|测站|测点|^site|^messpunkt"),
    ("position_deg", r"^pos(ition)?([_ ]?deg)?$|转位|位置"),
    ("inclination_deg", r"incl|井斜|neig|^inc$"),
    ("toolface_deg", r"tool.?face|工具面|^tf|^roll"),
    ("azimuth_deg", r"azim|方位|heading"),
)
"""Canonical column → words in a name that mean it."""
LAST_WORDS = {
    "s": "s",
    "ms": "ms",
    "us": "us",
    "degc": "degC",
    "degf": "degF",
    "fahrenheit": "degF",
    "k": "K",
    "dph": "deg/h",
    "dps": "deg/s",
    "rads": "rad/s",
    "radps": "rad/s",
    "deg": "deg",
    "rad": "rad",
    "mps2": "m/s^2",
    "ms2": "m/s^2",
    "g": "g",
    "mg": "mg",
}
"""Last word of a column's name → the only unit that it can mean."""


def unit_of_last_word(name: str) -> str:
    """Unit that the last of several words of a column's name is, as in `temp_case_degf` and "case
    temp degF"; or "".
    """
    words = re.split(r"[_ ]+", units.name_without_unit(name).strip().lower())
    return LAST_WORDS.get(words[-1], "") if len(words) > 1 else ""


_AXES = re.compile(
    r"(?:^|[_ .\-(（/\u4e00-\u9fff]|gyro?|gyr|acc(?:el)?|^[agfw])([xyzab])(?:[_ .)）\d]|$)",
    re.IGNORECASE,
)
"""Axis in a name."""


@dataclass(frozen=True, slots=True)
class LogColumn:
    """A column of a log: its own name, the unit that the log states (or ""), whether it holds
    times, and their format.
    """

    name: str
    unit: str
    is_time: bool = False
    time_format: str = ""
    kind: str = "number"
    """What its fields are, of a text log."""
    sensor: str = ""
    """Sensor that the name of the log states, where that of the column is an axis alone."""

    @property
    def plain(self) -> str:
        """Name without its unit, in lower case."""
        return units.name_without_unit(self.name).strip().lower()

    @property
    def stated(self) -> str:
        """Unit that the log states, in its header, in a row of units, or as the last word of the
        name; or "".
        """
        return self.unit or units.unit_in_header(self.name) or unit_of_last_word(self.name)

    @property
    def dimension(self) -> str:
        """Dimension of the unit that the log states; "" where it states none that is known."""
        return units.TABLE[self.stated].dimension if self.stated in units.TABLE else ""

    @property
    def is_counted(self) -> bool:
        """Whether the column holds counts, by its unit, or by its name where no unit is stated."""
        return self.dimension.startswith("count") or (
            not self.stated and bool(re.search(_COUNTED, self.plain))
        )

    def guess_canonical(self) -> str:
        """Canonical column that a log's column most likely is, "" where nothing indicates one."""
        name = self.plain
        if is_canonical(name) and not (name == "position" and self.dimension == "angle"):
            return name
        if self.is_time or (self.dimension in ("", "time") and re.search(_TIME, name)):
            return "time_s"
        if self.dimension == "temperature" or (not self.dimension and re.search(_BY_PLACE, name)):
            words = (("", _SETPOINT), ("temp_env_degc", _AIR), ("temp_case_degc", _CASE))
            places = (canonical for canonical, pattern in words if re.search(pattern, name))
            return next(places, "temp_degc")
        if re.search(_TABLE, name):
            return (
                "table_angle_deg"
                if re.search(_ANGLE, name) or self.dimension == "angle"
                else "table_rate_dps"
            )
        canonical = next((canonical for canonical, words in _WORDS if re.search(words, name)), "")
        return canonical or _guess_indication(self)


def _guess_indication(column: LogColumn) -> str:
    """Canonical column of a gyro or an accelerometer, by name, else by unit; or ""."""
    name = column.sensor + column.plain
    axis = "".join(_AXES.findall(name)[-1:]).lower()
    if column.dimension.startswith("acceleration") or (
        column.dimension != "angular rate" and re.search(_ACCEL, name)
    ):
        return f"accel_{axis or 'x'}_{'lsb' if column.dimension.startswith('count') else 'g'}"
    if re.search(_GYRO, name) or re.search(_RATE, name) or column.dimension == "angular rate":
        unit = "lsb" if column.is_counted else "dph"
        return f"gyro_{axis}_{unit}" if axis else f"gyro_{unit}"
    return ""


def name_sensor(log: str, columns: Sequence[LogColumn]) -> list[LogColumn]:
    """The columns, of which those that are called by an axis alone get the sensor in the log's
    name.
    """
    sensor_word = re.search(r"(gyro?|acc)", log.lower())
    sensor = {"acc": "accel_"}.get(sensor_word.group(), "gyro_") if sensor_word else ""
    return [
        replace(column, sensor=sensor) if re.fullmatch(r"[xyz]", column.plain) else column
        for column in columns
    ]


def _number_gyros(columns: Sequence[LogColumn]) -> dict[str, str]:
    """Name → canonical column of several gyros without axes that a digit in their names tells
    apart.
    """
    gyros = [
        column for column in columns if re.fullmatch(r"gyro_(lsb|dph)", column.guess_canonical())
    ]
    digits = [re.search(r"\d", column.plain) for column in gyros]
    numbers = [digit.group() for digit in digits if digit]
    if len(gyros) < 2 or len(set(numbers)) < len(gyros):
        return {}
    return {
        column.name: column.guess_canonical().replace("gyro", f"gyro_{number}")
        for column, number in zip(gyros, numbers, strict=True)
    }


def _find_table(columns: Sequence[LogColumn]) -> dict[str, str]:
    """Name → canonical column of a table's rate and of what a gyro counted beside it, in a log that
    names neither table nor gyro. A gyro at rest is logged in deg/h, or without its counts.
    """
    if any(column.guess_canonical().startswith("table_") for column in columns):
        return {}
    rates = [
        column
        for column in columns
        if column.dimension == "angular rate"
        and column.stated != "deg/h"
        and re.search(_RATE, column.plain)
        and not re.search(_GYRO, column.plain)
        and column.guess_canonical() == "gyro_dph"
    ]
    counted = {
        column.name: column.guess_canonical() or "gyro_lsb"
        for column in columns
        if column.is_counted
    }
    if len(rates) != 1 or not counted:
        return {}
    return {rates[0].name: "table_rate_dps"} | counted


def assign_columns(
    columns: Sequence[LogColumn],
) -> tuple[dict[str, LogColumn], list[tuple[str, LogColumn]]]:
    """Canonical column → the log's column that is taken for it; and the other columns, each with
    the canonical one that it could be.
    """
    assigned: dict[str, LogColumn] = {}
    alternatives: list[tuple[str, LogColumn]] = []
    by_neighbours = _number_gyros(columns) | _find_table(columns)
    # a column that is called canonically comes first, then in the log's order
    for column in sorted(columns, key=lambda column: not is_canonical(column.plain)):
        canonical = by_neighbours.get(column.name) or column.guess_canonical()
        if canonical and canonical not in assigned:
            assigned[canonical] = column
        elif canonical:
            alternatives.append((canonical, column))
    loose = assigned.pop("temp_degc", None)
    if loose is not None:
        free = next(
            (name for name in ("temp_case_degc", "temp_env_degc") if name not in assigned), ""
        )
        if free:
            assigned[free] = loose
        else:
            alternatives.append(("temp_case_degc", loose))
    for canonical, column in list(alternatives):
        if canonical == "temp_degc" and "temp_env_degc" not in assigned:
            assigned["temp_env_degc"] = column
            alternatives.remove((canonical, column))
    return assigned, alternatives
