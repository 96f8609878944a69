"""`calibkit export` and `verify` of exports from the command line."""

import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from calibkit import instruments, recipe
from calibkit.commands import pipeline
from calibkit.errors import OutputError
from calibkit.firmware import export as firmware_export, formats
from calibkit.instruments.bias import firmware
from conftest import ROOT, slow_after
from outputs.firmware_log import correct
from outputs.firmware_runs import cached


@pytest.fixture(scope="module")
def drift_run(tmp_path_factory):
    """Return the folder of a run with a lagged drift model."""
    return cached("lagged", tmp_path_factory).run.folder


@pytest.fixture(scope="module")
def triad_run(tmp_path_factory):
    """Return the folder of a run of a triad."""
    return cached("k", tmp_path_factory).run.folder


@pytest.mark.parametrize("number", ["f32", "f64"])
def test_an_export_verifies_and_is_the_same_in_another_process(
    number, drift_run, tmp_path, calibkit
):
    """Header and source are written, verified, and byte-identical from a process with another hash
    seed and locale.
    """
    arguments = ("export", str(drift_run), "--target", "c", "--number", number, "--prefix", "gyro")
    outcome = calibkit(*arguments, "--out", tmp_path / "a", "--json")
    assert outcome.code == 0
    files = [tmp_path / "a" / "gyro.c", tmp_path / "a" / "gyro.h"]
    assert outcome.json["files"] == [str(path) for path in files]
    verified = calibkit("verify", *files)
    assert verified.code == 0
    assert "C source of" in verified.out
    assert "REJECTED" not in verified.out
    subprocess.run(
        [sys.executable, "-m", "calibkit", *arguments, "--out", str(tmp_path / "b")],
        cwd=ROOT,
        check=True,
        capture_output=True,
        env={
            "PATH": "",
            "PYTHONHASHSEED": "7",
            "LC_ALL": "C",
            "PYTHONPATH": os.pathsep.join(sys.path),
        },
    )
    for path in files:
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes()


def test_a_source_beside_the_header_of_another_export_is_named(drift_run, tmp_path, calibkit):
    """gyro.c of single precision with the gyro.h of double precision: exit 4."""
    for number in ("f32", "f64"):
        arguments = ("--target", "c", "--number", number, "--prefix", "gyro")
        assert calibkit("export", drift_run, *arguments, "--out", tmp_path / number).code == 0
    source, header = tmp_path / "f32" / "gyro.c", tmp_path / "f32" / "gyro.h"
    header.write_bytes((tmp_path / "f64" / "gyro.h").read_bytes())
    outcome = calibkit("verify", header, source)
    assert outcome.code == 4
    assert f"FAILED {source}: gyro.h beside it is of another export" in outcome.err


@pytest.mark.parametrize(
    "prefix",
    [
        "int",
        "9lives",
        "a__b",
        "x" * 21,
        "printf",
        "STDLIB",
        "",
    ],
)
def test_a_prefix_that_c_or_cpp_forbid_is_refused(prefix, triad_run, tmp_path, calibkit):
    """Keywords, reserved names, headers of the C library and names that are none exit with 2 and a
    word of advice.
    """
    outcome = calibkit("export", triad_run, target="c", prefix=prefix, out=tmp_path / "x")
    assert outcome.code == 2
    assert not (tmp_path / "x").exists()
    firmware_export._check_prefix("gyro_7")


def test_a_rejected_run_is_refused_or_marked(tmp_path, tmp_path_factory):
    """A run that failed a limit exits with 4; told otherwise, every file says REJECTED and the
    header's macro is 0.
    """
    run = cached("k", tmp_path_factory).run
    failed = {"name": "residual rms", "value": 2.0, "limit": 1.0, "unit": "g", "passed": False}
    run = replace(
        run,
        document={**run.document, "verdict": "rejected", "accepted": False, "acceptance": [failed]},
    )
    with pytest.raises(OutputError, match="residual rms") as refused:
        pipeline.export([run], "c", "f32", "cal", tmp_path, allow_rejected=False)
    assert refused.value.exit_code == 4
    assert list(tmp_path.iterdir()) == []
    for path in pipeline.export([run], "c", "f32", "cal", tmp_path, allow_rejected=True):
        assert "REJECTED" in path.read_text()
        assert pipeline.verify(path).what.endswith(", REJECTED")
    header = (tmp_path / "cal.h").read_text()
    assert "#define CAL_VERDICT 0\n#define CAL_ACCEPTED 0\n" in header


def test_a_run_without_a_drift_term_or_with_one_that_removes_the_rate_is_refused(tmp_path_factory):
    """There is nothing to export, or something that must not be; exit code 4."""
    record = cached("gradient", tmp_path_factory).record("drift_rate.json")
    spec = instruments.parse_recipe(recipe.find("fog_thermal"))
    with pytest.raises(OutputError, match="no drift term") as refused:
        firmware.chain(spec, {"drift_rate.json": replace(record, models=())})
    assert refused.value.exit_code == 4
    one_step = ("drift.compensation='one_step'",)
    spec = instruments.parse_recipe(recipe.find("fog_thermal", one_step))
    with pytest.raises(OutputError, match="removes the true rate"):
        firmware.chain(spec, {"drift_rate.json": record})


