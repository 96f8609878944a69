"""Every bad input: one line with file, place, found, expected, next step; the contract's exit code;
nothing written.
"""

import os
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
ROWS = 900


def healthy():
    """Columns of a small healthy log: soak, 5 °C/min ramp, soak."""
    time = np.arange(float(ROWS))
    air = 20.0 + np.clip(time - 120.0, 0.0, 600.0) * 5.0 / 60.0
    case = air - 3.0 * (1.0 - np.exp(-np.maximum(time - 120.0, 0.0) / 100.0))
    return {
        "time_s": time,
        "temp_case_degc": case,
        "temp_env_degc": air,
        "gyro_dph": 9.0 + 0.01 * case,
    }


def ramped(columns):
    """Return how far the ramp of a healthy log has come, 0 to 1."""
    return np.clip((columns["time_s"] - 120.0) / 600.0, 0.0, 1.0)


def changed(column, rows, values):
    """Return healthy columns with some values of one replaced."""
    columns = healthy()
    columns[column] = columns[column].copy()
    columns[column][rows] = values
    return columns


CASES = {
    "missing column": (
        lambda c: {("gyro" if k == "gyro_dph" else k): v for k, v in c.items()},
        (
            "a.csv:1: column 'gyro_dph' is missing, found time_s",
            "did you mean 'gyro'?",
            "[columns.gyro_dph]",
        ),
    ),
    "time going backwards": (
        lambda c: changed("time_s", 500, 300.0),
        ("a.csv:502: column 'time_s': time runs backwards at 499 s → 300 s", "strictly increasing"),
    ),
    "NaN run": (
        lambda c: changed("gyro_dph", slice(400, 450), np.nan),
        ("a.csv:402: column 'gyro_dph': 50 missing or infinite values", "[[exclude]]"),
    ),
    "constant chamber": (
        lambda c: c | {"temp_env_degc": np.full(ROWS, 20.0)},
        ("a.csv: column 'temp_env_degc': constant at 20 over 900 rows", "a column that varies"),
    ),
    "kelvin": (
        lambda c: c | {"temp_case_degc": c["temp_case_degc"] + 273.15},
        ("a.csv:2: column 'temp_case_degc': 293.15 °C", "[columns.temp_case_degc]"),
    ),
    "gyro beyond any gyro": (
        lambda c: changed("gyro_dph", 5, 1e200),
        ("a.csv:7: column 'gyro_dph': 1e+200 deg/h", "at most 1e+07 deg/h"),
    ),
    "case and chamber swapped": (
        lambda c: (
            c
            | {
                "temp_env_degc": c["temp_case_degc"],
                "temp_case_degc": c["temp_case_degc"] + 8.0 * ramped(c),
            }
        ),
        ("°C/min the case gains", "temp_case_degc and temp_env_degc are swapped"),
    ),
    "gap": (
        lambda c: {k: np.delete(v, slice(300, 400)) for k, v in c.items()},
        ("a.csv:302: column 'time_s': a gap of 101 s at 299 s, expected at most 60 s",),
    ),
    "no ramp": (
        lambda c: c | {"temp_env_degc": 20.0 + 0.1 * np.sin(c["time_s"])},
        ("a.csv: no ramp found", "ramp_min_degc_min"),
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_an_unusable_log_is_refused_with_one_line_and_nothing_is_written(
    name, tmp_path, calibkit, log_writer
):
    """Exit code 3, one line naming place, found, expected and advice, no run folder."""
    change, fragments = CASES[name]
    log_writer(tmp_path / "logs" / "a.csv", **change(healthy()))
    outcome = calibkit(
        "fit", "fog_thermal", data=tmp_path / "logs", serial="S", out=tmp_path / "runs"
    )
    assert outcome.code == 3, outcome.err
    assert len(outcome.err.strip().splitlines()) == 1
    for fragment in fragments:
        assert fragment in outcome.err
    assert outcome.out == ""
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(
    ("content", "fragment"),
    [
        (b"", "a.csv: the file is empty"),
        (
            b"time_s,temp_case_degc,temp_env_degc,gyro_dph\n0,1,2,x9\n",
            "a.csv:2: column 'gyro_dph': found 'x9'",
        ),
        (
            b"time_s,temp_case_degc,temp_env_degc,gyro_dph\n0,1,2,3\n1,1,2\n",
            "a.csv:3: 3 fields, expected 4",
        ),
    ],
)
def test_a_file_that_is_no_table_is_refused(content, fragment, tmp_path, calibkit):
    """Empty files, text in a number and short rows exit with 3 and say where."""
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / "a.csv").write_bytes(content)
    outcome = calibkit(
        "fit", "fog_thermal", data=tmp_path / "logs", serial="S", out=tmp_path / "runs"
    )
    assert outcome.code == 3
    assert fragment in outcome.err
    assert not (tmp_path / "runs").exists()


def test_a_log_shorter_than_the_filter_is_refused(tmp_path, calibkit, log_writer):
    """Ten levels of CDF 9/7 do not fit a log of a quarter of an hour at 1 Hz: the log and both
    numbers are named.
    """
    log_writer(tmp_path / "logs" / "a.csv", **healthy())
    outcome = calibkit(
        "fit", "fog_thermal", data=tmp_path / "logs", serial="S", set="denoise.levels=10"
    )
    assert outcome.code == 3
    assert "a.csv: 900 samples are shorter" in outcome.err
    assert "10 levels" in outcome.err


@pytest.mark.parametrize(
    ("arguments", "code", "fragment"),
    [
        (["--set", "drift.ordr=2"], 2, "did you mean 'order'?"),
        (["--set", "denoise.wavelet=db99"], 2, "unknown wavelet 'db99'"),
        (["--set", "logs.files=['*.log']"], 3, "no log matches '*.log', found a.csv"),
        (["--set", "exclude=[{log='b', reason='r', person='p'}]"], 2, "no such log"),
        (["--date", "21.11.2026"], 2, "write YYYY-MM-DD"),
        (["--bogus"], 2, "No such option"),
    ],
)
def test_usage_and_recipe_faults_have_their_exit_code(
    arguments, code, fragment, tmp_path, calibkit, log_writer
):
    """Faults of the command line and the recipe exit with 2, logs that are not there with 3."""
    log_writer(tmp_path / "logs" / "a.csv", **healthy())
    outcome = calibkit(
        "fit", "fog_thermal", *arguments, data=tmp_path / "logs", serial="S", out=tmp_path / "r"
    )
    assert outcome.code == code
    assert fragment in outcome.err
    assert not (tmp_path / "r").exists()


def test_check_names_every_fault_and_fits_nothing(tmp_path, calibkit, log_writer):
    """`check` exits with 3 where fit would, lists each log, and `--json` carries place and
    advice.
    """
    log_writer(tmp_path / "logs" / "a.csv", **healthy())
    other = changed("gyro_dph", slice(400, 450), np.nan)
    log_writer(
        tmp_path / "logs" / "b.csv", **other | {"gyro_dph": other["gyro_dph"] + 0.5}
    )  # another measurement
    said = calibkit("check", "fog_thermal", "--data", tmp_path / "logs")
    assert said.code == 3
    assert "a.csv: ok" in said.out
    assert "REFUSED b.csv:402" in said.out
    document = calibkit("check", "fog_thermal", "--data", tmp_path / "logs", "--json").json
    assert [len(entry["findings"]) for entry in document["logs"]] == [0, 1]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["logs"]


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (
            '[[exclude]]\nlog = "a"\nfrom_s = 9000.0\nto_s = 9100.0\nreason = "r"\nperson = "p"',
            "no row between 9000 s",
        ),
        ('[[exclude]]\nlog = "b"\nreason = "r"\nperson = "p"', "no such log"),
        (
            '[columns.gyro_dph]\nfrom = "gyro_dph"\nunit = "degC"',
            "'degC' is a temperature, 'deg/h' an angular rate",
        ),
        ("[drift.rates_degc_min]\nb = 1.0", "no such log"),
    ],
)
def test_a_recipe_that_the_logs_contradict_is_told_with_its_line(
    table, words, tmp_path, calibkit, log_writer
):
    """What only the logs show to be wrong in a recipe names file and line of the recipe, in check
    and in fit.
    """
    from calibkit import recipe

    log_writer(tmp_path / "logs" / "a.csv", **healthy())
    text = recipe.find("fog_thermal").text + "\n" + table + "\n"
    (tmp_path / "r.toml").write_text(text, encoding="utf-8")
    first = text[: text.index(table)].count("\n") + 1
    for command in ("check", "fit"):
        said = calibkit(command, tmp_path / "r.toml", data=tmp_path / "logs", set="serial='S'")
        assert said.code == 2
        assert words in said.err
        line = int(said.err.split("r.toml:")[1].split(":")[0])
        assert first <= line < first + table.count("\n") + 1
    assert not (tmp_path / "runs").exists()


