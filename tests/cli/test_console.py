"""The command line on any console: encodings, colours, quiet and verbose, dry runs,
completion, exit codes.
"""

import hashlib
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from calibkit import cli
from calibkit.commands import pipeline
from conftest import ROOT
from kept import keep, model
from sample_runs import sample_run

TITLE = 'title="温度 γ ±0.5 °C 陀螺"'


def run(*arguments, cwd=ROOT, python=(), **environment):
    """Run calibkit in a process of its own, with nothing of this one's locale."""
    kept = {
        key: value
        for key, value in os.environ.items()
        if not key.startswith(("LC_", "LANG", "PYTHON", "NO_COLOR"))
    }
    return subprocess.run(
        [sys.executable, *python, "-m", "calibkit", *map(str, arguments)],
        capture_output=True,
        check=False,
        timeout=120,
        cwd=cwd,
        env=kept | {"PYTHONPATH": str(ROOT)} | environment,
    )


def warm_up(folder):
    """Write a short log of a static gyro that warms up, which takes no time to fit."""
    rows = [f"{k},{20.0 + 0.1 * k},{0.5 + 0.01 * k + 0.001 * (k * k % 7)}" for k in range(300)]
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "warm.csv"
    path.write_text(
        "\n".join(["time_s,temp_case_degc,gyro_dph", *rows, ""]), encoding="utf-8", newline="\n"
    )
    return folder


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """Return, per console, what a fit with Chinese text printed and the files it wrote."""
    consoles = {
        "utf-8": {"PYTHONIOENCODING": "utf-8"},
        "ascii": {"PYTHONIOENCODING": "ascii"},
        "gbk": {"PYTHONIOENCODING": "gbk"},
        "C": {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
    }
    results = {}
    for name, environment in consoles.items():
        out = tmp_path_factory.mktemp(name.replace("-", ""))
        data = warm_up(out / "logs")
        # the text comes from a recipe file: a C locale cannot carry it on the command line
        recipe = out / "recipe.toml"
        shipped = (ROOT / "recipes" / "bias_temperature.toml").read_text(encoding="utf-8")
        recipe.write_text(
            re.sub(r"^title *=.*$", TITLE, shipped, flags=re.MULTILINE), encoding="utf-8"
        )
        where = ("--data", data, "--serial", "QA-1", "--out", out / "runs")
        call = ("fit", recipe, *where, "--date", "2026-11-21")
        done = run(*call, **environment)
        folder = out / "runs" / "QA-1" / "r001"
        results[name] = (
            done,
            {path.name: path.read_bytes() for path in folder.glob("*")},
            out / "runs",
        )
    return results


@pytest.mark.parametrize("name", ["utf-8", "ascii", "gbk", "C"])
def test_no_console_stops_a_fit_and_the_files_are_the_same_bytes(fitted, name):
    """A fit with °, ± and 温度 in it ends well on consoles that lack them, and writes UTF-8 with LF
    whatever the console.
    """
    done, files, _ = fitted[name]
    assert done.returncode == 0, done.stderr
    assert set(files) >= {"run.json", "report.txt", "bias.json"}
    assert files == fitted["utf-8"][1]
    assert "温度" in files["run.json"].decode("utf-8")
    assert b"\r" not in files["run.json"] + files["report.txt"] + files["bias.json"]


@pytest.mark.parametrize(("encoding", "command"), [("ascii", "check"), ("gbk", "history")])
def test_json_is_whole_on_every_console(fitted, encoding, command):
    """A JSON document on a console that is not Unicode is the same document, other characters
    escaped.
    """
    folder = fitted["utf-8"][2]
    calls = {
        "history": ("history", "QA-1", "--runs", folder),
        "check": ("check", "bias_temperature", "--data", folder.parent / "logs"),
    }
    printed = run(*calls[command], "--json", PYTHONIOENCODING=encoding).stdout
    assert json.loads(printed.decode("ascii"))["ok"] is True
    unicode = run(*calls[command], "--json").stdout
    assert json.loads(printed) == json.loads(unicode.decode("utf-8"))


EVERY_COMMAND = """
import sys
from calibkit import cli
for command in cli.cli.commands:
    for option, expected in (("--help", 0), ("--nonsense-温度-\\udcff", 2)):
        try:
            cli.main([command, option])
        except SystemExit as ended:
            if ended.code != expected:
                sys.exit(f"{command} {option!r}: {ended.code}")
"""


@pytest.mark.parametrize("encoding", ["ascii", "gbk"])
def test_help_and_refusals_print_on_every_console(encoding):
    """The help of every command, and a refusal that quotes 温度 and half a surrogate, end with
    their own exit code.
    """
    environment = os.environ | {"PYTHONIOENCODING": encoding, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", EVERY_COMMAND], capture_output=True, check=False, env=environment
    )
    assert done.returncode == 0, done.stderr
    assert b"Traceback" not in done.stderr


# colours


@pytest.mark.skipif(os.name != "posix", reason="needs a pseudo-terminal")
@pytest.mark.parametrize(
    ("environment", "coloured"), [({}, True), ({"NO_COLOR": "1"}, False), ({"NO_COLOR": ""}, True)]
)
def test_no_color_means_no_escape_sequence(tmp_path, environment, coloured):
    """On a terminal a summary is coloured; with NO_COLOR set to anything there is no escape
    character at all.
    """
    import pty

    keep(tmp_path, model({"K": (1.0, "1", 0.1)}))
    controller, terminal = pty.openpty()
    kept = {key: value for key, value in os.environ.items() if key != "NO_COLOR"}
    done = subprocess.Popen(
        [sys.executable, "-m", "calibkit", "show", "S-1", "--runs", str(tmp_path)],
        stdout=terminal,
        stderr=subprocess.DEVNULL,
        cwd=ROOT,
        env=kept | {"TERM": "xterm-256color", "PYTHONPATH": str(ROOT)} | environment,
    )
    os.close(terminal)
    printed = b""
    while True:
        try:
            chunk = os.read(controller, 65536)
        except OSError:
            break
        if not chunk:
            break
        printed += chunk
    os.close(controller)
    assert done.wait(timeout=60) == 0
    assert (b"\x1b[" in printed) is coloured


# help


# quiet, verbose, log


def test_a_dry_run_says_what_would_be_and_writes_nothing(tmp_path, calibkit):
    """--dry-run fits, names the folder, exits as the fit would, writes nothing; its digests are
    those the fit then writes.
    """
    out, data = tmp_path / "runs", warm_up(tmp_path / "logs")
    where = ("--data", data, "--serial", "S", "--out", out, "--date", "2026-11-21")
    call = ("fit", "bias_temperature", *where, "--json")
    rehearsed = calibkit(*call, "--dry-run")
    assert rehearsed.code == 0
    assert rehearsed.json["dry_run"] is True
    assert not out.exists()
    written = calibkit(*call)
    assert "dry_run" not in written.json
    assert {key: value for key, value in rehearsed.json.items() if key != "dry_run"} == written.json
    digest = {entry["name"]: entry["sha256"] for entry in rehearsed.json["files"]}["report.html"]
    assert hashlib.sha256((out / "S" / "r001" / "report.html").read_bytes()).hexdigest() == digest


@pytest.mark.parametrize(
    "call",
    [
        ("simulate", "rate_table", "--seed", "1", "--out", "made"),
        ("apply", "S-1", "--runs", "{runs}", "--data", "{data}/at_60.csv", "--out", "made/c.csv"),
        ("validate", "S-1", "--runs", "{runs}", "--data", "{more}", "--out", "made/v.json"),
        ("certify", "S-1", "--runs", "{runs}", "--date", "2026-11-21", "--out", "made/c.pdf"),
        ("export", "S-1", "--runs", "{runs}", "--target", "c", "--out", "made"),
    ],
    ids=lambda call: call[0],
)
def test_a_dry_run_of_any_writer_does_all_but_write(rated, tmp_path, calibkit, monkeypatch, call):
    """It ends as the command does, names the same files as not written, and leaves none; the
    command then writes them.
    """
    if call[0] == "certify":
        pytest.importorskip("typst")
    monkeypatch.chdir(tmp_path)
    arguments = [part.format_map(rated) for part in call]
    rehearsed, listed = (
        calibkit(*arguments, "--dry-run"),
        calibkit(*arguments, "--dry-run", "--json"),
    )
    ends = int(call[0] == "validate")  # rejected: the logs are another gyro's
    assert (rehearsed.code, listed.code, list(tmp_path.iterdir())) == (ends, ends, [])
    assert listed.json["dry_run"] is True
    written = calibkit(*arguments)
    assert rehearsed.out.replace(" (dry run: not written)", "") == written.out != rehearsed.out
    assert list(tmp_path.rglob("*.*"))
    assert calibkit(*arguments, "--dry-run").code == 4  # what exists would be refused


@pytest.fixture(scope="module")
def rated(tmp_path_factory):
    """Return the folders of a run, its sample logs and other logs."""
    more = tmp_path_factory.mktemp("rated") / "more"
    pipeline.simulate("rate_table", more, 8)
    runs = sample_run(tmp_path_factory, "rate_table").folder.parents[1]
    return {"runs": runs, "data": ROOT / "datasets" / "rate_table", "more": more}


# completion


def completed(shell_line, cwd):
    """What bash would be offered for a line that is being typed."""
    words = shell_line.split(" ")
    environment = {
        "COMP_WORDS": shell_line,
        "COMP_CWORD": str(len(words) - 1),
        "_CALIBKIT_COMPLETE": "bash_complete",
    }
    done = run(cwd=cwd, **environment)
    assert done.returncode == 0, done.stderr
    return {
        line.split(",")[1]
        for line in done.stdout.decode().splitlines()
        if line.startswith("plain,")
    }


def test_a_shell_is_offered_commands_recipes_serials_and_revisions(tmp_path):
    """Completion knows the commands, their options, the shipped recipes, the serials under runs and
    their revisions.
    """
    keep(tmp_path / "runs", model({"K": (1.0, "1", 0.1)}), serial="FOG-1")
    keep(tmp_path / "runs", model({"K": (1.0, "1", 0.1)}), serial="FOG-1")
    assert completed("calibkit va", tmp_path) == {"validate"}
    assert completed("calibkit fit --dry", tmp_path) == {"--dry-run"}
    assert completed("calibkit fit gyro_", tmp_path) >= {"gyro_pair", "gyro_triad"}
    assert completed("calibkit show F", tmp_path) == {"FOG-1"}
    assert completed("calibkit compare FOG-1 FOG-1@", tmp_path) == {"FOG-1@r001", "FOG-1@r002"}
    assert completed("calibkit history X", tmp_path) == set()


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_a_recipe_that_a_windows_shell_or_editor_saved_is_read(tmp_path, calibkit, encoding):
    """Notepad's UTF-8 with a mark, PowerShell's UTF-16, CR LF: the recipe is the same, its digest
    too.
    """
    text = (ROOT / "recipes" / "bias_temperature.toml").read_text(encoding="utf-8")
    path = tmp_path / "mine.toml"
    path.write_bytes(text.replace("\n", "\r\n").encode(encoding))
    where = ("--data", warm_up(tmp_path / "logs"), "--serial", "S", "--date", "2026-11-21")
    call = (*where, "--dry-run", "--json")
    own, shipped = (
        calibkit("fit", recipe, *call).json["files"] for recipe in (path, "bias_temperature")
    )
    assert [entry["name"] for entry in own] == [entry["name"] for entry in shipped]
    pairs = zip(own, shipped, strict=True)
    assert [entry["name"] for entry, other in pairs if entry != other] == [
        "report.html"
    ]  # it names the recipe's file


# exit codes: one test each, as the contract lists them


def test_exit_code_0_is_done(tmp_path, calibkit):
    """A command that did what it was asked and met every limit exits with 0."""
    keep(tmp_path, model({"K": (1.0, "1", 0.1)}))
    assert calibkit("show", "S-1", "--runs", tmp_path).code == 0


def test_exit_code_1_is_a_limit_that_failed(tmp_path, calibkit):
    """The run is written whole but was not accepted; --quiet does not hide that."""
    limit = ("--set", "acceptance.max_nonlinearity_ppm=1e-9", "--quiet")
    data = ROOT / "datasets" / "rate_table"
    where = ("--data", data, "--serial", "S", "--out", tmp_path)
    outcome = calibkit("fit", "rate_table", *where, *limit)
    assert outcome.code == 1
    assert "REJECTED" in outcome.err
    assert outcome.out == f"{tmp_path / 'S' / 'r001'}\n"
    assert calibkit("show", "S", "--runs", tmp_path, "--json").json["run"]["accepted"] is False


@pytest.mark.parametrize(
    "call",
    [
        (),
        ("fit", "fog_thermal"),
        ("fit", "no_such_recipe", "--data", "."),
        ("fit", "fog_thermal", "--data", "datasets/fog_thermal"),
        ("check", "fog_thermal", "--data", "datasets/fog_thermal", "--set", "drift.ordre=2"),
        ("show", "NOBODY"),
    ],
)
def test_exit_code_2_is_usage_or_recipe(calibkit, call, monkeypatch):
    """What cannot be meant is refused before any log is read, as one message, and as one JSON
    document with --json.
    """
    monkeypatch.chdir(ROOT)
    assert calibkit(*call).code == 2
    if call:
        refused = calibkit(*call, "--json")
        assert refused.code == 2
        assert refused.json["ok"] is False
        assert set(refused.json["error"]) == {"code", "message", "hint"}


def test_exit_code_3_is_data(tmp_path, calibkit):
    """A folder without a matching log, and a log that is no log, are data: 3."""
    where = ("--data", tmp_path, "--serial", "S", "--out", tmp_path / "runs")
    call = ("fit", "fog_thermal", *where, "--json")
    assert calibkit(*call).code == 3
    (tmp_path / "ramp.csv").write_bytes(b"time_s,temp_case_degc,gyro_dph\n0,1\n")
    outcome = calibkit(*call)
    assert (outcome.code, outcome.json["ok"]) == (3, False)


def test_exit_code_4_is_output_or_verification(tmp_path, calibkit):
    """An output that exists and a digest that is wrong are 4, with the error's own code in JSON."""
    (tmp_path / "room_1.csv").write_bytes(b"mine")
    exists = calibkit("simulate", "rate_table", "--out", tmp_path, "--seed", 1, "--json")
    assert (exists.code, exists.json["error"]["code"]) == (4, "output")
    folder = keep(tmp_path / "runs", model({"K": (1.0, "1", 0.1)}))
    (folder / "report.txt").write_bytes(b"other")
    changed = calibkit("show", folder, "--json")
    assert (changed.code, changed.json["error"]["code"]) == (4, "coefficients")
    for call in (("verify", folder), ("history", "S-1", "--runs", tmp_path / "runs")):
        found = calibkit(*call, "--json")
        assert (found.code, found.json["ok"], found.json["error"]["code"]) == (
            4,
            False,
            "coefficients",
        )


def test_exit_code_70_is_an_internal_error(tmp_path, calibkit, monkeypatch):
    """What nobody foresaw is one line that says how to report it, in JSON too."""

    def broken(path, trust, schema_dir):
        raise ZeroDivisionError("division by zero")

    monkeypatch.setattr(pipeline, "verify", broken)
    outcome = calibkit("verify", tmp_path, "--json")
    assert (outcome.code, outcome.json["error"]["code"]) == (70, "internal")
    assert "CALIBKIT_DEBUG=1" in outcome.json["error"]["hint"]
    assert "Traceback" not in outcome.err


def test_exit_code_5_is_not_checked(tmp_path, calibkit, monkeypatch):
    """A library that checks certificates is missing: neither good nor bad."""
    (tmp_path / "c.xml").write_text("<a/>", encoding="utf-8")
    monkeypatch.setitem(sys.modules, "lxml.etree", None)
    outcome = calibkit("verify", tmp_path / "c.xml")
    assert (outcome.code, outcome.out) == (5, "")
    assert "NOT CHECKED: install calibkit[verify]" in outcome.err


def test_exit_code_130_is_interrupted(tmp_path, calibkit, monkeypatch):
    """Ctrl-C is 130 and one line, no traceback."""

    def interrupted(path, demands, schema_dir, beside):
        raise KeyboardInterrupt

    monkeypatch.setattr(pipeline, "verify", interrupted)
    outcome = calibkit("verify", tmp_path)
    assert outcome.code == 130
    assert outcome.err.strip() == "calibkit: interrupted; what was not finished was not written"
    assert calibkit("verify", tmp_path, "--json").json["error"]["code"] == "interrupted"


def test_the_documented_exit_codes_are_these():
    """The help and the README list the same codes, each of which a test above reaches."""
    tested = {
        int(code)
        for code in re.findall(
            r"def test_exit_code_(\d+)", Path(__file__).read_text(encoding="utf-8")
        )
    }
    for text in (cli.cli.help, (ROOT / "README.md").read_text(encoding="utf-8")):
        codes = re.search(r"Exit codes: (.+?interrupted)", text.replace("\n", " ")).group(1)
        assert {int(code) for code in re.findall(r"\b\d+\b", codes)} == tested
