"""Compiled kernels: there where a compiler is, of the sources that stand there, and without
influence on a single bit.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from calibkit import native
from calibkit.native import compiling
from conftest import ROOT, slow_after

COMPILER = any(shutil.which(name) for name in ("cc", "gcc", "clang"))


@pytest.fixture
def sources(tmp_path):
    """Copy the kernels' sources into a folder of their own."""
    for source in native.FOLDER.glob("*.c"):
        shutil.copy(source, tmp_path)
    return tmp_path


def state(folder):
    """State of the kernels of a folder, in a process of its own that may use them."""
    environment = {name: value for name, value in os.environ.items() if name != "CALIBKIT_NATIVE"}
    script = (
        "import pathlib; from calibkit import native;"
        f"native.FOLDER = pathlib.Path({str(folder)!r}); print(native.state())"
    )
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return done.stdout.strip()


@pytest.mark.skipif(not COMPILER, reason="no C compiler")
def test_where_there_is_a_compiler_the_kernels_are_in_use():
    """An installation with a compiler has kernels of its own sources (otherwise: python -m
    calibkit.native).
    """
    assert state(native.FOLDER) == "in use"


def test_kernels_can_be_turned_off():
    """With CALIBKIT_NATIVE=off there are none."""
    command = [
        sys.executable,
        "-c",
        "from calibkit import native; print(native.kernels(), native.state())",
    ]
    environment = {**os.environ, "CALIBKIT_NATIVE": "off"}
    out = subprocess.run(
        command, env=environment, capture_output=True, text=True, check=True
    ).stdout
    assert out == "None turned off by CALIBKIT_NATIVE\n"


@pytest.mark.skipif(native.kernels() is None, reason="no compiled kernels")
@pytest.mark.parametrize("kept", slow_after(1, [0.0, 0.001, 0.1, 0.5, 0.99]))
def test_a_cut_off_library_is_called_damaged(sources, kept):
    """A library that is not whole is not loaded, which might end the process, and is not called one
    that was never compiled.
    """
    library = Path(shutil.copy(native.FOLDER / compiling.LIBRARY, sources))
    os.truncate(library, int(kept * library.stat().st_size))
    assert state(sources).startswith("not in use: _kernels.so is damaged or of another machine")


@pytest.mark.parametrize("package", ["wheel", "sdist"])
def test_what_another_process_is_compiling_is_in_no_package(tmp_path, monkeypatch, package):
    """A folder that a compilation uses, or that a killed one left, is packed neither into a wheel
    nor into a source distribution.
    """
    builder = pytest.importorskip(f"hatchling.builders.{package}")
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    folder = tmp_path / "calibkit" / "native"
    shutil.copytree(native.FOLDER, folder)

    def seen(*_, **__):
        packed = getattr(builder, f"{package.capitalize()}Builder")(str(tmp_path))
        listed.extend(file.distribution_path for file in packed.recurse_included_files())
        assert list(folder.glob("*/mark.c"))
        return subprocess.CompletedProcess((), 1, stderr="")

    listed = []
    monkeypatch.setenv("CC", sys.executable)
    monkeypatch.setattr(subprocess, "run", seen)
    compiling.compile_kernels(folder)
    assert "calibkit/native/numbers.c" in listed
    assert not [name for name in listed if "mark.c" in name]


@pytest.mark.skipif(not COMPILER, reason="no C compiler")
def test_the_kernels_compile_without_a_warning():
    """All warnings, on every source, are errors."""
    for source in sorted(native.FOLDER.glob("*.c")):
        flags = ["-std=c11", "-O2", "-Wall", "-Wextra", "-Werror", "-fsyntax-only"]
        done = subprocess.run(
            ["cc", *flags, str(source)], capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr


@pytest.mark.skipif(native.kernels() is None, reason="no compiled kernels")
def test_a_fit_without_kernels_writes_the_same_bytes(tmp_path):
    """The coefficient files of the sample gyro are equal with kernels and without."""
    written = []
    for native_ in ("on", "off"):
        out, data = tmp_path / native_, ROOT / "datasets" / "fog_thermal"
        where = ["--data", data, "--serial", "N1", "--date", "2026-01-01", "--out", out]
        command = [sys.executable, "-m", "calibkit", "fit", "fog_thermal", *where]
        environment = {**os.environ, "CALIBKIT_NATIVE": native_}
        subprocess.run(command, env=environment, check=True, capture_output=True)
        written.append({path.name: path.read_bytes() for path in sorted(Path(out).rglob("*.json"))})
    assert written[0] == written[1]
    assert written[0]
