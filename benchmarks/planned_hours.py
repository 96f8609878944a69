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
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from calibkit import instruments, plans, recipe
from calibkit.numeric import attitude
from calibkit.planning import document, equipment, exchange
from calibkit.planning.bench import Design, Task

ASKED = {
    "accelerometer": ("inclination", "deg", (-20.0, 125.0)),
    "accelerometer_magnitude": ("component", "g", None),
    "bias_temperature": ("drift", "deg/h", (-40.0, 60.0)),
    "inclinometer": ("azimuth", "deg", (20.0, 120.0)),
    "gyro_noise": ("bias instability", "deg/h", None),
    "gyro_pair": ("N", "ppm", None),
    "fog_thermal": ("drift", "deg/h", (-40.0, 60.0)),
    "rate_table": ("scale factor", "ppm", (-40.0, 60.0)),
    "gyro_triad": ("angle", "deg", (-40.0, 60.0)),
}
"""Procedure → result, unit and range of use."""
LEVELS = 9
"""Temperatures of a usual campaign, from low to high."""
FACES = ((0, 0), (180, 0), (90, 0), (90, 90), (90, 180), (90, 270))
EDGES = (
    *((tilt, roll) for tilt in (45, 135) for roll in (0, 90, 180, 270)),
    *((90, roll) for roll in (45, 135, 225, 315)),
)
CORNERS = tuple((tilt, roll) for tilt in (54.7356, 125.2644) for roll in (45, 135, 225, 315))
ATTITUDES = {
    "6 faces": FACES,
    "12 edges": EDGES,
    "18 faces and edges": (*FACES, *EDGES),
    "26 faces, edges and corners": (*FACES, *EDGES, *CORNERS),
    "42 attitudes of the sample logs": (
        (0, 0),
        *((tilt, roll) for tilt in range(30, 151, 30) for roll in range(0, 360, 45)),
        (180, 0),
    ),
}
"""Usual attitudes of a triad: directions to the faces, edges and corners of a cube."""
RATES = (5, 7, 9, 12, 17, 22, 30, 41, 55, 74, 100)
"""Usual rates [°/s] of a table, in steps of one ratio."""


def list_usual(procedure: str, range_degc: tuple[float, float] | None) -> Iterator[Design]:
    """Usual campaigns of a procedure, that of the sample logs last."""
    spec = instruments.parse_recipe(recipe.find(procedure))
    task = Task(equipment.read_equipment(None), range_degc=range_degc)
    bench: Any = instruments.optional(spec.procedure, "prepare_plan")(spec, task)
    levels = np.rint(np.linspace(*bench.range_degc, LEVELS)).astype(int).tolist()
    if procedure == "accelerometer":
        bench.task = replace(task, withheld=True)
        for name, spots in ATTITUDES.items():
            bench.mountings = [np.array(spots, dtype=np.float64)]
            design = bench.design(levels, range(len(spots)), 60.0)
            design = replace(design, label=f"{name}, {LEVELS} temperatures")
            yield replace(design, results=bench.predict(design.rows))
        return
    if procedure == "accelerometer_magnitude":
        gravity = attitude.gravity_vector(*bench.mountings[0].T)
        spread = exchange.spread_apart(gravity, [0], 23)
        design = bench.design((25,), [0, *spread], 4.0)
    elif procedure == "bias_temperature":
        design = bench.design(levels, 1, 3600.0)
    elif procedure == "inclinometer":
        tilt, azimuth = bench.places.T
        u, _ = bench.roots_by_dwell_s[60.0]
        places = np.flatnonzero((tilt == 30.0) & (azimuth % 90.0 == 0.0) & np.isfinite(u))
        design = bench.design(levels, places.tolist(), 60.0)
    elif procedure == "gyro_noise":
        design = bench.design((25,), None, 21600.0)
    elif procedure == "fog_thermal":
        design = bench.design((), ((1, 5, 8, 10), (1, 5, 8, 10)), 3600.0)
    elif procedure == "gyro_pair":
        design = bench.design((25,), RATES, 30.0)
    else:
        design = bench.design((25, 25, 25, -40, -8, 60), RATES, 30.0)
    yield replace(design, results=bench.predict(design.rows))


def make_plan(procedure: str, wish: str, range_degc: tuple[float, float] | None) -> dict[str, Any]:
    """plan.json of a wish."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "plan"
        request = {"wishes": (wish,), "range_degc": range_degc}
        plans.plan(recipe.find(procedure), out, **request)
        return dict(document.load_plan(out).document)


def main() -> None:
    """Print a table, of one campaign per procedure, or of all usual ones of one procedure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--usual", choices=list(ASKED), help="all usual campaigns of a procedure")
    every = parser.parse_args().usual
    print("| procedure | usual campaign | h | U | plan at the same U | h | saved | search [s] |")
    print("|---|---|---|---|---|---|---|---|")
    for procedure, (name, unit, range_degc) in ASKED.items():
        if every not in (None, procedure):
            continue
        for usual in [*list_usual(procedure, range_degc)][0 if every else -1 :]:
            size, hours = usual.expanded(name), usual.hours
            begin = time.perf_counter()
            found = make_plan(procedure, f"{name}<={size!r} {unit}", range_degc)
            took = time.perf_counter() - begin
            saved = 100.0 * (1.0 - found["hours"] / hours)
            label = found["plan"] if found["results"] and _met(found) else "not reached"
            print(
                f"| {procedure} | {usual.label} | {hours:.3g} | {size:.3g} {unit} |"
                f" {label} |"
                f" {found['hours']:.3g} | {saved:.0f} % | {took:.0f} |",
                flush=True,
            )


def _met(found: dict[str, Any]) -> bool:
    """Whether the wish of a plan is met."""
    return all(one["met"] is not False for one in found["results"])


if __name__ == "__main__":
    main()
