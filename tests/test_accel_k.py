"""K-factor: scale factor, zero offset and cross-axis terms of a triad over temperature, ten
coefficients an axis.
"""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.stats import t

from calibkit.errors import FitError
from calibkit.instruments.accelerometer.numeric import determination, k_factor
from calibkit.numeric import attitude
from calibkit.numeric.least_squares import fit as least_squares, gram

AUTHORITY = json.loads((Path(__file__).parent / "authorities" / "accel_k.json").read_text())
ROWS = np.array(AUTHORITY["rows"])
TEMPERATURE, ANGLES, INDICATION = ROWS[:, 0], ROWS[:, 1:3], ROWS[:, 3:]
REFERENCE = attitude.gravity_vector(*ANGLES.T)
TRUTH = np.array([AUTHORITY["expected"][f"accel_{axis}"] for axis in "xyz"])
NOISE_G = 2e-5
NO_CROSS = (k_factor.KTerms(cross=False),) * 3


def corrected_by(k, indication, temperature):
    """Corrected components [n, 3] by K0 … K9 [3, 10]."""
    parts = [k_factor.columns(indication, temperature, i) @ k[i] for i in range(3)]
    return np.column_stack(parts)


def simulated(seed, *, truth=TRUTH, noise=NOISE_G, temperature=TEMPERATURE, reference=REFERENCE):
    """Indications of the K model with white noise."""
    rng = np.random.default_rng(seed)
    return k_factor.indications(truth, reference, temperature) + rng.normal(
        0.0, noise, reference.shape
    )


def grid(temperatures, angles):
    """Temperatures [n] and reference vectors [n, 3] of every attitude at every temperature."""
    angle = np.tile(np.array(angles, dtype=float), (len(temperatures), 1))
    return np.repeat(np.array(temperatures, dtype=float), len(angles)), attitude.gravity_vector(
        *angle.T
    )


def scores(fitted, truth=TRUTH):
    """Errors of the fitted coefficients over their standard uncertainties, all axes in one
    array.
    """
    parts = [
        (axis.coefficients - k)[list(axis.fitted)] / axis.standard_uncertainty[list(axis.fitted)]
        for axis, k in zip(fitted, truth, strict=True)
    ]
    return np.concatenate(parts)


@pytest.mark.parametrize("loss", ["least_squares", "robust"])
def test_published_coefficients_come_out_of_the_worked_example(loss):
    """All thirty coefficients are reproduced to 1e-9 of their own size, the tiny K3 and K7
    included.
    """
    for axis, expected in zip(
        k_factor.fit(INDICATION, TEMPERATURE, REFERENCE, loss=loss), TRUTH, strict=True
    ):
        np.testing.assert_allclose(axis.coefficients, expected, rtol=1e-10, atol=0.0)
        assert axis.suspects == ()


def test_correction_is_the_published_sum_term_by_term():
    """The corrected components equal the equation written out with loops and letters, and the
    reference.
    """
    twin = np.empty_like(INDICATION)
    for row, (temperature, indicated) in enumerate(zip(TEMPERATURE, INDICATION, strict=True)):
        x, y, z = indicated
        for axis, (own, first, second) in enumerate(((x, y, z), (y, z, x), (z, x, y))):
            K = TRUTH[axis]
            scale = sum(K[k] * temperature**k for k in range(4))
            zero = sum(K[4 + k] * temperature**k for k in range(4))
            twin[row, axis] = own * scale - zero - K[8] * first - K[9] * second
    corrected = corrected_by(TRUTH, INDICATION, TEMPERATURE)
    np.testing.assert_allclose(corrected, twin, atol=1e-15)  # g
    np.testing.assert_allclose(corrected, REFERENCE, atol=1e-14)  # g


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_indications_and_correction_undo_each_other(seed):
    """For any small K, correcting what the model indicates gives the reference back."""
    truth = np.random.default_rng(seed).normal(0.0, 1e-2, (3, 10)) * np.array(
        [1, 1e-2, 1e-4, 1e-6] * 2 + [1, 1]
    )
    truth[:, 0] += 1.0
    indicated = k_factor.indications(truth, REFERENCE, TEMPERATURE)
    np.testing.assert_allclose(
        corrected_by(truth, indicated, TEMPERATURE), REFERENCE, atol=1e-13
    )  # g


