from __future__ import annotations

import dataclasses

import allantools
import numpy as np
import pytest
import pywt
from hypothesis import given, settings, strategies as st

from calibkit.errors import FitError
from calibkit.numeric.noise import allan, allan_fit, confidence
from calibkit.numeric.noise.allan_fit import LAWS, fit_noise
from conftest import slow_after

NBS_9_POINTS = np.array([892.0, 809.0, 823.0, 798.0, 671.0, 644.0, 883.0, 903.0, 677.0])
"""NBS Monograph 140 annex 8.E, as in NIST SP 1065 table 30."""


def nist_1000_points():
    """Frequency data of the 1000-point suite, generated as NIST SP 1065 section 12.4 says."""
    values, n = np.empty(1000), 1234567890
    for i in range(1000):
        values[i] = n / 2147483647.0
        n = 16807 * n % 2147483647
    return values


def naive_allan(rate, factor):
    """Overlapping Allan variance and number of whole pairs, one sample at a time."""
    square, pairs = 0.0, 0
    for start in range(len(rate) - 2 * factor + 1):
        first = [rate[k] for k in range(start, start + factor)]
        second = [rate[k] for k in range(start + factor, start + 2 * factor)]
        if any(value != value for value in first + second):  # noqa: PLR0124 - NaN is what differs from itself
            continue
        square += (sum(second) / factor - sum(first) / factor) ** 2
        pairs += 1
    return (square / (2 * pairs), pairs) if pairs else (None, 0)


def flicker(generator, samples, bias_instability):
    """Averaged 1/f noise of the given B [deg/h], eight times oversampled so that its Allan
    deviation is flat from τ₀ on.
    """
    fine = 8 * samples
    weights = np.cumprod(np.concatenate(([1.0], (np.arange(1, fine) - 0.5) / np.arange(1, fine))))
    spectrum = np.fft.rfft(weights, 2 * fine) * np.fft.rfft(
        generator.standard_normal(fine), 2 * fine
    )
    return bias_instability * np.fft.irfft(spectrum, 2 * fine)[:fine].reshape(samples, 8).mean(
        axis=1
    )


def record(generator, samples, interval_s, *, N=0.0, B=0.0, K=0.0, R=0.0, Q=0.0):
    """Rate [deg/h] averaged over each interval, with N deg/√h, B deg/h, K deg/h/√h, R deg/h/h and Q
    arcsec.
    """
    rate = N * 60.0 / np.sqrt(interval_s) * generator.standard_normal(samples)
    if K:
        step = K / 60.0 * np.sqrt(interval_s)
        steps = step * generator.standard_normal(samples)
        rate += (
            np.cumsum(steps)
            - steps / 2.0
            + step / np.sqrt(12.0) * generator.standard_normal(samples)
        )
    if B:
        rate += flicker(generator, samples, B)
    if Q:
        rate += np.diff(Q * generator.standard_normal(samples + 1)) / interval_s
    return rate + R / 3600.0 * interval_s * np.arange(samples)


def fitted_symbols(fit):
    """Letters of the observed terms."""
    return "".join(term.symbol for term in fit.terms)


def test_overlapping_deviation_gives_the_published_values_of_nbs_nine_points():
    """The nine points of NBS Monograph 140 give the deviations printed in NIST SP 1065 table 31."""
    curve = allan.overlapping(NBS_9_POINTS, 1.0, tau_s=[1.0, 2.0])
    np.testing.assert_allclose(curve.deviation, [91.22945, 85.95287], atol=5e-6)


def test_overlapping_deviation_gives_the_published_values_of_the_nist_suite():
    """The 1000-point suite gives the deviations printed in NIST SP 1065 table 32, to their last
    digit.
    """
    curve = allan.overlapping(nist_1000_points(), 1.0, tau_s=[1.0, 10.0, 100.0])
    np.testing.assert_allclose(curve.deviation, [2.922319e-1, 9.159953e-2, 3.241343e-2], atol=5e-9)


