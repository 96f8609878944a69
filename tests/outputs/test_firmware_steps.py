"""Each step of a chain by itself: largest errors that can be worked out by hand."""

from fractions import Fraction

import pytest

from calibkit.firmware.ranges import Ranges, magnitude
from calibkit.firmware.rounding import Rounding
from calibkit.firmware.steps import Case, ChainTerm, Limit, Play, Quotient, Select, Sum

EXACT = 1000
"""Significant bits of a number that rounds nothing."""


def rounding(bits, values, tables=(), stored=()):
    """Magnitudes of values (name → largest), tables and the errors of their numbers."""
    ranges = {name: (Fraction(-most), Fraction(most)) for name, most in values.items()}
    exact = {name: tuple(map(Fraction, numbers)) for name, numbers in dict(tables).items()}
    reaches = {name: float(magnitude(ends)) for name, ends in ranges.items()}
    return Rounding(bits, Ranges(exact, {}, ranges), reaches, dict(stored))


def test_a_product_is_off_by_each_factor_times_the_others():
    """3 · 5 with errors of 0.1 and 0.01: 5 · 0.1 + 3 · 0.01; a coefficient of 2 doubles it."""
    errors, values = {"a": 0.1, "b": 0.01}, {"a": 3, "b": 5, "y": 100}
    scale = rounding(EXACT, values, {"c": (2,)}, {"c": (0.0,)})
    plain = Sum("y", (ChainTerm("", "", ("a", "b")),))
    assert plain.error(errors, scale) == pytest.approx(0.53)
    doubled = Sum("y", (ChainTerm("c", "", ("a", "b"), -1),))
    assert doubled.error(errors, scale) == pytest.approx(1.06)
    together = Sum("y", (ChainTerm("", "", ("a",)), ChainTerm("", "", ("a",), -1)))
    assert together.error(errors, scale) == pytest.approx(0.0)


@pytest.mark.parametrize(("reach", "error"), [(0.5, 0.1), (2, 0.6)])
def test_a_limit_adds_the_error_of_its_ends_where_they_are_reached(reach, error):
    """An end that is stored 0.5 off counts for a source that goes to 2, not for one to 0.5."""
    scale = rounding(EXACT, {"x": reach}, {"l": (-1, 1)}, {"l": (0.0, 0.5)})
    assert Limit("y", "x", "l", "").error({"x": 0.1}, scale) == pytest.approx(error)


def test_a_play_operator_is_off_by_its_source_its_distance_and_one_rounding():
    """0.1, the larger of 0.2 and 0.3, and 2⁻² of 4."""
    scale = rounding(2, {"x": 1, "y": 4}, {"d": (-3, 3)}, {"d": (0.2, 0.3)})
    play = Play("y", "x", "y_before", "d")
    assert play.error({"x": 0.1}, scale) == pytest.approx(1.4)
    assert play.sources == ("x", "y_before")


def test_a_selection_is_as_wrong_as_the_worst_of_its_cases():
    """0.3 of 0.1 and 0.3; its range holds 0, where no case holds."""
    cases = (Case("a", 1, "t", "g"), Case("b", -1, "t", "g"))
    step = Select("y", "x", cases, "HELD")
    assert step.error({"a": 0.1, "b": 0.3}, rounding(EXACT, {})) == 0.3
    known = Ranges({}, {}, {"a": (Fraction(2), Fraction(3)), "b": (Fraction(1), Fraction(4))})
    assert step.range(known) == (0, 4)


def test_a_quotient_is_off_by_both_over_the_smallest_denominator():
    """6 / (2 … 4) with errors of 0.2 and 0.1: (0.2 + 3 · 0.1) / (2 − 0.1)."""
    scale = rounding(EXACT, {"n": 6, "y": 3})
    scale.ranges.values["d"] = (Fraction(2), Fraction(4))
    error = Quotient("y", "n", "d").error({"n": 0.2, "d": 0.1}, scale)
    assert error == pytest.approx(0.5 / 1.9)
