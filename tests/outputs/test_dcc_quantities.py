"""Every number of a digital calibration certificate is in the unit that stands beside it: values,
uncertainties, intervals, conditions, lists and covariances, each in hand-computed SI values.
"""

import numpy as np
import pytest

from calibkit.certificate import dcc, dcc_results, dcc_xml as xml
from calibkit.certificate.dcc_units import dsi
from calibkit.certificate.results import GridTable, ListTable, Result, Uncertainty
from calibkit.certificate.run_files import AsFoundAsLeft, BeforeAfter
from calibkit.certificate.words import Words
from calibkit.records.coefficients import Coefficient, Model

pytest.importorskip("lxml")

NOTATION = dcc_results.Notation("en", 9.8)
"""English, and the local gravity [m/s²] of these certificates."""
ACCELERATION = r"\metre\second\tothe{-2}"
UNITS = [
    ("mg", 9.8e-3, ACCELERATION),
    ("ug/degC", 9.8e-6, rf"\kelvin\tothe{{-1}}{ACCELERATION}"),
    ("ppm", 1e-6, r"\one"),
    ("mdeg", 1e-3, r"\degree"),
    ("mrad", 1e-3, r"\radian"),
    ("rev/min", 360.0, r"\degree\minute\tothe{-1}"),
    ("mV/(deg/s)", 1e-3, r"\volt\degree\tothe{-1}\second"),
]
"""Unit of a coefficient file, how many of the certificate's unit it is, and that unit."""


def stated(expanded, standard=0.5):
    """Return an uncertainty in the unit of its result."""
    return Uncertainty((), standard, 50.0, 2.0, expanded, 0.9545)


def result(value, unit, **more):
    """Return a result in a unit."""
    return Result("stage.model.a", "a", Words("a"), value, unit, **more)


def made(macro, *arguments):
    """Return the element that a macro of the template makes."""
    template = dcc.templates().get_template("dcc_results.xml.j2")
    text = getattr(template.make_module(dcc.wording(NOTATION)), macro)(*arguments)
    names = " ".join(f'xmlns:{prefix}="{name}"' for prefix, name in xml.NAMES.items())
    return xml.etree().fromstring(f"<part {names}>{text}</part>")


def numbers(element, name):
    """Return the numbers of all `si:` elements of a name, in their order."""
    found = element.iter(f"{{{xml.SI}}}{name}")
    return [float(number) for one in found for number in one.text.split()]


def texts(element, name):
    """Return the texts of all `si:` elements of a name, in their order."""
    return [one.text for one in element.iter(f"{{{xml.SI}}}{name}")]


@pytest.mark.parametrize(("unit", "size", "spelling"), UNITS)
def test_a_result_and_its_expanded_uncertainty_are_converted(unit, size, spelling):
    """3 ± 0.25 of a unit, at a condition of 20 of the same unit."""
    at = (("input", 20.0, unit),)
    quantity = made("quantity", result(3.0, unit, uncertainty=stated(0.25), at=at))
    assert numbers(quantity, "value") == pytest.approx([3.0 * size, 20.0 * size], rel=1e-14)
    assert texts(quantity, "unit") == [spelling, spelling]
    assert numbers(quantity, "valueExpandedMU") == pytest.approx([0.25 * size], rel=1e-14)
    assert numbers(quantity, "coverageFactor") == [2.0]


@pytest.mark.parametrize(("unit", "size", "spelling"), UNITS)
def test_a_coverage_interval_is_converted(unit, size, spelling):
    """3 with the standard uncertainty 0.5 in the interval from 2 to 4.5 of a unit."""
    one = result(3.0, unit, uncertainty=stated(0.25), interval=(2.0, 4.5))
    quantity = made("quantity", one)
    assert texts(quantity, "unit") == [spelling]
    assert numbers(quantity, "value") == pytest.approx([3.0 * size], rel=1e-14)
    assert numbers(quantity, "valueStandardMU") == pytest.approx([0.5 * size], rel=1e-14)
    assert numbers(quantity, "intervalMin") == pytest.approx([2.0 * size], rel=1e-14)
    assert numbers(quantity, "intervalMax") == pytest.approx([4.5 * size], rel=1e-14)


@pytest.mark.parametrize(("unit", "size", "spelling"), UNITS)
def test_a_condition_and_its_standard_uncertainty_are_converted(unit, size, spelling):
    """An influence condition of 20 with u = 0.1 of a unit."""
    quantity = made("influence", "local_input", 20.0, unit, 0.1)
    assert numbers(quantity, "value") == pytest.approx([20.0 * size], rel=1e-14)
    assert texts(quantity, "unit") == [spelling]
    assert numbers(quantity, "valueStandardMU") == pytest.approx([0.1 * size], rel=1e-14)


