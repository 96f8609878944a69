from __future__ import annotations

import GTC
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from calibkit.errors import FitError
from calibkit.numeric import gum
from calibkit.numeric.gum import UncertaintyComponent
from calibkit.recipe.type_b import TypeB
from fits.naive import sensitivities


def gauge_block():
    """Uncertainty budget of JCGM 100 example H.1, contributions in nm."""
    return [
        UncertaintyComponent("standard", 0.0, 25.0, "B", dof=18.0),
        UncertaintyComponent("difference", 0.0, 9.7, "A", dof=25.6),
        UncertaintyComponent("expansion difference", 0.0, 2.9, "B", dof=50.0),
        UncertaintyComponent("temperature difference", 0.0, 16.6, "B", dof=2.0),
    ]


def test_the_gauge_block_of_the_gum_has_its_published_uncertainty():
    """JCGM 100 H.1: u_c 32 nm with 16 effective degrees of freedom, k 2.92 and U 93 nm at 99 %."""
    result = gum.combine(gauge_block(), probability=0.99)
    assert round(result.standard_uncertainty) == 32
    assert int(result.effective_dof) == 16
    assert result.coverage_factor == pytest.approx(2.92, abs=0.005)
    assert result.expanded_uncertainty == pytest.approx(
        93.0, abs=0.7
    )  # nm; the GUM rounds u_c first


def impedance(inputs):
    """Resistance, reactance and impedance of JCGM 100 example H.2 from V, I and phase."""
    voltage, current, phase = np.moveaxis(np.asarray(inputs), -1, 0)
    return np.stack(
        [voltage / current * np.cos(phase), voltage / current * np.sin(phase), voltage / current],
        axis=-1,
    )


def impedance_inputs():
    """Estimates, standard uncertainties and covariance of V, I and phase of JCGM 100 table H.2."""
    estimate = np.array([4.9990, 19.661e-3, 1.04446])
    uncertainty = np.array([0.0032, 0.0095e-3, 0.00075])
    correlation = np.array([[1.0, -0.36, 0.86], [-0.36, 1.0, -0.65], [0.86, -0.65, 1.0]])
    return estimate, uncertainty, correlation


def test_the_impedance_of_the_gum_has_its_published_covariance():
    """JCGM 100 table H.3: 0.071, 0.295, 0.236 Ω, correlated −0.588, −0.485 and 0.993."""
    estimate, uncertainty, correlation = impedance_inputs()
    jacobian = sensitivities(impedance, estimate, uncertainty)
    covariance = gum.propagate(jacobian, correlation * np.outer(uncertainty, uncertainty))
    u = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(
        u, [0.071, 0.295, 0.236], atol=1.1e-3
    )  # Ω; the GUM's own inputs had more digits
    found = covariance / np.outer(u, u)
    np.testing.assert_allclose(
        [found[0, 1], found[0, 2], found[1, 2]], [-0.588, -0.485, 0.993], atol=6e-3
    )


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(st.floats(1e-9, 1e9), st.floats(-50.0, 50.0), st.floats(1.0, 200.0)),
        min_size=1,
        max_size=6,
    )
)
def test_independent_components_combine_as_in_gtc(parts):
    """The peer finds the same standard uncertainty, effective degrees of freedom and 95 % coverage
    factor.
    """
    components = [UncertaintyComponent("x", 1.0, u, "A", sensitivity=c, dof=v) for u, c, v in parts]
    peer = sum(c * GTC.ureal(1.0, u, v) for u, c, v in parts)
    if max(abs(u * c) for u, c, _ in parts) < 1e-60:  # the peer's fourth powers underflow
        return
    result = gum.combine(components, probability=0.95)
    assert result.standard_uncertainty == pytest.approx(GTC.uncertainty(peer), rel=1e-12)
    assert result.effective_dof == pytest.approx(GTC.dof(peer), rel=1e-9)
    whole = np.floor(result.effective_dof + 1e-9)
    assert result.coverage_factor == pytest.approx(GTC.reporting.k_factor(whole, 95), rel=1e-6)


