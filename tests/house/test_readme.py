"""The README's two commands, typed as they stand, in a fresh copy with nothing else installed."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
GUARD = "CALIBKIT_README_COMMANDS"

pytestmark = pytest.mark.skipif(
    os.environ.get(GUARD) == "inside" or not (ROOT / ".git").exists(),
    reason="runs the README's commands, which run this suite",
)


def command(name):
    """Shell command of the README that stands under a marker."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    found = re.search(rf"<!-- {name} command -->\n```sh\n(.+?)\n```", text, re.DOTALL)
    assert found, name
    return found.group(1)


@pytest.fixture
def fresh(tmp_path):
    """Return a copy of what git knows or would know of this checkout."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        check=True,
    )
    for name in filter(None, listed.stdout.decode().split("\0")):
        if (ROOT / name).is_file():
            target = tmp_path / "clone" / name
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, target)
    return tmp_path / "clone"


def typed(shell, folder, **environment):
    """Run a command as a user would type it, outside of this test's virtual environment."""
    clean = {
        key: value
        for key, value in os.environ.items()
        if key not in ("VIRTUAL_ENV", "PYTHONPATH", "PYTEST_ADDOPTS")
    }
    clean["PATH"] = os.pathsep.join(p for p in clean["PATH"].split(os.pathsep) if ".venv" not in p)
    return subprocess.run(
        ["bash", "-c", shell],
        cwd=folder,
        env=clean | environment,
        capture_output=True,
        text=True,
        timeout=900,
        check=False,
    )


@pytest.mark.slow
def test_the_fit_command_works_in_a_fresh_copy(fresh):
    """The first command installs calibkit, fits the sample logs and leaves a run folder."""
    done = typed(command("fit"), fresh)
    assert done.returncode == 0, done.stdout + done.stderr
    assert (fresh / "runs" / "FOG-0001" / "r001" / "run.json").is_file()
    assert "ramps the fit had not seen" in done.stdout
    named = typed(
        "../.venv/bin/calibkit check fog_thermal --data ../datasets/fog_thermal", fresh / "docs"
    )
    # the recipe is found by name in the installed package
    assert named.returncode == 0, named.stderr


@pytest.mark.slow
def test_the_test_command_works_in_a_fresh_copy(fresh):
    """The second command installs the test tools and runs pytest, here on one module so that the
    suite does not call itself.
    """
    done = typed(
        command("test"), fresh, **{GUARD: "inside", "PYTEST_ADDOPTS": "tests/logs/test_units.py"}
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.search(r"\d+ passed", done.stdout)
