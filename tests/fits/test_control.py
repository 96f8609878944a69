"""Control charts of individuals: whom they name, whom they don't, and how often they are wrong."""

import math

import numpy as np
import pytest

from calibkit.numeric import control
from conftest import slow_after

SIZES = (10, 17, 33, 150, 700)


@pytest.mark.parametrize("count", slow_after(1, SIZES))
def test_a_faultless_fleet_has_somebody_named_once_in_a_hundred(count):
    """Of many samples of normal values 1 % have a value beyond the limit, within 4 standard errors
    and the steps of the table.
    """
    rng = np.random.default_rng(count)
    samples = 8_000 if count < 100 else 4_000
    named = sum(
        bool(control.Control.chart(rng.standard_normal(count)).outliers) for _ in range(samples)
    )
    # between the table's counts, and for even counts, the rate is up to a third lower
    assert (
        0.006 - 4.0 * math.sqrt(0.006 / samples)
        < named / samples
        < 0.01 + 4.0 * math.sqrt(0.01 / samples)
    )


def test_the_lines_are_those_of_the_definition():
    """Centre is the median and sigma the MAD over the normal quantile 0.6745, by hand of seven
    values.
    """
    found = control.Control.chart(np.array([1.0, 2.0, 4.0, 7.0, 11.0, 16.0, 22.0]))
    assert found.centre == 7.0
    assert found.sigma == pytest.approx(
        5.0 / 0.6744897501960817, rel=1e-14
    )  # distances 0 3 4 5 6 9 15
    assert found.z[6] == pytest.approx(15.0 / found.sigma, rel=1e-14)
    assert math.isinf(found.limit)  # seven units are too few
    assert found.outliers == ()


def test_outliers_are_named_furthest_first_and_do_not_cover_for_one_another():
    """Five of twenty values 50 and 100 sigma off are named; mean and standard deviation would name
    none.
    """
    values = np.random.default_rng(3).standard_normal(20)
    values[[2, 5, 7, 11]] += 50.0
    values[13] -= 100.0
    assert control.Control.chart(values).outliers[0] == 13
    assert set(control.Control.chart(values).outliers) == {2, 5, 7, 11, 13}
    assert np.max(np.abs(values - values.mean())) / values.std(ddof=1) < control._limit(20)


def test_the_limit_falls_while_the_spread_gets_known_and_rises_with_the_number_of_chances():
    """Fewer than ten cannot judge; from ten on the limit falls to about 200 values and rises
    beyond.
    """
    limits = [control._limit(count) for count in (9, 10, 20, 50, 200, 1000, 10_000)]
    assert math.isinf(limits[0])
    assert limits[1] > limits[2] > limits[3] > limits[4] < limits[5] < limits[6]


def fleets(count, kind):
    """Values of a faultless fleet, their standard uncertainties and degrees of freedom."""
    rng = np.random.default_rng(count)
    normal, known = rng.standard_normal(count), np.full(count, np.inf)
    while True:
        normal = rng.standard_normal(count)
        if kind == "short logs":
            u = np.where(rng.random(count) < 0.05, 10.0, 1.0)
            yield u * normal, u, known
        elif kind == "unequal, and devices differ":
            u = np.exp(0.7 * rng.standard_normal(count))
            yield u * normal + rng.standard_normal(count), u, known
        elif kind == "few degrees of freedom":
            yield normal, np.sqrt(rng.chisquare(6, count) / 6.0), np.full(count, 6.0)
        elif kind == "noise":
            yield np.exp(0.3 * normal), np.zeros(count), known
        else:
            yield np.abs(normal), np.zeros(count), known


@pytest.mark.parametrize("count", [100, 1000])
@pytest.mark.parametrize(
    "kind",
    slow_after(
        1,
        [
            "short logs",
            "unequal, and devices differ",
            "few degrees of freedom",
            "noise",
            "absolute value",
        ],
    ),
)
def test_a_device_is_judged_by_its_own_uncertainty_and_figures_by_their_own_shape(count, kind):
    """Of faultless fleets with unequal uncertainties or a skewed figure at most 2 of 100 have
    somebody named, within 3 standard errors; by the spread of all alone, up to all of them.
    """
    samples, made = 250, fleets(count, kind)
    named = sum(bool(control.Control.chart(*next(made)).outliers) for _ in range(samples))
    assert named / samples < 0.02 + 3.0 * math.sqrt(0.02 / samples)


def test_the_ends_are_where_the_limit_is():
    """Values beyond an end are named and no others, of a skewed figure and of one with
    uncertainties.
    """
    rng = np.random.default_rng(5)
    values = np.exp(0.4 * rng.standard_normal(201))
    values[:20] *= np.geomspace(1.0, 1e3, 20)
    values[-10:] /= np.geomspace(1.0, 1e3, 10)
    for found in (control.Control.chart(values), control.Control.chart(values, np.full(201, 0.1))):
        low, high = found.ends
        beyond = set(np.flatnonzero((values < low) | (values > high)))
        assert set(found.outliers) == beyond
        assert 5 <= len(beyond) <= 30
