"""How many firmware layouts the simulated devices of a procedure have, and its model forms: one
layout per form is wanted.

Every campaign is of another device with noise of its own, which is more than fits of one device
differ by.

    PYTHONPATH=. python benchmarks/firmware_layouts.py [campaigns, default 500] [procedure …]
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections import Counter, defaultdict
from pathlib import Path

from calibkit import coefficients, instruments, pipeline, recipe
from calibkit.errors import OutputError
from calibkit.firmware import blob, formats
from calibkit.ingest import logs

PROCEDURES = {
    "rate_table": (),
    "gyro_pair": (),
    "gyro_triad": ("site.latitude_deg=34.2",),
    "accelerometer": (),
    "inclinometer": (),
    "fog_thermal": (),
    "fog_thermal, level": ("drift.model=level",),
    "fog_thermal, lagged": ("drift.model=lagged",),
    "fog_thermal, bank": ("drift.model=bank",),
}
"""Procedure and what pins its model."""


def layout(procedure: str, overrides: tuple[str, ...], data: Path, seed: int) -> tuple[str, str]:
    """Model forms and layout of the fit to a simulated campaign; none where nothing is exported."""
    pipeline.simulate(procedure, data, seed)
    source = recipe.find(procedure, overrides)
    spec, instrument = instruments.parse_recipe(source), instruments.find(procedure)
    fitted = instrument.fit(spec, data, logs.find_logs(spec, data), instruments.silent)
    identity = coefficients.Identity(
        f"U-{seed}", 1, "2026-11-21", "calibkit", source.sha256, fitted.inputs
    )
    records = {one.file: one.as_record(identity, "") for one in fitted.results}
    try:
        chain = instruments.optional(procedure, "chain")(spec, records)
    except OutputError as error:
        return f"not exported: {error}", "none"
    quantised = chain.quantise(formats.Format.find("f32"))
    return ", ".join(dict.fromkeys(chain.structure.forms)), blob.shape(quantised).digest.hex()


def main() -> None:
    """Print a row of the table for each procedure and form."""
    campaigns = int(sys.argv[1]) if len(sys.argv) > 1 else 500
    chosen = sys.argv[2:] or list(PROCEDURES)
    print("| procedure | form | campaigns | layouts |\n|---|---|---|---|")
    for title in chosen:
        found: defaultdict[str, Counter[str]] = defaultdict(Counter)
        begun = time.monotonic()
        for seed in range(1, 1 + campaigns):
            with tempfile.TemporaryDirectory() as place:
                procedure = title.partition(",")[0]
                form, digest = layout(procedure, PROCEDURES[title], Path(place) / "logs", seed)
                found[form][digest] += 1
        for form, digests in sorted(found.items()):
            kinds = len(digests.keys() - {"none"})
            print(f"| {title} | {form} | {digests.total()} | {kinds} |", flush=True)
        print(f"{title}: {time.monotonic() - begun:.0f} s", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