def test_scaled_temperature_keeps_the_design_well_conditioned():
    """The condition number is below 20 in mapped temperature and above a million in raw degrees."""
    raw = k_factor.columns(INDICATION, TEMPERATURE, 0)
    assert np.linalg.cond(raw) > 1e6
    assert all(axis.condition < 20.0 for axis in k_factor.fit(INDICATION, TEMPERATURE, REFERENCE))


@pytest.mark.parametrize(
    ("temperatures", "expected"), [((25,), 4), ((-20, 125), 6), ((-20, 50, 125), 8)]
)
def test_rank_grows_with_the_temperatures(temperatures, expected):
    """One temperature determines four coefficients of an axis, two determine six, three eight, four
    all ten.
    """
    few, many = grid(temperatures, ANGLES[:20]), grid((*temperatures, 0, 10, 20, 30), ANGLES[:20])
    assert least_squares.rank(k_factor.columns(few[1], few[0] / 100.0, 0)) == expected
    assert least_squares.rank(k_factor.columns(many[1], many[0] / 100.0, 0)) == 10


def test_three_temperatures_are_refused_by_name_with_reason_and_remedy():
    """The refusal names K3 and K7, counts temperatures, and the dwells that it proposes do
    determine all ten.
    """
    temperature, reference = grid((-20, 25, 125), ANGLES[:20])
    with pytest.raises(FitError) as refused:
        k_factor.fit(
            simulated(0, temperature=temperature, reference=reference), temperature, reference
        )
    message = refused.value.message
    assert "accel_x: K3, K7; accel_y: K3, K7; accel_z: K3, K7" in message
    assert "60 dwells at 3 distinct temperatures (-20, 25, 125 °C; order 3 needs 4)" in message
    added = [
        (float(level), float(tilt), float(roll))
        for level, spots in re.findall(
            r"([-\d.]+) °C at inclination/toolface ([^;]+)", refused.value.hint
        )
        for tilt, roll in re.findall(r"([-\d.]+)°/([-\d.]+)°", spots)
    ]
    assert len(added) in range(2, 7)
    extra = np.array(added)
    k_factor._require_determined(
        np.concatenate([reference, attitude.gravity_vector(extra[:, 1], extra[:, 2])]),
        np.concatenate([temperature, extra[:, 0]]),
        (k_factor.KTerms(),) * 3,
    )


@pytest.mark.parametrize(
    ("angles", "loose"),
    [
        ([(45, 0), (45, 120)], "accel_x: K8, K9"),
        ([(45, 0), (45, 120), (135, 0)], "accel_x: K8; accel_y: K9; accel_z: K9"),
        (
            [(45, roll) for roll in range(0, 360, 45)],
            "accel_x: K9; accel_y: K8; accel_z: K4, K5, K6, K7",
        ),
    ],
)
def test_sweeps_at_too_few_attitudes_are_refused_by_name(angles, loose):
    """A continuous sweep at two attitudes leaves two coefficients of x open, at three, or any on
    one cone, one.
    """
    temperature, reference = grid(np.linspace(-20.0, 125.0, 200), angles)
    with pytest.raises(FitError) as refused:
        k_factor.fit(
            simulated(0, temperature=temperature, reference=reference), temperature, reference
        )
    assert loose in refused.value.message
    assert "add dwells at -19." in refused.value.hint


def test_two_attitudes_and_a_sweep_determine_scale_and_zero():
    """Without cross-axis terms, two attitudes over a continuous sweep are enough, and the truth
    comes out.
    """
    truth = TRUTH.copy()
    truth[:, 8:] = 0.0
    temperature, reference = grid(np.linspace(-20.0, 125.0, 300), [(54.7, 45), (125.3, 225)])
    indicated = simulated(1, truth=truth, temperature=temperature, reference=reference)
    fitted = k_factor.fit(indicated, temperature, reference, terms=NO_CROSS)
    assert np.max(np.abs(scores(fitted, truth))) < 4.0
    assert fitted[0].fitted == tuple(range(8))


def test_a_chamber_that_wanders_about_its_set_point_is_one_temperature():
    """Scatter of 0.2 °C at one set point does not pass for four temperatures, however full it makes
    the matrix.
    """
    temperature, reference = grid((25.0,) * 5, ANGLES[:20])
    wandering = temperature + np.random.default_rng(3).uniform(-0.2, 0.2, temperature.size)
    assert least_squares.rank(k_factor.columns(reference, wandering - 25.0, 0)) == 10
    with pytest.raises(FitError, match="at 1 distinct temperatures"):
        k_factor.fit(simulated(0, temperature=wandering, reference=reference), wandering, reference)


