"""The denoiser: trends stay, noise goes, and ends are marked."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from calibkit.errors import FitError
from calibkit.numeric.wavelet.denoise import _shortest, denoise
from calibkit.numeric.wavelet.shrinkage import RULES, THRESHOLDS, noise_gains
from fits.transforms import forward, inverse

SIGMA = 0.6  # °/h at 1 Hz: 0.01 °/√h


def ramp_log(samples=2400, seed=5):
    """A ramp's drift [°/h] as two lagged exponentials and a slope, and the same with white
    noise.
    """
    time = np.arange(samples)
    trend = 2.0 * (1.0 - np.exp(-time / 250.0)) - 1.5 * time / samples + 0.8 * np.exp(-time / 400.0)
    return trend, trend + SIGMA * np.random.default_rng(seed).normal(size=samples)


def firm(thresholds):
    """What makes of details those to be used, by the default rule."""
    return lambda level, part: RULES["firm"](part, float(thresholds[level]))


def rms(values):
    """Root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def test_the_default_recovers_the_trend_of_a_noisy_ramp():
    """Noise of 0.6 °/h comes down to below 0.07 °/h over the whole ramp and 0.15 °/h over its last
    minutes.
    """
    trend, log = ramp_log()
    errors = [rms(denoise(ramp_log(seed=s)[1]).signal - trend) for s in range(8)]
    assert max(errors) < 0.075
    assert rms([denoise(ramp_log(seed=s)[1]).signal[-60:] - trend[-60:] for s in range(8)]) < 0.15
    assert rms(log - trend) > 0.55


@pytest.mark.parametrize("rule", sorted(RULES))
def test_a_straight_line_passes_unchanged_to_rounding(rule):
    """A linear drift of 5 °/h over a ramp keeps every sample, ends included, to 1e-12 °/h."""
    line = -2.0 + 5.0 * np.arange(1201) / 1200.0
    for extension in ("antisymmetric", "trend"):
        for wavelet in ("cdf53", "cdf97", "db4"):
            found = denoise(line, wavelet=wavelet, extension=extension, rule=rule)
            assert np.max(np.abs(found.signal - line)) < 1e-11


