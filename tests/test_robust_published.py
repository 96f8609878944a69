"""Robust fits of published data beside `lmrob` of R's robustbase."""

import numpy as np
import pytest

from calibkit.numeric.least_squares import robust
from tests.robustbase import PUBLISHED


@pytest.mark.parametrize("name", PUBLISHED)
def test_coefficients_are_those_of_lmrob(name):
    """Within 0.3 of the standard errors that lmrob prints."""
    data = PUBLISHED[name]
    found = robust.linear(data.design, data.indication).fit.coefficients
    away = (found - data.coefficients) / np.array(data.standard_errors)
    assert np.max(np.abs(away)) < 0.3


@pytest.mark.parametrize(
    ("name", "outliers"),
    [
        ("hbk", set(range(1, 11))),
        ("starsCYG", {11, 20, 30, 34}),
        ("salinity", {16}),
        ("coleman", {3, 18}),
    ],
)
def test_the_known_outliers_are_named_and_no_others(name, outliers):
    """Rows from 1; the good points 11 to 14 of hbk, far out as they are, keep their weight."""
    data = PUBLISHED[name]
    found = robust.linear(data.design, data.indication)
    assert {row + 1 for row in found.suspects} == outliers
    assert set(np.flatnonzero(found.row_weights < 0.2) + 1) == outliers
