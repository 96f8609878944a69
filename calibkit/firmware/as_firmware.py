"""A log corrected as the exported firmware would: by the bit-exact twin, without anything that a
target cannot know.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from calibkit import check
from calibkit.arrays import Array, Integers
from calibkit.firmware import twin, twin_clock
from calibkit.firmware.chain import Chain, Correction
from calibkit.firmware.program import Program
from calibkit.frame import Log, refuse, values
from calibkit.ingest import logs, write_back
from calibkit.ingest.write_back import Applied
from calibkit.numeric.intervals import Intervals
from calibkit.recipe import Recipe


def apply(
    spec: Recipe,
    chain: Chain,
    quantised: Program,
    data: Path,
    derive: Callable[[Mapping[str, Array]], Mapping[str, Array]] = lambda _: {},
) -> Applied:
    """Correct every row of a log by a chain without memory; statuses are returned as flags.

    `derive` gives further columns from the outputs, by name.
    """
    structure, corrections = quantised.structure, chain.corrections
    names = [*(entry.name for entry in structure.inputs), *(entry.column for entry in corrections)]
    log = logs.read_log(spec, data, data.name, list(dict.fromkeys(names)))
    refuse(check.find_too_few_rows(log, 1))
    words = {
        e.name: twin.encode(quantised, e.name, values(log.frame, e.name)) for e in structure.inputs
    }
    result = twin.call(quantised, words)
    found = {
        o.name: twin.decode(quantised, o.name, result.outputs[o.name]) for o in structure.outputs
    }
    columns, derived = _corrected(log, found, corrections)
    content = write_back.rewrite_log(spec, data, log, columns, {**derived, **derive(found)})
    return content, _status_flags(log.file, quantised, result.status)


def follow(
    quantised: Program, held: Intervals, time: Array, heard: Mapping[str, Array]
) -> tuple[dict[str, Array], Integers]:
    """Outputs at each row of a log [rows] of a chain that is updated at the end of each interval
    that holds enough rows, with inputs heard over it [m]; and the statuses of the updates.

    Between two updates an output goes in a straight line from that of the update before to that of
    the last; rows of the first interval get its own.
    """
    used = held.enough
    number = held.number[used]
    elapsed = np.diff(number, prepend=number[0]) * quantised.structure.interval_ms
    words = {name: twin.encode(quantised, name, heard[name][used]) for name in heard}
    results = list(twin_clock.run_by_the_clock(quantised, words, elapsed))
    # the last update before the interval of each row, and how much of the next interval is over
    row = np.searchsorted(number, np.repeat(held.number, held.count), side="left") - 1
    last = np.maximum(row, 0)
    ended = held.begin + (number[last] + 1) * held.length_s - 0.5 * held.step_s
    share = np.where(row < 0, 1.0, np.clip((time - ended) / held.length_s, 0.0, 1.0))
    found = {}
    for name in (output.name for output in quantised.structure.outputs):
        sides = [(one.before[name], one.outputs[name]) for one in results]
        before, after = (
            twin.decode(quantised, name, np.concatenate(side)) for side in zip(*sides, strict=True)
        )
        found[name] = before[last] + (after[last] - before[last]) * share
    return found, np.concatenate([one.status for one in results])


def updates_flags(log: Log, quantised: Program, status: Integers) -> tuple[str, ...]:
    """What a log is corrected by in which interval, what becomes of its gaps, and the share of the
    updates that returned each status.
    """
    pace, interval_s = quantised.structure.pace, quantised.structure.interval_ms / 1000.0
    assert pace is not None  # noqa: S101 (a chain that keeps time)
    return (
        (
            f"{log.file}: as the firmware's output between updates every {interval_s:g} s, which is"
            " one interval late; the first interval by its own"
        ),
        *check.flag_bridged_gaps(
            log,
            f"the firmware bridges up to {pace.longest * interval_s:g} s in a straight line and"
            " knows nothing of what happened in a longer gap",
        ),
        *_status_flags(log.file, quantised, status),
    )


def _corrected(
    log: Log, found: Mapping[str, Array], corrections: Sequence[Correction]
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Columns that replace those of the log, and columns that it did not have."""
    columns, derived = {}, {}
    applied = {entry.output: entry for entry in corrections}
    for name, result in found.items():
        if name in applied:
            entry = applied[name]
            indication = values(log.frame, entry.column)
            columns[entry.column] = indication * result if entry.product else indication - result
        elif name in log.frame.columns:
            columns[name] = result
        else:
            derived[name] = result
    return columns, derived


def _status_flags(file: str, quantised: Program, status: Integers) -> tuple[str, ...]:
    """Share of calls that returned each status."""
    bits = {flag: 1 << k for k, flag in enumerate(quantised.structure.flags)} | {
        "INVALID": twin.INVALID
    }
    shares = {flag: 100.0 * float(np.mean(status & bit != 0)) for flag, bit in bits.items()}
    return tuple(
        f"{file}: status {flag} in {share:.2g} % of the calls"
        for flag, share in shares.items()
        if share > 0.0
    )
