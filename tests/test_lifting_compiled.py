"""The compiled lifting steps against those of arrays: the same bits for every scheme, length,
extension and rule.
"""

from __future__ import annotations

import contextlib
import dataclasses

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st

from calibkit import native
from calibkit.numeric.wavelet import lifting
from calibkit.numeric.wavelet.denoise import denoise
from calibkit.numeric.wavelet.factor import APPROXIMATION, DETAIL, Scheme, Step
from calibkit.numeric.wavelet.lifting import EXTENSIONS, find_scheme, forward, inverse
from calibkit.numeric.wavelet.shrinkage import RULES, Shrinkage

pytestmark = pytest.mark.skipif(native.kernels() is None, reason="no compiled kernels")

NAMED = [
    "haar",
    "cdf53",
    "cdf97",
    "db2",
    "db4",
    "db9",
    "db20",
    "sym8",
    "sym13",
    "coif3",
    "bior3.5",
    "bior5.5",
    "rbio2.2",
]
STEPS = st.builds(
    Step,
    st.sampled_from([APPROXIMATION, DETAIL]),
    st.integers(-4, 4),
    # few values, so that taps are equal and are joined
    st.lists(st.sampled_from([-0.5, 0.25, 1.0, 0.3]), min_size=1, max_size=5).map(tuple),
)
MADE_UP = st.builds(
    Scheme,
    st.just("made up"),
    st.lists(STEPS, min_size=1, max_size=5).map(tuple),
    st.tuples(*(st.sampled_from([0.7, 1.3, -2.0]),) * 2),
    st.integers(-2, 2),
    st.tuples(st.integers(-3, 3), st.integers(-3, 3)),
)
THREE_EQUAL = Scheme(
    "three equal taps",
    (Step(DETAIL, -1, (0.3, 0.3, 0.3)), Step(APPROXIMATION, 0, (0.5,))),
    (1.1, 0.9),
)
FAR_APART = Scheme(
    "wider than a block's room",
    (Step(DETAIL, -150, (0.3,)), Step(DETAIL, 150, (0.2,))),
    (1.1, 0.9),
)


