"""Fits of many rows, block by block: digits, rank, memory, and what breaks silently elsewhere."""

import csv
from fractions import Fraction

import numpy as np
import pytest

from calibkit.errors import FitError
from calibkit.numeric.least_squares import fit, polynomial
from conftest import NIST

ROWS = 30_000


def exact(t, y, order):
    """Least-squares polynomial of integers, in rational arithmetic."""
    t, y = [int(v) for v in t], [int(v) for v in y]
    moments, targets, power = [], [], [1] * len(t)
    for k in range(2 * order + 1):
        moments.append(sum(power))
        if k <= order:
            targets.append(sum(p * v for p, v in zip(power, y, strict=True)))
        power = [p * v for p, v in zip(power, t, strict=True)]
    rows = [
        [Fraction(moments[i + j]) for j in range(order + 1)] + [Fraction(targets[i])]
        for i in range(order + 1)
    ]
    for i in range(order + 1):
        rows[i] = [v / rows[i][i] for v in rows[i]]
        for k in range(order + 1):
            if k != i:
                rows[k] = [a - rows[k][i] * b for a, b in zip(rows[k], rows[i], strict=True)]
    return np.array([float(row[-1]) for row in rows])


def drifting(rows=ROWS, seed=0):
    """Seconds and counts of a drifting channel: integers, so that a rational reference exists."""
    t = np.arange(rows, dtype=np.float64)
    noise = np.random.default_rng(seed).normal(0.0, 200.0, rows)
    return t, np.round(8_000_000.0 + 30.0 * t - 2e-4 * t**2 + noise)


def folded_polynomial(abscissa, indication, order):
    """Fit a polynomial in the memory of a block; its mapped and its raw coefficients."""
    design, to_raw = polynomial.mapped_powers(abscissa, order)
    names = [f"p{k}" for k in range(order + 1)]
    coefficients = fit.linear_in_blocks(design, indication, names=names)
    return coefficients, np.asarray(to_raw @ coefficients, dtype=np.float64)


def test_a_polynomial_has_twelve_digits_of_the_exact_one():
    """Bias, slope and curvature of 30,000 integer readings agree with rational arithmetic to
    1e-12.
    """
    t, y = drifting()
    expected = exact(t, y, 2)
    assert folded_polynomial(t, y, 2)[1] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "order", "digits"),
    [
        ("norris", 1, 13),
        ("pontius", 2, 12),
        ("noint1", 0, 14),
        ("noint2", 0, 14),
        ("wampler1", 5, 9),
        ("wampler2", 5, 12),
    ],
)
def test_nist_sets_repeated_until_they_are_tall_keep_their_digits(name, order, digits):
    """A set measured many times over has the certified coefficients, twelve digits of them on
    mapped powers.
    """
    # In raw powers too, but for Wampler's first: its constant of 1 stands beside terms of 3
    # million.
    data = np.genfromtxt(
        NIST / f"linear_{name}.csv", delimiter=",", names=True, encoding="utf-8-sig"
    )
    with (NIST / "linear_certified_15digits.csv").open(encoding="utf-8") as opened:
        rows = [row for row in csv.DictReader(opened) if row["dataset"] == name]
    expected = np.array([float(row["estimate"]) for row in rows])
    times = 1 + ROWS // data.size
    x, y = np.tile(data["x"], times), np.tile(data["y"], times)
    if order == 0:
        raw = fit.linear_in_blocks(lambda part: x[part, None], y)
    else:
        found, raw = folded_polynomial(x, y, order)
        middle, half = polynomial.middle_and_half(x)
        mapped = polynomial.to_raw_powers(-middle / half, 1.0 / half, order) @ expected
        np.testing.assert_allclose(found, np.asarray(mapped, dtype=np.float64), rtol=1e-12)
        assert found.size == order + 1
    np.testing.assert_allclose(raw, expected, rtol=10.0**-digits)


def test_a_term_that_lstsq_drops_without_a_word_is_kept():
    """Raw counts squared fall under lstsq's cut of eps · n; the curvature is right to 1e-9 here."""
    counts = np.linspace(0.0, 2.0**24, ROWS)
    X = np.vander(counts, 3, increasing=True)
    y = 5.0 + 1e-3 * counts - 2e-10 * counts**2
    _, _, rank, _ = np.linalg.lstsq(X, y, rcond=None)
    assert rank == 2
    _, raw = folded_polynomial(counts, y, 2)
    assert raw == pytest.approx([5.0, 1e-3, -2e-10], rel=1e-9)
    assert fit.linear(X, y).coefficients == pytest.approx([5.0, 1e-3, -2e-10], rel=1e-9)


def test_normal_equations_of_a_static_record_are_refused():
    """Where temperature does not vary a plain normal equation returns a wrong bias; here the
    columns are named.
    """
    temperature = np.full(ROWS, 25.3)
    X = np.column_stack([np.ones(ROWS), temperature, temperature**2])
    y = 7.5 + np.random.default_rng(3).normal(0.0, 0.1, ROWS)
    for refused in (
        lambda: fit.linear_in_blocks(lambda part: X[part], y, names=("b0", "b1", "b2")),
        lambda: fit.linear(X, y, names=("b0", "b1", "b2")),
    ):
        with pytest.raises(FitError, match=r"cannot determine b0, b1, b2: rank 1 of 3"):
            refused()
    with pytest.raises(FitError, match=r"the abscissa is constant at 25\.3"):
        folded_polynomial(temperature, y, 2)


def test_columns_dependent_to_rounding_are_refused_not_guessed():
    """A column that is another one but for 1e-13 of it is no information, however many rows there
    are.
    """
    rng = np.random.default_rng(4)
    X = rng.normal(size=(ROWS, 3))
    X[:, 2] = X[:, 0] * (1.0 + 1e-13 * rng.normal(size=ROWS))
    with pytest.raises(FitError, match="first, third: rank 2 of 3"):
        fit.linear_in_blocks(lambda part: X[part], X[:, 1], names=("first", "second", "third"))


def test_ill_conditioned_rows_keep_their_digits():
    """Powers of 20 … 40 to the fifth have a condition number of 1e7; exact readings come back to
    1e-7, as from the whole.
    """
    x = np.linspace(20.0, 40.0, ROWS)
    truth = (-0.5) ** np.arange(6)
    X = np.vander(x, 6, increasing=True)
    y = np.asarray(X.astype(np.longdouble) @ truth.astype(np.longdouble), dtype=np.float64)
    assert fit.linear_in_blocks(lambda part: X[part], y) == pytest.approx(truth, rel=1e-7)
    assert fit.linear(X, y).coefficients == pytest.approx(truth, rel=1e-7)


def test_dependent_columns_are_refused_by_name():
    """The triangle knows what the rows leave open."""
    design = np.random.default_rng(2).normal(size=(5000, 3))
    design[:, 2] = design[:, 0] - design[:, 1]
    with pytest.raises(FitError, match="first, second, third"):
        fit.linear_in_blocks(
            lambda part: design[part], design[:, 0], names=("first", "second", "third")
        )