def test_degrees_of_freedom_agree_with_the_published_ones_of_the_nist_suite():
    """NIST SP 1065 prints 146.177 degrees of freedom at ten samples, by an empirical fit good to
    about one percent.
    """
    assert confidence.equivalent_dof(10, np.array([1000]), "angle_random_walk") == pytest.approx(
        146.177, rel=0.012
    )


@pytest.mark.parametrize("kind", ["white", "random walk", "differenced"])
def test_overlapping_deviation_equals_allantools(kind):
    """The peer gives the same deviations and pair counts, a large mean included."""
    white = np.random.default_rng(11).standard_normal(5000)
    rate = {
        "white": white,
        "random walk": np.cumsum(white),
        "differenced": np.diff(white, prepend=0.0),
    }[kind] + 1e4
    curve = allan.overlapping(rate, 0.1, spacing="decade", points=7)
    _, deviation, _, pairs = allantools.oadev(
        rate - 1e4, rate=10.0, data_type="freq", taus=curve.tau_s
    )
    np.testing.assert_allclose(curve.deviation, deviation, rtol=1e-10)
    np.testing.assert_array_equal(curve.pairs, pairs)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    samples=st.integers(8, 60),
    missing=st.integers(0, 6),
    factor=st.integers(1, 8),
)
def test_overlapping_deviation_with_gaps_equals_a_loop_over_samples(seed, samples, missing, factor):
    """A loop that looks at every pair of averages finds the same variance and the same whole
    pairs.
    """
    generator = np.random.default_rng(seed)
    rate = generator.standard_normal(samples) + 50.0
    rate[generator.integers(0, samples, missing)] = np.nan
    variance, pairs = naive_allan(rate, factor)
    if pairs == 0 or np.sum(~np.isnan(rate)) < 3:
        with pytest.raises(FitError):
            allan.overlapping(rate, 2.0, tau_s=[2.0 * factor])
        return
    curve = allan.overlapping(rate, 2.0, tau_s=[2.0 * factor])
    assert curve.pairs[0] == pairs
    assert curve.deviation[0] ** 2 == pytest.approx(variance, rel=1e-9, abs=1e-20)


def test_work_in_blocks_leaves_no_seam(monkeypatch):
    """Blocks of seven samples give what one block gives, gaps included, to the last digits."""
    rate = np.random.default_rng(5).standard_normal(1000) + 3.0
    rate[[100, 101, 612]] = np.nan
    whole = allan.overlapping(rate, 1.0)
    monkeypatch.setattr("calibkit.numeric.noise.allan.BLOCK", 7)
    np.testing.assert_allclose(allan.overlapping(rate, 1.0).deviation, whole.deviation, rtol=1e-12)


def test_a_ramp_shows_its_rate_over_the_square_root_of_two():
    """σ(τ) = R τ/√2 holds exactly, whatever the offset the ramp starts from."""
    curve = allan.overlapping(1e6 + 0.25 * np.arange(5000), 1.0)
    np.testing.assert_allclose(curve.deviation, 0.25 * curve.tau_s / np.sqrt(2.0), rtol=1e-9)


@pytest.mark.parametrize("noise", ["angle_random_walk", "bias_instability", "rate_random_walk"])
def test_degrees_of_freedom_agree_with_the_peer_where_sampling_is_fine(noise):
    """Greenhall and Riley's approximation in allantools agrees within 0.5 % from 64 samples an
    average on.
    """
    alpha = {"angle_random_walk": 0, "bias_instability": -1, "rate_random_walk": -2}[noise]
    for factor in (64, 200, 1000, 3000):
        peer = allantools.edf_greenhall(alpha, 2, factor, 10001, overlapping=True)
        assert confidence.equivalent_dof(factor, np.array([10000]), noise) == pytest.approx(
            peer, rel=0.005
        )


