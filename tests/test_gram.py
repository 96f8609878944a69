"""Fits of many rows, block by block: digits, rank, memory, and what breaks silently elsewhere."""

import csv
import tracemalloc
from fractions import Fraction

import numpy as np
import pytest

from calibkit.errors import FitError
from calibkit.instruments.accelerometer.numeric import determination, k_factor
from calibkit.numeric import attitude
from calibkit.numeric.least_squares import fit, fold, gram, polynomial
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
    """Fit a polynomial in the memory of a block; its fit, raw coefficients and their covariance."""
    design, to_raw = polynomial.mapped_powers(abscissa, order)
    fit = fold.reduced(design, indication, names=[f"p{k}" for k in range(order + 1)])
    return fit, *polynomial.in_raw_powers(fit.coefficients, fit.covariance, to_raw)


def test_blocks_cover_the_rows_once():
    """Slices follow one another to the last row."""
    assert [(part.start, part.stop) for part in gram.blocks(10, 4)] == [(0, 4), (4, 8), (8, 10)]
    assert list(gram.blocks(0, 4)) == []


def test_a_polynomial_has_twelve_digits_of_the_exact_one():
    """Bias, slope and curvature of 30,000 integer readings agree with rational arithmetic to
    1e-12.
    """
    t, y = drifting()
    expected = exact(t, y, 2)
    assert folded_polynomial(t, y, 2)[1] == pytest.approx(expected, rel=1e-12)


def test_blocks_give_what_a_whole_factorisation_gives():
    """Coefficients, covariance, residuals, rms and condition equal those by QR to 1e-12, weights
    included.
    """
    rng = np.random.default_rng(1)
    X, w = rng.normal(size=(ROWS, 6)) + 0.5, rng.uniform(0.1, 10.0, ROWS)
    y = X @ rng.normal(size=6) + rng.normal(size=ROWS)
    for weights in (None, w):
        root = np.ones(ROWS) if weights is None else np.sqrt(w)
        q, r = np.linalg.qr(X * root[:, None])
        beta = np.linalg.solve(r, q.T @ (y * root))
        left = y - X @ beta
        inverse = np.linalg.inv(r)
        found = fit.linear(X, y, weights=weights)
        np.testing.assert_allclose(found.coefficients, beta, rtol=1e-12)
        square = np.sum((root * left) ** 2)
        np.testing.assert_allclose(
            found.covariance, inverse @ inverse.T * square / (ROWS - 6), rtol=1e-11, atol=1e-18
        )
        np.testing.assert_allclose(found.residuals, left, atol=1e-13)
        assert found.residual_rms == pytest.approx(np.sqrt(square / np.sum(root**2)), rel=1e-12)
        assert found.condition == pytest.approx(
            np.linalg.cond(r / np.linalg.norm(r, axis=0)), rel=1e-10
        )
        assert (found.dof, found.coefficients.size) == (ROWS - 6, 6)


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
        raw = fold.reduced(lambda part: x[part, None], y).coefficients
    else:
        found, raw, _ = folded_polynomial(x, y, order)
        middle, half = polynomial.middle_and_half(x)
        mapped = polynomial.to_raw_powers(-middle / half, 1.0 / half, order) @ expected
        np.testing.assert_allclose(
            found.coefficients, np.asarray(mapped, dtype=np.float64), rtol=1e-12
        )
        assert found.coefficients.size == order + 1
    np.testing.assert_allclose(raw, expected, rtol=10.0**-digits)


def test_a_term_that_lstsq_drops_without_a_word_is_kept():
    """Raw counts squared fall under lstsq's cut of eps · n; the curvature is right to 1e-9 here."""
    counts = np.linspace(0.0, 2.0**24, ROWS)
    X = np.vander(counts, 3, increasing=True)
    y = 5.0 + 1e-3 * counts - 2e-10 * counts**2
    _, _, rank, _ = np.linalg.lstsq(X, y, rcond=None)
    assert rank == 2
    _, raw, _ = folded_polynomial(counts, y, 2)
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
        lambda: fold.reduced(lambda part: X[part], y, names=("b0", "b1", "b2")),
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
    assert gram.solve(lambda part: X[part], X[:, 1]) is None
    with pytest.raises(FitError, match="first, third: rank 2 of 3"):
        fold.linear(lambda part: X[part], X[:, 1], names=("first", "second", "third"))


def test_ill_conditioned_rows_are_factorised_instead():
    """Powers of 20 … 40 to the fifth have a condition number of 1e7; exact readings come back to
    1e-7, as from the whole.
    """
    x = np.linspace(20.0, 40.0, ROWS)
    truth = (-0.5) ** np.arange(6)
    X = np.vander(x, 6, increasing=True)
    y = np.asarray(X.astype(np.longdouble) @ truth.astype(np.longdouble), dtype=np.float64)
    assert gram.solve(lambda part: X[part], y) is None
    assert fold.reduced(lambda part: X[part], y).coefficients == pytest.approx(truth, rel=1e-7)
    assert fit.linear(X, y).coefficients == pytest.approx(truth, rel=1e-7)


