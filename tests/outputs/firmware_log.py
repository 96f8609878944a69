"""A log corrected as the exported firmware does it, by its bit-exact twin."""

import numpy as np

from calibkit import instruments
from calibkit.commands import pipeline
from calibkit.firmware import formats, twin, twin_clock
from calibkit.numeric.intervals import Intervals
from calibkit.records import store


def chain_of(folder):
    """Correction chain of a run."""
    run = store.load(folder)
    spec = pipeline.run_recipe(run, ())
    return instruments.optional(spec.procedure, "chain")(spec, run.records)


def words(quantised, columns):
    """Columns of inputs as the firmware gets them."""
    return {name: np.asarray(x, dtype=twin.dtype(quantised)) for name, x in columns.items()}


def run_by_the_clock(quantised, inputs, elapsed_ms):
    """Result of each update from a reset on, for rows of inputs so many milliseconds apart."""
    state, found = twin.reset(quantised, 1), []
    for k in range(len(elapsed_ms)):
        row = {name: column[k : k + 1] for name, column in inputs.items()}
        found.append(twin_clock.update(quantised, row, elapsed_ms[k : k + 1], state))
        state = found[-1].after
    return found


def correct(chain, frame, number="f64"):
    """Frame with its indications corrected, and the statuses of the calls.

    A chain with memory is updated once an interval, with means over it; between two updates its
    output goes in a straight line from that of the update before to that of the last.
    """
    quantised = chain.quantise(formats.Format.find(number))
    structure, corrected = quantised.structure, frame.copy()
    columns = {entry.name: frame[entry.name].to_numpy() for entry in structure.inputs}
    if structure.has_memory:
        outputs, status = _follow(quantised, frame["time_s"].to_numpy(), columns)
    else:
        result = twin.call(quantised, words(quantised, columns))
        outputs, status = result.outputs, result.status
    applied = {entry.output: entry for entry in chain.corrections}
    for name, output in outputs.items():
        entry = applied.get(name)
        if entry is None:
            corrected[name] = output
        elif entry.product:
            corrected[entry.column] *= output
        else:
            corrected[entry.column] -= output
    return corrected, status


def _follow(quantised, time, columns):
    """Outputs [rows] of a chain with memory, and the statuses of its updates."""
    structure = quantised.structure
    held = Intervals.find(time, structure.interval_s)
    used = held.well_filled
    number = held.number[used]
    means = {name: held.means(column)[used] for name, column in columns.items()}
    elapsed = np.diff(number, prepend=number[0]) * structure.interval_ms
    results = run_by_the_clock(quantised, words(quantised, means), elapsed)
    # the last update before the interval of each row, and how much of the next interval is over
    row = np.searchsorted(number, np.repeat(held.number, held.count), side="left") - 1
    last = np.maximum(row, 0)
    ended = held.begin + (number[last] + 1) * held.length_s - 0.5 * held.step_s
    share = np.where(row < 0, 1.0, np.clip((time - ended) / held.length_s, 0.0, 1.0))
    outputs = {}
    for name in (output.name for output in structure.outputs):
        before = np.concatenate([one.before[name] for one in results]).astype(np.float64)
        after = np.concatenate([one.outputs[name] for one in results]).astype(np.float64)
        outputs[name] = before[last] + (after[last] - before[last]) * share
    return outputs, np.concatenate([one.status for one in results])
