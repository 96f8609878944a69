"""Acceptance limits: decided in one place, on both sides of the limit and at equality."""

import math

import pytest

from calibkit.records.coefficients import at_least, at_most

LIMIT = 0.3
BELOW, ABOVE = math.nextafter(LIMIT, 0.0), math.nextafter(LIMIT, 1.0)


@pytest.mark.parametrize(
    ("value", "passed"),
    [(BELOW, True), (LIMIT, True), (ABOVE, False), (math.inf, False), (math.nan, False)],
)
def test_at_most_passes_up_to_its_limit(value, passed):
    """A value that must not exceed its limit passes below and at it; NaN fails."""
    made = at_most("drift rms", value, LIMIT, "deg/h")
    assert made.passed is passed
    assert (made.name, made.limit, made.unit) == ("drift rms", LIMIT, "deg/h")
    assert made.value is value


@pytest.mark.parametrize(
    ("value", "passed"),
    [(BELOW, False), (LIMIT, True), (ABOVE, True), (-math.inf, False), (math.nan, False)],
)
def test_at_least_passes_from_its_limit(value, passed):
    """A value that must reach its limit passes at and above it; NaN fails."""
    made = at_least("reduction", value, LIMIT, "1")
    assert made.passed is passed
    assert (made.name, made.limit, made.unit) == ("reduction", LIMIT, "1")
    assert made.value is value
