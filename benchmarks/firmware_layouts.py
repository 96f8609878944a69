"""How many firmware layouts the simulated devices of a procedure have, each fitted anew to several
campaigns: one is wanted, with the model form pinned where a procedure chooses among several.

    PYTHONPATH=. python benchmarks/firmware_layouts.py [devices, default 50] [refits, default 10]
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from pathlib import Path

from calibkit import instruments, pipeline, recipe, store
from calibkit.errors import CalibkitError
from calibkit.firmware import blob, formats, program

PROCEDURES = {
    "rate_table": (),
    "gyro_pair": (),
    "gyro_triad": ("site.latitude_deg=34.2",),
    "accelerometer": (),
    "inclinometer": (),
    "fog_thermal, lagged": ("drift.model=lagged",),
    "fog_thermal, bank": ("drift.model=bank",),
}
"""Procedure and what pins its model."""


def layouts(procedure: str, overrides: tuple[str, ...], seeds: range, folder: Path) -> Counter[str]:
    """Layouts of the fits to simulated campaigns with these seeds; "" where nothing is exported."""
    found: Counter[str] = Counter()
    for seed in seeds:
        data = folder / f"{seed}"
        pipeline.simulate(procedure, data, seed)
        try:
            run = store.load(
                pipeline.fit(
                    recipe.find(procedure, overrides),
                    data,
                    f"U-{seed}",
                    folder / "runs",
                    "2026-11-21",
                    instruments.silent,
                ).run.folder
            )
            chain = (
                instruments.find(procedure)
                .firmware()
                .chain(pipeline.run_recipe(run, ()), run.records)
            )
        except CalibkitError:
            found[""] += 1
            continue
        quantised = program.quantise(chain, formats.Format.find("f32"))
        found[blob.shape(quantised).digest.hex()] += 1
    return found


def main() -> None:
    """Print the layouts of every procedure with the number of fits that have them."""
    given = [int(word) for word in sys.argv[1:]]
    devices, refits = (*given, *(50, 10)[len(given) :])
    for title, overrides in PROCEDURES.items():
        with tempfile.TemporaryDirectory() as place:
            procedure = title.partition(",")[0]
            found = layouts(procedure, overrides, range(1, 1 + devices * refits), Path(place))
            print(title, dict(found), flush=True)


if __name__ == "__main__":
    main()
