"""Robust fits of published data beside `lmrob` of R's robustbase."""

import numpy as np
import pytest

from calibkit.fit import robust
from fits.robustbase import PUBLISHED


@pytest.mark.parametrize("name", PUBLISHED)
def test_coefficients_are_those_of_lmrob(name):
    """Within 0.3 of the standard errors that lmrob prints."""
    data = PUBLISHED[name]
    found = robust.linear(data.design, data.indication).coefficients
    away = (found - data.coefficients) / np.array(data.standard_errors)
    assert np.max(np.abs(away)) < 0.3


OUTLIERS = {
    "hbk": set(range(1, 11)),
    "starsCYG": {11, 20, 30, 34},
    "salinity": {16},
    "coleman": {3, 18},
}
"""Rows, from 1, to which lmrob gives a weight below 0.2, by its own test."""


@pytest.mark.parametrize("name", OUTLIERS)
def test_weights_leave_out_the_rows_that_lmrob_leaves_out(name):
    """The good points 11 to 14 of hbk, far out as they are, keep their weight."""
    data = PUBLISHED[name]
    found = robust.linear(data.design, data.indication)
    assert set(np.flatnonzero(found.row_weights < 0.2) + 1) == OUTLIERS[name]
