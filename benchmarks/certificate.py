"""CPU time of a certificate with two figures against that of importing numpy, matplotlib.figure and
typst, in one run.

python benchmarks/certificate.py

The certificate is that of the sample rate-table run, made by the command line in a fresh process:
reading and checking the run folder, uncertainties, two figures, PDF/A-3 with attachments. At most
twice the import is allowed.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
IMPORT = [sys.executable, "-c", "import numpy, matplotlib.figure, typst"]
CALIBKIT = [sys.executable, "-m", "calibkit"]
MOST = 2.0
TIMES = 5


def cpu_s(command: list[str]) -> float:
    """User and system time [s] of a command in a process of its own."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        command,
        check=True,
        capture_output=True,
        cwd=ROOT,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> int:
    """Print both times and their ratio; exit 1 where it is above the limit."""
    with tempfile.TemporaryDirectory() as folder:
        runs, profile = Path(folder) / "runs", ROOT / "reports" / "profiles" / "rate_table.toml"
        fit = [
            "fit",
            "rate_table",
            "--data",
            "datasets/rate_table",
            "--serial",
            "G",
            "--out",
            str(runs),
        ]
        subprocess.run(
            [*CALIBKIT, *fit, "--date", "2026-11-21"], check=True, capture_output=True, cwd=ROOT
        )
        certify = [
            *CALIBKIT,
            "certify",
            "G",
            "--runs",
            str(runs),
            "--profile",
            str(profile),
            "--date",
            "2026-11-21",
        ]
        made, imported = [], []
        for k in range(TIMES):  # one beside the other: what slows the machine slows both
            imported.append(cpu_s(IMPORT))
            made.append(cpu_s([*certify, "--out", str(Path(folder) / f"{k}.pdf")]))
    ratio = min(made) / min(imported)
    print(
        f"certificate {min(made):.3f} s, import {min(imported):.3f} s CPU: ratio {ratio:.2f}, at"
        f" most {MOST:g}"
    )
    return 0 if ratio <= MOST else 1


if __name__ == "__main__":
    sys.exit(main())
