"""The wavelet transform against PyWavelets, a loop-only twin, and the laws it must keep at every
length and end.
"""

from __future__ import annotations

import numpy as np
import pytest
import pywt
from hypothesis import given, settings, strategies as st

from calibkit.numeric.wavelet.denoise import EXTENSIONS
from calibkit.numeric.wavelet.lifting import LIFTING, find_wavelet
from fits.transforms import clean_details, extend_by, forward, inverse

BANKS = [name for name in pywt.wavelist(kind="discrete") if name != "dmey"]


def noise(size, seed=7):
    """Unit white noise."""
    return np.random.default_rng(seed).normal(size=size)


def interior_details(signal, bank, levels):
    """PyWavelets' details of each level, finest first, with NaN where its own extension was
    used.
    """
    count = pywt.Wavelet(bank).dec_len
    coefficients = pywt.wavedec(np.asarray(signal), bank, mode="zero", level=levels)[:0:-1]
    reach = [(count - 1) * (2**level - 1) for level in range(1, levels + 1)]
    out = []
    for level, (detail, lost) in enumerate(zip(coefficients, reach, strict=True), start=1):
        edge = lost // 2**level + 2
        kept = detail.copy()
        kept[:edge] = kept[-edge:] = np.nan
        out.append(kept)
    return out


@pytest.mark.parametrize(
    ("name", "tolerance"), [("haar", 1e-13), ("cdf53", 1e-13), ("db2", 1e-13), ("cdf97", 1e-11)]
)
def test_lifting_steps_equal_pywavelets_up_to_shift_and_sign(name, tolerance):
    """One shift of the samples and one of each level line all details up with ± PyWavelets' (9/7:
    its table ends there).
    """
    signal, levels = noise(700), 3
    ours = [detail[8:-8] for detail, _ in clean_details(signal, name, levels)]
    misfits = []
    for offset in range(2**levels):
        moved = np.concatenate([np.zeros(offset), signal])
        theirs = interior_details(moved, find_wavelet(name).bank, levels)
        misfits.append(max(best_match(a, b) for a, b in zip(ours, theirs, strict=True)))
    assert min(misfits) < tolerance
    assert sorted(misfits)[1] > 1e-3


def best_match(ours, theirs):
    """Smallest over shifts and signs of the largest difference."""
    windows = np.lib.stride_tricks.sliding_window_view(theirs, ours.size)
    windows = windows[~np.isnan(windows).any(axis=1)]
    return min(np.min(np.max(np.abs(windows - sign * ours), axis=1)) for sign in (1.0, -1.0))


@pytest.mark.parametrize("name", sorted(LIFTING))
def test_a_loop_only_twin_gives_the_same_coefficients(name):
    """Steps run one sample at a time on a dictionary of a level give the same two levels, wherever
    it has all neighbours; and those that it has are made of the values that the wavelet states.
    """
    known, wavelet = noise(80).cumsum(), find_wavelet(name)
    for _ in range(2):
        channels = naive_level(dict(enumerate(known.tolist())), wavelet)
        both = wavelet.analyse(known)
        for coefficients, expected in zip(both, channels, strict=True):
            index = sorted(expected)
            assert len(index) >= known.size // 2 - 4
            values = [expected[i] for i in index]
            np.testing.assert_allclose(coefficients[index], values, rtol=1e-11, atol=1e-11)
        inside = set(channels[0]) & set(channels[1])
        assert min(inside) == -(wavelet.reads[0] // 2)
        assert max(inside) == (known.size - 1 - wavelet.reads[1]) // 2
        known = both[0]


def naive_level(values, wavelet):
    """One analysis level on a dictionary index → value; indices whose neighbours are missing fall
    away.
    """
    channels = [{k // 2: v for k, v in values.items() if k % 2 == c} for c in (0, 1)]
    for step in wavelet.steps:
        source = channels[1 - step.updates]
        channels[step.updates] = {
            i: value + step.tap * sum(source[i + k] for k in step.offsets)
            for i, value in channels[step.updates].items()
            if all(i + k in source for k in step.offsets)
        }
    gains = wavelet.gain, 1.0 / wavelet.gain
    return [{i: g * v for i, v in c.items()} for c, g in zip(channels, gains, strict=True)]


@settings(max_examples=250, deadline=None)
@given(
    length=st.integers(1, 400),
    levels=st.integers(1, 6),
    name=st.sampled_from(["cdf53", "cdf97", *BANKS]),
    extension=st.sampled_from(EXTENSIONS),
    seed=st.integers(0, 2**32 - 1),
)
def test_reconstruction_is_perfect_for_any_length_wavelet_and_extension(
    length, levels, name, extension, seed
):
    """Synthesis returns the samples to 1e-9 of the largest (1e-12 with lifting steps, which undo
    themselves), odd lengths and lengths below the filter included.
    """
    signal = np.random.default_rng(seed).normal(size=length).cumsum()
    rebuilt = inverse(*forward(signal, name, levels, extension), name, length)
    assert rebuilt.shape == signal.shape
    tolerance = 1e-12 if name in LIFTING else 1e-9
    assert np.max(np.abs(rebuilt - signal)) < tolerance * np.max(np.abs(signal))


def test_extensions_follow_their_definitions():
    """Values beyond the ends by hand: mirrored, and reflected in the end point; a signal that is
    shorter than its extension is reflected again.
    """
    signal = np.array([1.0, 2.0, 5.0, 7.0])
    expected = {
        "symmetric": [5, 7, 5, 2, 1, 2, 5, 7, 5, 2, 1, 2],
        "antisymmetric": [-7, -5, -3, 0, 1, 2, 5, 7, 9, 12, 13, 14],
    }
    for extension, values in expected.items():
        np.testing.assert_array_equal(extend_by(signal, 4, extension), values, err_msg=extension)
