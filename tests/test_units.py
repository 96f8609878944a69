"""Units of the field and the conversions between them."""

import numpy as np
import pytest

from calibkit import units
from calibkit.errors import RecipeError


@pytest.mark.parametrize(
    ("value", "source", "target", "expected"),
    [
        (1.0, "deg/s", "deg/h", 3600.0),
        (1.0, "rad/s", "deg/s", 57.29577951308232),
        (15.041067, "deg/h", "rad/s", 7.292115e-5),
        (0.0, "degC", "K", 273.15),
        (-40.0, "degF", "degC", -40.0),
        (212.0, "degF", "degC", 100.0),
        (1.0, "mg", "ug", 1000.0),
        (1500.0, "ms", "s", 1.5),
        (90.0, "arcmin", "deg", 1.5),
        (2.0, "1/ms", "1/s", 2000.0),
        (1.0, "rpm", "deg/s", 6.0),
    ],
)
def test_a_value_converts_as_the_units_are_defined(value, source, target, expected):
    """A value converts as the units are defined, to 1e-7 relative where the expected value is rounded."""
    assert units.convert(np.array([value]), source, target)[0] == pytest.approx(expected, rel=1e-7, abs=1e-9)


def test_every_unit_converts_to_its_base_and_back():
    """Every unit converts to its dimension's base and back to 1e-12 relative."""
    for name, unit in units.TABLE.items():
        base = next(other for other, b in units.TABLE.items() if b.dimension == unit.dimension)
        there = units.convert(np.array([3.7]), name, base)
        assert units.convert(there, base, name)[0] == pytest.approx(3.7, rel=1e-12)


def test_specific_force_in_si_needs_the_local_gravity():
    """m/s² becomes local g only with a local gravity, never with the standard one."""
    with pytest.raises(RecipeError, match="local gravity"):
        units.convert(np.array([9.8]), "m/s^2", "g")
    assert units.convert(np.array([9.7803]), "m/s^2", "g", gravity_mps2=9.7803)[0] == pytest.approx(1.0, rel=1e-15)
    assert units.convert(np.array([1000.0]), "mg", "m/s^2", gravity_mps2=9.79)[0] == pytest.approx(9.79, rel=1e-15)


def test_units_of_different_dimensions_do_not_convert():
    """A temperature does not become a rate."""
    with pytest.raises(RecipeError, match="temperature"):
        units.convert(np.array([1.0]), "degC", "deg/h")


def test_an_unknown_unit_is_answered_with_the_closest_one():
    """A misspelt unit names the one that was meant."""
    with pytest.raises(RecipeError, match="did you mean 'deg/h'"):
        units.known("deg/hh")


@pytest.mark.parametrize(
    ("column", "unit"),
    [("temp_case_degc", "degC"), ("gyro_x_lsb", "1/s"), ("accel_x_lsb", "1"), ("gyro_dph", "deg/h"), ("station", "1")],
)
def test_the_last_word_of_a_column_is_its_unit(column, unit):
    """A column's unit is read from its name, a gyro's counts being per second."""
    assert units.column_unit(column) == unit
