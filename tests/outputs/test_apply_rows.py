"""What `apply` asks of a log and what it writes: columns that the model needs, rows that cannot be
corrected, headers and dialects.
"""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import calibkit as api

DATA = Path(__file__).resolve().parents[2] / "datasets" / "fog_thermal"
LOG = "ramp_heating_05"
CHAMBER = """
procedure = "fog_thermal"
[logs]
files = ["ramp*.csv"]
[chamber]
files = ["chamber_{log}.csv"]
provides = ["temp_env_degc"]
clock = "same"
[drift]
model = "%s"
%s
"""
GERMAN = {"time_s": "Zeit", "temp_case_degc": "Gehäuse", "temp_env_degc": "Luft"}
GERMAN |= {"gyro_dph": "Kreisel"}
MAPPED = [
    word for name, own in GERMAN.items() for word in ("--set", f'columns.{name}.from="{own}"')
]


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Return the folder of a run whose model needs the air, AIR, and of one that does not, CASE."""
    folder = tmp_path_factory.mktemp("runs")
    (folder / "logs").mkdir()
    for path in sorted(DATA.glob("ramp*.csv")):
        table = pd.read_csv(path)
        split(table, folder / "logs", path.stem)
    for serial, model, more in (("AIR", "gradient_rate", "order = 1"), ("CASE", "lagged", "")):
        (folder / f"{serial}.toml").write_text(CHAMBER % (model, more), encoding="utf-8")
        recipe = api.load_recipe(folder / f"{serial}.toml")
        api.fit(recipe, folder / "logs", date="2026-01-01", serial=serial, runs=folder / "runs")
    return folder / "runs"


def split(table, folder, name, keep=slice(None)):
    """Write a log and beside it the chamber's."""
    table.drop(columns="temp_env_degc").to_csv(folder / f"{name}.csv", index=False)
    air = table[["time_s", "temp_env_degc"]].iloc[keep]
    air.to_csv(folder / f"chamber_{name}.csv", index=False)


@pytest.fixture
def table():
    """Return a log."""
    return pd.read_csv(DATA / f"{LOG}.csv")


@pytest.fixture
def apply(calibkit, runs, tmp_path):
    """Apply a run to a log and return the outcome and the new file."""

    def run(serial, data, *more, out="out.csv"):
        arguments = ("--runs", runs, "--data", data, "--out", tmp_path / out, *more)
        return calibkit("apply", serial, *arguments), tmp_path / out

    return run


def test_a_model_of_the_case_needs_no_air(apply, table, tmp_path):
    """No column and no chamber file: the same rates as with them."""
    table.drop(columns="temp_env_degc").to_csv(tmp_path / "flight.csv", index=False)
    table.to_csv(tmp_path / "lab.csv", index=False)
    outcome, out = apply("CASE", tmp_path / "flight.csv")
    assert outcome.code == 0, outcome.err
    assert "5,401 of 5,401 rows corrected" in outcome.err
    whole = apply("CASE", tmp_path / "lab.csv", out="whole.csv")[1]
    rates = [pd.read_csv(path)["gyro_dph"] for path in (out, whole)]
    assert np.array_equal(*rates)
    assert not np.array_equal(rates[0], table["gyro_dph"])


def test_rows_outside_the_chamber_file_have_a_status(apply, table, tmp_path):
    """The chamber's file begins 300 s later, has a gap and ends 200 s earlier: those rows are
    written without a corrected value, all others as with the whole file.
    """
    (tmp_path / "logs").mkdir()
    rows = np.r_[300:2000, 2100:5201]
    split(table, tmp_path / "logs", LOG, rows)
    outcome, out = apply("AIR", tmp_path / "logs" / f"{LOG}.csv")
    assert outcome.code == 0, outcome.err
    made = pd.read_csv(out)
    assert list(made) == ["time_s", "temp_case_degc", "gyro_dph", "status"]
    assert len(made) == len(table)
    assert np.array_equal(made["time_s"], table["time_s"])
    chamber = f"no value of chamber_{LOG}.csv"
    assert made["status"].value_counts().to_dict() == {
        f"{chamber}: before its start": 300,
        f"{chamber}: after its end": 200,
        f"{chamber}: in its gaps": 100,
    }
    corrected = made["status"].isna()
    assert made["gyro_dph"].notna().equals(corrected)
    assert made["gyro_dph"][corrected].ne(table["gyro_dph"][corrected]).mean() > 0.5
    assert "4,801 of 5,401 rows corrected" in outcome.err
    kept = apply(
        "AIR", tmp_path / "logs" / f"{LOG}.csv", "--uncorrected", "keep", "--json", out="k.csv"
    )
    raw = pd.read_csv(kept[1])
    assert raw["gyro_dph"][~corrected].equals(table["gyro_dph"][~corrected])
    assert raw["gyro_dph"][corrected].equals(made["gyro_dph"][corrected])
    assert kept[0].json["uncorrected"][f"{chamber}: after its end"] == 200


