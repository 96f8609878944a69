"""Regenerate the sample reports and the README's picture from the sample logs: `python reports/regenerate.py`."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from calibkit import pipeline, recipe
from calibkit.procedures import silent
from calibkit.report.figures import png
from calibkit.report.fog_thermal import DriftReport, logs_page
from calibkit.stages import fog_compensate, fog_ramps, fog_report, ingest

ROOT = Path(__file__).resolve().parents[1]
DATE = "2026-11-21"
SHOWN = ("ramp_heating_05.csv", "ramp_cooling_05.csv", "withheld/ramp_heating_03.csv", "withheld/ramp_cooling_03.csv")


def fog_thermal(out: Path) -> None:
    """Fit the sample gyro, keep its report, and draw four of its logs, two of them withheld."""
    data = ROOT / "datasets" / "fog_thermal"
    with tempfile.TemporaryDirectory() as folder:
        source = recipe.find(str(ROOT / "recipes" / "fog_thermal.toml"))
        outcome = pipeline.fit(source, data, "FOG-0001", Path(folder), DATE, silent)
        run = pipeline.store.load(outcome.folder)
        for name in ("report.pdf", "report.txt"):
            (out / f"fog_thermal.{name.partition('.')[2]}").write_bytes((outcome.folder / name).read_bytes())
        spec = pipeline.run_recipe(run, ())
        model = fog_compensate.model_from(run.records["drift_rate.json"], spec)
        read = [ingest.read_log(spec, data / file, file, fog_ramps.COLUMNS) for file in SHOWN]
        logs = tuple(fog_report.log_view(fog_ramps.prepare(log, spec), model) for log in read)
    view = DriftReport("Simulated gyro: two fitted and two withheld ramps", spec.drift.interval_s, logs, (), (), ())
    (out / "fog_thermal.png").write_bytes(png(logs_page(view, logs), dpi=90))


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "reports"
    target.mkdir(parents=True, exist_ok=True)
    fog_thermal(target)
