"""Magnitudes of the corrected vectors of a triad and their derivatives, for many rows at a time."""

import numpy as np

from calibkit.arrays import Array
from calibkit.native import kernels_for

LOWER = ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2))
"""(row, column) of the entries of the lower triangular correction matrix, in the order of the
parameters.
"""
_ROWS, _COLUMNS = np.transpose(LOWER)


def lower_matrix(entries: Array) -> Array:
    """Lower triangular matrix [3, 3] from its six entries [6] in the order of LOWER."""
    matrix = np.zeros((3, 3))
    matrix[_ROWS, _COLUMNS] = entries
    return matrix


def length_residuals(
    triangle: Array, indication: Array, gravity: float, root: Array
) -> tuple[Array, Array]:
    """Weighted residuals [n] |T (V − b)| − gravity and their derivatives [n, 9] by the entries of T
    and by b.

    Parameters
    ----------
    triangle
        Six entries of T in the order of LOWER, and b: [9].
    indication
        V [n, 3].
    gravity
        The length that is expected.
    root
        Square roots of the weights [n].

    Notes
    -----
    Compiled or not, all but the two products of matrices are rounded one by one in the order
    written here.
    """
    matrix, count = lower_matrix(triangle[:6]), len(indication)
    library = kernels_for(indication, root)
    if library is not None:
        # the NumPy equivalent of the compiled function, in two passes
        bias = triangle[6:].copy()
        shifted, direction, slopes, residual = (np.empty((k, count)) for k in (3, 3, 9, 1))
        library.calibkit_components(
            indication.ctypes.data, count, bias.ctypes.data, shifted.ctypes.data
        )
        vector = matrix @ shifted
        library.calibkit_lengths(
            *(vector.ctypes.data, shifted.ctypes.data, root.ctypes.data, count, gravity),
            *(residual.ctypes.data, direction.ctypes.data, slopes.ctypes.data),
        )
        np.matmul(-matrix.T, direction, out=slopes[6:])
        return residual[0], slopes.T
    shifted = np.subtract(
        indication.T, triangle[6:, None], order="C"
    )  # components as rows, along the memory
    vector = matrix @ shifted
    square = vector * vector
    length = np.sqrt(square[0] + square[1] + square[2])
    direction = vector * (root / length)
    slopes = np.empty((9, count))
    for row, (i, j) in zip(slopes, LOWER, strict=False):
        np.multiply(direction[i], shifted[j], out=row)
    np.matmul(-matrix.T, direction, out=slopes[6:])
    return (length - gravity) * root, slopes.T