CASES = {
    "white": {"N": 0.01},
    "flicker": {"B": 0.1},
    "random walk": {"K": 0.1},
    "white, random walk from 60 s on": {"N": 0.01, "K": 1.1},
}


@pytest.mark.parametrize("case", slow_after(1, CASES))
@pytest.mark.parametrize("seed", [31, 32])
def test_confidence_limits_cover_the_truth(case, seed):
    """Limits stated for 95 % hold the true deviation in 92 to 99.9 % of 400 records at every
    averaging time, the last one of two whole averages included.
    """
    # the flicker is drawn at eight times the rate: its deviation is flat from the second octave on
    terms, generator = CASES[case], np.random.default_rng(seed)
    inside = 0.0
    for _ in range(400):
        curve = allan.overlapping(record(generator, 600, 1.0, **terms), 1.0)
        hours = curve.tau_s / 3600.0
        truth = np.sqrt(
            terms.get("N", 0.0) ** 2 / hours
            + 2.0 * np.log(2.0) / np.pi * terms.get("B", 0.0) ** 2
            + terms.get("K", 0.0) ** 2 * hours / 3.0
        )
        inside += (curve.lower < truth) & (truth < curve.upper)
    share = (inside / 400.0)[1 if case == "flicker" else 0 :]
    assert np.all((share >= 0.92) & (share <= 0.999)), share


@pytest.mark.parametrize("wavelet", slow_after(1, ["haar", "db2"]))
@pytest.mark.parametrize("case", slow_after(1, CASES))
def test_limits_of_the_wavelet_deviation_cover_its_mean(case, wavelet):
    """Limits stated for 95 % hold the mean variance of 300 records in at least 92 % of them at
    every averaging time; there are at most one and a half degrees of freedom for a block.
    """
    generator = np.random.default_rng(33)
    curves = [
        allan.wavelet_deviation(record(generator, 600, 1.0, **CASES[case]), 1.0, wavelet=wavelet)
        for _ in range(300)
    ]
    low, middle, high = (
        np.array([getattr(curve, edge) for curve in curves])
        for edge in ("lower", "deviation", "upper")
    )
    truth = np.sqrt(np.mean(middle**2, axis=0))
    share = np.mean((low < truth) & (truth < high), axis=0)
    assert np.all(share >= 0.92), share
    assert np.all(curves[0].dof <= 1.5 * 600.0 / curves[0].factor)


@pytest.mark.parametrize("symbol", ["Q", "N", "B", "K", "QNK"])
def test_noise_types_are_those_of_the_peer(symbol):
    """At every averaging time with 30 blocks and more the type is that of allantools' lag-1 test
    for frequency data, exponents below −2 counted as −2 and above 2 as 2.
    """
    value = {"Q": 1.0, "N": 0.002, "B": 0.1, "K": 0.3}
    generator = np.random.default_rng(46)
    rate = record(generator, 8192, 1.0, **{letter: value[letter] for letter in symbol})
    curve = allan.overlapping(rate, 1.0)
    for factor, noise in zip(curve.factor.tolist(), curve.noise, strict=True):
        if 8192 // factor >= 30:
            exponent = allantools.autocorr_noise_id(rate, factor, data_type="freq")[0]
            assert noise == confidence.TYPES[2 - min(max(exponent, -2), 2)], factor


def test_limits_of_a_noise_follow_from_chi_square():
    """With 5142.6 degrees of freedom of quantization the 95 % limits of the peer come out."""
    rate = np.diff(np.random.default_rng(1).standard_normal(10001))
    curve = allan.overlapping(rate, 1.0, tau_s=[1.0])
    low, high = allantools.confidence_interval(curve.deviation[0], curve.dof[0], ci=0.95)
    assert curve.dof[0] == pytest.approx(5142.607360543, rel=1e-9)
    assert (curve.lower[0], curve.upper[0]) == pytest.approx((low, high), rel=1e-9)


