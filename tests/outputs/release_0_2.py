"""What calibkit 0.2.0 wrote (tests/golden/0.2), and how each of it is used again.

0.2.0 at commit 949e426 wrote the folder. `use` gives the numbers of every command that reads a run
of one recipe; those of 0.2.0 stand in `numbers.json`, and the test compares them.
"""

import csv
import json
import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "tests" / "golden" / "0.2"
DATE = "2026-11-24"
SERIAL = "G-1"
PAIR = "gyro_pair"
"""The recipe whose certificate is signed."""
AUTOPILOT = "bias_temperature"
"""The recipe whose runs PX4 and ArduPilot can hold."""


@dataclass(frozen=True)
class Sample:
    """How a recipe is used."""

    logs: str = ""
    """Folder of its logs below datasets/; empty: a simulated warm-up."""
    withheld: bool = False
    """Whether unseen logs lie in `withheld` there; else the run was fitted to noisier ones."""
    field: str = ""
    """Log that is compensated; empty: the procedure compensates none."""
    inputs: tuple[str, ...] = ()
    """Points at which results are evaluated, inputs of each divided by blanks."""
    firmware: bool = True
    planned: bool = True
    runs: int = 2
    """Revisions that are kept; two are compared."""


AT_A_POINT = "temp_case=40 accel_x=0.1 accel_y=0.2 accel_z=0.97"
SAMPLES = {
    "accelerometer": Sample("accelerometer", field="positions.csv", inputs=(AT_A_POINT,), runs=1),
    "accelerometer_magnitude": Sample(
        "accelerometer_magnitude",
        withheld=True,
        field="withheld/tumble.csv",
        inputs=(AT_A_POINT.replace("40", "25"),),
    ),
    AUTOPILOT: Sample(
        field="warm_up_9.csv",
        inputs=("temp_case=40",),
    ),
    "fog_thermal": Sample(
        "fog_thermal",
        withheld=True,
        field="withheld/ramp_heating_03.csv",
        inputs=("temp_case=40 temp_rate=2", "temp_case=-20 temp_rate=-5"),
        runs=1,
    ),
    "gyro_noise": Sample("gyro_noise", firmware=False),
    PAIR: Sample(PAIR, field="table_axis_a.csv", inputs=("temp_case=25", "table_rate=50")),
    "gyro_triad": Sample(
        "gyro_triad",
        withheld=True,
        field="withheld/about_x_40.csv",
        inputs=("temp_case=40",),
        runs=1,
    ),
    "inclinometer": Sample(
        "inclinometer", withheld=True, field="withheld/stations.csv", inputs=("temp_case=60",)
    ),
    "rate_table": Sample("rate_table", field="at_0.csv", inputs=("temp_case=40", "table_rate=50")),
    "thermal": Sample(
        "thermal",
        field="sweep.csv",
        inputs=("temp_case=40 temp_rate=1",),
        planned=False,
        runs=1,
    ),
}
"""Recipe → how it is used."""


def code_numbers(path):
    """Numbers in C without its comments."""
    code = re.sub(r"/\*.*?\*/|//[^\n]*", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    words = re.findall(r"(?<![\w.])[-+]?\d+\.\d*(?:e[-+]?\d+)?|(?<![\w.])[-+]?\d+e[-+]?\d+", code)
    return [float(word) for word in words]


def log_numbers(path):
    """Numeric cells of a log by column and row."""
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return {
        f"{name}[{number}]": float(cell)
        for number, row in enumerate(rows)
        for name, cell in row.items()
        if re.fullmatch(r"[-+.\de]+", cell or "")
    }


def leaves(document, path=""):
    """Numbers of a JSON document by their path; entries of a list that have a key or a quantity go
    by that.
    """
    if isinstance(document, dict):
        entries = document.items()
    elif isinstance(document, list):
        named = [item if isinstance(item, dict) else {} for item in document]
        entries = [
            (item.get("key") or item.get("quantity") or number, document[number])
            for number, item in enumerate(named)
        ]
    else:
        is_number = isinstance(document, float | int) and not isinstance(document, bool)
        return {path: float(document)} if is_number else {}
    return {key: v for name, item in entries for key, v in leaves(item, f"{path}/{name}").items()}


def use(recipe, run, out):
    """Use what is kept of a recipe by every command that reads it; its numbers by command.

    `run` runs the command line and gives its stdout, or fails; what is written goes below `out`.
    """
    sample, folder = SAMPLES[recipe], FOLDER / recipe
    newest = folder / SERIAL / f"r{sample.runs:03}"
    numbers = {}
    rows = csv.DictReader(run("show", newest, "--csv").splitlines())
    for row in rows:
        key = f"{row['stage']}/{row['model']}/{row['name']}"
        cells = ("value", "standard_uncertainty", "dof")
        numbers |= {f"show {key} {cell}": float(row[cell]) for cell in cells if row[cell]}
    profile = ROOT / "reports" / "profiles" / f"{recipe}.toml"
    documents = {
        "history": run("history", SERIAL, "--runs", folder, "--json"),
        "validate": run(
            "validate",
            newest,
            "--data",
            unseen_logs(recipe),
            "--out",
            out / "validation.json",
            "--json",
        ),
        "certify": run(
            "certify",
            newest,
            "--profile",
            profile,
            "--out",
            out / "c.pdf",
            "--date",
            DATE,
            "--json",
        ),
    }
    for number, point in enumerate(sample.inputs):
        documents[f"evaluate {number}"] = run("evaluate", newest, *point.split(), "--json")
    if sample.runs > 1:
        documents["compare"] = run("compare", folder / SERIAL / "r001", newest, "--json")
    numbers |= {
        f"{command} {key}": value
        for command, document in documents.items()
        for key, value in leaves(json.loads(document)).items()
        if "/changes/" not in key  # of `compare`: the largest of them is kept
    }
    run("report", newest, "--out", out / "report.html")
    if sample.field:
        run("apply", newest, "--data", folder / "field.csv", "--out", out / "applied.csv")
        applied = log_numbers(out / "applied.csv")
        numbers |= {f"apply {key}": value for key, value in applied.items()}
    for target in targets(recipe):
        run("export", newest, "--target", target, "--out", out / target, "--allow-rejected")
    if sample.firmware:
        constants = [x for name in ("cal.h", "cal.c") for x in code_numbers(out / "c" / name)]
        numbers |= {f"c {number}": value for number, value in enumerate(constants)}
    return numbers


def targets(recipe):
    """Targets of a recipe's exports."""
    autopilots = ("px4", "ardupilot") if recipe == AUTOPILOT else ()
    return ("c", "blob", *autopilots) if SAMPLES[recipe].firmware else ()


def unseen_logs(recipe):
    """Folder of logs that the run of a recipe was not fitted to."""
    sample = SAMPLES[recipe]
    if not sample.logs:
        return FOLDER / recipe / "unseen"
    return ROOT / "datasets" / sample.logs / ("withheld" if sample.withheld else "")