def test_literals_read_back_to_the_same_number_in_c():
    """Nine and seventeen significant digits, with a point or an exponent, and F for single
    precision.
    """
    f32, f64 = formats.Format.find("f32"), formats.Format.find("f64")
    assert f32.text(1.0) == "1.0F"
    assert f32.text(f32.nearest(formats.Fraction(1, 10))) == "0.100000001F"
    assert f64.text(0.1) == "0.10000000000000001"
    rng = np.random.default_rng(3)
    for x in rng.normal(size=200) * 10.0 ** rng.integers(-40, 30, 200):
        exact = formats.Fraction(float(x))
        assert f32.nearest(exact) == float(np.float32(x))
        assert np.float32(f32.text(f32.nearest(exact))[:-1]) == np.float32(x)
        assert f64.nearest(exact) == x


def test_the_firmware_corrects_a_log_as_apply_does(tmp_path_factory, tmp_path, calibkit):
    """By the twin: within the float32 bound of the float64 result for a triad, one interval late
    for a drift.
    """
    triad, drifting = (cached(name, tmp_path_factory) for name in ("k", "lagged"))
    data = ROOT / "datasets/accelerometer/positions.csv"
    log = ROOT / "datasets/fog_thermal/withheld/ramp_heating_03.csv"
    for run, frame in ((triad, data), (drifting, log)):
        out = tmp_path / frame.name
        assert calibkit("apply", run.run.folder, "--data", frame, "--out", out).code == 0
    columns = [f"accel_{axis}_g" for axis in "xyz"]
    found, _ = correct(triad.chain, pd.read_csv(data), "f32")
    applied = pd.read_csv(tmp_path / data.name)
    assert (applied[columns] - found[columns]).abs().to_numpy().max() < 1e-6  # g
    raw = pd.read_csv(log)
    found, _ = correct(drifting.chain, raw, "f32")
    drift = (raw["gyro_dph"] - found["gyro_dph"]).to_numpy()
    along = (raw["gyro_dph"] - pd.read_csv(tmp_path / log.name)["gyro_dph"]).to_numpy()
    assert np.std(drift) > 0.1  # °/h
    late = 15  # rows of 1 s: the middle of an interval of 10 s is shown an interval after its end
    np.testing.assert_allclose(drift[30:], along[30 - late : -late], atol=1e-4)  # °/h


@pytest.mark.parametrize("number", ["q31", "q15", "f16"])
def test_fixed_point_is_no_longer_exported(number, triad_run, tmp_path, calibkit):
    """The formats that there are stand in the message."""
    outcome = calibkit("export", triad_run, target="c", number=number, out=tmp_path / "x")
    assert outcome.code == 2
    assert "f32, f64" in outcome.err
    assert not (tmp_path / "x").exists()


ADVISORY = {"2.5", "8.7", "8.9"}
"""MISRA C:2012 rules that generated files deviate from, all advisory: status macros are for the
application (2.5), functions are called from another file (8.7), tables stand together at file
scope, where a reviewer looks for them (8.9).
"""


@pytest.mark.parametrize("number", slow_after(1, ["f32", "f64"]))
def test_cppcheck_finds_no_misra_deviation_but_the_three_on_the_list(
    number, drift_run, triad_run, tmp_path, calibkit
):
    """The addon's rules over sources with and without memory, and no other finding."""
    if shutil.which("cppcheck") is None:
        pytest.skip("cppcheck is not installed")
    for k, run in enumerate((drift_run, triad_run)):
        assert (
            calibkit("export", run, target="c", number=number, prefix=f"m{k}", out=tmp_path).code
            == 0
        )
    if number == "f32":
        options = ("--target", "blob", "--prefix", "m2", "--out", tmp_path)
        assert calibkit("export", drift_run, *options).code == 0
    done = subprocess.run(
        [
            *(
                "cppcheck",
                "--addon=misra",
                "--std=c99",
                "--enable=all",
                "-q",
                "--suppress=missingIncludeSystem",
            ),
            *("--suppress=unusedFunction", "m0.c", "m1.c"),
            *(["m2.c"] if number == "f32" else []),
        ],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    found = re.findall(r"^\S+:\d+:\d+: .*\[([\w.-]+)\]$", done.stderr, re.MULTILINE)
    if "misra" not in done.stderr:
        pytest.skip("cppcheck has no MISRA addon here")
    recorded = {"19.2"} if number == "f32" else set()  # the loader's deviation
    assert {rule.removeprefix("misra-c2012-") for rule in found} <= ADVISORY | recorded
