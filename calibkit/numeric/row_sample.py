"""A sample of rows by which a copy is known: the rows that have the smallest hashes, wherever they
stand (Broder 1997, bottom-k sketch).

A copy whose first or last rows were cut keeps nearly all of its sample. What is hashed is as many
consecutive rows as make nearly each position of the log different from all others: then noise, not
quantisation, tells positions apart, and an independent repeat shares next to none of them.
`check.copies` compares the samples of logs, and finds copies with rounded digits in another way.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calibkit.numeric import chunks
from calibkit.numeric.arrays import Array

SIZE = 1000
"""Hashes of a sample."""
DOUBLINGS = (0, 3, 6)
"""Consecutive rows that are hashed together, as powers of two: the fewest that differ are taken."""
DIFFERENT = 0.9
"""Share of the positions that must occur once in their log. An independent repeat has a position of
this log as rarely as the log has it again: in a tenth at most.
"""


def sample_rows(columns: Sequence[Array]) -> frozenset[int]:
    """The SIZE smallest hashes of rows of columns [n]. Where rows are not different enough, as many
    consecutive ones are hashed together as needed; empty where even these are alike.
    """
    for doublings in DOUBLINGS if columns else ():
        # the SIZE smallest hashes so far, ascending, and how often each is there
        smallest, counts = np.zeros(0, np.uint64), np.zeros(0, np.intp)
        for start, stop in chunks.ranges(columns[0].size):
            # of each row with the 2^doublings − 1 rows behind it
            end = min(stop + 2**doublings - 1, columns[0].size)
            hashes = np.zeros(end - start, np.uint64)
            for column in columns:
                # adding 0 turns −0 into 0
                hashes = _mix(hashes + (column[start:end] + 0.0).view(np.uint64))
            for step in (2 ** np.arange(doublings)).tolist():
                hashes = _mix(_mix(hashes[:-step]) + hashes[step:])
            largest = smallest[-1] if smallest.size == SIZE else np.iinfo(np.uint64).max
            different, times = np.unique(hashes[hashes <= largest], return_counts=True)
            merged, inverse = np.unique(np.concatenate([smallest, different]), return_inverse=True)
            # a hash that is kept to the end was never left out before: its count is complete
            counts = np.bincount(inverse, np.concatenate([counts, times])).astype(np.intp)[:SIZE]
            smallest = merged[:SIZE]
        once = counts == 1
        if once.sum() >= DIFFERENT * max(counts.sum(), 1):
            return frozenset(smallest[once].tolist())
    return frozenset()


def _mix(values: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Integers [n] scattered over all 64 bits, one to one (Steele et al. 2014, splitmix64)."""
    values = (values ^ (values >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    values = (values ^ (values >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return values ^ (values >> np.uint64(31))
