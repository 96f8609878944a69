"""The lifting transform against PyWavelets, a loop-only twin, and the laws it must keep at every
length and end.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import pywt
from hypothesis import given, settings, strategies as st

from calibkit.errors import FitError
from calibkit.numeric.wavelet import lifting
from calibkit.numeric.wavelet.extension import Continuation, continue_signal
from calibkit.numeric.wavelet.factor import factor_bank
from calibkit.numeric.wavelet.lifting import EXTENSIONS, find_scheme, forward, inverse

INEXACT_TABLES = {
    *(f"sym{k}" for k in (*range(2, 9), *range(14, 21))),
    *(f"{kind}{order}" for kind in ("bior", "rbio") for order in ("4.4", "5.5", "6.8")),
}
"""Banks whose PyWavelets table itself misses perfect reconstruction by 2e-13 to 1.4e-11: lifting
steps always reconstruct, so they cannot equal such a table to more digits than it has (see
test_factor).
"""
BANKS = [
    *(f"db{k}" for k in range(1, 21)),
    *(f"sym{k}" for k in range(2, 21)),
    *(f"coif{k}" for k in range(1, 9)),
    *(name for name in pywt.wavelist(kind="discrete") if name.startswith(("bior", "rbio"))),
]
SOME = [
    "haar",
    "cdf53",
    "cdf97",
    "db2",
    "db4",
    "db9",
    "sym8",
    "sym13",
    "coif3",
    "bior3.5",
    "bior5.5",
    "rbio2.2",
]


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


@pytest.mark.parametrize("bank", BANKS)
def test_every_factored_bank_gives_the_coefficients_of_pywavelets_at_the_same_index(bank):
    """Details of three levels have PyWavelets' values, signs and indices, away from the ends."""
    signal = noise(1003)
    parts = forward(
        signal, factor_bank(bank), 3, extension="symmetric"
    )  # scheme("db2") is the hand-written one
    tolerance = 2e-11 if bank in INEXACT_TABLES else 1e-12  # of unit noise
    for ours, first, theirs in zip(
        parts.details, parts.first, interior_details(signal, bank, 3), strict=True
    ):
        index = np.flatnonzero(~np.isnan(theirs))
        index = index[index - first < ours.size]
        assert index.size > 30
        assert np.max(np.abs(ours[index - first] - theirs[index])) < tolerance * scale(bank)


def scale(bank):
    """Largest row sum of the bank's three-level analysis filters: short splines amplify noise, and
    rounding with it.
    """
    return max(1.0, np.sum(np.abs(pywt.Wavelet(bank).dec_lo)) ** 3)


@pytest.mark.parametrize(
    ("name", "bank", "tolerance"),
    [
        ("haar", "haar", 1e-13),
        ("cdf53", "bior2.2", 1e-13),
        ("db2", "db2", 1e-13),
        ("cdf97", "bior4.4", 1e-11),
    ],
)
def test_hand_written_schemes_equal_pywavelets_up_to_shift_and_sign(name, bank, tolerance):
    """One shift of the samples and one of each level line all details up with ± PyWavelets' (9/7:
    its table).
    """
    signal, levels = noise(700), 3
    parts = forward(signal, find_scheme(name), levels, extension="symmetric")
    ours = [detail[part][8:-8] for detail, part in zip(parts.details, parts.interior, strict=True)]
    misfits = []
    for offset in range(2**levels):
        theirs = interior_details(np.concatenate([np.zeros(offset), signal]), bank, levels)
        misfits.append(max(best_match(a, b) for a, b in zip(ours, theirs, strict=True)))
    assert min(misfits) < tolerance
    assert sorted(misfits)[1] > 1e-3


def best_match(ours, theirs):
    """Smallest over shifts and signs of the largest difference."""
    windows = np.lib.stride_tricks.sliding_window_view(theirs, ours.size)
    windows = windows[~np.isnan(windows).any(axis=1)]
    return min(np.min(np.max(np.abs(windows - sign * ours), axis=1)) for sign in (1.0, -1.0))


