"""The log file of a command: what was called, what was printed, how it ended. No result is ever
read from it.
"""

from pathlib import Path

from calibkit import new_files
from calibkit.cli.clock import now
from calibkit.errors import OutputError


def append(path: Path, level: str, text: str) -> None:
    """Append lines to a log file, each with the time (UTC) and its kind; raises OutputError.

    A log file is the one file that calibkit adds to; it is never opened inside a run folder.
    """
    new_files.refuse_run_folder(path)
    at = now().strftime("%Y-%m-%dT%H:%M:%SZ")
    lines = "".join(f"{at} {level:8} {line}\n" for line in text.splitlines())
    try:
        with path.open("a", encoding="utf-8", errors="backslashreplace", newline="\n") as stream:
            stream.write(lines)
    except OSError as error:
        raise OutputError(
            f"--log-file {path}: {error.strerror}", hint="give another file"
        ) from None
