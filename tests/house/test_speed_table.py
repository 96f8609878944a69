"""The runner of the speed table: sides in processes of their own give the same numbers, and the
page is what was measured.
"""

import json
import os
import subprocess
import sys

import pytest

from conftest import ROOT

BENCHMARKS = ROOT / "benchmarks"


@pytest.fixture(scope="module", autouse=True)
def _found():
    """The benchmarks are scripts: they are found where they lie."""
    sys.path.insert(0, str(BENCHMARKS))
    yield
    sys.path.remove(str(BENCHMARKS))
    for name in [name for name in sys.modules if name.split(".")[0] in {"speed", "run"}]:
        del sys.modules[name]


def test_rows_run_beside_the_peers_that_are_installed_here(tmp_path):
    """On a few thousand rows PyWavelets, lmfit and numpy give calibkit's numbers, and the page
    holds a line for each.
    """
    page, results = tmp_path / "page.md", tmp_path / "results.json"
    page.write_text(
        "before\n<!-- measured: benchmarks/run.py writes what stands below -->\nBEFORE\n<!-- end of"
        " what is measured -->\nafter\n"
    )
    chosen = ("denoise", "magnitude", "mad")
    done = subprocess.run(
        [
            sys.executable,
            str(BENCHMARKS / "run.py"),
            "--here",
            "--rows",
            "2560",
            "--turns",
            "1",
            "--page",
            str(page),
        ]
        + ["--results", str(results)]
        + [part for name in chosen for part in ("--only", name)],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )
    assert done.returncode == 0, done.stderr[-2000:]
    lines = {line["name"]: line for line in json.loads(results.read_text())["lines"]}
    assert set(lines) == set(chosen)
    assert lines["denoise"]["digits"] > 9.0
    assert lines["magnitude"]["digits"] > 6.0
    assert lines["mad"]["digits"] == 17.0
    text = page.read_text()
    assert text.startswith("before\n<!-- measured")
    assert text.endswith("<!-- end of what is measured -->\nafter\n")
    assert "BEFORE" not in text
    assert text.count("lifting denoise, 8 levels, CDF 9/7 |") == 1