@pytest.mark.parametrize(("unit", "size", "spelling"), UNITS)
@pytest.mark.parametrize("kind", ["list", "grid"])
def test_a_column_over_a_condition_is_converted(kind, unit, size, spelling):
    """1 and 3 of a unit with U = 0.25 and 0.5, at 10 and 20 of the same unit."""
    column = [
        result(value, unit, condition=f"{at:g}", uncertainty=stated(U), at=(("input", at, unit),))
        for value, U, at in ((1.0, 0.25, 10.0), (3.0, 0.5, 20.0))
    ]
    title = Words("a over the input")
    table = (
        ListTable(title, tuple(column))
        if kind == "list"
        else GridTable(
            title, Words("input"), (title,), (unit,), ("10", "20"), tuple((r,) for r in column)
        )
    )
    quantity = made("table", table)
    expected = np.array([10.0, 20.0, 1.0, 3.0]) * size
    assert numbers(quantity, "valueXMLList") == pytest.approx(expected, rel=1e-14)
    assert texts(quantity, "unitXMLList") == [spelling] * 2
    assert numbers(quantity, "valueExpandedMUXMLList") == pytest.approx(
        [0.25 * size, 0.5 * size], rel=1e-14
    )


def test_parameters_and_their_covariance_are_converted():
    """2 mg and 5 ppm/mg, u² = 9 mg² and 16 ppm²/mg², covariance 6 ppm, at 9.8 m/s²."""
    model = Model(
        "triad",
        "form/1",
        (Coefficient("b", 2.0, "mg", 3.0), Coefficient("c", 5.0, "ppm/mg", 4.0)),
        ((9.0, 6.0), (6.0, 16.0)),
        10,
        0.1,
        "g",
        {},
    )
    quantity = made("parameters", "accel", model)
    values, *covariance = (
        [float(v) for v in one.text.split()] for one in quantity.iter(f"{{{xml.SI}}}valueXMLList")
    )
    # 2 · 9.8e-3 m/s², 5 · 1e-6 / 9.8e-3 s²/m
    assert values == pytest.approx([0.0196, 5.102040816326531e-4], rel=1e-14)
    # 9 · 9.604e-5 m²/s⁴, 6e-6, 16 · (1e-6 / 9.8e-3)² s⁴/m²
    expected = [8.6436e-4, 6e-6, 6e-6, 1.6659725114535610e-7]
    assert [entry for (entry,) in covariance] == pytest.approx(expected, rel=1e-14)
    assert texts(quantity, "unitXMLList") == [
        rf"{ACCELERATION} \metre\tothe{{-1}}\second\tothe{{2}}",
        r"\metre\tothe{2}\second\tothe{-4}",
        r"\one",
        r"\one",
        r"\metre\tothe{-2}\second\tothe{4}",
    ]


@pytest.mark.parametrize(("unit", "size", "spelling"), UNITS)
def test_as_found_and_as_left_are_converted(unit, size, spelling):
    """A figure of a validation, 3 with U = 0.25 of a unit."""
    row = BeforeAfter("log.csv", Words("rms"), 3.0, 3.0, unit, 0.25, 2.0)
    states = dcc_results.split_states(AsFoundAsLeft((row,), (), (), (), (), ""))
    quantity = made("as_found_as_left", states)
    assert numbers(quantity, "value") == pytest.approx([3.0 * size] * 2, rel=1e-14)
    assert texts(quantity, "unit") == [spelling] * 2
    assert numbers(quantity, "valueExpandedMU") == pytest.approx([0.25 * size], rel=1e-14)


@pytest.mark.parametrize(
    ("prefixed", "whole", "size"),
    [
        ("ms", "s", 1e-3),
        ("ns", "s", 1e-9),
        ("mrad", "rad", 1e-3),
        ("mm", "m", 1e-3),
        ("mV", "V", 1e-3),
        ("ppm", "1", 1e-6),
        ("%", "1", 1e-2),
        ("rev", "deg", 360.0),
        ("mg", "g", 1e-3),
        ("ug", "g", 1e-6),
    ],
)
def test_a_part_of_a_unit_has_the_size_that_its_prefix_says(prefixed, whole, size):
    """Prefixes of the SI, parts of one, revolutions of 360°."""
    part, one = (
        dsi(prefixed).with_gravity(NOTATION.gravity),
        dsi(whole).with_gravity(NOTATION.gravity),
    )
    assert part.text == one.text
    assert part.factor / one.factor == pytest.approx(size, rel=1e-14)