def test_noise_of_the_indications_does_not_pass_for_attitudes():
    """Toolfaces at one inclination are refused although the noise makes the columns of the
    indications independent.
    """
    temperature, reference = grid(
        (-20, 25, 60, 90, 125), [(60, roll) for roll in range(0, 360, 30)]
    )
    indicated = simulated(4, temperature=temperature, reference=reference)
    assert least_squares.rank(k_factor.columns(indicated, temperature / 100.0, 0)) == 10
    with pytest.raises(FitError, match="accel_z: K4"):
        k_factor.fit(indicated, temperature, reference)


def test_logged_table_noise_does_not_pass_for_attitudes():
    """Toolfaces at one inclination stay one cone when the table's own scatter of 0.01° is logged
    with them.
    """
    temperature, reference = grid(
        (-20, 25, 60, 90, 125), [(60, roll) for roll in range(0, 360, 30)]
    )
    logged = np.tile([(60.0, roll) for roll in range(0, 360, 30)], (5, 1))
    logged = logged + np.random.default_rng(15).normal(0.0, 0.01, logged.shape)
    reference = attitude.gravity_vector(*logged.T)
    assert least_squares.rank(k_factor.columns(reference, temperature / 100.0, 2)) == 10
    with pytest.raises(FitError, match="accel_z: K4"):
        k_factor.fit(
            simulated(15, temperature=temperature, reference=reference), temperature, reference
        )


def test_lower_orders_fit_what_three_temperatures_can_say():
    """Orders lowered to 2 leave K3 and K7 at zero, without uncertainty, and fit the rest."""
    truth = TRUTH.copy()
    truth[:, [3, 7]] = 0.0
    temperature, reference = grid((-20, 25, 125), ANGLES[:20])
    indicated = simulated(5, truth=truth, temperature=temperature, reference=reference)
    fitted = k_factor.fit(indicated, temperature, reference, terms=(k_factor.KTerms(2, 2),) * 3)
    assert np.max(np.abs(scores(fitted, truth))) < 4.0
    assert all(axis.coefficients[3] == axis.standard_uncertainty[7] == 0.0 for axis in fitted)


def test_axes_can_have_terms_of_their_own():
    """One axis without cross-axis terms leaves the others theirs."""
    terms = (k_factor.KTerms(), k_factor.KTerms(1, 2, cross=False), k_factor.KTerms())
    fitted = k_factor.fit(simulated(6), TEMPERATURE, REFERENCE, terms=terms)
    assert [len(axis.fitted) for axis in fitted] == [10, 5, 10]
    assert fitted[1].fitted == (0, 1, 4, 5, 6)


def test_orders_beyond_the_cubic_are_refused():
    """The published model ends at the cubic."""
    with pytest.raises(FitError, match="scale order 4"):
        k_factor.KTerms(scale_order=4)


def test_every_coefficient_lies_within_four_uncertainties_and_the_residual_is_the_noise():
    """With 20 µg noise and exact angles all K are within 4 u and the residual rms within 5 % of the
    noise.
    """
    spots = [
        (0, 0),
        *((tilt, roll) for tilt in (30, 60, 90, 120, 150) for roll in range(0, 360, 45)),
        (180, 0),
    ]
    temperature, reference = grid((-20, -5, 10, 25, 45, 65, 85, 105, 125), spots)
    for seed in range(3):
        fitted = k_factor.fit(
            simulated(seed, temperature=temperature, reference=reference), temperature, reference
        )
        assert np.max(np.abs(scores(fitted))) < 4.0
        rms = np.sqrt(np.mean([axis.residual_rms**2 for axis in fitted]))
        assert rms == pytest.approx(NOISE_G, rel=0.05)


@pytest.mark.parametrize("loss", ["least_squares", "robust"])
def test_intervals_cover_the_truth(loss):
    """Over simulated sets the 95 % intervals cover 93 to 97 % of all coefficients."""
    count = {"least_squares": 60, "robust": 30}[loss]
    sets = [
        k_factor.fit(simulated(seed), TEMPERATURE, REFERENCE, loss=loss) for seed in range(count)
    ]
    covered = [np.abs(scores(fitted)) <= t.ppf(0.975, fitted[0].dof) for fitted in sets]
    assert 0.93 <= np.mean(covered) <= 0.97


