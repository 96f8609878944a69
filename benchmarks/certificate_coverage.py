"""Does U of a certificate cover the truth? Writes its part of docs/coverage.md.

    PYTHONPATH=. python benchmarks/certificate_coverage.py
        [--only PROCEDURE]... [--sets N] [--first N] [--jobs N] [--results FILE]

Of each shipped procedure 1,000 campaigns are simulated where one takes less than 0.2 s, else 200,
with a new instrument every time. The equipment is off as the sample profile's [[type_b]] terms say,
drawn anew from the distribution of each: an error in the term's unit is the same in all readings of
one half of the campaigns, and grows from −e at the lowest to +e at the highest in the other half.
Each is fitted with the shipped recipe, and each result of its certificate is held against the truth
with the U that is printed. A row fails whose binomial 99 % interval (members of one campaign count
as one trial) lies outside 93 to 99.5 %. With --results campaigns are kept in a file of JSON lines
and not simulated again. --first draws the campaigns N … N + sets − 1 in place of 0 … sets − 1. Exit
code 1 where a row fails.
"""

from __future__ import annotations

import argparse
import functools
import json
import re
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import beta

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "benchmarks"))

from certified.campaigns import PROCEDURES, Errors  # noqa: E402
from speed.page import machine, replaced, table  # noqa: E402

from calibkit import instruments, recipe, units  # noqa: E402 the folder is found first
from calibkit.certificate import profile, uncertainty  # noqa: E402
from calibkit.certificate.stated import Stated  # noqa: E402
from calibkit.commands import analysis  # noqa: E402 the folder is found first
from calibkit.errors import CalibkitError  # noqa: E402
from calibkit.instruments import silent  # noqa: E402
from calibkit.logs import log_files  # noqa: E402
from calibkit.readers import in_memory  # noqa: E402
from calibkit.recipe import type_b  # noqa: E402
from calibkit.records.coefficients import Identity  # noqa: E402
from calibkit.records.sensitivities import InputError  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Sequence

    from certified.campaigns import Frames

    from calibkit.certificate.results import Result
    from calibkit.recipe import TypeB

PAGE = ROOT / "docs" / "coverage.md"
BEGIN, END = (
    "<!-- measured: benchmarks/certificate_coverage.py writes what stands below -->",
    "<!-- end of what is measured of certificates -->",
)
LEAST, MOST, CONFIDENCE = 0.93, 0.995, 0.99
FAST_S, MANY, FEWER, FIRST = 0.2, 1000, 200, 30_000
Outcome = dict[str, list[float]]
"""Kind of result → error over U of each of its members; {"refused": []} where there is no fit."""


@functools.cache
def profile_of(name: str) -> profile.Profile:
    """Sample profile of a recipe."""
    return profile.load(ROOT / "reports" / "profiles" / f"{name}.toml")[0]


def draw(term: TypeB, rng: np.random.Generator) -> float:
    """Error of a term, in its own unit."""
    if term.shape == "normal":
        return float(term.u * rng.normal())
    assert term.shape == "rectangular"  # noqa: S101 (no sample profile states another one)
    return float(term.u * np.sqrt(3.0) * rng.uniform(-1.0, 1.0))


def shift(logs: Frames, term: TypeB, size: float, *, spread: bool) -> None:
    """Put the error of an input into the readings of all logs."""
    column, kind = term.quantity, "span" if spread else "offset"
    if term.unit in type_b.RELATIVE:
        size, kind = size * type_b.RELATIVE[term.unit], "scale"
    elif column != "time_s":
        size *= units.difference_factor(term.unit, units.column_unit(column))
    if column == "time_s":  # counts per second of a clock that is off
        for log in logs.values():
            counted = [name for name in log if name.endswith("_lsb")]
            log[counted] *= 1.0 + size
        return
    readings = np.concatenate([log[column] for log in logs.values()])
    error = InputError(column, kind, size, (float(readings.min()), float(readings.max())))
    for log in logs.values():
        log[column] = error.shift(log[column])
        if column == "inclination_deg":  # beyond the vertical the other side of the tool is up
            beyond = (log[column] < 0.0) | (log[column] > 180.0)
            log["toolface_deg"] += 180.0 * beyond
            log[column] = np.degrees(np.arccos(np.cos(np.radians(log[column]))))


def results(name: str, logs: Frames) -> list[Result]:
    """Results of the certificate of a fit with the shipped recipe and the sample profile."""
    spec = instruments.parse_recipe(recipe.find(name))
    instrument, stated = instruments.find(spec.procedure), profile_of(name)
    with in_memory.hold(logs, analysis.patterns(spec)) as folder:
        fitted = instrument.fit(spec, folder, log_files.find_logs(spec, folder), silent)
    identity = Identity("S", 1, "2026-11-21", "calibkit", "0" * 64, fitted.inputs)
    blocks = instruments.optional(spec.procedure, "blocks")(
        Stated(
            {one.file: one.as_record(identity, "") for one in fitted.results},
            uncertainty.TypeBTerms.merge((), stated.terms),
            tuple(sorted({*stated.results.temperatures_degc})),
            spec.reference_temp_degc,
            fitted.sensitivities,
        )
    )
    return [one for block in blocks for one in block.results]


def kind_of(result: Result) -> str:
    """Name of the row that a result belongs to: its quantity without axis, and whether it is at a
    stated temperature.
    """
    kind = re.sub(r"@.*", "(T)", result.key.split(".", 1)[1])
    kind = re.sub(r"^(pair|triad|static|(gyro|accel)_\w+|[abxyz](_about_[abxyz])?)\.", "", kind)
    kind = re.sub(r"\.(static|[xyz]_[xyz])$", "", kind)
    kind = re.sub(r"^([mS])_([xyz])\2\b", r"\1_ii", kind)
    return re.sub(r"^m_[xyz]{2}\b", "m_ij", re.sub(r"^(b_|Q)[xyz123]\b", r"\1i", kind))