def test_small_residuals_under_a_large_mean_are_not_cancelled():
    """The residual rms of 1e-3 under readings of 1e9 is right to 1e-4, though squares differ by 24
    orders.
    """
    rng = np.random.default_rng(5)
    t = np.linspace(-1.0, 1.0, ROWS)
    noise = rng.normal(0.0, 1e-3, ROWS)
    found, _, _ = folded_polynomial(t, 1e9 + noise, 1)
    clean, _, _ = folded_polynomial(t, noise, 1)
    assert found.residual_rms == pytest.approx(clean.residual_rms, rel=1e-4)
    assert np.sqrt(found.covariance[1, 1]) == pytest.approx(
        np.sqrt(clean.covariance[1, 1]), rel=1e-4
    )


def test_a_sample_that_misleads_costs_a_pass_not_digits():
    """Rows that differ from every evenly spread one leave the fit as it is: the first guess is only
    that.
    """
    step = 1 + ROWS // gram.SAMPLE_ROWS
    rng = np.random.default_rng(6)
    X = rng.normal(size=(ROWS, 3))
    X[:, 2] = X[:, 0] + 1e-3 * X[:, 2]
    y = X @ [1.0, 2.0, 3.0] + rng.normal(0.0, 30.0, ROWS)
    for row, reading in (([1.0, 0.0, 0.0], 1e6), ([0.0, 0.0, 0.0], 0.0)):
        X[::step], y[::step] = row, reading
        q, r = np.linalg.qr(X)
        assert fit.linear(X, y).coefficients == pytest.approx(
            np.linalg.solve(r, q.T @ y), rel=1e-11
        )


def test_a_sample_of_nothing_leaves_the_residuals_their_digits():
    """Where the sampled rows are empty the sum of squares still is that of the noise, 1e-8 of the
    readings, to 1e-6.
    """
    rng = np.random.default_rng(6)
    X, noise = rng.normal(size=(ROWS, 3)), rng.normal(0.0, 1e-8, ROWS)
    y = X @ [1.0, 2.0, 3.0] + noise
    X[:: 1 + ROWS // gram.SAMPLE_ROWS], y[:: 1 + ROWS // gram.SAMPLE_ROWS] = 0.0, 0.0
    found = fit.linear(X, y)
    expected = np.sqrt(np.mean((y - X @ np.linalg.lstsq(X, y, rcond=None)[0]) ** 2))
    assert found.residual_rms == pytest.approx(expected, rel=1e-6)


def test_read_only_arrays_serve():
    """Arrays of pandas 3 are read-only; nothing is written into them, and the fit is the same."""
    t, y = drifting()
    expected = folded_polynomial(t, y, 2)[1]
    for array in (t, y):
        array.flags.writeable = False
    assert (folded_polynomial(t, y, 2)[1] == expected).all()
    assert (
        fit.linear(polynomial.powers(t, 2), y).coefficients
        == fit.linear(polynomial.powers(t.copy(), 2), y).coefficients
    ).all()


@pytest.mark.parametrize("place", [0, 1, ROWS // 2, ROWS - 1])
def test_a_value_that_is_not_finite_is_refused_wherever_it_stands(place):
    """One NaN among the rows, or one infinity, never becomes a coefficient."""
    t, y = drifting()
    for spoiled, value in ((t, np.nan), (y, np.inf)):
        spoiled = spoiled.copy()  # noqa: PLW2901 (the other stays whole)
        spoiled[place] = value
        X = polynomial.powers(t if spoiled[place] == np.inf else spoiled, 2)
        with pytest.raises(FitError, match="not finite"):
            fold.reduced(lambda part, X=X: X[part], y if np.isnan(value) else spoiled)


def test_memory_is_that_of_a_block():
    """A million rows are fitted in less than 4 MiB beyond themselves, half of one of their
    columns.
    """
    t, y = drifting(1_000_000)
    folded_polynomial(t[:ROWS], y[:ROWS], 2)
    tracemalloc.start()
    folded_polynomial(t, y, 2)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 4 << 20


def test_many_rows_on_one_cone_are_refused_as_few_are():
    """Which coefficients many dwells at one inclination leave open is said in the same words as of
    few.
    """

    def said(rows):
        turn = np.resize(np.linspace(-180.0, 170.0, 36), rows)
        reference = attitude.gravity_vector(np.full(rows, 60.0), turn)
        temperature = np.resize([-20.0, 25.0, 70.0, 125.0], rows)
        with pytest.raises(FitError) as refused:
            k_factor.require_determined(reference, temperature, (k_factor.KTerms(),) * 3)
        return str(refused.value).replace(f"{rows} dwells", "dwells"), refused.value.hint

    assert said(36 * 700) == said(36 * 4)


def test_levels_of_many_temperatures_are_those_of_a_search():
    """Looking levels up in cells gives what a binary search gives, also exactly on the openings and
    a rounding beside.
    """
    rng = np.random.default_rng(9)
    grid = np.round(rng.uniform(-40.0, 125.0, ROWS), 1)
    spread = rng.uniform(-40.0, 125.0, ROWS)
    for temperature, step in (
        (grid, 1.0),
        (grid, 0.1),
        (spread, 0.7),
        (np.nextafter(grid, np.inf), 0.3),
    ):
        ascending = np.sort(temperature)
        openings = [ascending[0]]
        for value in ascending:
            if value >= openings[-1] + step:
                openings.append(value)
        expected = np.searchsorted(openings, temperature, side="right") - 1
        assert (
            determination._level_numbers(np.array(openings), temperature, step) == expected
        ).all()
        assert determination.distinct_temperatures(temperature, step)[0].size == len(openings)
