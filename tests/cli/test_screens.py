"""The first screen of every command: at most 25 lines, the verdict among the first three, one line
per cause of doubt, and a next command that works as it is printed.
"""

import re
import shlex

import pytest

from calibkit.records.coefficients import at_least
from calibkit.report.overview import KeyValue, Overview, concise, describe_span, merge_flags
from calibkit.report.screen import MOST, compose_screen
from calibkit.report.summary import Summary
from calibkit.report.table import Table
from conftest import ROOT
from written_logs import still

SAMPLES = {
    "fog_thermal": "Drift on ramps the fit had not seen",
    "accelerometer": "Residual of 378 dwells",
    "accelerometer_magnitude": "Residual of 24 dwells",
    "gyro_pair": "Angle between the input axes",
    "gyro_triad": "Largest departure from right angles",
    "rate_table": "Scale factor of gyro_x at 25.1 °C",
    "inclinometer": "Azimuth of 36 of 36 stations",
    "gyro_noise": "angle random walk N",
}
"""Procedure with sample logs → what its first screen must state."""


def next_command(text):
    """Arguments of the call that a screen advises."""
    (line,) = [line for line in text.splitlines() if "Next: " in line]
    return shlex.split(line.partition("Next: ")[2])[1:]


@pytest.mark.parametrize("name", SAMPLES)
def test_the_screen_of_a_sample_answers_in_25_lines(name, tmp_path, calibkit, monkeypatch):
    """Verdict with its limit in the first three lines, the result in words and units, the report,
    the next command, which ends with 0 as it is typed; nothing that succeeded is printed as a
    warning.
    """
    monkeypatch.chdir(tmp_path)
    outcome = calibkit("fit", name, "--data", ROOT / "datasets" / name, "--serial", "S-1")
    lines = outcome.out.splitlines()
    assert len(lines) <= MOST, outcome.out
    (verdict,) = [line for line in lines[:3] if line.startswith("accepted: ")]
    assert re.search(r"\(limit: at (most|least) ", verdict)
    assert SAMPLES[name] in outcome.out
    assert not [line for line in lines if line.startswith("!")]
    assert "- exported" not in outcome.out
    assert lines[-1] == "runs/S-1/r001"
    assert "Report: runs/S-1/r001/report.html" in outcome.out
    page = (tmp_path / "runs/S-1/r001/report.html").read_text(encoding="utf-8")
    assert 0 < page.index("<svg") < page.index("<table")
    captions = re.findall("<figcaption>(.+?)</figcaption>", page)
    assert len(captions) == len(set(captions)) == page.count("<svg")
    assert 1 <= page.count("<dt>") <= 4
    first = "Results" if name == "gyro_noise" else "Exported model"
    assert re.search(r"<h3[^>]*>(.+?)</h3>", page)[1] == first
    assert calibkit(*next_command(outcome.out)).code == 0
    if name == "gyro_pair":
        where = ("--data", ROOT / "datasets" / name, "--serial", "S-1")
        again = calibkit("fit", name, *where, "--details")
        assert len(again.out.splitlines()) > len(lines)
    if name == "fog_thermal":
        state_what_noise_alone_gives(outcome.out)


def state_what_noise_alone_gives(out):
    """Drift before, after and of noise alone, the model of how many, the largest U, every ramp."""
    sentence = r"([\d.]+) °/h before, ([\d.]+) °/h after; noise alone gives ([\d.]+)"
    drift = re.search(sentence, " ".join(out.split()))
    before, after, noise = map(float, drift.groups())
    assert before > 5.0 * after
    assert 0.5 * after < noise <= after
    assert re.search(r"Model: .+ of \d+ models,\s+tested", out)
    assert "Largest uncertainty of the correction: " in out
    assert sum(line.startswith("ramp_") for line in out.splitlines()) == 8


def spiked(folder):
    """Put a spike into every log of a folder."""
    for path in sorted(folder.glob("*.csv")):
        lines = path.read_text(encoding="utf-8").splitlines()
        cells = lines[200].split(",")
        lines[200] = ",".join([*cells[:2], "50000.0"])
        path.write_text("\n".join([*lines, ""]), encoding="utf-8", newline="\n")
    return folder


def test_forty_logs_fit_on_a_screen_and_one_cause_is_one_line(tmp_path, calibkit):
    """Forty logs with the same spike: check and fit print one line for it and at most 25 in all;
    --details prints each.
    """
    data = spiked(still(tmp_path / "logs", 40))
    checked = calibkit("check", "bias_temperature", "--data", data)
    lines = checked.out.splitlines()
    assert len(lines) <= MOST
    assert lines[0].startswith(("40 of 40 logs ok", "0 of 40 logs ok, 40 refused"))
    assert "Please check (1)" in checked.out
    assert checked.out.count("a spike") == 1
    assert "flagged [40 logs] warm_00.csv:201: " in checked.out
    assert "more: --details" in checked.out
    full = calibkit("check", "bias_temperature", "--data", data, "--details").out
    assert full.count("a spike") == 40
    fitted = calibkit("fit", "bias_temperature", data=data, serial="S", out=tmp_path / "runs")
    assert len((fitted.out + fitted.err).splitlines()) <= 45
    assert len(fitted.out.splitlines()) <= MOST
    assert fitted.out.count("a spike") <= 1