def test_bias_stability_is_the_standard_deviation_of_block_means():
    """A loop over blocks of ten and a hundred seconds finds the figures of GJB 2426A, blocks with a
    gap left out.
    """
    rate = np.random.default_rng(51).standard_normal(36_050) + 7.0
    rate[12_345] = np.nan
    for block_s, length in ((10.0, 100), (100.0, 1000)):
        means = [
            np.mean(rate[start : start + length]) for start in range(0, 36_050 - length + 1, length)
        ]
        means = [mean for mean in means if not np.isnan(mean)]
        figure = allan.bias_stability(rate, 0.1, block_s=block_s)
        middle = sum(means) / len(means)
        expected = (sum((mean - middle) ** 2 for mean in means) / (len(means) - 1)) ** 0.5
        assert figure.value == pytest.approx(expected, rel=1e-12)
        assert (figure.blocks, figure.block_s) == (len(means), pytest.approx(block_s))


def naive_detail_variance(rate, high_pass, low_pass, level):
    """√2-scaled variance of undecimated wavelet details that lie inside the record, by explicit
    equivalent filters.
    """
    equivalent = np.ones(1)
    for below in range(level):
        taps = high_pass if below == level - 1 else low_pass
        spread = np.zeros((len(taps) - 1) * 2**below + 1)
        spread[:: 2**below] = np.asarray(taps) / np.sqrt(2.0)
        equivalent = np.convolve(equivalent, spread)
    details = np.convolve(rate, equivalent, mode="valid")
    details = details[~np.isnan(details)]
    return 2.0 * np.mean(details**2), details.size


@pytest.mark.parametrize("wavelet", ["db2", "db3", "sym4"])
def test_wavelet_deviation_equals_explicit_filters(wavelet):
    """Convolution with the equivalent filters of each level gives the same variance from the same
    coefficients.
    """
    import pywt

    rate = np.random.default_rng(62).standard_normal(700)
    rate[[90, 400]] = np.nan
    bank = pywt.Wavelet(wavelet)
    curve = allan.wavelet_deviation(rate, 1.0, wavelet=wavelet)
    for level, (deviation, count) in enumerate(
        zip(curve.deviation, curve.pairs, strict=True), start=1
    ):
        variance, expected = naive_detail_variance(rate, bank.dec_hi, bank.dec_lo, level)
        assert (deviation**2, count) == (pytest.approx(variance, rel=1e-9), expected)


def test_haar_wavelet_deviation_is_the_allan_deviation():
    """√2 times the Haar wavelet deviation equals the overlapping Allan deviation, gaps included."""
    rate = np.random.default_rng(61).standard_normal(3000) + 40.0
    rate[[200, 1500, 1501]] = np.nan
    wavelet = allan.wavelet_deviation(rate, 0.5, wavelet="haar")
    curve = allan.overlapping(rate, 0.5, tau_s=wavelet.tau_s)
    np.testing.assert_array_equal(wavelet.pairs, curve.pairs)
    np.testing.assert_allclose(wavelet.deviation, curve.deviation, rtol=1e-10)


@pytest.mark.parametrize(("wavelet", "degree"), [("db2", 1), ("db3", 2)])
def test_wavelet_deviation_ignores_the_drift_it_is_said_to_ignore(wavelet, degree):
    """A drift of 1000 deg/h over the record changes nothing up to the wavelet's degree, and much
    beyond it.
    """
    noise = np.random.default_rng(63).standard_normal(4096)
    time = np.linspace(0.0, 1.0, 4096)
    plain = allan.wavelet_deviation(noise, 1.0, wavelet=wavelet).deviation
    blind = allan.wavelet_deviation(noise + 1000.0 * time**degree, 1.0, wavelet=wavelet).deviation
    seen = allan.wavelet_deviation(
        noise + 1000.0 * time ** (degree + 1), 1.0, wavelet=wavelet
    ).deviation
    np.testing.assert_allclose(blind, plain, rtol=1e-4)
    assert seen[-1] > 10.0 * plain[-1]