def test_weights_by_dwell_noise_make_the_fit_better_and_honest():
    """Where half of the dwells are ten times noisier, weighting shrinks the errors and the
    intervals still hold.
    """
    noise = np.where(np.arange(len(ROWS)) % 2, NOISE_G, 10.0 * NOISE_G)[:, None]
    plain, weighted = [], []
    for seed in range(20):
        indicated = (
            simulated(seed, noise=0.0)
            + np.random.default_rng(seed).normal(0.0, 1.0, REFERENCE.shape) * noise
        )
        plain.append(scores(k_factor.fit(indicated, TEMPERATURE, REFERENCE)))
        fitted = k_factor.fit(indicated, TEMPERATURE, REFERENCE, weights=1.0 / noise[:, 0] ** 2)
        weighted.append(scores(fitted))
    ratio = (
        fitted[0].standard_uncertainty
        / k_factor.fit(indicated, TEMPERATURE, REFERENCE)[0].standard_uncertainty
    )
    assert np.all(ratio < 0.4)
    assert 0.93 <= np.mean(np.abs(weighted) < 1.97) <= 0.97


def test_weights_of_one_axis_leave_the_others_alone():
    """Weights [n, 3] are each axis's own."""
    indicated = simulated(8)
    weights = np.ones((len(ROWS), 3))
    weights[:60, 1] = 0.01
    plain, weighted = (
        k_factor.fit(indicated, TEMPERATURE, REFERENCE, weights=w) for w in (None, weights)
    )
    np.testing.assert_allclose(weighted[0].coefficients, plain[0].coefficients, rtol=1e-9)
    assert (
        np.max(
            np.abs(weighted[1].coefficients - plain[1].coefficients) / plain[1].standard_uncertainty
        )
        > 0.1
    )


def test_table_positions_that_are_wrong_alike_at_every_temperature_need_groups():
    """Errors shared by a position break the ordinary intervals; leaving out position by position
    mends them.
    """
    angles = [(tilt, roll) for tilt in (20, 55, 90, 125, 160) for roll in range(0, 360, 45)]
    temperature, reference = grid((-20, 25, 75, 125), angles)
    position = np.tile(np.arange(len(angles)), 4)
    covered = {"rows": [], "positions": []}
    for seed in range(25):
        rng = np.random.default_rng(seed)
        stood = np.tile(np.array(angles) + rng.normal(0.0, 0.01, (len(angles), 2)), (4, 1))
        indicated = simulated(
            seed, temperature=temperature, reference=attitude.gravity_vector(*stood.T)
        )
        for name, groups in (("rows", None), ("positions", position)):
            fitted = k_factor.fit(indicated, temperature, reference, groups=groups)
            covered[name].append(
                np.abs(scores(fitted))[[0, 4, 8, 9, 10, 14, 18, 19, 20, 24, 28, 29]] < 2.02
            )
    assert np.mean(covered["rows"]) < 0.85
    assert np.mean(covered["positions"]) > 0.91
    assert fitted[0].dof == len(angles) - 4


def test_stated_variance_of_the_correction_is_that_of_many_fits():
    """The variance of corrected components matches the scatter over repeated calibrations."""
    fits = [k_factor.fit(simulated(seed), TEMPERATURE, REFERENCE) for seed in range(60)]
    exact = k_factor.indications(TRUTH, REFERENCE, TEMPERATURE)
    scatter = np.var(
        [
            corrected_by(np.array([axis.coefficients for axis in f]), exact, TEMPERATURE)
            for f in fits
        ],
        axis=0,
    )

    def stated_variance(axes):
        variances = []
        for i, axis in enumerate(axes):
            design = k_factor.columns(exact, (TEMPERATURE - axis.middle) / axis.half, i)
            variances.append(np.einsum("ij,jk,ik->i", design, axis.mapped_covariance, design))
        return np.column_stack(variances)

    stated = np.mean([stated_variance(f) for f in fits], axis=0)
    assert np.mean(scatter / stated) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("size_g", [1e-4, 1e-3, 0.05, 1.0, 50.0])
