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
        (212.0, "degF", "degC", 100.0),
        (1500.0, "ms", "s", 1.5),
        (2.0, "1/ms", "1/s", 2000.0),
    ],
)
def test_a_value_converts_as_the_units_are_defined(value, source, target, expected):
    """A value converts as the units are defined, to 1e-7 relative where the expected value is
    rounded.
    """
    assert units.convert(np.array([value]), source, target)[0] == pytest.approx(
        expected, rel=1e-7, abs=1e-9
    )


def test_specific_force_in_si_needs_the_local_gravity():
    """m/s² becomes local g only with a local gravity, never with the standard one."""
    with pytest.raises(RecipeError, match="local gravity"):
        units.convert(np.array([9.8]), "m/s^2", "g")
    assert units.convert(np.array([9.7803]), "m/s^2", "g", gravity_mps2=9.7803)[0] == pytest.approx(
        1.0, rel=1e-15
    )
    assert units.convert(np.array([1000.0]), "mg", "m/s^2", gravity_mps2=9.79)[0] == pytest.approx(
        9.79, rel=1e-15
    )


def test_an_unknown_unit_is_answered_with_the_closest_one():
    """A misspelt unit names the one that was meant."""
    with pytest.raises(RecipeError, match="did you mean 'deg/h'"):
        units.known("deg/hh")


@pytest.mark.parametrize(
    ("column", "unit"),
    [
        ("temp_case_degc", "degC"),
        ("gyro_x_lsb", "1/s"),
        ("accel_x_lsb", "1"),
        ("gyro_dph", "deg/h"),
        ("station", "1"),
    ],
)
def test_the_last_word_of_a_column_is_its_unit(column, unit):
    """A column's unit is read from its name, a gyro's counts being per second."""
    assert units.column_unit(column) == unit


PINT = {
    "us": "microsecond",
    "d": "day",
    "degC": "degC",
    "degF": "degF",
    "K": "kelvin",
    "deg/h": "degree/hour",
    "deg/s": "degree/second",
    "deg/min": "degree/minute",
    "mdeg/s": "millidegree/second",
    "mdeg/h": "millidegree/hour",
    "mrad/s": "milliradian/second",
    "urad/s": "microradian/second",
    "rad/h": "radian/hour",
    "arcsec/s": "arcsecond/second",
    "rpm": "revolution/minute",
    "mdeg": "millidegree",
    "mrad": "milliradian",
    "urad": "microradian",
    "arcmin": "arcminute",
    "arcsec": "arcsecond",
    "rev": "revolution",
    "mm/s^2": "millimeter/second**2",
    "cm/s^2": "centimeter/second**2",
    "m/s^2": "meter/second**2",
    "1/ms": "1/millisecond",
    "1/min": "1/minute",
    "1/h": "1/hour",
    "1/s": "1/second",
    "1": "dimensionless",
    "g": "standard_gravity",
    "mg": "millistandard_gravity",
    "ug": "microstandard_gravity",
    "mV": "millivolt",
    "uV": "microvolt",
    "mA": "milliampere",
}
"""Units whose spelling is ours → the same unit in pint's words; the others are spelled alike."""
ALONE = {"1/sample"}
"""Units of this field that no library knows."""


def test_every_unit_converts_as_pint_defines_it():
    """Each unit to the base of its dimension, to 1e-14 relative; offsets of temperatures to 1e-12
    °C.
    """
    quantity = pytest.importorskip("pint").UnitRegistry().Quantity
    values = np.array([-40.0, 0.0, 1.0, 3.7, 98.6, 12345.678])
    bases = {}
    for name, unit in units.TABLE.items():
        base = bases.setdefault(unit.dimension, name)
        ours = units.convert(values, name, base)
        if name in ALONE:
            continue
        theirs = quantity(values, PINT.get(name, name)).to(PINT.get(base, base)).magnitude
        np.testing.assert_allclose(ours, theirs, rtol=1e-14, atol=1e-12, err_msg=name)


@pytest.mark.parametrize(
    ("header", "unit"),
    [
        ("gyro (deg/h)", "deg/h"),
        ("温度(℃)", "degC"),
        ("陀螺输出((°)/h)", "deg/h"),
        ("T / °C", "degC"),
        ("Temperatur °C", "degC"),
        ("Chan 101 (VDC)", "V"),
        ("角速度(度/秒)", "deg/s"),
        ("acc (m/s²)", "m/s^2"),
        ("time_s", ""),
        ("pressure (hPa)", ""),
        ("gyro (left)", ""),
        ("a/b", ""),
    ],
)
def test_a_header_states_its_unit(header, unit):
    """Brackets, commas, lone slashes and last words that can be nothing else; anything else states
    none.
    """
    assert units.unit_in_header(header) == unit


def test_a_decimal_scale_means_its_digits():
    """Counts of 0.0001 are the float64 nearest to the product; a plain multiplication misses
    some.
    """
    counts = np.arange(100_000.0)
    exact = np.array([float(f"{count}e-4") for count in range(100_000)])
    assert np.array_equal(units.scaled(counts, 1e-4), exact)
    assert not np.array_equal(counts * 1e-4, exact)
    assert np.array_equal(units.scaled(counts, -2.5), counts * -2.5)
    assert np.array_equal(units.scaled(counts, np.pi * 1e-30), counts * (np.pi * 1e-30))


@pytest.mark.parametrize(
    ("source", "target", "factor"),
    [
        ("µg/h", "g/h", 1e-6),
        ("mm/s^2/h", "g/h", 1e-3 / 9.80665),
        ("ppm/°C", "1/degC", 1e-6),
        ("%/degF", "1/degC", 0.018),
        ("ppm/mg", "1/g", 1e-3),
        ("deg/h/h", "deg/s/s", 1.0 / 3600.0**2),
        ("°/h", "deg/s", 1.0 / 3600.0),
    ],
)
def test_uncertainties_convert_between_quotients_of_units(source, target, factor):
    """Differences, so that zeros of temperature scales do not matter."""
    assert units.difference_factor(source, target) == pytest.approx(factor, rel=1e-14)


@pytest.mark.parametrize(
    ("source", "target", "named"),
    [
        ("ug/s", "1/g", "state it in 1, %, ppm, ppb per g, mg, ug, m/s^2"),
        ("deg", "g/h", "state it in g, mg, ug, m/s^2, mm/s^2, cm/s^2 per h, s, ms, us, ns, min, d"),
        ("uu/h", "g/h", "did you mean|known units"),
    ],
)
def test_an_uncertainty_in_a_unit_of_another_kind_names_those_that_are_accepted(
    source, target, named
):
    """One line, whatever the kind."""
    with pytest.raises(RecipeError, match=named.replace("^", r"\^")) as refused:
        units.difference_factor(source, target)
    assert "\n" not in str(refused.value)