@pytest.mark.skipif(os.name != "posix", reason="names are text on other systems")
def test_a_log_whose_name_is_no_text_is_refused_by_name(tmp_path, calibkit, log_writer):
    """A name in Latin-1 on a UTF-8 system cannot stand in a record; fit and check say so and what
    to do.
    """
    log = log_writer(tmp_path / "log.csv", time_s=[0.0, 1.0], gyro_dph=[1.0, 2.0])
    try:
        log.rename(tmp_path / os.fsdecode(b"caf\xe9.csv"))
    except OSError:
        pytest.skip("this file system takes text only")
    for call in (("check",), ("fit", "--serial", "S", "--out", tmp_path / "runs")):
        command, *options = call
        outcome = calibkit(command, "fog_thermal", "--data", tmp_path, *options)
        assert outcome.code == 3
        assert "the file's name is not UTF-8; rename the file" in outcome.err


DECEIVING = [
    ("a\u202eb", "has characters that are not shown"),
    ("a\nb", "has characters that are not shown"),
    ("e\u0301", "is not in NFC"),
    ("l\u043eg", "has letters of Cyrillic and Latin"),
    ("nul", "is a device's name on Windows"),
]


@pytest.mark.skipif(os.name != "posix", reason="other systems refuse such names themselves")
@pytest.mark.parametrize(("name", "fault"), DECEIVING)
def test_a_log_whose_name_deceives_is_refused(tmp_path, calibkit, log_writer, name, fault):
    """Two logs that look alike, and names that another system cannot hold."""
    log_writer(tmp_path / f"{name}.csv", time_s=[0.0, 1.0], gyro_dph=[1.0, 2.0])
    outcome = calibkit("check", "fog_thermal", "--data", tmp_path)
    assert outcome.code == 3
    assert f"the file's name {fault}; rename the file" in outcome.err
    assert outcome.err.strip().isprintable()