@pytest.mark.parametrize(
    "bank", ["db1", "db2", "db4", "db7", "coif2", "bior2.2", "bior3.3", "rbio3.5"]
)
@pytest.mark.parametrize(
    ("extension", "mode"), [("symmetric", "reflect"), ("antisymmetric", "antireflect")]
)
@pytest.mark.parametrize("length", [40, 41])
def test_one_level_equals_pywavelets_to_the_very_ends(bank, extension, mode, length):
    """Whole-sample reflections are PyWavelets' reflect and antireflect, for even and odd
    lengths.
    """
    signal = noise(length).cumsum()
    parts = forward(signal, factor_bank(bank), 1, extension=extension)
    approximation, detail = pywt.dwt(signal, bank, mode=mode)
    for ours, theirs in ((parts.approximation, approximation), (parts.details[0], detail)):
        low, high = max(parts.first[0], 0), min(parts.first[0] + ours.size, theirs.size)
        assert high - low >= (length + 1) // 2
        np.testing.assert_allclose(
            ours[low - parts.first[0] : high - parts.first[0]], theirs[low:high], rtol=0, atol=1e-12
        )


@pytest.mark.parametrize("bank", ["haar", "db4", "bior2.2", "coif2"])
def test_the_periodic_extension_gives_the_periodization_of_pywavelets(bank):
    """On 64 samples the details repeat with the period and equal PyWavelets' up to a cyclic
    shift.
    """
    signal = noise(64)
    parts = forward(signal, factor_bank(bank), 1, extension="periodic")
    ours = np.array([parts.details[0][(k - parts.first[0]) % 32] for k in range(32)])
    misfit = min(
        np.max(
            np.abs(
                np.roll(ours, k) - pywt.dwt(np.roll(signal, start), bank, mode="periodization")[1]
            )
        )
        for k in range(32)
        for start in (
            0,
            1,
        )  # PyWavelets begins at the odd samples where half the filter length is even
    )
    assert misfit < 1e-13