def test_records_without_a_deviation_are_refused():
    """Too few, infinite or unevenly asked samples raise with a reason."""
    white = np.random.default_rng(71).standard_normal(100)
    with pytest.raises(FitError, match="fewer than three"):
        allan.overlapping(np.array([1.0, np.nan, 2.0]), 1.0)
    with pytest.raises(FitError, match="infinite"):
        allan.overlapping(np.array([1.0, np.inf, 2.0, 3.0]), 1.0)
    with pytest.raises(FitError, match="interval"):
        allan.overlapping(white, 0.0)
    with pytest.raises(FitError, match="averaging times"):
        allan.overlapping(white, 1.0, tau_s=[1.0, 51.0])
    with pytest.raises(FitError, match="averaging times"):
        allan.overlapping(white, 1.0, tau_s=[0.2])
    with pytest.raises(FitError, match="averaging times"):
        allan.overlapping(np.where(np.arange(100) % 2, np.nan, white), 1.0, tau_s=[1.0])
    with pytest.raises(FitError, match="no two whole neighbours"):
        allan.overlapping(np.where(np.arange(100) % 2, np.nan, white), 1.0)
    with pytest.raises(FitError, match="whole number of samples"):
        allan.bias_stability(white, 0.7)
    with pytest.raises(FitError, match="whole blocks"):
        allan.bias_stability(white, 1.0, block_s=100.0)
    with pytest.raises(FitError, match="too few"):
        allan.wavelet_deviation(white[:3], 1.0, wavelet="db2")
    with pytest.raises(FitError, match="no stretch without a gap"):
        allan.wavelet_deviation(np.where(np.arange(100) % 3, white, np.nan), 1.0, wavelet="db4")


def exact_curve(**terms):
    """A curve of 10⁷ samples whose deviations are the noise model itself."""
    curve = allan.overlapping(np.random.default_rng(81).standard_normal(300_000), 0.01)
    tau = 0.01 * 2.0 ** np.arange(22)
    N, B, K, R, Q = (terms.get(name, 0.0) for name in "NBKRQ")
    hours = tau / 3600.0
    variance = (
        N**2 / hours + 2.0 * np.log(2.0) / np.pi * B**2 + K**2 * hours / 3.0 + R**2 * hours**2 / 2.0
    )
    variance += 3.0 * (Q / tau) ** 2
    samples = 20_000_000
    return dataclasses.replace(
        curve,
        samples=samples,
        factor=2 ** np.arange(22),
        tau_s=tau,
        deviation=np.sqrt(variance),
        pairs=samples - 2 * 2 ** np.arange(22) + 1,
        noise=("angle_random_walk",) * 22,
        dof=1.5 * samples / 2.0 ** np.arange(22),
    )


def test_every_term_comes_back_from_its_own_curve_in_its_own_unit():
    """N in deg/√h, B in deg/h, K in deg/h/√h, R in deg/h/h, Q in arcsec come back to nine digits
    from exact deviations.
    """
    truth = {"N": 0.005, "B": 0.02, "K": 0.1, "R": 0.2, "Q": 0.05}
    for symbol, value in truth.items():
        fit = fit_noise(exact_curve(**{symbol: value}))
        assert fitted_symbols(fit) == symbol
        assert fit.terms[0].value == pytest.approx(value, rel=1e-9)
    units = {law.symbol: law.unit for law in LAWS}
    expected = {
        "Q": "arcsec",
        "N": "deg/sqrt(h)",
        "B": "deg/h",
        "K": "deg/h/sqrt(h)",
        "R": "deg/h/h",
    }
    assert units == expected


