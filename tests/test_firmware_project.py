"""The example project: generated files in an application with a plain Makefile, on the host and on
an emulated core.
"""

import shutil
import subprocess

import pytest

from conftest import ROOT

PROJECT = ROOT / "tests" / "firmware_project"


@pytest.fixture(scope="module")
def delivered(tmp_path_factory):
    """Return a folder with the sample gyro exported as C and as a blob, as the Makefile expects
    it.
    """
    from calibkit import pipeline, recipe, store
    from calibkit.instruments import silent

    root = tmp_path_factory.mktemp("project")
    data = ROOT / "datasets" / "rate_table"
    outcome = pipeline.fit(
        recipe.find("rate_table"), data, "GYRO-0001", root / "runs", "2026-11-21", silent
    )
    run = store.load(outcome.run.folder)
    pipeline.export([run], "c", "f32", "gyro", root / "exported")
    pipeline.export([run], "blob", "f32", "gyro", root / "exported_blob")
    return root


def make(root, target):
    """Run make; returns what it printed, where an emulator prints too."""
    places = [f"{name}={root / folder}" for name, folder in PLACES.items()]
    done = subprocess.run(
        ["make", "-s", *places, target],
        cwd=PROJECT,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr[:3000]
    assert "warning" not in done.stderr
    return done.stdout + done.stderr


PLACES = {"EXPORTED": "exported", "BLOB": "exported_blob", "BUILD": "build"}


def test_host_and_core_give_the_same_bits_from_source_and_from_blob(delivered):
    """Four programs, one result: self-test passed, three rates without a status, one clamped; no
    warning anywhere.
    """
    for tool in ("make", "arm-none-eabi-gcc", "qemu-system-arm"):
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} is not installed")
    host, core = make(delivered, "run"), make(delivered, "run-arm")
    once = host[: len(host) // 2]
    assert host == once * 2 == core
    assert once.startswith("self-test passed\n")
    assert once.count("status 00000000") == 3
    assert once.count("status 00000002") == 1


def test_a_damaged_blob_keeps_the_application_from_correcting(delivered):
    """One bit of the blob flipped: the program says why and ends with an error."""
    if shutil.which("make") is None:
        pytest.skip("make is not installed")
    folder = delivered / "damaged"
    shutil.copytree(delivered / "exported_blob", folder)
    content = bytearray((folder / "gyro.bin").read_bytes())
    content[130] ^= 4
    (folder / "gyro.bin").write_bytes(bytes(content))
    places = [
        f"EXPORTED={delivered / 'exported'}",
        f"BLOB={folder}",
        f"BUILD={delivered / 'build_damaged'}",
    ]
    done = subprocess.run(
        ["make", "-s", *places, "run"], cwd=PROJECT, capture_output=True, text=True, check=False
    )
    assert done.returncode != 0
    assert "blob refused: reason 00000005" in done.stdout
