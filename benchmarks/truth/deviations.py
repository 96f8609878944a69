"""Allan deviations beside allantools: the same numbers, whether limits hold, and what a gap
does.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from speed import pairs, peers
from speed.page import table

from calibkit.numeric.noise import allan

if TYPE_CHECKING:
    from numpy.typing import NDArray


def measured(units: int, environments: Path) -> str:
    """Agreement, gaps, and whether limits hold, beside allantools."""
    records, samples, factor = 60 * units, 2000, 256
    rng = np.random.default_rng(3)
    octaves = 2 ** np.arange(int(np.log2(samples // 3)) + 1)
    at = int(np.flatnonzero(octaves == factor)[0])
    held = {"calibkit": 0, "allantools": 0, "by hand": 0}
    digits = pairs.EVERY_BIT
    with (
        pairs.Worker(peers.environment("allantools", environments), "theirs") as peer,
        tempfile.TemporaryDirectory() as name,
    ):
        path = Path(name) / "rate.npy"
        for _ in range(records):
            rate = rng.normal(size=samples)
            np.save(path, rate)
            peer.ask("load", side="allan", files={"rate": str(path)}, settings={"hertz": 1.0})
            peer.ask("once", times=1)
            theirs, ours = pairs.answers(peer), allan.overlapping(rate, 1.0)
            digits = min(
                digits, pairs.agreeing_digits({"d": ours.deviation}, {"d": theirs["deviation"]})
            )
            truth, error = 1.0 / np.sqrt(factor), 1.959964 * theirs["error"][at]
            held["calibkit"] += bool(ours.lower[at] <= truth <= ours.upper[at])
            held["allantools"] += bool(abs(theirs["deviation"][at] - truth) <= error)
            peer.ask(
                "load",
                side="allan_limits",
                files={"rate": str(path)},
                settings={"hertz": 1.0, "factor": factor},
            )
            peer.ask("once", times=1)
            low, high = pairs.answers(peer)["limits"]
            held["by hand"] += bool(low <= truth <= high)
        rate[700:720] = np.nan
        np.save(path, rate)
        peer.ask("load", side="allan", files={"rate": str(path)}, settings={"hertz": 1.0})
        peer.ask("once", times=1)
        gap = pairs.answers(peer)["deviation"]
    own = allan.overlapping(rate, 1.0).deviation
    shares = {key: f"{count / records:.1%}" for key, count in held.items()}
    own_error = (
        f"{shares['allantools']} by ± 1.96 of the error that `oadev` returns, which takes all"
        " differences for independent"
    )
    by_hand = (
        f"{shares['by hand']} by `edf_greenhall` and `confidence_interval`, told the noise type"
    )
    asked = (
        f"95 % limits of white noise, {factor} of {samples} samples averaged: how many of {records}"
        " records hold the truth"
    )
    rows = [
        ["a whole record", f"the same to {digits:.1f} digits", "the same"],
        [
            asked,
            f"{own_error}; {by_hand}",
            f"{shares['calibkit']}, the noise type told from the record",
        ],
        [
            "a gap of 20 samples (NaN)",
            f"{_missing(gap)} values are NaN",
            f"{_missing(own)} values are NaN",
        ],
    ]
    more = (
        (
            "allantools has an estimator for records with gaps too (`gradev`), and many kinds of"
            " deviation that calibkit has not"
        ),
        "(modified, Hadamard, total, time).",
    )
    return f"{table(('', 'allantools `oadev`', 'calibkit'), rows)}\n{' '.join(more)}"


def _missing(values: NDArray[np.float64]) -> str:
    """How many of how many."""
    return f"{np.count_nonzero(np.isnan(values))} of {values.size}"