def simulate(name: str, number: int) -> Outcome:
    """Simulate, fit and certify one campaign."""
    rng = np.random.default_rng([FIRST + number, 7])
    drawn = [(term, draw(term, rng)) for term in profile_of(name).terms]
    direct: dict[str, float] = {}
    for term, size in drawn:
        if term.unit not in type_b.RELATIVE:
            ends = term.quantity.rpartition("_")[2]
            unit = ends if ends in units.TABLE else term.unit
            size *= units.difference_factor(term.unit, unit)  # noqa: PLW2901
            direct[term.quantity] = direct.get(term.quantity, 0.0) + size
    logs, truth = PROCEDURES[name](FIRST + number, Errors(direct))
    columns = {column for log in logs.values() for column in log}
    for term, size in drawn:
        if term.quantity in columns or term.quantity == "time_s":
            shift(logs, term, size, spread=bool(number % 2))
    try:
        found = results(name, logs)
    except CalibkitError as error:
        return {f"refused: {error}": []}
    outcome: Outcome = {}
    for result in found:
        true = truth(result)
        if true is None or result.uncertainty is None or result.by_definition:
            continue
        ratio = (result.value - true) / result.uncertainty.expanded_uncertainty
        outcome.setdefault(kind_of(result), []).append(float(ratio))
    return outcome


def kept(file: Path | None, name: str) -> dict[int, Outcome]:
    """Campaigns of a procedure from earlier calls, by their numbers."""
    if file is None or not file.is_file():
        return {}
    entries = map(json.loads, file.read_text(encoding="utf-8").splitlines())
    return {one["number"]: one["outcome"] for one in entries if one["procedure"] == name}


def run(name: str, asked: argparse.Namespace, pool: ProcessPoolExecutor | None) -> list[Outcome]:
    """All campaigns of a procedure, those that are kept included."""
    file: Path | None = asked.results
    found, sets = kept(file, name), asked.sets
    if sets is None:
        simulate(name, asked.first)
        begin = time.perf_counter()
        for number in range(asked.first + 1, asked.first + 4):
            simulate(name, number)
        sets = MANY if (time.perf_counter() - begin) / 3 < FAST_S else FEWER
    drawn = range(asked.first, asked.first + sets)
    numbers = [number for number in drawn if number not in found]
    one = functools.partial(simulate, name)
    for number, outcome in zip(numbers, pool.map(one, numbers) if pool else map(one, numbers)):  # noqa: B905 (as long as numbers)
        found[number] = outcome
        if file is not None:
            with file.open("a", encoding="utf-8") as stream:
                entry = {"procedure": name, "number": number, "outcome": outcome}
                stream.write(json.dumps(entry) + "\n")
    return [found[number] for number in drawn]


def judge(name: str, outcomes: Sequence[Outcome]) -> tuple[list[list[str]], bool]:
    """Rows of a procedure for the page, and whether one fails."""
    refused = [one for one in outcomes if any(key.startswith("refused") for key in one)]
    good = [one for one in outcomes if one not in refused]
    rows, failed = [], bool(refused)
    for kind in dict.fromkeys(key for one in good for key in one):
        own = [np.abs(one[kind]) for one in good if kind in one]
        n, covered = len(own), float(np.mean([np.mean(ratios <= 1.0) for ratios in own]))
        tail, k = (1.0 - CONFIDENCE) / 2.0, covered * len(own)
        low = float(beta.ppf(tail, k, n - k + 1.0)) if k > 0.0 else 0.0
        high = float(beta.isf(tail, k + 1.0, n - k)) if k < n else 1.0
        spread = float(np.sqrt(np.mean(np.concatenate(own) ** 2)))
        text = f"{100.0 * covered:.1f} % ({100.0 * low:.1f}–{100.0 * high:.1f})"
        outside = high < LEAST or low > MOST
        failed |= outside
        rows.append([name, kind, str(n), f"**{text}**" if outside else text, f"{spread:.2f}"])
    if refused:
        print(f"{name}: {len(refused)} refused: {next(iter(refused[0]))}")
    return rows, failed


def main(given: Sequence[str] | None = None) -> int:
    """Simulate, print, write the page where all procedures were asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", action="append", choices=PROCEDURES, help="procedure")
    parser.add_argument("--sets", type=int, help="campaigns of a procedure")
    parser.add_argument("--first", type=int, default=0, help="number of the first campaign")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--results", type=Path, help="campaigns that are kept between calls")
    parser.add_argument("--page", type=Path, help="page that is written anew")
    asked = parser.parse_args(given)
    pool = ProcessPoolExecutor(asked.jobs) if asked.jobs > 1 else None
    rows: list[list[str]] = []
    bad: list[str] = []
    for name in asked.only or PROCEDURES:
        begin = time.perf_counter()
        found, failed = judge(name, run(name, asked, pool))
        bad += [name] * failed
        rows += found
        for row in found:
            print("  ".join(row), flush=True)
        print(f"    {time.perf_counter() - begin:.0f} s", flush=True)
    if pool:
        pool.shutdown()
    page = asked.page or (None if asked.only else PAGE)
    if page is not None:
        head = ["procedure", "results", "campaigns", "within U", "rms error over U"]
        text = f"Measured on {machine()}.\n\n{table(head, rows)}"
        old = page.read_text(encoding="utf-8")
        page.write_text(replaced(old, BEGIN, END, text), encoding="utf-8")
    print(f"{len(rows)} rows, failed: {', '.join(bad) or 'none'}")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