@pytest.mark.parametrize(("name", "fault"), DECEIVING)
def test_an_output_whose_name_deceives_is_refused(tmp_path, calibkit, name, fault):
    """A file or a new folder is not given a name that another reader or system takes for
    another's.
    """
    for out in (tmp_path / name, tmp_path / name / "logs"):
        outcome = calibkit("simulate", "rate_table", "--out", out, "--seed", 1, "--dry-run")
        assert outcome.code == 4
        assert f"the name {fault}" in outcome.err
    outcome = calibkit("simulate", "rate_table", "--dry-run", out=tmp_path / "отчёт_A1", seed=1)
    assert outcome.code == 0


@pytest.mark.parametrize(
    ("serial", "shown"),
    [
        ("A\u202eB", "A\\u202eB"),
        ("A\x1b[31mB", "A\\x1b[31mB"),
        ("A\nB", "A\\nB"),
        ("\u0410B-1", "letters of Cyrillic and Latin"),
        ("A\u030a-1", "cannot name"),
        ("\uff21B-1", "letters of Fullwidth and Latin"),
    ],
)
def test_a_serial_number_that_deceives_is_refused_and_shown(calibkit, tmp_path, serial, shown):
    """Marks of direction, colours, line breaks, alphabets that look alike, letters in two parts."""
    data = ROOT / "datasets" / "gyro_noise"
    outcome = calibkit("fit", "gyro_noise", "--data", data, "--serial", serial, "--out", tmp_path)
    assert outcome.code == 2
    assert shown in outcome.err
    assert outcome.err.count("\n") == 1
    assert outcome.err.strip().isprintable()
    assert not list(tmp_path.iterdir())
