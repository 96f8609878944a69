"""The example project: generated files in an application with a plain Makefile, with two slots of
flash and a fall-back, on the host, on an emulated Cortex-M and on an emulated RISC-V core.
"""

import shutil
import subprocess

import pytest

from conftest import ROOT, slow_after

PROJECT = ROOT / "tests" / "outputs" / "firmware_project"
EMULATED = {
    "run-arm": ("arm-none-eabi-gcc", "qemu-system-arm"),
    "run-riscv": ("riscv64-unknown-elf-gcc", "qemu-system-riscv32"),
}
DAMAGE = 700
"""A byte of a blob that is damaged."""


@pytest.fixture(scope="module")
def delivered(tmp_path_factory):
    """Return a folder with two revisions of the sample gyro's scale factor as slots with their
    loader, and the drift of the sample gyro as source, as the Makefile expects them.
    """
    from calibkit import recipe
    from calibkit.commands import pipeline
    from calibkit.instruments import silent
    from calibkit.records import store

    root = tmp_path_factory.mktemp("project")
    out = root / "exported"
    for name, date in (("slot_a", "2026-11-21"), ("slot_b", "2026-11-22")):
        data = ROOT / "datasets" / "rate_table"
        fitted = pipeline.fit(
            recipe.find("rate_table"), data, "GYRO-0001", root / "runs", date, silent
        )
        run = store.load(fitted.run.folder)
        pipeline.export([run], "blob", "f32", "gyro", root / name)
    shutil.copytree(root / "slot_b", out)
    for name in ("slot_a", "slot_b"):
        shutil.copy(root / name / "gyro.bin", out / f"{name}.bin")
    fitted = pipeline.fit(
        recipe.find("fog_thermal", ("drift.model=lagged",)),
        ROOT / "datasets" / "fog_thermal",
        "FOG-0001",
        root / "runs",
        "2026-11-21",
        silent,
    )
    pipeline.export([store.load(fitted.run.folder)], "c", "f32", "drift", out)
    return root


def make(root, target, exported="exported"):
    """Run make; returns what it printed, where an emulator prints too, and its exit code."""
    places = (f"EXPORTED={root / exported}", f"BUILD={root / 'build'}_{exported}")
    done = subprocess.run(
        ["make", "-s", *places, target],
        cwd=PROJECT,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert "warning" not in done.stderr, done.stderr[:3000]
    return done.stdout + done.stderr, done.returncode


def damaged(root, *slots):
    """Folder of the project in which slots have one bit wrong."""
    name = "damaged_" + "_".join(slots)
    shutil.copytree(root / "exported", root / name)
    for slot in slots:
        content = bytearray((root / name / f"{slot}.bin").read_bytes())
        content[DAMAGE] ^= 4
        (root / name / f"{slot}.bin").write_bytes(bytes(content))
    return name


def test_the_application_takes_the_newer_slot_and_heeds_every_status(delivered):
    """Revision 2 is loaded, proven and used; a wrong slot later changes nothing; the drift bridges
    two missed updates, holds without a thermometer and leaves a glitch out.
    """
    if shutil.which("make") is None:
        pytest.skip("make is not installed")
    said, code = make(delivered, "run")
    assert code == 0, said
    lines = said.splitlines()
    assert lines[:3] == [
        "slot b load 00000000",
        "GYRO-0001 revision 00000002",
        "self-test passed",
    ]
    statuses = [line.split()[1] for line in lines if line.strip().startswith("status")]
    assert statuses[:4] == ["00000000"] * 3 + ["00000002"]
    header = (delivered / "exported" / "drift.h").read_text()
    bit = {
        name: next(
            int(line.split()[2].rstrip("U"), 16)
            for line in header.splitlines()
            if line.startswith(f"#define DRIFT_{name} ")
        )
        for name in ("STARTING", "INTERVAL", "JUMPED", "INVALID")
    }
    starting = bit["STARTING"]
    assert [int(status, 16) for status in statuses[4:10]] == [
        starting,
        starting,
        starting | bit["INTERVAL"],
        bit["INVALID"],
        bit["JUMPED"],
        starting | bit["INTERVAL"],
    ]
    assert "wrong slot load 00000002" in lines
    assert "still revision 00000002" in lines
    assert [line for line in lines if line.startswith("rate")][1] == lines[-2]


@pytest.mark.parametrize("target", slow_after(1, EMULATED))
def test_emulated_cores_print_the_bits_of_the_host(target, delivered):
    """The same text, bit for bit, from a Cortex-M4F and from a RISC-V core without a floating-point
    unit; no warning anywhere.
    """
    for tool in ("make", *EMULATED[target]):
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} is not installed")
    assert make(delivered, target) == make(delivered, "run")


def test_a_damaged_slot_falls_back_and_two_correct_nothing(delivered):
    """One bit of the newer slot wrong: the older one is used; of both: the program says why and
    ends with an error.
    """
    if shutil.which("make") is None:
        pytest.skip("make is not installed")
    said, code = make(delivered, "run", damaged(delivered, "slot_b"))
    assert said.splitlines()[:3] == [
        "slot b load 00000005",
        "slot a load 00000000",
        "GYRO-0001 revision 00000001",
    ]
    assert code == 0
    said, code = make(delivered, "run", damaged(delivered, "slot_a", "slot_b"))
    assert "slot a load 00000005" in said
    assert "no good numbers: nothing is corrected" in said
    assert code != 0
