"""Regenerate sample reports and certificates and the README's picture from the sample logs: `python
reports/regenerate.py`.
"""

from __future__ import annotations

import os

os.environ.setdefault(
    "OPENBLAS_NUM_THREADS", "1"
)  # as the command line does, before numpy is imported

import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from calibkit import instruments, recipe
from calibkit.certificate import certify
from calibkit.commands import pipeline, run_content
from calibkit.instruments import silent
from calibkit.instruments.bias import compensate, ramps
from calibkit.instruments.bias.figures import DriftReport
from calibkit.logs import log_files
from calibkit.report import documents
from calibkit.report.figures import png

if TYPE_CHECKING:
    from calibkit.records import store

ROOT = Path(__file__).resolve().parents[1]
DATE = "2026-11-21"
SAMPLES = {
    "fog_thermal": "FOG-0001",
    "accelerometer": "ACC-0001",
    "gyro_pair": "PAIR-0001",
    "gyro_triad": "TRIAD-0001",
    "rate_table": "GYRO-0001",
    "inclinometer": "INC-0001",
    "gyro_noise": "FOG-0001",
}
"""Procedure, which is also the name of its sample logs and of its recipe → serial number in the
report.
"""
PAGES = ("fog_thermal", "gyro_pair", "inclinometer")
"""Procedures whose sample report is kept as a page too: each is several times its PDF."""
VALIDATED = ("fog_thermal", "inclinometer")
"""Procedures whose sample certificate states as-found and as-left results, on the logs that were
withheld.
"""
SHOWN = ("withheld/ramp_heating_03.csv", "withheld/ramp_cooling_03.csv")


def report(name: str, out: Path, runs: Path) -> store.StoredRun:
    """Fit a procedure's sample logs and keep the run's report as <name>.pdf and <name>.txt, of some
    as <name>.html too.
    """
    source = recipe.find(str(ROOT / "recipes" / f"{name}.toml"))
    outcome = pipeline.fit(source, ROOT / "datasets" / name, SAMPLES[name], runs, DATE, silent)
    for file in (documents.TEXT, *((documents.PAGE,) if name in PAGES else ())):
        (out / f"{name}{Path(file).suffix}").write_bytes((outcome.run.folder / file).read_bytes())
    (out / f"{name}.pdf").write_bytes(run_content.read_report(outcome.run, ".pdf"))
    return outcome.run


def certificate(name: str, run: store.StoredRun, out: Path, work: Path) -> None:
    """Certificate of a sample run after its sample profile; as found and as left where the sample
    has withheld logs.
    """
    validation = work / f"{name}.json" if name in VALIDATED else None
    if validation is not None:
        pipeline.validate(run, ROOT / "datasets" / name / "withheld", validation, silent)
    made = work / f"{name}.pdf"
    profile = ROOT / "reports" / "profiles" / f"{name}.toml"
    certify.certify(
        run.folder,
        made,
        instruments.certificate_layout,
        date=DATE,
        profile_path=profile,
        validation=validation,
    )
    (out / "certificates").mkdir(exist_ok=True)
    (out / "certificates" / f"{name}.pdf").write_bytes(made.read_bytes())


def picture(run: store.StoredRun, out: Path) -> None:
    """Draw the drift of the withheld logs before and after compensation by a run that has not seen
    them.
    """
    spec = pipeline.run_recipe(run, ())
    data = ROOT / "datasets" / "fog_thermal"
    model = compensate.DriftModel.read(run.records, spec)
    read = [log_files.read_log(spec, data / file, file, ramps.COLUMNS) for file in SHOWN]
    prepared = [ramps.prepare(log, spec, ramps.find_faults(log, spec)) for log in read]
    found = [compensate.LogFigures.summarize(log.name, log.raw, model) for log in prepared]
    view = DriftReport(spec.drift.interval_s, tuple(prepared), tuple(found))
    drawn = view.before_after("Simulated gyro, ramps that were not fitted")
    (out / "fog_thermal.png").write_bytes(png(drawn, dpi=90))


def main(out: Path) -> None:
    """Write every sample report, every sample certificate and the picture into a folder."""
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as runs:
        found = {name: report(name, out, Path(runs)) for name in SAMPLES}
        for name, run in found.items():
            certificate(name, run, out, Path(runs) / "certificates")
        picture(found["fog_thermal"], out)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "reports")
