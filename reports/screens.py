"""Pictures of the first screens of the sample reports, in a window of 1280 × 900 pixels: `python
reports/screens.py` (needs Chromium; another version of it may give other bytes).
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from regenerate import DATE, ROOT, SAMPLES

from calibkit import recipe
from calibkit.commands import pipeline
from calibkit.instruments import silent
from calibkit.report.documents import PAGE

BROWSERS = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")
OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--hide-scrollbars",
    "--force-color-profile=srgb",
    "--window-size=1280,900",
)


def main(out: Path) -> None:
    """Fit every sample and write the picture of its report's first screen into a folder."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        sys.exit(f"no browser: install one of {', '.join(BROWSERS)}")
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        for name, serial in SAMPLES.items():
            source = recipe.find(str(ROOT / "recipes" / f"{name}.toml"))
            data, runs = ROOT / "datasets" / name, Path(folder) / name
            run = pipeline.fit(source, data, serial, runs, DATE, silent).run
            picture, page = (out / f"{name}.png").resolve(), (run.folder / PAGE).as_uri()
            subprocess.run(  # noqa: S603 (a browser of this machine on a page that was just made)
                [browser, *OPTIONS, f"--screenshot={picture}", page],
                check=True,
                capture_output=True,
            )


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "reports" / "screens")