@pytest.mark.parametrize("words", [False, True], ids=["clean", "text"])
def test_a_unit_in_the_header_is_that_of_the_compensated_column(apply, table, words, tmp_path):
    """A gyro in °/s by its header alone is written in °/s, also where a units row states it."""
    plain, out = apply("CASE", DATA / f"{LOG}.csv", out="plain.csv")
    assert plain.code == 0, plain.err
    expected = pd.read_csv(out)["gyro_dph"] / 3600.0
    name = "Rate" if words else "Rate (deg/s)"
    lines = table.assign(gyro_dph=table["gyro_dph"] / 3600.0).rename(columns={"gyro_dph": name})
    text = lines.to_csv(index=False)
    if words:
        header, _, rows = text.partition("\n")
        text = f"{header}\ns,degC,degC,deg/s\n{rows}"
    (tmp_path / "log.csv").write_text(text, encoding="utf-8")
    mapped = ("--set", f'columns.gyro_dph.from="{name}"')
    outcome, out = apply("CASE", tmp_path / "log.csv", *mapped)
    assert outcome.code == 0, outcome.err
    written = pd.read_csv(out)["Rate (deg/s)"]
    assert np.allclose(written, expected, rtol=0.0, atol=1e-9)


def test_logs_without_header_and_time_column_are_counted(apply, table, tmp_path):
    """`rate_hz` gives the time; the new file has the names of the recipe, and the drift stands
    behind the columns.
    """
    columns = ["temp_case_degc", "gyro_dph"]
    table[columns].to_csv(tmp_path / "flight.csv", index=False, header=False)
    names = ("--set", f"logs.names={json.dumps(columns)}", "--set", "logs.rate_hz=1.0")
    mapped = ("--set", 'columns.time_s.from="Zeit"')
    for number, more in enumerate([names, (*names, *mapped)]):
        outcome, out = apply(
            "CASE", tmp_path / "flight.csv", *more, "--set", "output.drift=true", out=f"{number}"
        )
        assert outcome.code == 0, outcome.err
        made = pd.read_csv(out)
        assert list(made) == [*columns, "gyro_drift_dph"]
        assert len(made) == len(table)
        rate = made["gyro_dph"] + made["gyro_drift_dph"]
        assert np.allclose(rate, table["gyro_dph"], atol=1e-12)
        assert np.ptp(made["gyro_drift_dph"]) > 0.1


@pytest.mark.parametrize(
    ("delimiter", "decimal", "encoding", "end"),
    [(";", ",", "cp1252", "\r\n"), ("\t", ".", "utf-16", "\n"), (" ", ".", "utf-8", "\n")],
)
def test_a_text_log_becomes_clean_csv(delimiter, decimal, encoding, end, apply, table, tmp_path):
    """Commas, points, UTF-8, one line of names with the units that stood below them; every row and
    column in order, only the indication changes, and columns are added behind. `apply` reads it
    again.
    """
    rows = [
        delimiter.join(f"{value:.4f}".replace(".", decimal) for value in row)
        for row in table.to_numpy()[:600]
    ]
    rows[5] = rows[5].replace(rows[5].split(delimiter)[1], "----", 1)
    units = ["s", "°C", "°C", "°/h"]
    lines = ["Messung 7", delimiter.join(GERMAN.values()), delimiter.join(units), *rows, ""]
    (tmp_path / "log.txt").write_bytes(end.join(lines).encode(encoding))
    outcome, out = apply("CASE", tmp_path / "log.txt", *MAPPED, "--set", "output.drift=true")
    assert outcome.code == 0, outcome.err
    made = pd.read_csv(out)
    assert list(made) == [
        "Zeit (s)",
        "Gehäuse (degC)",
        "Luft (degC)",
        "Kreisel (deg/h)",
        "gyro_drift_dph",
        "status",
    ]
    assert len(made) == len(rows)
    before = np.array([row.replace(",", ".").split(delimiter) for row in rows])
    for k, name in enumerate(list(made)[:3]):
        assert made[name].astype(str).tolist() == before[:, k].tolist() or np.array_equal(
            made[name].to_numpy(), before[:, k].astype(float)
        )
    assert made["status"][5] == "no temp_case_degc"
    assert made["status"].isna().sum() == len(made) - 1
    rate = made["Kreisel (deg/h)"] + made["gyro_drift_dph"]
    corrected = made["status"].isna()
    assert np.allclose(rate[corrected], before[corrected, 3].astype(float), atol=1e-9)
    assert apply("CASE", out, *MAPPED, out="again.csv")[0].code in {0, 3}