@pytest.mark.parametrize(("wavelet", "most"), [("cdf53", 30), ("cdf97", 62), ("db4", 62)])
def test_the_edge_mask_is_no_wider_than_the_reach_of_the_filters(wavelet, most):
    """The samples that do change under another extension come that close to the inner borders of
    the mask.
    """
    _, log = ramp_log(1500)
    changed = np.zeros(1500, dtype=bool)
    for seed in range(20):
        generator = np.random.default_rng(seed)
        kept = [generator.random(log.size // 2**j + 200) < 0.5 for j in (1, 2, 3)]

        def shrink(level, detail, kept=kept):
            return detail * kept[level][: detail.size]

        signals = [
            inverse(*forward(log, wavelet, 3, extension), wavelet, log.size, shrink)
            for extension in ("symmetric", "antisymmetric")
        ]
        changed |= signals[0] != signals[1]
    clear = np.flatnonzero(~denoise(log, wavelet=wavelet, levels=3, shifted=0).edge)
    assert not changed[clear].any()
    touched = np.flatnonzero(changed)
    assert clear[0] - touched[touched < 700].max() < most
    assert touched[touched > 800].min() - clear[-1] < most


@pytest.mark.parametrize("threshold", sorted(THRESHOLDS))
def test_noise_and_thresholds_are_reported_level_by_level_in_the_unit_of_the_signal(threshold):
    """Noise is σ times the level's gain within 4 standard errors of the MAD, and both figures scale
    with the signal.
    """
    log = SIGMA * np.random.default_rng(8).normal(size=20_000)
    found = denoise(log, wavelet="cdf53", levels=4, threshold=threshold)
    allowed = 4.0 * 1.17 / np.sqrt(20_000 / 2.0 ** np.arange(1, 5))
    assert np.all(np.abs(found.noise / (SIGMA * noise_gains("bior2.2", 4)) - 1.0) < allowed)
    scaled = denoise(8.0 * log, wavelet="cdf53", levels=4, threshold=threshold)
    assert np.array_equal(scaled.noise, 8.0 * found.noise)
    np.testing.assert_allclose(scaled.thresholds, 8.0 * found.thresholds, rtol=1e-13)
    assert found.noise.size == found.thresholds.size == 4


@pytest.mark.parametrize(
    ("wavelet", "levels", "length"), [("cdf97", 6, 509), ("haar", 7, 128), ("db4", 3, 56)]
)
def test_a_ramp_shorter_than_the_filter_is_refused_with_found_and_needed(wavelet, levels, length):
    """The shortest length passes; one sample less is an error that states both numbers."""
    assert _shortest(wavelet, levels) == length
    _, log = ramp_log(length)
    assert denoise(log, wavelet=wavelet, levels=levels).signal.size == length
    with pytest.raises(
        FitError, match=f"{length - 1} samples are shorter than the filter: .* needs {length}"
    ) as error:
        denoise(log[1:], wavelet=wavelet, levels=levels)
    assert error.value.exit_code == 3


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"threshold": "univers"}, "unknown threshold 'univers'; did you mean 'universal'"),
        ({"rule": "gentle"}, "unknown shrinkage rule 'gentle'; use one of soft, hard"),
        ({"wavelet": "cdf79"}, "unknown wavelet 'cdf79'"),
        ({"extension": "mirror"}, "unknown extension 'mirror'"),
        ({"levels": 0}, "0 levels"),
    ],
)
def test_unknown_choices_are_refused(keywords, message):
    """Every name is checked and the error says which one is meant."""
    with pytest.raises(FitError, match=message):
        denoise(ramp_log(600)[1], **keywords)


def test_a_sample_that_is_not_finite_is_refused_with_its_place():
    """One NaN would spread over a whole filter: count and first place are told."""
    _, log = ramp_log(900)
    log[[123, 400]] = np.nan, np.inf
    with pytest.raises(FitError, match="2 of 900 samples are not finite, the first is sample 123"):
        denoise(log)


@given(
    wavelet=st.sampled_from(["haar", "cdf53", "cdf97", "db2", "db4", "bior3.5"]),
    size=st.integers(200, 3000),
)
@settings(max_examples=30, deadline=None)
def test_the_published_scheme_is_a_decimated_transform_there_and_back(wavelet, size):
    """Without shifts."""
    signal = np.random.default_rng(size).normal(size=size).cumsum()
    got = denoise(signal, wavelet=wavelet, levels=2, shifted=0)
    shrink = firm(got.thresholds)
    coefficients = forward(signal, wavelet, 2, "trend")
    assert np.array_equal(got.signal, inverse(*coefficients, wavelet, size, shrink))


@pytest.mark.parametrize("wavelet", ["haar", "cdf97", "db4"])
def test_the_coarsest_levels_are_averaged_over_signals_that_begin_later(wavelet):
    """Away from the ends: eight transforms of five levels, each begun 2^2 samples later, with the
    thresholds of the first; noise and thresholds are those without shifts.
    """
    signal = np.random.default_rng(8).normal(size=3000).cumsum()
    found, first = (denoise(signal, wavelet=wavelet, levels=5, shifted=k) for k in (3, 0))
    shrink = firm(found.thresholds)
    each = [
        inverse(*forward(signal[k:], wavelet, 5), wavelet, 3000 - k, shrink)[800 - k :][:1000]
        for k in range(0, 32, 4)
    ]
    assert np.allclose(found.signal[800:1800], np.mean(each, axis=0), rtol=0.0, atol=1e-10)
    assert np.all(~found.edge[800:1800])
    assert np.array_equal(found.noise, first.noise)
    assert np.array_equal(found.thresholds, first.thresholds)
