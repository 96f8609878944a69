"""The command line around the commands: help, start-up, simulate, names after installation."""

import json
import subprocess
import sys

from conftest import ROOT


def imported(names, code):
    """Which of these modules a process has imported after a piece of code, as it prints them."""
    code = f"import sys\n{code}\nprint([m for m in {names!r} if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT
    )
    return done.stdout.splitlines()[-1]


def test_help_imports_nothing_heavy():
    """`calibkit --help` does not import numpy, pandas, scipy, matplotlib, rich or pydantic."""
    heavy = ("numpy", "pandas", "scipy", "matplotlib", "rich", "pydantic", "lmfit", "pywt")
    code = "from calibkit import cli\ntry:\n    cli.main(['--help'])\nexcept SystemExit: pass"
    assert imported(heavy, code) == "[]"


def test_no_command_is_usage(calibkit):
    """Calling nothing shows the help and exits with 2; an unknown command too."""
    assert calibkit().code == 2
    assert calibkit("fitt").code == 2


def test_simulate_writes_logs_with_truth_and_never_overwrites(tmp_path, calibkit):
    """A campaign is written once; a second call refuses before it writes anything."""
    written = calibkit("simulate", "fog_thermal", "--json", out=tmp_path / "a", seed=5).json[
        "files"
    ]
    assert "truth.json" in written
    assert all((tmp_path / "a" / name).is_file() for name in written)
    again = calibkit("simulate", "fog_thermal", "--out", tmp_path / "a", "--seed", 6)
    assert again.code == 4
    assert "exists already" in again.err


def test_fit_keeps_its_run_where_runs_or_out_names(tmp_path, calibkit):
    """Both names of one option, as every other command has `--runs`."""
    fit = ("fit", "gyro_noise", "--data", ROOT / "datasets" / "gyro_noise", "--serial", "S-1")
    for number, option in enumerate(("--runs", "--out"), start=1):
        assert calibkit(*fit, option, tmp_path / "kept").code == 0
        assert (tmp_path / "kept" / "S-1" / f"r{number:03d}" / "run.json").is_file()


def test_what_a_rejected_run_gives_says_so(tmp_path, calibkit):
    """`apply` and `evaluate` print it beside the result; a report has no digest of its own."""
    data, runs = ROOT / "datasets" / "rate_table", ("--runs", tmp_path / "runs")
    fit = ("fit", "rate_table", "--data", data, "--serial", "S-1", *runs)
    assert calibkit(*fit, "--set", "acceptance.max_nonlinearity_ppm=1e-3").code == 1
    log = ("--data", data / "room_1.csv", "--out", tmp_path / "out.csv")
    for call in (("apply", "S-1", *log), ("evaluate", "S-1", "temp_case=25")):
        outcome = calibkit(*call, *runs)
        assert outcome.code == 0
        assert "S-1@r001 was rejected: " in outcome.err
    outcome = calibkit("verify", tmp_path / "runs" / "S-1" / "r001" / "report.txt")
    assert outcome.code == 2
    assert "name the run folder" in outcome.err


def test_verify_reports_each_file_and_the_worst_code(tmp_path, calibkit):
    """A list of files gives a line each; an absent file is usage, a foreign one a failed
    verification.
    """
    foreign = tmp_path / "x.json"
    foreign.write_text(json.dumps({"format": "other"}), encoding="utf-8")
    assert calibkit("verify", foreign).code == 4
    assert calibkit("verify", tmp_path / "none.json").code == 2
    assert calibkit("verify", foreign, "--json").json["files"][0]["ok"] is False


def test_fit_imports_no_library_that_it_does_not_use(tmp_path):
    """`calibkit fit` executes no PDF writer, filter, compiler or test tool of a library, and
    nothing of its own that validation, plans or certificates alone need.
    """
    unused = (
        "matplotlib.backends.backend_pdf",
        "scipy.ndimage",
        "scipy.stats",
        "numpy.f2py.crackfortran",
        "unittest.mock",
        "fontTools.ttLib",
        "calibkit.certificate.profile",
        "calibkit.planning.document",
    )
    fit = ["fit", "gyro_pair", "--data", str(ROOT / "datasets" / "gyro_pair"), "--serial", "G"]
    code = (
        "from calibkit import cli\n"
        f"try:\n    cli.main([*{fit!r}, '--out', {str(tmp_path)!r}, '--date', '2026-11-21'])\n"
        "except SystemExit: pass"
    )
    assert imported(unused, code) == "[]"
    assert (tmp_path / "G" / "r001" / "run.json").is_file()
