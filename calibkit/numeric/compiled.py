"""The compiled kernels, for arrays that they can read and write as these lie in memory."""

from ctypes import CDLL

import numpy as np

from calibkit.arrays import Array
from calibkit.native import kernels


def kernels_for(*arrays: Array) -> CDLL | None:
    """The compiled kernels; none where they were not built, or where an array is not of adjacent
    doubles of this machine.
    """
    library = kernels()
    if library is None:
        return None
    flags = (array.flags for array in arrays if array.dtype == np.float64)
    return (
        library
        if sum(flag.c_contiguous and flag.aligned for flag in flags) == len(arrays)
        else None
    )
