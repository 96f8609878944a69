"""Choice between families of models by their errors on groups of rows that were left out."""

from collections.abc import Mapping

import numpy as np

from calibkit.arrays import Array


def choose_simplest(squares: Mapping[int, Array]) -> int:
    """Number of the first of some models that is within one standard error of the best.

    Parameters
    ----------
    squares : mean square error [groups] of each model on each group of rows that was left out of
        its fit, in one unit; the simplest model stands first.

    Notes
    -----
    The standard error is that of the difference group by group, in which the noise of a group
    cancels (Breiman et al. 1984, 1-SE rule). The difference of the logarithms must be within its
    standard error too: there one bad group does not decide alone.
    """
    best = min(squares, key=lambda number: float(np.mean(squares[number])))
    floor = np.maximum(squares[best], np.finfo(np.float64).tiny)
    for number, square in squares.items():
        ratio = np.maximum(square, np.finfo(np.float64).tiny) / floor
        if _is_chance(square - squares[best]) and _is_chance(np.log(ratio)):
            return number
    return best


def _is_chance(excess: Array) -> bool:
    """Whether the mean of what groups are worse by is within its standard error."""
    return bool(excess.mean() <= np.std(excess, ddof=1) / np.sqrt(excess.size))