def screen(flags=(), rows=0, criteria=(), width=110, logs=(), tail=("Report: r", "Next: n")):
    """Screen of a made-up result."""
    table = Table("t", ("ramp", "before"), tuple((f"ramp_{k}", str(k)) for k in range(rows)))
    overview = Overview("What was found.", ("And more.",), (), table)
    summary = Summary("S@r001: title", (), tuple(flags), criteria, overview=overview, logs=logs)
    return compose_screen(summary, tail, width)


@pytest.mark.parametrize("width", [80, 110, 200])
@pytest.mark.parametrize(("findings", "rows"), [(30, 0), (30, 40), (3, 40), (0, 12), (0, 0)])
def test_whatever_is_found_a_screen_has_25_lines(findings, rows, width):
    """Thirty findings of thirty causes and forty ramps: verdict, some of each, how many more, and
    the whole tail.
    """
    causes = ["zero", "gap", "noise", "step", "slow", "fast", "torn", "cold", "warm", "late"]
    flags = [f"{a} of {'the log ' * 20}{b}" for a in causes for b in causes[:3]][:findings]
    lines = screen(flags, rows, (at_least("reduction", 6.5, 1.0, "1"),), width)
    assert len(lines) <= MOST
    assert all(len(line) <= width for line in lines)
    assert "accepted: reduction 6.5 (limit: at least 1)" in lines[:3]
    assert lines[-2:] == ["Report: r", "Next: n"]
    if findings:
        (count,) = [line for line in lines if line.startswith("Please check")]
        assert count == f"Please check ({findings})"
        shown = sum(line.startswith("- ") for line in lines)
        more = [int(line.split()[0]) for line in lines if line.endswith("more: --details")]
        assert shown >= 1
        assert findings - shown == 0 or findings - shown in more
    if rows == 40:
        assert sum(line.startswith("ramp_") for line in lines) >= 4


def test_flags_of_one_cause_become_one_line():
    """Flags that differ in log and figures alone are merged; others are not."""
    logs = [f"ramp_{k}.csv" for k in range(1, 31)]
    flags = [f"{log}: {k} of 21600 samples are missing" for k, log in enumerate(logs)]
    merged = merge_flags([*flags, "ramp_1.csv: a spike", "no latitude"], logs)
    assert merged == [
        f"{flags[0]} [also ramp_2.csv, ramp_3.csv, ramp_4.csv and 26 more]",
        "ramp_1.csv: a spike",
        "no latitude",
    ]


@pytest.mark.parametrize(
    "flags",
    [
        ["a.csv: gyro_1 is noisy", "a.csv: gyro_2 is noisy"],
        ["a.csv: gyro_1 is noisy", "b.csv: gyro_2 is noisy"],
        ["no soak at 20 °C", "no soak at 60 °C"],
        ["a.csv: no soak at 20 °C", "a.csv: no soak at 60 °C"],
        ["1.csv: 21 rows", "1.csv: 31 rows"],
    ],
)
def test_flags_of_two_channels_or_temperatures_stay_apart(flags):
    """A number that names a channel or a temperature is no figure that could be left out."""
    logs = [flag.partition(":")[0] for flag in flags if ":" in flag]
    assert merge_flags(flags, logs) == flags


@pytest.mark.parametrize(
    ("value", "u", "text"),
    [
        (7.5124, 0.013, "7.512(13)"),
        (10077.3891, 0.008, "10077.3891(80)"),
        (8.19, 1.2, "8.2(1.2)"),
        (-0.00099016, 3.1e-7, "−0.00099016(31)"),
        (0.4182, 0.0, "0.418"),
        (1234.0, 31.0, "1234(31)"),
    ],
)
def test_a_value_stands_with_its_uncertainty_in_brackets(value, u, text):
    """Two digits of u in units of the value's last digits, as VIM and GUM 7.2.2 print it."""
    assert concise(value, u) == text


@pytest.mark.parametrize(
    ("value", "u", "dof", "unit", "text"),
    [
        (7.5124, 0.0134, None, "°/h", "(7.512 ± 0.027) °/h"),
        (90.0567321, 1.7e-5, 3.0, "°", "(90.056732 ± 0.000056)°"),
        (-0.00099016, 3.1e-7, 5.0, "1", "−0.00099016 ± 0.00000082"),
        (0.4182, 0.0, None, "°", "0.418°"),
        (8.19, 1.2, 0.5, "ppm", "8.19 ppm"),
    ],
)
def test_a_key_value_stands_with_its_expanded_uncertainty(value, u, dof, unit, text):
    """With the coverage factor of its degrees of freedom, as tables and certificates state it; none
    where they are below one.
    """
    printed = str(KeyValue.of("x", value, unit, u, dof))
    assert printed.replace("\N{NO-BREAK SPACE}", " ") == text


def test_a_span_about_zero_has_no_negative_zero():
    """−0.3 to 0.2 °C reads 0 °C."""
    assert describe_span(-0.3, 0.2, "°C") == "0 °C"
    assert describe_span(-40.2, -0.1, "°C") == "−40 to 0 °C"