@pytest.mark.parametrize("name", SOME)
@pytest.mark.parametrize("extension", EXTENSIONS)
def test_a_loop_only_twin_gives_the_same_coefficients(name, extension):
    """Steps run one sample at a time on a dictionary of the extended signal give the same two
    levels.
    """
    signal, lifting_scheme = noise(23).cumsum(), find_scheme(name)
    parts = forward(signal, lifting_scheme, 2, extension=extension)
    reach = 400
    values = dict(
        enumerate(
            extended(signal, -reach, signal.size + reach, extension, window=6).tolist(),
            start=-reach,
        )
    )
    for level in (1, 2):
        approximation, detail = naive_level(values, lifting_scheme)
        values = approximation
        expected = [
            detail[parts.first[level - 1] + k] for k in range(parts.details[level - 1].size)
        ]
        np.testing.assert_allclose(parts.details[level - 1], expected, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(
        parts.approximation,
        [values[parts.first[1] + k] for k in range(parts.approximation.size)],
        rtol=1e-11,
    )


def extended(signal, start, stop, extension, window):
    """Samples start … stop − 1 of a signal and of what goes on beyond its ends."""
    return continue_signal(signal, start, stop, Continuation.fit(signal, extension, window))


def naive_level(values, lifting_scheme):
    """One analysis level on a dictionary index → value; indices whose neighbours are missing fall
    away.
    """
    p = lifting_scheme.parity
    channels = [
        {(k - p) // 2: v for k, v in values.items() if (k - p) % 2 == 0},
        {(k - p) // 2: v for k, v in values.items() if (k - p) % 2},
    ]
    for step in lifting_scheme.steps:
        target, source = channels[step.updates], channels[1 - step.updates]
        updated = {}
        for i, value in target.items():
            wanted = [i + step.first + k for k in range(len(step.taps))]
            if all(j in source for j in wanted):
                updated[i] = value + sum(
                    tap * source[j] for tap, j in zip(step.taps, wanted, strict=True)
                )
        channels[step.updates] = updated
    return tuple(
        {i - shift: gain * v for i, v in channel.items()}
        for channel, gain, shift in zip(
            channels, lifting_scheme.gains, lifting_scheme.shifts, strict=True
        )
    )


@settings(max_examples=250, deadline=None)
@given(
    length=st.integers(1, 400),
    levels=st.integers(1, 6),
    name=st.sampled_from(["haar", "cdf53", "cdf97", *BANKS]),
    extension=st.sampled_from(EXTENSIONS),
    seed=st.integers(0, 2**32 - 1),
)
def test_reconstruction_is_perfect_for_any_length_scheme_and_extension(
    length, levels, name, extension, seed
):
    """Synthesis returns the samples to 1e-12 of the largest, odd lengths and lengths below the
    filter included.
    """
    signal = np.random.default_rng(seed).normal(size=length).cumsum()
    rebuilt = inverse(forward(signal, find_scheme(name), levels, extension=extension))
    assert rebuilt.shape == signal.shape
    assert np.max(np.abs(rebuilt - signal)) < 1e-12 * np.max(np.abs(signal))


@pytest.mark.parametrize(
    ("name", "moments"),
    [
        *(
            ("haar", 1),
            ("cdf53", 2),
            ("cdf97", 4),
            ("db2", 2),
            ("db4", 4),
            ("db10", 10),
            ("sym5", 5),
            ("sym9", 9),
        ),
        *(("coif2", 4), ("bior1.3", 1), ("bior3.5", 3), ("rbio2.4", 4)),
    ],
)
def test_polynomials_below_the_vanishing_moments_leave_no_details(name, moments):
    """Interior details of every power below the number of vanishing moments are rounding; the next
    power's are not.
    """
    time = np.linspace(-1.0, 1.0, 801)
    size = {}
    for power in range(moments + 1):
        parts = forward(time**power, find_scheme(name), 2, extension="symmetric")
        size[power] = max(
            np.max(np.abs(d[i])) for d, i in zip(parts.details, parts.interior, strict=True)
        )
    largest = max(size[power] for power in range(moments))
    assert largest < 2e-11  # tables are good to a few 1e-12
    time = np.arange(48.0) - 23.5
    following = forward(time**moments, find_scheme(name), 1, extension="symmetric")
    assert np.min(np.abs(following.details[0][following.interior[0]])) > 0.01


@pytest.mark.parametrize("name", ["cdf53", "cdf97", "db2", "db4", "sym8", "coif1"])
@pytest.mark.parametrize("extension", ["antisymmetric", "trend"])
@pytest.mark.parametrize("length", [9, 64, 501])
def test_a_straight_line_has_no_details_even_at_its_ends(name, extension, length):
    """Both extensions that keep a linear trend continue it, so that two vanishing moments leave
    nothing.
    """
    line = 3.0 - 0.25 * np.arange(length)
    parts = forward(line, find_scheme(name), 3, extension=extension)
    assert (
        max(np.max(np.abs(detail)) for detail in parts.details) < 1e-9
    )  # of a line that spans up to 125


@pytest.mark.parametrize("extension", ["symmetric", "constant", "periodic"])
def test_the_other_extensions_break_a_straight_line_at_its_ends(extension):
    """The details at the ends are far above rounding, those of the interior are not."""
    line = 3.0 - 0.25 * np.arange(200)
    parts = forward(line, find_scheme("cdf97"), 3, extension=extension)
    assert max(np.max(np.abs(detail)) for detail in parts.details) > 0.1
    assert (
        max(np.max(np.abs(d[i])) for d, i in zip(parts.details, parts.interior, strict=True))
        < 1e-11
    )


def test_extensions_follow_their_definitions_over_several_reflections():
    """Values beyond the ends by hand: mirrored, reflected in the end point, held, repeated."""
    signal = np.array([1.0, 2.0, 5.0])
    expected = {
        "symmetric": [1, 2, 5, 2, 1, 2, 5, 2, 1, 2, 5],
        "antisymmetric": [-7, -6, -3, 0, 1, 2, 5, 8, 9, 10, 13],
        "constant": [1, 1, 1, 1, 1, 2, 5, 5, 5, 5, 5],
        "periodic": [5, 1, 2, 5, 1, 2, 5, 1, 2, 5, 1],
    }
    for extension, values in expected.items():
        # sample 0 is the fifth value, except that the periodic list is written from sample −4 too
        found = extended(signal, -4, 7, extension, window=2)
        np.testing.assert_array_equal(found, values, err_msg=extension)


def test_the_trend_extension_reflects_in_the_fitted_end_values():
    """Beyond each end stand the samples reflected in the value of the line through the window, by
    np.polyfit.
    """
    signal, window = 0.02 * np.arange(200.0) + noise(200), 60
    found = extended(signal, -10, 210, "trend", window)
    for end, beyond in ((signal, found[9::-1]), (signal[::-1], found[210:])):
        value = np.polyval(np.polyfit(np.arange(window), end[:window], 1), 0.0)
        np.testing.assert_allclose(beyond, 2.0 * value - end[1:11], rtol=0, atol=1e-12)


def test_the_trend_extension_fits_no_line_over_a_bend():
    """A drift that turns after 60 samples is fitted before the turn: the end value is right to 3
    standard errors.
    """
    turn, window = 60, 600
    time = np.arange(900.0)
    trend = np.where(time < turn, 0.2 * time, 0.2 * turn - 0.01 * (time - turn))
    errors, straight = [], []
    for seed in range(40):
        signal = trend + noise(900, seed=seed)
        at_minus_one = extended(signal, -1, 0, "trend", window)[0]
        errors.append((at_minus_one + signal[1]) / 2.0 - trend[0])
        straight.append(np.polyval(np.polyfit(time[:window], signal[:window], 1), 0.0) - trend[0])
    assert (
        np.sqrt(np.mean(np.square(errors))) < 0.8
    )  # 2 σ/√size at sizes of 16 to 60 is 0.5 to 0.26
    assert np.sqrt(np.mean(np.square(straight))) > 5.0


@pytest.mark.parametrize("name", SOME)
def test_only_coefficients_outside_the_interior_depend_on_the_extension(name):
    """Two extensions give bit-equal interior details and different ones outside."""
    signal = noise(900).cumsum()
    one, other = (
        forward(signal, find_scheme(name), 4, extension=e) for e in ("symmetric", "periodic")
    )
    for a, b, interior in zip(one.details, other.details, one.interior, strict=True):
        assert np.array_equal(a[interior], b[interior])
        assert interior.stop - interior.start > 0
    outside = [
        np.delete(d, np.arange(i.start, i.stop))
        for d, i in zip(one.details, one.interior, strict=True)
    ]
    others = [
        np.delete(d, np.arange(i.start, i.stop))
        for d, i in zip(other.details, one.interior, strict=True)
    ]
    if name != "haar":
        assert all(not np.array_equal(a, b) for a, b in zip(outside, others, strict=True))


@pytest.mark.parametrize("name", ["cdf97", "db4", "bior3.5"])
def test_blocks_leave_no_trace_in_the_result(name, monkeypatch):
    """Blocks of 64 pairs give bit for bit what one block gives, forwards and back."""
    signal = noise(3001)
    whole = forward(signal, find_scheme(name), 4, extension="trend")
    back = inverse(whole)
    monkeypatch.setattr("calibkit.numeric.wavelet.level.BLOCK", 64)
    monkeypatch.setattr(lifting, "CHUNK", 256)
    monkeypatch.setattr(lifting, "COARSEST", 3)
    cut = forward(signal, find_scheme(name), 4, extension="trend")
    assert all(np.array_equal(a, b) for a, b in zip(whole.details, cut.details, strict=True))
    assert np.array_equal(whole.approximation, cut.approximation)
    assert np.array_equal(back, inverse(cut))


@pytest.mark.parametrize("name", ["cdf97", "bior3.5"])
def test_details_shrunk_on_the_way_back_equal_those_shrunk_before(name, monkeypatch):
    """Level by level with its own threshold, block by block, to the last bit; the decomposition
    stays as it is.
    """
    signal = noise(20_000)
    before = forward(signal, find_scheme(name), 4, extension="trend")
    thresholds = (0.5, 1.0, 1.5, 2.0)
    kept = [detail.copy() for detail in before.details]
    shrunk = tuple(
        np.where(np.abs(d) > t, d, 0.0) for d, t in zip(before.details, thresholds, strict=True)
    )
    monkeypatch.setattr(lifting, "CHUNK", 1 << 10)
    monkeypatch.setattr("calibkit.numeric.wavelet.level.BLOCK", 100)
    found = inverse(
        before, lambda level, detail: np.where(np.abs(detail) > thresholds[level], detail, 0.0)
    )
    assert (found == inverse(dataclasses.replace(before, details=shrunk))).all()
    assert all((detail == copy).all() for detail, copy in zip(before.details, kept, strict=True))


def test_a_read_only_signal_is_accepted_and_left_alone():
    """A column of a pandas frame is read-only; the transform neither needs to write to it nor hands
    it out.
    """
    signal = noise(100)
    signal.flags.writeable = False
    before = signal.copy()
    parts = forward(signal, find_scheme("cdf97"), 2, extension="trend")
    parts.details[0][:] = 0.0
    assert np.array_equal(signal, before)
    assert inverse(parts).flags.writeable


@pytest.mark.parametrize(
    ("name", "suggestion"),
    [("cdf9/7", "cdf97"), ("sym21", "sym20"), ("Haar", "haar"), ("bior44", "bior4.4")],
)
def test_an_unknown_wavelet_is_refused_with_a_suggestion(name, suggestion):
    """The message names what was asked for and the nearest names there are."""
    with pytest.raises(FitError, match=f"unknown wavelet {name!r}.*did you mean.*{suggestion}"):
        find_scheme(name)


def test_a_wavelet_that_resembles_nothing_is_refused_with_examples():
    """Without a near name the hint lists usual ones; continuous wavelets are not accepted."""
    with pytest.raises(FitError, match=r"unknown wavelet '§§'.*use haar"):
        find_scheme("§§")
    with pytest.raises(FitError, match="unknown wavelet 'mexh'"):
        find_scheme("mexh")


@pytest.mark.parametrize(
    ("signal", "levels", "extension", "message"),
    [
        (np.zeros(0), 1, "symmetric", "cannot be transformed"),
        (np.zeros((2, 2)), 1, "symmetric", "cannot be transformed"),
        (np.zeros(5), 0, "symmetric", "over 0 levels"),
        (np.zeros(5), 1, "mirror", "unknown extension 'mirror'"),
    ],
)
def test_what_cannot_be_transformed_is_refused(signal, levels, extension, message):
    """Empty and two-dimensional signals, no levels and unknown extensions are errors with a
    reason.
    """
    with pytest.raises(FitError, match=message):
        forward(signal, find_scheme("haar"), levels, extension=extension)


def test_coefficients_of_another_length_are_refused():
    """Details or an approximation that lost an element cannot be turned back silently."""
    parts = forward(noise(50), find_scheme("cdf97"), 2, extension="symmetric")
    with pytest.raises(FitError, match="belong to 50 samples"):
        inverse(dataclasses.replace(parts, details=(parts.details[0][:-1], parts.details[1])))
    with pytest.raises(FitError, match="belong to 50 samples"):
        inverse(dataclasses.replace(parts, approximation=parts.approximation[1:]))