def test_one_wild_dwell_in_a_hundred_moves_no_coefficient_by_its_uncertainty(size_g):
    """A spoilt dwell of any size is named and moves nothing by more than a standard uncertainty."""
    temperature, reference = grid((-20, -5, 10, 25, 45, 65, 85, 105, 125), ANGLES[:20])
    clean = simulated(10, temperature=temperature, reference=reference)
    untouched = k_factor.fit(clean, temperature, reference, loss="robust")
    rng = np.random.default_rng(11)
    for _ in range(3):
        spoilt = clean.copy()
        wild = rng.choice(len(clean), len(clean) // 100 + 1, replace=False)
        spoilt[wild] += size_g * rng.choice([-1.0, 1.0], (wild.size, 3))
        for before, after in zip(
            untouched, k_factor.fit(spoilt, temperature, reference, loss="robust"), strict=True
        ):
            moved = np.abs(after.coefficients - before.coefficients) / before.standard_uncertainty
            assert np.max(moved) < 1.0
            # five sigmas can still be noise, fifty cannot
            assert size_g < 1e-3 or set(wild.tolist()) <= set(after.suspects)


def test_a_dwell_with_a_mistyped_toolface_is_named():
    """A wrong reference, not a wrong indication, is found as well."""
    reference = REFERENCE.copy()
    reference[37] = attitude.gravity_vector(ANGLES[37, 0], ANGLES[37, 1] + 50.0)
    fitted = k_factor.fit(simulated(12), TEMPERATURE, reference, loss="robust")
    assert 37 in fitted[0].suspects
    assert 37 in fitted[1].suspects
    assert np.max(np.abs(scores(fitted))) < 4.0


def test_ten_dwells_for_ten_coefficients_are_refused():
    """Without a residual nothing judges the fit, and zero is no uncertainty."""
    with pytest.raises(FitError, match="10 dwells for 10 coefficients"):
        k_factor.fit(INDICATION[:10], TEMPERATURE[:10], REFERENCE[:10])


def test_long_logs_are_folded_without_losing_digits():
    """Thirty thousand rows, folded block by block, give the coefficients and covariance of one
    factorisation.
    """
    rng = np.random.default_rng(13)
    temperature = rng.uniform(-20.0, 125.0, 30_000)
    reference = attitude.gravity_vector(
        rng.uniform(0.0, 180.0, 30_000), rng.uniform(-180.0, 180.0, 30_000)
    )
    indicated = simulated(14, temperature=temperature, reference=reference)
    for i, axis in enumerate(k_factor.fit(indicated, temperature, reference)):
        design = k_factor.columns(indicated, (temperature - axis.middle) / axis.half, i)
        whole = least_squares.linear(design, reference[:, i])
        np.testing.assert_allclose(
            axis.mapped_coefficients, whole.coefficients, rtol=1e-10, atol=1e-15
        )
        np.testing.assert_allclose(axis.mapped_covariance, whole.covariance, rtol=1e-8, atol=1e-24)
        np.testing.assert_allclose(axis.residuals, whole.residuals, atol=1e-13)
        assert axis.dof == 29_990


def test_what_some_of_many_rows_determine_is_not_searched_in_all(monkeypatch):
    """A long sweep whose evenly spread rows determine every coefficient is condensed no further;
    one whose spread rows are all of one attitude is, and is accepted too.
    """
    times = 2500
    whole = np.tile(TEMPERATURE, times), np.tile(REFERENCE, (times, 1))
    condensed, condense = [], gram.condensed

    def counted(design, rows):
        condensed.append(rows)
        return condense(design, rows)

    monkeypatch.setattr(gram, "condensed", counted)
    k_factor.fit(simulated(1, temperature=whole[0], reference=whole[1]), *whole)
    assert not condensed
    step = 1 + len(whole[0]) // gram.SAMPLE_ROWS
    alike = np.arange(len(whole[0])) % step == 0
    turned = whole[1].copy()
    turned[alike] = REFERENCE[0]
    k_factor.fit(simulated(1, temperature=whole[0], reference=turned), whole[0], turned)
    assert condensed == [len(whole[0])] * 3


def test_temperatures_a_step_apart_are_distinct_and_a_sweep_counts_its_steps():
    """Levels open a step above the last one, in any order of the rows, and each row is counted to
    one level.
    """
    levels, level = determination.distinct_temperatures(
        np.array([25.0, -20.0, 25.4, 60.0, -19.7]), 1.0
    )
    np.testing.assert_allclose(levels, [-19.85, 25.2, 60.0])
    np.testing.assert_allclose(level, [25.2, -19.85, 25.2, 60.0, -19.85])
    assert determination.distinct_temperatures(np.linspace(0.0, 100.0, 5001), 1.0)[0].size == 101