@pytest.fixture(scope="module")
def rated(tmp_path_factory):
    """Return the folder of a run of a rate table."""
    folder = tmp_path_factory.mktemp("rated")
    logs = DATA.parent / "rate_table"
    api.fit("rate_table", logs, date="2026-01-01", serial="R", runs=folder)
    return folder


def test_a_counter_gives_its_first_row_no_rate(rated, tmp_path, calibkit):
    """Pulses added up, without a time column: each row after the first has the rate that its counts
    have, the first a status.
    """
    table = pd.read_csv(DATA.parent / "rate_table" / "room_1.csv")
    step = float(np.median(np.diff(table["time_s"])))
    columns = ["temp_case_degc", "gyro_x_lsb"]
    table[columns].to_csv(tmp_path / "rates.csv", index=False)
    total = table[columns].assign(gyro_x_lsb=np.cumsum(table["gyro_x_lsb"] * step))
    total.to_csv(tmp_path / "total.csv", index=False, header=False)
    counted = ["--set", f"logs.names={json.dumps(columns)}", "--set", f"logs.rate_hz={1.0 / step}"]
    counted += ["--set", 'columns.gyro_x_lsb.from="gyro_x_lsb"']
    counted += ["--set", "columns.gyro_x_lsb.accumulated=true"]
    made = {}
    for name, more in (("rates", []), ("total", counted)):
        arguments = ("--data", tmp_path / f"{name}.csv", "--out", tmp_path / f"{name}.out")
        outcome = calibkit("apply", "R", "--runs", rated, *arguments, *more)
        assert outcome.code == 0, outcome.err
        made[name] = pd.read_csv(tmp_path / f"{name}.out")
    assert made["total"]["status"][0] == "counts since the row before: the first row has none"
    assert made["total"]["status"][1:].isna().all()
    assert np.isnan(made["total"]["gyro_x_dps"][0])
    assert np.allclose(made["total"]["gyro_x_dps"][1:], made["rates"]["gyro_x_dps"][1:], atol=1e-6)


def test_time_that_runs_backwards_is_refused(rated, tmp_path, calibkit):
    """A log that was put together wrongly is not compensated as if it were one."""
    table = pd.read_csv(DATA.parent / "rate_table" / "room_1.csv")
    pd.concat([table.iloc[50:], table.iloc[:50]]).to_csv(tmp_path / "log.csv", index=False)
    arguments = ("--data", tmp_path / "log.csv", "--out", tmp_path / "out.csv")
    outcome = calibkit("apply", "R", "--runs", rated, *arguments)
    assert outcome.code == 3
    assert f"log.csv:{len(table) - 48}: column 'time_s': time runs backwards" in outcome.err


def test_one_row_a_station(tmp_path, calibkit):
    """`rows = "station"` lists the stations with the angles that their rows have otherwise."""
    folder = DATA.parent / "inclinometer"
    api.fit("inclinometer", folder, date="2026-01-01", serial="I", runs=tmp_path)
    data = folder / "withheld" / "stations.csv"
    made = {}
    for rows in ("all", "station"):
        arguments = ("--runs", tmp_path, "--data", data, "--out", tmp_path / f"{rows}.csv")
        more = ("--set", f'output.rows="{rows}"', "--set", "output.azimuth_uncertainty=true")
        outcome = calibkit("apply", "I", *arguments, *more)
        assert outcome.code == 0, outcome.err
        made[rows] = pd.read_csv(tmp_path / f"{rows}.csv")
    angles = ["inclination_deg", "toolface_deg", "azimuth_deg", "azimuth_standard_uncertainty_deg"]
    first = made["all"].groupby("station", sort=False).first().reset_index()
    assert len(made["station"]) == made["all"]["station"].nunique() > 3
    assert np.allclose(
        made["station"][["station", *angles]], first[["station", *angles]], equal_nan=True
    )
    assert list(made["station"])[:3] == ["station", "time_s", "temp_case_degc"]
