"""What the stamps of two files say of each other: which of them begins first, and where both have
rows.
"""

from calibkit.errors import FrameError
from calibkit.numeric.arrays import Array
from calibkit.records.frame import Log, values

_DAY_S = 86400.0
_ALIKE = 0.5
"""Share of the best overlap beyond which another day explains two times of day as well."""


def relate_origins(first: Log, second: Log, *, same_clock: bool) -> float:
    """Seconds from second 0 of one log to second 0 of the other by their stamps, 0 where these
    cannot be compared; FrameError where they must be, as on the `same_clock`.
    """
    a, b = first.origin, second.origin
    if a is None or b is None or a.kind != b.kind:
        if same_clock:
            raise FrameError(
                f'{first.file}: clock = "same", but the log has {_describe_kind(first)} and'
                f" {second.file} has {_describe_kind(second)}, expected stamps of one kind",
                hint=(
                    'state in [chamber] clock = "stated", offset_s = seconds from the log\'s first'
                    " row to the other file's, and standard_uncertainty_s; or pin time_format"
                    " where a date can be read in two ways"
                ),
            )
        return 0.0
    begins = (b.nanoseconds - a.nanoseconds) / 1e9
    return begins if a.kind != "times of day" else begins + _find_day(first, second, begins)


def _describe_kind(log: Log) -> str:
    """Kind of a log's stamps, for a message."""
    return "stamps without a certain date" if log.origin is None else log.origin.kind


def _find_day(first: Log, second: Log, begins: float) -> float:
    """Days [s] between two logs with times of day alone: those at which they overlap most."""
    ends = [values(log.frame, "time_s")[[0, -1]] for log in (first, second)]
    (low, high), second_ends = ends[0], ends[1] + begins
    common = {
        day: float(min(high, second_ends[1] + day) - max(low, second_ends[0] + day))
        for day in (0.0, -_DAY_S, _DAY_S)
    }
    best = max(common, key=lambda day: common[day])
    rivals = [day for day in common if day != best and common[day] > _ALIKE * common[best]]
    if rivals and common[best] > 0.0:
        raise FrameError(
            f"{first.file}: the times of day of {second.file} fit it on two days, expected one",
            hint="log dates, or take the other days out of that file",
        )
    return best if common[best] > 0.0 else 0.0


def _describe_span(log: Log, time_s: Array) -> str:
    """First and last of times [n, s] of a log's clock as its stamps would say them."""
    origin = log.origin
    stamp = "{:.10g} s".format if origin is None else origin.stamp
    first, last = stamp(float(time_s[0])), stamp(float(time_s[-1]))
    date, _, time_of_day = last.rpartition(" ")
    return f"{first}–{time_of_day if date and first.startswith(date) else last}"


def describe_overlap(log: Log, time_s: Array) -> str:
    """Times [n, s] of a log at which a second logger's file has values too."""
    return f"files overlap {_describe_span(log, time_s)}"


def nothing_common(log: Log, time_s: Array, file: str, others_s: Array) -> FrameError:
    """The error of a log and a file that has no value at any of its times [n, s]."""
    return FrameError(
        f"{log.file}: no row has a value of {file}: the log goes from"
        f" {_describe_span(log, time_s)}, that file from {_describe_span(log, others_s)} of the"
        " log's clock",
        hint="name the file of the same hours in [chamber] files, or state offset_s there",
    )