def test_degrees_of_freedom_do_not_depend_on_the_unit():
    """Contributions of 1e-90 and 1e90 keep the eight effective degrees of freedom that they have in
    units of one.
    """
    for unit in (1e-90, 1.0, 1e90):
        parts = [UncertaintyComponent("x", 0.0, unit, "A", dof=4.0)] * 2
        assert gum.combine(parts).effective_dof == pytest.approx(8.0, rel=1e-12)
    assert (
        gum.combine([UncertaintyComponent("x", 0.0, 0.0, "A", dof=4.0)]).expanded_uncertainty == 0.0
    )


def test_correlated_components_combine_as_in_gtc():
    """An ensemble of three inputs with nine degrees of freedom beside an independent one of four
    agrees with the peer.
    """
    correlation = np.array([[1.0, 0.5, -0.3], [0.5, 1.0, 0.2], [-0.3, 0.2, 1.0]])
    ensemble = GTC.multiple_ureal([1.0, 2.0, 3.0], [0.1, 0.2, 0.3], 9)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        GTC.set_correlation(float(correlation[i, j]), ensemble[i], ensemble[j])
    peer = 2.0 * ensemble[0] - ensemble[1] + 0.5 * ensemble[2] + GTC.ureal(0.0, 0.15, 4)
    components = [
        UncertaintyComponent("a", 1.0, 0.1, "A", sensitivity=2.0, dof=9.0),
        UncertaintyComponent("b", 2.0, 0.2, "A", sensitivity=-1.0, dof=9.0),
        UncertaintyComponent("c", 3.0, 0.3, "A", sensitivity=0.5, dof=9.0),
        UncertaintyComponent("d", 0.0, 0.15, "A", dof=4.0),
    ]
    whole = np.eye(4)
    whole[:3, :3] = correlation
    result = gum.combine(components, correlation=whole)
    assert result.standard_uncertainty == pytest.approx(GTC.uncertainty(peer), rel=1e-12)
    assert result.effective_dof == pytest.approx(GTC.dof(peer), rel=1e-9)


def test_a_chain_of_correlations_is_one_group_with_its_fewest_degrees_of_freedom():
    """Inputs tied one to the next share the five degrees of freedom of the worst, an independent
    one keeps its own.
    """
    chain = np.eye(4)
    chain[0, 2] = chain[2, 0] = chain[2, 3] = chain[3, 2] = 0.4
    parts = [
        UncertaintyComponent(str(i), 0.0, 1.0, "A", dof=dof)
        for i, dof in enumerate((20.0, 1e9, 5.0, 50.0))
    ]
    result = gum.combine(parts, correlation=chain)
    tied = 3.0 + 2.0 * 0.8
    assert result.standard_uncertainty**2 == pytest.approx(tied + 1.0, rel=1e-12)
    assert result.effective_dof == pytest.approx(
        (tied + 1.0) ** 2 / (tied**2 / 5.0 + 1.0 / 1e9), rel=1e-12
    )


def test_expanded_intervals_cover_the_truth():
    """Two averages of 5 and 10 readings and a type B term: k u_c holds the truth in 95.45 ± 0.9 %
    of 4000 repetitions.
    """
    generator = np.random.default_rng(17)
    readings = [generator.normal(0.0, sigma, (4000, n)) for sigma, n in ((1.0, 5), (2.0, 10))]
    error = sum(part.mean(axis=1) for part in readings) + generator.normal(0.0, 0.3, 4000)
    scatter = np.stack(
        [part.std(axis=1, ddof=1) / np.sqrt(part.shape[1]) for part in readings], axis=1
    )
    inside = 0
    for i in range(4000):
        parts = [
            UncertaintyComponent("first", 0.0, scatter[i, 0], "A", dof=4.0),
            UncertaintyComponent("second", 0.0, scatter[i, 1], "A", dof=9.0),
            UncertaintyComponent("certificate", 0.0, 0.3, "B"),
        ]
        inside += abs(error[i]) < gum.combine(parts).expanded_uncertainty
    assert inside / 4000.0 == pytest.approx(0.9545, abs=0.009)