@contextlib.contextmanager
def arrays_only():
    """Everything by arrays, as where nothing is compiled."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(native, "kernels", lambda: None)
        yield


def same_bits(one, other):
    """Equal to the last bit, signs of zeros among them; a NaN is any NaN."""
    one, other = np.asarray(one), np.asarray(other)
    lost = np.isnan(one)
    return np.array_equal(lost, np.isnan(other)) and one[~lost].tobytes() == other[~lost].tobytes()


def coefficients(signal, lifting_scheme, levels, extension, shrink):
    """All that a transform and its inverse give."""
    with np.errstate(all="ignore"):
        parts = forward(signal, lifting_scheme, levels, extension=extension)
        return parts.approximation, *parts.details, inverse(parts), inverse(parts, shrink)


def kind_of_signal(kind, size, seed):
    """Noise, counts of a coarse converter, or values at the ends of what a double holds."""
    rng = np.random.default_rng(seed)
    if kind == "noise":
        return rng.normal(size=size).cumsum()
    if kind == "counts":
        return np.round(rng.normal(size=size)) * rng.choice([-0.0, 1.0], size=size)
    return rng.choice([5e-324, -1e-310, 2.3e-308, 1e300, -1.7e308, 0.0, -0.0, 1.0], size=size)


@given(
    which=st.sampled_from(NAMED).map(find_scheme) | MADE_UP,
    size=st.integers(1, 40) | st.integers(1, 6000),
    levels=st.integers(1, 12),
    extension=st.sampled_from(EXTENSIONS),
    rule=st.sampled_from(sorted(RULES)),
    chunk=st.sampled_from([1 << 9, 1 << 18]),
    kind=st.sampled_from(["noise", "counts", "extremes"]),
    seed=st.integers(0, 99),
)
@example(FAR_APART, 5000, 2, "symmetric", "soft", 1 << 18, "noise", 1)
@example(THREE_EQUAL, 5000, 2, "trend", "firm", 1 << 18, "noise", 1)
@settings(max_examples=50, deadline=None)
def test_compiled_steps_give_the_bits_of_arrays(
    which, size, levels, extension, rule, chunk, kind, seed
):
    """Both ways give the same approximation, details, signal and shrunk signal, whatever the chunks
    are.
    """
    signal = kind_of_signal(kind, size, seed)
    thresholds = np.abs(np.random.default_rng(seed).normal(size=levels)).round(1)  # some are zero
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lifting, "CHUNK", chunk)
        patch.setattr(lifting, "COARSEST", min(lifting.COARSEST, chunk))
        found = coefficients(signal, which, levels, extension, Shrinkage(rule, thresholds))
        with arrays_only():
            plain = coefficients(signal, which, levels, extension, Shrinkage(rule, thresholds))
    assert all(same_bits(one, other) for one, other in zip(found, plain, strict=True))


@pytest.mark.parametrize("rule", sorted(RULES))
@pytest.mark.parametrize("threshold", [0.0, 5e-324, 1.0, 3.0e150, np.inf, np.nan])
def test_every_rule_gives_the_bits_of_arrays_at_its_corners(rule, threshold):
    """Details at, beside and far from the threshold, zeros of both signs, the smallest and the
    largest, infinite ones, NaN.
    """
    near = np.nextafter(threshold, [-np.inf, np.inf])
    corners = np.array(
        [0.0, 5e-324, 1e-310, 1.0, threshold, *near, 2.0 * threshold, 1.7e308, np.inf, np.nan]
    )
    detail = np.tile(np.concatenate([corners, -corners]), 3)
    parts = forward(np.zeros(2 * detail.size), find_scheme("haar"), 1, extension="symmetric")
    parts = dataclasses.replace(parts, details=(detail[: parts.details[0].size],))
    shrink = Shrinkage(rule, np.array([threshold]))
    with np.errstate(all="ignore"):
        found = inverse(parts, shrink)
        with arrays_only():
            plain = inverse(parts, shrink)
    assert same_bits(found, plain)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", NAMED)
def test_what_is_not_finite_spreads_over_the_same_coefficients(name, bad):
    """One NaN or infinity reaches the same coefficients; all others keep their bits."""
    signal = np.random.default_rng(4).normal(size=3001)
    signal[1400] = bad
    shrink = Shrinkage("firm", np.full(3, 0.5))
    found = coefficients(signal, find_scheme(name), 3, "symmetric", shrink)
    with arrays_only():
        plain = coefficients(signal, find_scheme(name), 3, "symmetric", shrink)
    assert any(not np.isfinite(part).all() for part in plain)
    assert all(same_bits(one, other) for one, other in zip(found, plain, strict=True))


def test_details_of_another_type_or_spacing_are_used_as_arrays_use_them():
    """Details in single precision, in the other byte order, spread out, at an odd address, or
    shrunk by any function.
    """
    parts = forward(
        np.random.default_rng(5).normal(size=3000), find_scheme("cdf97"), 2, extension="trend"
    )
    given_ = {
        "single": parts.details[0].astype(np.float32),
        "swapped": parts.details[0].astype(">f8"),
        "spread": np.repeat(parts.details[0], 2)[::2],
        "odd address": np.frombuffer(b"-" + parts.details[0].tobytes(), dtype=np.float64, offset=1),
    }
    for details in given_.values():
        changed = dataclasses.replace(parts, details=(details, parts.details[1]))
        for shrink in (None, lambda level, detail: detail * (level + 0.5)):
            found = inverse(changed, shrink)
            with arrays_only():
                assert same_bits(inverse(changed, shrink), found)


@pytest.mark.parametrize("size", [700, 300_001])
@pytest.mark.parametrize("wavelet", ["cdf97", "db4"])
def test_denoising_gives_the_bits_of_arrays(wavelet, size):
    """The denoised signal, its noise and its thresholds."""
    signal = np.random.default_rng(6).normal(size=size).cumsum()
    found = denoise(signal, wavelet=wavelet)
    with arrays_only():
        plain = denoise(signal, wavelet=wavelet)
    for field in ("signal", "noise", "thresholds"):
        assert same_bits(getattr(found, field), getattr(plain, field))


def test_the_compiled_steps_are_what_runs(monkeypatch):
    """Where kernels are in use, no lifting step is done by arrays."""

    def refused(*_args):
        raise AssertionError("lifted by arrays")

    monkeypatch.setattr("calibkit.numeric.wavelet.level._lift", refused)
    denoise(np.random.default_rng(7).normal(size=5000))
    with arrays_only(), pytest.raises(AssertionError, match="by arrays"):
        denoise(np.zeros(5000))