def test_values_scale_with_the_rate_and_with_time():
    """Twice the rate gives twice every value; four times the interval halves K's and doubles N's
    share of it.
    """
    rate = record(np.random.default_rng(82), 20_000, 1.0, N=0.01, K=1.0)
    once, twice = (
        fit_noise(allan.overlapping(rate, 1.0)),
        fit_noise(allan.overlapping(2.0 * rate, 1.0)),
    )
    slow = fit_noise(allan.overlapping(rate, 4.0))
    assert fitted_symbols(once) == fitted_symbols(twice) == fitted_symbols(slow) == "NK"
    assert [term.value for term in twice.terms] == pytest.approx(
        [2.0 * term.value for term in once.terms], rel=1e-6
    )
    expected = [2.0 * once.terms[0].value, once.terms[1].value / 2.0]
    assert [term.value for term in slow.terms] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(
    ("symbol", "value", "records"),
    slow_after(1, [("N", 0.01, 250), ("Q", 1.0, 120), ("K", 0.1, 120), ("B", 0.1, 50)]),
)
def test_a_record_of_one_noise_reports_that_noise_alone_and_covers_its_truth(
    symbol, value, records
):
    """At most 2 % report anything else; value ± 1.96 u holds the truth in 95 % of them within three
    standard deviations.
    """
    generator = np.random.default_rng(91)
    others, inside = 0, 0
    for _ in range(records):
        fit = fit_noise(allan.overlapping(record(generator, 3600, 1.0, **{symbol: value}), 1.0))
        others += fitted_symbols(fit) != symbol
        found = {term.symbol: term for term in fit.terms}
        inside += (
            symbol in found
            and abs(found[symbol].value - value) < 1.96 * found[symbol].standard_uncertainty
        )
    assert others <= 0.02 * records
    assert abs(inside / records - 0.95) < 3.0 * np.sqrt(0.95 * 0.05 / records)


@pytest.mark.slow
def test_uncertainty_of_a_long_record_is_the_scatter_of_repetitions():
    """Over 100 records the scatter of N agrees with its stated uncertainty within a quarter, its
    bias is below 0.7 of it.
    """
    generator = np.random.default_rng(93)
    terms = [
        fit_noise(allan.overlapping(record(generator, 6000, 1.0, N=0.01), 1.0)).terms[0]
        for _ in range(100)
    ]
    values = np.array([term.value for term in terms])
    stated = float(np.sqrt(np.mean([term.standard_uncertainty**2 for term in terms])))
    assert values.std(ddof=1) == pytest.approx(stated, rel=0.25)
    assert abs(values.mean() - 0.01) < 0.7 * stated


@pytest.mark.slow
def test_the_uncertainty_of_a_ramp_covers_its_truth():
    """Of 50 records with 5 deg/h/h of drift at least 43 hold it in value ± 1.96 u (95 % less three
    deviations).
    """
    generator = np.random.default_rng(5)
    inside = reported = 0
    for _ in range(50):
        fit = fit_noise(allan.overlapping(record(generator, 3600, 1.0, N=0.01, R=5.0), 1.0))
        found = {term.symbol: term for term in fit.terms}
        reported += "R" in found
        inside += (
            "R" in found and abs(found["R"].value - 5.0) < 1.96 * found["R"].standard_uncertainty
        )
    assert reported >= 45
    assert inside / reported >= 0.86


@pytest.mark.slow
def test_chance_occurs_as_often_as_it_says():
    """Ramps that random walks imitate with a stated probability of 1 % are met in at most 2 % of
    400 of them.
    """
    # A normal tail, which σ̂² of two degrees of freedom does not have, would meet them in 2.8 %.
    generator = np.random.default_rng(5)
    others = np.array([True, True, True, True, False])
    met = 0
    for _ in range(400):
        curve = allan.overlapping(record(generator, 600, 1.0, K=0.1), 1.0)
        met += allan_fit._Attempt(curve).chance(4, others) < 0.01
    assert met / 400.0 <= 0.02