@pytest.mark.parametrize(
    ("dof", "factor"),
    [(1, 13.97), (2, 4.53), (3, 3.31), (4, 2.87), (5, 2.65), (8, 2.37), (10, 2.28), (20, 2.13)],
)
def test_coverage_factors_are_the_published_ones(dof, factor):
    """JCGM 100 table G.2 and EA-4/02 annex E print these for 95.45 %; fractions of a degree of
    freedom are dropped.
    """
    assert gum.coverage_factor(float(dof)) == pytest.approx(factor, abs=0.006)
    assert gum.coverage_factor(dof + 0.9) == gum.coverage_factor(float(dof))


def test_coverage_factor_is_two_from_thirty_degrees_of_freedom_on():
    """The factor is 2 exactly at 30 and beyond, Student's at 29.99, and the normal quantile for
    another probability.
    """
    assert gum.coverage_factor(30.0) == gum.coverage_factor(np.inf) == 2.0
    assert gum.coverage_factor(29.99) == pytest.approx(2.08997, abs=1e-5)
    assert gum.coverage_factor(np.inf, probability=0.95) == pytest.approx(1.959964, abs=1e-6)
    assert gum.coverage_factor(1.0 - 1e-12) == gum.coverage_factor(1.0)
    with pytest.raises(FitError, match="effective degrees of freedom"):
        gum.coverage_factor(0.9)
    with pytest.raises(FitError, match="effective degrees of freedom"):
        gum.coverage_factor(float("nan"))
    with pytest.raises(FitError, match="coverage probability"):
        gum.coverage_factor(10.0, probability=95.0)


@pytest.mark.parametrize(
    ("distribution", "divisor"), [("rectangular", 3.0), ("triangular", 6.0), ("arcsine", 2.0)]
)
def test_type_b_limits_become_standard_uncertainties(distribution, divisor):
    """Half-width a gives a/√3, a/√6 and a/√2 for rectangular, triangular and arcsine
    distributions.
    """
    term = TypeB(
        name="axes", quantity="alpha_deg", unit="deg", half_width=0.1, distribution=distribution
    )
    assert term.u == pytest.approx(0.1 / np.sqrt(divisor), rel=1e-12)


def test_four_rectangular_inputs_give_the_published_interval():
    """JCGM 101 9.2.3: the sum of four of unit variance has u 2.00 and the 95 % interval [−3.88,
    3.88].
    """
    inputs = np.sqrt(3.0) * np.random.default_rng(29).uniform(-1.0, 1.0, (400_000, 4))
    low, high = gum.shortest_interval(inputs.sum(axis=1))
    assert high - low == pytest.approx(2.0 * 3.88, abs=0.03)


def test_one_dominant_rectangular_input_gives_the_published_interval():
    """JCGM 101 9.2.4: with a fourth of ten times the width, the interval is [−17.0, 17.0]."""
    half_widths = np.sqrt(3.0) * np.array([1.0, 1.0, 1.0, 10.0])
    inputs = half_widths * np.random.default_rng(30).uniform(-1.0, 1.0, (400_000, 4))
    low, high = gum.shortest_interval(inputs.sum(axis=1))
    assert high - low == pytest.approx(34.0, abs=0.2)


def test_the_interval_of_a_skewed_result_is_the_shortest_of_its_distribution():
    """Exponential results: from zero to −ln 0.05."""
    low, high = gum.shortest_interval(np.random.default_rng(31).exponential(1.0, 400_000))
    assert low == pytest.approx(0.0, abs=0.004)
    assert high == pytest.approx(-np.log(0.05), rel=0.02)


def test_a_coverage_interval_holds_the_stated_share_of_the_trials():
    """Of 10,000 results 9501 lie between the bounds, both included."""
    results = np.random.default_rng(32).standard_normal(10_000)
    low, high = gum.shortest_interval(results)
    assert np.sum((results >= low) & (results <= high)) == 9501


