"""How far is it from a recipe to its coefficients? Lists the functions of calibkit on the way.

    python benchmarks/fit_stops.py [PROCEDURE ...] [--list]

Fits the sample logs of each procedure (the accelerometer's without a name) and counts its stops:
distinct named functions that a reader walks through from the recipe to the last coefficient file;
tables of the summary are behind it. Comprehensions and lambdas are part of the function that holds
them. What lies below the solver is one stop, as is all reading of logs as
far as the rows that are fitted.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import calibkit
from calibkit import instruments, recipe
from calibkit.logs import log_files
from calibkit.records import coefficients

if TYPE_CHECKING:
    from types import FrameType

PACKAGE = Path(calibkit.__file__).parent
DATASETS = PACKAGE.parent / "datasets"
READING = "reading of logs"
ONE_STOP = {"fit": "the solver", "logs": READING, "readers": READING, "check": READING}
"""Package of calibkit → the stop that all its functions are."""
ROWS = ("instruments.accelerometer.plausibility.read_plausible",)
"""Functions of instruments that read logs as far as the rows that are fitted: what they call is
part of the reading.
"""


def name_stop(frame: FrameType) -> str:
    """Name of the stop that a call of calibkit is; empty for any other."""
    code = frame.f_code
    if not code.co_filename.startswith(f"{PACKAGE}/"):
        return ""
    module = Path(code.co_filename).relative_to(PACKAGE).with_suffix("")
    if module.parts[0] in ONE_STOP:
        return ONE_STOP[module.parts[0]]
    name = code.co_qualname.split(".<locals>.<")[0]
    if name.startswith("<"):
        return ""
    stop = f"{'.'.join(module.parts)}.{name}"
    return READING if stop in ROWS else stop


def walk(procedure: str) -> list[str]:
    """Stops of the fit of a procedure's sample logs up to its last stage, in the order of entry."""
    source = recipe.find(procedure)
    spec = instruments.parse_recipe(source)
    files = log_files.find_logs(spec, DATASETS / procedure)
    stops: dict[str, None] = {}
    inside: FrameType | None = None  # the call below which everything is one stop
    to_last_stage = 0
    construct = coefficients.StageResult.__init__

    def construct_stage(*arguments: object, **named: object) -> None:
        nonlocal to_last_stage
        to_last_stage = len(stops)
        construct(*arguments, **named)

    def note(frame: FrameType, event: str, _: object) -> None:
        nonlocal inside
        if event == "return" and frame is inside:
            inside = None
        elif event == "call" and inside is None and (stop := name_stop(frame)):
            stops.setdefault(stop)
            if stop in ONE_STOP.values():
                inside = frame

    fit = instruments.find(procedure).fit
    setattr(coefficients.StageResult, "__init__", construct_stage)  # noqa: B010 (mypy refuses the plain way)
    sys.setprofile(note)
    try:
        fit(spec, DATASETS / procedure, files, lambda items, _: items)
    finally:
        sys.setprofile(None)
        setattr(coefficients.StageResult, "__init__", construct)  # noqa: B010 (the same)
    return list(stops)[:to_last_stage]


def main() -> None:
    """Print the number of stops of each procedure, and their names where they are asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("procedures", nargs="*", default=["accelerometer"])
    parser.add_argument("--list", action="store_true", help="print every stop")
    options = parser.parse_args()
    for procedure in options.procedures:
        stops = walk(procedure)
        print(f"{procedure}: {len(stops)} stops")
        if options.list:
            print("\n".join(f"  {stop}" for stop in stops))


if __name__ == "__main__":
    main()
