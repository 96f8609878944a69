"""The sample logs: small, as they were written, and said to be simulated."""

import hashlib
import json

import pytest

from calibkit.commands import pipeline
from conftest import ROOT

DATASETS = sorted(path for path in (ROOT / "datasets").iterdir() if path.is_dir())


@pytest.mark.parametrize("folder", DATASETS, ids=lambda path: path.name)
def test_the_sample_logs_are_what_their_digests_say(folder):
    """SHA256SUMS lists every sample file and each has its digest."""
    sums = dict(
        reversed(line.split("  "))
        for line in (folder / "SHA256SUMS").read_text(encoding="utf-8").splitlines()
    )
    there = {p.relative_to(folder).as_posix(): p for p in folder.rglob("*") if p.is_file()}
    assert set(sums) == set(there) - {"SHA256SUMS", "SOURCE.md"}
    for name, digest in sums.items():
        assert hashlib.sha256(there[name].read_bytes()).hexdigest() == digest, name


@pytest.mark.parametrize("folder", DATASETS, ids=lambda path: path.name)
def test_the_sample_logs_are_small_and_honest(folder):
    """A data set is under 5 MB, and SOURCE.md says that it is simulated."""
    assert sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) < 5_000_000
    assert "**simulated**" in (folder / "SOURCE.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("folder", DATASETS, ids=lambda path: path.name)
def test_the_sample_logs_come_from_the_simulator_that_is_here(folder):
    """Simulating the seed that SOURCE.md names gives the same files and, to 1e-9 relative, the same
    first truth numbers.
    """
    source = (folder / "SOURCE.md").read_text(encoding="utf-8")
    seed = int(source.split("--seed ")[1].split("`")[0])
    files = pipeline.simulated(folder.name, seed).files()
    there = {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()} - {
        "SHA256SUMS",
        "SOURCE.md",
    }
    assert set(files) == there
    now, then = (
        json.loads(files["truth.json"]),
        json.loads((folder / "truth.json").read_text(encoding="utf-8")),
    )
    assert _numbers(now)[:200] == pytest.approx(_numbers(then)[:200], rel=1e-9, abs=1e-12)


def _numbers(node):
    """All numbers of a JSON document in order."""
    if isinstance(node, dict):
        return [number for key in sorted(node) for number in _numbers(node[key])]
    if isinstance(node, list):
        return [number for item in node for number in _numbers(item)]
    return [float(node)] if isinstance(node, int | float) and not isinstance(node, bool) else []
