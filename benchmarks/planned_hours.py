"""Chamber hours that a plan saves at the uncertainty of a usual campaign, on the sample bench.

    python benchmarks/planned_hours.py
    python benchmarks/planned_hours.py --usual accelerometer

For each procedure: hours and U of the campaign that the sample logs have, the hours of the plan
that reaches the same U with its withheld part and its return to the first temperature, the hours
that it saves, and how long the search took.
"""

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any

from calibkit import plans, recipe
from calibkit.planning import document

ASKED = {
    "accelerometer": ("inclination", "deg", (-20.0, 125.0), "0.1"),
    "accelerometer_magnitude": ("component", "g", None, "1"),
    "bias_temperature": ("drift", "deg/h", (-40.0, 60.0), "10"),
    "inclinometer": ("azimuth", "deg", (20.0, 120.0), "10"),
    "gyro_noise": ("bias instability", "deg/h", None, "10"),
    "gyro_pair": ("N", "ppm", None, "1000"),
    "fog_thermal": ("drift", "deg/h", (-40.0, 60.0), "10"),
    "rate_table": ("scale factor", "ppm", (-40.0, 60.0), "1000"),
    "gyro_triad": ("angle", "deg", (-40.0, 60.0), "10"),
}
"""Procedure → result, unit, range of use, and a wish that every campaign meets."""


def make_plan(procedure: str, wish: str, range_degc: tuple[float, float] | None) -> dict[str, Any]:
    """plan.json of a wish."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "plan"
        request = plans.Request(wishes=(wish,), range_degc=range_degc)
        plans.plan(recipe.find(procedure), request, out)
        return dict(document.load_plan(out).document)


def main() -> None:
    """Print a table, of one campaign per procedure, or of all usual ones of one procedure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--usual", choices=list(ASKED), help="all usual campaigns of a procedure")
    every = parser.parse_args().usual
    print("| procedure | usual campaign | h | U | plan at the same U | h | saved | search [s] |")
    print("|---|---|---|---|---|---|---|---|")
    for procedure, (name, unit, range_degc, loose) in ASKED.items():
        if every not in (None, procedure):
            continue
        first = make_plan(procedure, f"{name}<={loose} {unit}", range_degc)
        for usual in first["usual"][0 if every else -1 :]:
            size, hours = usual["expanded_uncertainty"][name], usual["hours"]
            begin = time.perf_counter()
            found = make_plan(procedure, f"{name}<={size!r} {unit}", range_degc)
            took = time.perf_counter() - begin
            saved = 100.0 * (1.0 - found["hours"] / hours)
            label = found["plan"] if found["results"] and _met(found) else "not reached"
            print(
                f"| {procedure} | {usual['name']} | {hours:.3g} | {size:.3g} {unit} | {label} |"
                f" {found['hours']:.3g} | {saved:.0f} % | {took:.0f} |",
                flush=True,
            )


def _met(found: dict[str, Any]) -> bool:
    """Whether the wish of a plan is met."""
    return all(one["met"] is not False for one in found["results"])


if __name__ == "__main__":
    main()
