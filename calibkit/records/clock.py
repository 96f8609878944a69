"""The only clocks that calibkit reads: today's date, and the time of a signature and of a log
line.
"""

import datetime as dt

from calibkit.errors import UsageError


def date_or_today(text: str | None, option: str = "--date") -> str:
    """Date as given with an option, or today's; UsageError for what is not a date."""
    if text is None:
        return dt.datetime.now().astimezone().date().isoformat()
    try:
        return dt.date.fromisoformat(text).isoformat()
    except (TypeError, ValueError):
        raise UsageError(f"{option} {text}: not a date", hint="write YYYY-MM-DD") from None


def now() -> dt.datetime:
    """Time (UTC) to the second, which a signature claims and a log line begins with."""
    return dt.datetime.now(dt.UTC).replace(microsecond=0)