def test_a_rise_that_walk_and_ramp_explain_alike_is_not_attributed():
    """A random walk that rises over the last octaves only has no number; all terms that explain the
    rise have one reason, which names them, and no other sentence speaks of them.
    """
    fits = [
        fit_noise(
            allan.overlapping(record(np.random.default_rng(seed), 10_000, 1.0, N=0.01, K=0.1), 1.0)
        )
        for seed in range(20)
    ]
    assert sum(fitted_symbols(fit) == "N" for fit in fits) >= 18
    named = 0
    for fit in fits:
        reasons = {term.symbol: term.reason for term in fit.not_observable}
        rising = [symbol for symbol, reason in reasons.items() if "cannot tell" in reason]
        named += "K" in rising
        assert all(f"shows {' or '.join(rising)};" in reasons[symbol] for symbol in rising)
        assert all("none of it" in reasons[symbol] for symbol in reasons if symbol not in rising)
        assert fit.flags == ()
    assert named >= 14


def test_averaging_times_that_a_filter_bends_are_left_out():
    """White noise behind a low-pass gives its N within 3 %, not the 0.6 of it that all averaging
    times would give.
    """
    rate = record(np.random.default_rng(96), 200_000, 0.1, N=0.01)
    filtered = np.convolve(rate, [0.25, 0.5, 0.25], mode="valid")
    fit = fit_noise(allan.overlapping(filtered, 0.1))
    found = {term.symbol: term for term in fit.terms}
    assert set(found) == {"N"}
    assert found["N"].value == pytest.approx(0.01, rel=0.03)
    assert abs(found["N"].value - 0.01) < 3.0 * found["N"].standard_uncertainty
    assert "left out" in fit.flags[0]


def test_a_curve_that_is_none_of_the_five_noises_reports_none_of_them():
    """A sinusoid as strong as the noise leaves no term, a reason for each and a flag."""
    rate = record(np.random.default_rng(97), 50_000, 1.0, N=0.01) + 0.3 * np.sin(
        2.0 * np.pi * np.arange(50_000) / 300.0
    )
    fit = fit_noise(allan.overlapping(rate, 1.0))
    assert fit.terms == ()
    assert {term.reason for term in fit.not_observable} == {
        "the five noise terms do not describe the curve"
    }
    assert fit.misfit > 10.0
    assert "no noise term reported" in fit.flags[0]


def test_curves_that_cannot_be_fitted_are_refused():
    """Another estimator's curve, five averaging times, and a rate that never changes raise with a
    reason.
    """
    white = np.random.default_rng(72).standard_normal(1000)
    with pytest.raises(FitError, match="wavelet db2"):
        fit_noise(allan.wavelet_deviation(white, 1.0))
    with pytest.raises(FitError, match="5 averaging times"):
        fit_noise(allan.overlapping(white[:60], 1.0))
    with pytest.raises(FitError, match="does not change"):
        fit_noise(allan.overlapping(np.full(1000, 3.0), 1.0))


@pytest.mark.parametrize("wavelet", ["haar", "db2", "db3", "sym4"])
def test_the_wavelet_deviation_is_that_of_the_stationary_transform(wavelet):
    """Levels, coefficients that count and variances are those of PyWavelets' undecimated transform,
    of a record with a gap.
    """
    rate = np.random.default_rng(4).normal(0.0, 1.0, 1024)
    rate[300:304] = np.nan
    curve = allan.wavelet_deviation(rate, 1.0, wavelet=wavelet)
    half = pywt.Wavelet(wavelet).dec_len // 2
    centred = np.nan_to_num(rate - np.nanmean(rate))
    details = pywt.swt(centred, wavelet, level=curve.factor.size, norm=True)[::-1]
    for factor, deviation, pairs, (_, detail) in zip(
        curve.factor, curve.deviation, curve.pairs, details, strict=True
    ):
        back, ahead = (2 * factor - 1) * (half - 1), (2 * factor - 1) * half
        seen = [
            detail[k]
            for k in range(back, 1024 - ahead)
            if np.isfinite(rate[k - back : k + ahead + 1]).all()
        ]
        assert len(seen) == pairs
        assert deviation == pytest.approx(np.sqrt(2.0 * np.mean(np.square(seen))), rel=1e-9)