def test_uncertainty_along_a_log_is_the_diagonal_of_the_full_propagation():
    """The same standard uncertainties without the square matrix, to rounding."""
    generator = np.random.default_rng(41)
    root = generator.standard_normal((4, 4))
    jacobian = generator.standard_normal((60, 4))
    expected = np.sqrt(np.diag(gum.propagate(jacobian, root @ root.T)))
    np.testing.assert_allclose(gum.uncertainty_along(jacobian, root @ root.T), expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("value", "uncertainty", "expected"),
    [
        (1.23456, 0.0996, ("1.23", "0.10")),
        (1.23456, 0.0994, ("1.235", "0.099")),
        (56789.0, 1234.0, ("56800", "1200")),
        (99.5, 0.995, ("99.5", "1.0")),
        (-0.0001, 0.05, ("0.000", "0.050")),
        (0.125, 0.125, ("0.13", "0.13")),
        (1e-7, 3.04e-9, ("0.0000001000", "0.0000000030")),
        (5.0, 9.96, ("5", "10")),
    ],
)
def test_values_are_rounded_to_two_digits_of_their_uncertainty(value, uncertainty, expected):
    """Two significant digits of the uncertainty, carry included, and the value to the same decimal
    place.
    """
    assert gum.rounded(value, uncertainty) == expected


@settings(max_examples=200, deadline=None)
@given(st.floats(-1e9, 1e9), st.floats(1e-9, 1e6))
def test_rounding_stays_within_half_a_place_and_repeats_itself(value, uncertainty):
    """Printed numbers differ by at most half of the last place, and print as themselves."""
    shown, short = gum.rounded(value, uncertainty)
    significant = short.replace(".", "").lstrip("0")
    place = float(short) / float(significant) if "." in short else 10.0 ** (len(short) - 2)
    assert abs(float(short) - uncertainty) <= 0.5000001 * place
    assert abs(float(shown) - value) <= 0.5000001 * place + 1e-15 * abs(value)
    assert gum.rounded(float(shown), float(short)) == (shown, short)
    if "." in short:
        assert len(significant) == 2


def test_degrees_of_freedom_of_a_combination():
    """Of one input its own; of independent ones after Welch and Satterthwaite; of correlated ones
    the fewest; an input that does not take part counts for nothing.
    """
    dof, free = np.array([3.0, 20.0]), np.diag([4.0, 1.0])
    assert gum.degrees_of_freedom(np.array([1.0, 0.0]), free, dof) == pytest.approx(3.0)
    both = gum.degrees_of_freedom(np.array([1.0, 2.0]), free, dof)
    assert both == pytest.approx(8.0**2 / (4.0**2 / 3.0 + 4.0**2 / 20.0))
    tied = np.array([[4.0, 1.0], [1.0, 1.0]])
    assert gum.degrees_of_freedom(np.array([1.0, 2.0]), tied, dof) == pytest.approx(3.0)
    assert gum.degrees_of_freedom(np.array([0.0, 2.0]), tied, np.array([0.0, 20.0])) == 20.0
    assert gum.degrees_of_freedom(np.array([1.0, 2.0]), tied, np.array([0.0, 20.0])) == 0.0


@settings(max_examples=200, deadline=None)
@given(
    st.lists(
        st.tuples(st.floats(1e-3, 1e3), st.sampled_from([1.0, 2.0, 3.0, 7.0, 29.5, np.inf])),
        min_size=2,
        max_size=7,
    )
)
def test_no_further_contribution_lowers_a_cautious_uncertainty(parts):
    """U of any selection is at most that of all; it is never below that of the GUM, and u and the
    degrees of freedom are those of the GUM.
    """
    components = [UncertaintyComponent("x", 0.0, u, "A", dof=dof) for u, dof in parts]
    whole, plain = gum.combine_cautiously(components), gum.combine(components)
    assert whole.expanded_uncertainty >= plain.expanded_uncertainty * (1.0 - 1e-12)
    assert whole.standard_uncertainty == plain.standard_uncertainty
    assert whole.effective_dof == plain.effective_dof
    for k in range(len(components)):
        fewer = gum.combine_cautiously([*components[:k], *components[k + 1 :]])
        assert whole.expanded_uncertainty >= fewer.expanded_uncertainty * (1.0 - 1e-12)


def test_fifteen_contributions_are_combined_cautiously_too():
    """Beyond twelve the smallest count as one; U holds the badly known one."""
    parts = [UncertaintyComponent("fit", 0.0, 0.003, "A", dof=1.0)]
    parts += [UncertaintyComponent("b", 0.0, 0.001, "B")] * 15
    assert gum.combine_cautiously(parts).expanded_uncertainty >= 0.0419
