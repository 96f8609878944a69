"""A log that a run was fitted to is known again by its values: for validation, for histories, and
before anything is fitted.
"""

import re
import tomllib

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings, strategies as st

import calibkit as api
from calibkit.check import copies, find_copied_rows
from calibkit.records import store
from calibkit.records.frame import COMPARED_ROWS, KEPT_DIGITS, KEPT_ROWS, Log, fingerprint
from conftest import ROOT
from written_logs import sample_logs

DATA = ROOT / "datasets"
SMALL = ("accelerometer",)


def rows(seed, count):
    """Rows of one measurement."""
    values = np.random.default_rng(seed).normal(size=(count, 3))
    return [row.tobytes() for row in values]


def entry(measured, sha256="a"):
    """A log as run.json lists it."""
    return {
        "name": "x.csv",
        "sha256": sha256,
        "rows": len(measured),
        "fingerprint": fingerprint(measured),
    }


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**32), st.integers(3, COMPARED_ROWS), st.data())
def test_an_excerpt_is_a_copy_and_another_measurement_is_none(seed, count, data):
    """Nine tenths of the rows and more are always told; noise of another seed never is."""
    measured = rows(seed, count)
    left = data.draw(st.integers(0, count // 20))
    excerpt = measured[left:]
    if len(excerpt) >= copies.FEWEST:
        assert copies._find_fitted_copy(frozenset(excerpt), [entry(measured)]) == "x.csv"
        assert copies._are_fingerprints_alike(fingerprint(excerpt), fingerprint(measured))
    other = rows(seed + 1, count)
    assert copies._find_fitted_copy(frozenset(other), [entry(measured)]) == ""
    assert not copies._are_fingerprints_alike(fingerprint(other), fingerprint(measured))


def test_a_quarter_of_a_log_is_told_from_its_fingerprint():
    """250 of 1000 rows: some 16 of the 64 that are kept, which is enough."""
    measured = rows(1, COMPARED_ROWS)
    assert copies._find_fitted_copy(frozenset(measured[300:550]), [entry(measured)]) == "x.csv"


def with_line_ends(folder, into):
    """Copy the CSV logs of a folder, with carriage returns, under other names."""
    into.mkdir(parents=True)
    for path in sorted(folder.glob("*.csv")):
        (into / path.name).write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    return into


@pytest.mark.parametrize("name", SMALL)
def test_validation_leaves_out_a_fitted_log_that_was_saved_again(name, tmp_path, calibkit):
    """Other line ends are no unseen measurement: exit 3; the run keeps one fingerprint a log."""
    runs = tmp_path / "runs"
    assert calibkit("fit", name, "--data", DATA / name, "--serial", "S", "--out", runs).code in (
        0,
        1,
    )
    inputs = store.load(runs / "S" / "r001").document["inputs"]
    assert all(len(one["fingerprint"]) <= KEPT_ROWS * KEPT_DIGITS for one in inputs)
    again = with_line_ends(DATA / name, tmp_path / "again")
    outcome = calibkit("validate", "S", runs=runs, data=again, out=tmp_path / "v.json")
    assert outcome.code == 3
    assert f"holds the values of {inputs[0]['name']}, which this run was fitted to" in outcome.err
    assert not (tmp_path / "v.json").exists()


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """Folder of runs with the sample inclinometer in it, twice: the second from the same log with
    other line ends.
    """
    from calibkit import cli

    folder = tmp_path_factory.mktemp("runs")
    again = with_line_ends(DATA / "inclinometer", folder / "again")
    for data in (DATA / "inclinometer", again):
        with pytest.raises(SystemExit):
            cli.main(
                ["fit", "inclinometer", "--data", str(data), "--serial", "S", "--out", str(folder)]
            )
    return folder


COPIES = {
    "accelerometer": "positions_2.csv",
    "accelerometer_magnitude": "tumble_2.csv",
    "bias_temperature": "warm_2.csv",
    "fog_thermal": "ramp_cooling_09.csv",
    "gyro_noise": "static_2.csv",
    "gyro_pair": "table_axis_b.csv",
    "gyro_triad": "about_x_26.csv",
    "inclinometer": "stations_2.csv",
    "rate_table": "room_4.csv",
    "thermal": "sweep_2.csv",
}
"""Names that a copy of a procedure's first sample log is fitted under."""


@pytest.mark.parametrize("name", COPIES)
def test_a_copy_of_another_time_or_of_later_rows_is_refused(name):
    """A log under a second name, 5000 s later and without its first sixth: no fit takes it for a
    repeat.
    """
    logs = sample_logs(name)
    file, log = next(iter(logs.items()))
    # whole stations of four rows
    copy = log.iloc[len(log) // 24 * 4 :].copy()
    if "time_s" in copy:
        copy["time_s"] += 5000.0
    recipe = tomllib.loads((ROOT / "recipes" / f"{name}.toml").read_text(encoding="utf-8"))
    recipe["logs"]["files"] = sorted({*recipe["logs"]["files"], file, COPIES[name]})
    with pytest.raises(api.CalibkitError, match=f"the same values as {file}"):
        api.fit(recipe, logs=logs | {COPIES[name]: copy}, runs=None, date="2026-11-21")


def decimals(column):
    """Decimals that a column is written with, nine of one that was never rounded."""
    return min(9, max(len(f"{value:.12g}".partition(".")[2]) for value in column[:500]))


TIME_S = 0.1007 * np.arange(4200)
"""Times of a run."""


def table_run(seed, noise_lsb):
    """A gyro's run over held rates of a table, in whole counts."""
    rng = np.random.default_rng([seed, 2])
    rate = np.repeat(np.linspace(-50.0, 50.0, 21), 200)
    counts = np.round(97.3 * rate + 0.3 + noise_lsb * rng.normal(size=rate.size))
    return pd.DataFrame({"time_s": TIME_S, "table_rate_dps": rate, "gyro_x_lsb": counts})


def find_copies(*frames):
    """Logs of frames that are copies of one before them."""
    logs = [Log(f"{k}", f"{k}.csv", f"{k}", len(f), f) for k, f in enumerate(frames)]
    return copies.find_copies(map(copies.Content.of, logs))


@pytest.mark.parametrize("noise_lsb", [0.0, 0.03, 0.1, 0.15, 0.2, 0.3, 1.0, 10.0])
def test_honest_repeats_of_coarse_counts_are_no_copies(noise_lsb):
    """Runs at the same rates, at other times; noise of none to ten counts."""
    runs = [table_run(seed, noise_lsb).assign(time_s=seed + TIME_S) for seed in range(20)]
    assert find_copies(*runs) == []


@pytest.mark.parametrize("noise_lsb", [0.3, 1.0, 10.0])
def test_copies_of_coarse_counts_are_found_by_rows_behind_each_other(noise_lsb):
    """Without the first or the last sixth, at another time: the copy is found, whichever is
    longer.
    """
    run = table_run(1, noise_lsb)
    later = run.assign(time_s=run["time_s"] + 77.0)
    for copy in (later, later.iloc[700:], later.iloc[:-700]):
        assert [file for file, _ in find_copies(run, copy)] == ["1.csv"]
        assert [file for file, _ in find_copies(copy, run)] == ["1.csv"]


@pytest.mark.parametrize("lost", [1, 2])
def test_a_copy_with_fewer_digits_is_found_and_a_repeat_is_none(lost):
    """The last digits rounded and the times shifted; a repeat logged with fewer digits stays."""
    decimals = {"table_rate_dps": 4, "gyro_dph": 4}
    first, second = (
        table_run(seed, 1.0).rename(columns={"gyro_x_lsb": "gyro_dph"}) for seed in (1, 2)
    )
    rng = np.random.default_rng(3)
    for run in (first, second):
        run["gyro_dph"] = run["gyro_dph"] / 8.0 + 0.1 * rng.normal(size=len(run))
    fewer = {"gyro_dph": decimals["gyro_dph"] - lost}
    run = first.round(decimals)
    copy = run.round(fewer).assign(time_s=run["time_s"] + 77.0)
    for logs in ((run, copy), (copy, run)):
        assert [file for file, _ in find_copies(*logs)] == ["1.csv"]
    assert find_copies(run, second.round(decimals).round(fewer)) == []


TABLES = {
    "accelerometer": ("positions.csv", slice(10, 15)),
    "inclinometer": ("stations.csv", slice(12, 16)),
}


@pytest.mark.parametrize("name", TABLES)
def test_rows_of_a_table_that_were_pasted_twice_are_refused(name, tmp_path, calibkit):
    """A copy would count as a second measurement, and make U smaller."""
    file, pasted = TABLES[name]
    table = pd.read_csv(DATA / name / file)
    copied = table.iloc[pasted].copy()
    if "station" in copied:
        copied["station"] += 1000
        copied["time_s"] += 1e6
    pd.concat([table, copied]).to_csv(tmp_path / file, index=False)
    done = calibkit("fit", f"recipes/{name}.toml", data=tmp_path, serial="S", out=tmp_path)
    first = len(table) + 2
    assert done.code == 3, done.out
    assert f"{file}:{first}: {len(copied)} rows from here on hold the same numbers" in done.err
    assert f'lines = ["{first}-{first + len(copied) - 1}"]' in done.err


def test_repeats_that_differ_and_pairs_of_rows_are_no_copied_rows():
    """Noise makes honest repeats differ, and two rows may be alike by chance."""
    rng = np.random.default_rng(8)
    attitudes = rng.uniform(-1.0, 1.0, (40, 3))
    held = np.concatenate([attitudes + rng.normal(0.0, 1e-5, (40, 3)) for _ in range(2)])
    for copied, found in ((2, 0), (3, 1)):
        table = np.concatenate([held, held[5 : 5 + copied]])
        log = Log("a", "a.csv", "a", len(table), pd.DataFrame(table, columns=list("xyz")))
        assert len(find_copied_rows(log, ("x", "y", "z"))) == found


def test_copies_in_many_places_are_all_in_the_advice():
    """Twelve runs of three copied rows: leaving out what the advice lists leaves no copy."""
    rng = np.random.default_rng(9)
    parts = []
    for _ in range(12):
        run = rng.uniform(-1.0, 1.0, (3, 3))
        parts += [run, run, rng.uniform(-1.0, 1.0, (2, 3))]
    table = np.concatenate(parts)
    log = Log("a", "a.csv", "a", len(table), pd.DataFrame(table, columns=list("xyz")))
    (finding,) = find_copied_rows(log, ("x", "y", "z"))
    listed = re.findall(r'"(\d+)-(\d+)"', finding.advice)
    assert len(listed) == 12
    left_out = {line for a, b in listed for line in range(int(a), int(b) + 1)}
    kept = [row for row in range(len(table)) if row + 2 not in left_out]
    rest = Log("a", "a.csv", "a", len(kept), log.frame.iloc[kept])
    assert find_copied_rows(rest, ("x", "y", "z")) == []
