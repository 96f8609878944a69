"""The oldest libraries that pyproject.toml admits against those installed here; slow, so only where
it is asked for.
"""

import json
import os
import re
import subprocess
import sys
import tomllib

import pytest

from calibkit.records import store
from conftest import ROOT
from outputs.firmware_runs import UNITS, cached, warmed_up

ASKED = "CALIBKIT_OLDEST_LIBRARIES"

pytestmark = pytest.mark.skipif(
    not os.environ.get(ASKED), reason=f"installs a second environment; set {ASKED}=1"
)

EXPORTS = [
    *((run, "c", number) for run in ("lagged", "k") for number in ("f32", "f64")),
    ("level", "c", "f32"),
    ("gradient", "c", "f64"),
    ("k", "blob", "f32"),
    ("lagged", "blob", "f64"),
    ("lagged", "hex", "f32"),
    ("pair", "c", "f32"),
    ("triad", "c", "f64"),
    ("scale", "c", "f32"),
    ("rate", "csv", "f64"),
]
"""Run, target and number format: every chain once, every number format; the autopilots' below."""


def oldest():
    """Return a requirement at its lower bound for every library of the core and of the blob's
    record formats.
    """
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = [*project["dependencies"], *project["optional-dependencies"]["hex"]]
    bounds = [re.fullmatch(r"([\w.-]+)>=([\w.]+),<[\w.]+", requirement) for requirement in wanted]
    assert all(bounds), wanted
    return [f"{found.group(1)}=={found.group(2)}" for found in bounds]


@pytest.fixture(scope="module")
def old_python(tmp_path_factory):
    """Return the interpreter of an environment with the oldest libraries and this calibkit."""
    folder = tmp_path_factory.mktemp("oldest")
    subprocess.run([sys.executable, "-m", "venv", folder], check=True)
    python = folder / "bin" / "python"
    for wanted in (oldest(), ["--no-deps", str(ROOT)]):
        subprocess.run([python, "-m", "pip", "install", "--quiet", *wanted], check=True)
    return python


def typed(python, *arguments):
    """Run calibkit under an interpreter, away from this checkout and its path."""
    clean = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    command = [str(python), "-m", "calibkit", *map(str, arguments)]
    done = subprocess.run(command, cwd="/", env=clean, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def same_bytes(run, target, number, old_python, folder):
    """Export a run under both environments and compare every file."""
    for python, out in ((sys.executable, folder / "new"), (old_python, folder / "old")):
        placed = ("--address", "0x08040000") if target == "hex" else ()
        typed(python, "export", run, "--target", target, "--number", number, "--out", out, *placed)
    new, old = (
        {path.name: path.read_bytes() for path in (folder / side).iterdir()}
        for side in ("new", "old")
    )
    assert new
    assert new == old


def test_the_environment_holds_the_lower_bounds(old_python):
    """What was installed is what pyproject.toml names, so that nothing newer is tested by
    accident.
    """
    listed = subprocess.run(
        [old_python, "-m", "pip", "list", "--format=json"], check=True, capture_output=True
    )
    versions = {entry["name"].lower(): entry["version"] for entry in json.loads(listed.stdout)}
    for name, version in (requirement.lower().split("==") for requirement in oldest()):
        assert re.match(rf"{re.escape(version)}(\.0)*$", versions[name]), (
            name,
            version,
            versions[name],
        )


@pytest.mark.parametrize(("run", "target", "number"), EXPORTS)
def test_an_export_is_the_same_bytes_with_the_oldest_libraries(
    run, target, number, old_python, tmp_path, tmp_path_factory
):
    """Firmware made from one run folder does not know which numpy made it."""
    same_bytes(cached(run, tmp_path_factory).run.folder, target, number, old_python, tmp_path)


def test_parameters_of_autopilots_are_the_same_bytes_with_the_oldest_libraries(
    old_python, tmp_path
):
    """So are the texts that PX4 and ArduPilot load."""
    run = warmed_up(tmp_path) / UNITS[0] / "r001"
    for target in ("px4", "ardupilot"):
        same_bytes(run, target, "f32", old_python, tmp_path / target)


@pytest.mark.parametrize("procedure", ["fog_thermal", "accelerometer"])
def test_a_fit_finds_the_same_coefficients_with_the_oldest_libraries(
    procedure, old_python, tmp_path
):
    """Coefficients agree within a millionth of their standard uncertainty: other libraries round,
    they do not decide.
    """
    for python, out in ((sys.executable, tmp_path / "new"), (old_python, tmp_path / "old")):
        typed(
            python,
            "fit",
            procedure,
            "--data",
            ROOT / "datasets" / procedure,
            "--serial",
            "S",
            "--out",
            out,
        )
    new, old = (store.load(tmp_path / side / "S" / "r001").records for side in ("new", "old"))
    assert new.keys() == old.keys()
    for name, record in new.items():
        for one, other in zip(record.models, old[name].models, strict=True):
            for a, b in zip(one.coefficients, other.coefficients, strict=True):
                assert abs(a.value - b.value) <= 1e-6 * a.standard_uncertainty, (
                    name,
                    one.name,
                    a,
                    b,
                )
