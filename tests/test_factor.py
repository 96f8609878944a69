"""Filter banks factored into lifting steps: they multiply back to the bank and stay well
conditioned.
"""

from __future__ import annotations

import numpy as np
import pytest
import pywt

from calibkit.errors import FitError
from calibkit.numeric.wavelet import factor
from calibkit.numeric.wavelet.factor import LITERAL, _condition, factor_bank

SPLINES = [name for name in pywt.wavelist(kind="discrete") if name.startswith(("bior", "rbio"))]
BANKS = [
    *(f"db{k}" for k in range(1, 21)),
    *(f"sym{k}" for k in range(2, 21)),
    *(f"coif{k}" for k in range(1, 9)),
    *SPLINES,
]


def table_defect(bank):
    """How far PyWavelets' own table is from perfect reconstruction: Σ_k dec_lo[k] rec_lo[2m + c −
    k] against δ_m.
    """
    wavelet = pywt.Wavelet(bank)
    product = np.convolve(wavelet.dec_lo, wavelet.rec_lo)
    middle = int(np.argmax(np.abs(product)))
    every_other = product[middle % 2 :: 2].copy()
    every_other[np.argmax(np.abs(every_other))] -= 1.0
    return np.max(np.abs(every_other))


def filter_taps(rows):
    """Taps of the two analysis filters by sample offset, put together from polyphase rows by
    definition.
    """
    out = []
    for row in rows:
        taps = {}
        for odd, (low, values) in enumerate(row):
            for k, value in enumerate(values):
                taps[2 * (low + k) + odd] = value
        out.append(taps)
    return out


@pytest.mark.parametrize("bank", BANKS)
def test_the_steps_multiply_to_the_filters_of_the_bank(bank):
    """Every tap is the table's, to rounding or to the table's own distance from perfect
    reconstruction.
    """
    # PyWavelets' tables of sym2–8, sym14–20, bior/rbio4.4, 5.5 and 6.8 are printed to 12 digits or
    # fewer and miss perfect reconstruction by 2e-13 to 1.4e-11; steps reconstruct by construction,
    # so they cannot come closer than that.
    scheme, wavelet = factor_bank(bank), pywt.Wavelet(bank)
    for taps, table in zip(
        filter_taps(scheme.polyphase()), (wavelet.dec_lo, wavelet.dec_hi), strict=True
    ):
        expected = {1 - k - scheme.parity: tap for k, tap in enumerate(table)}
        worst = max(
            abs(taps.get(m, 0.0) - expected.get(m, 0.0)) for m in taps.keys() | expected.keys()
        )
        assert worst < 2.0 * table_defect(bank) + 2e-15


def test_only_the_tables_known_for_it_are_inexact():
    """The tables that miss perfect reconstruction by more than 1e-13 are the ones that the
    tolerances allow for.
    """
    inexact = {bank for bank in BANKS if table_defect(bank) > 1e-13}
    known = {f"sym{k}" for k in (*range(2, 9), *range(14, 21))}
    assert inexact == known | {
        f"{kind}{order}" for kind in ("bior", "rbio") for order in ("4.4", "5.5", "6.8")
    }


@pytest.mark.parametrize("bank", BANKS)
def test_the_steps_found_are_well_conditioned(bank):
    """The norms of steps and gains multiply to less than e⁸ = 3000, so that at most 4 of 16 digits
    can be lost.
    """
    assert _condition(factor_bank(bank)) < 8.0


@pytest.mark.parametrize("name", sorted(LITERAL))
def test_the_determinant_of_every_hand_written_scheme_is_one(name):
    """Steps have determinant 1 and the gains are reciprocal: nothing is scaled between signal and
    coefficients.
    """
    scheme = LITERAL[name]
    assert np.prod(scheme.gains) == pytest.approx(1.0, rel=1e-14)


def test_the_hand_written_cdf97_has_the_taps_of_bior44():
    """The steps multiply to PyWavelets' 9 and 7 taps to 6e-13, up to a shift and the sign of the
    details.
    """
    wavelet = pywt.Wavelet("bior4.4")
    for taps, table in zip(
        filter_taps(LITERAL["cdf97"].polyphase()), (wavelet.dec_lo, wavelet.dec_hi), strict=True
    ):
        found = np.array([taps[m] for m in sorted(taps)])
        expected = np.trim_zeros(np.array(table))
        sign = np.sign(found[0] * expected[0])
        np.testing.assert_allclose(sign * found, expected, rtol=0, atol=6e-13)


def best_condition(bank):
    """Best logarithmic condition number among the factorings that the search yields."""
    wavelet = pywt.Wavelet(bank)
    rows = [
        (factor._polyphase(wavelet.dec_lo, p), factor._polyphase(wavelet.dec_hi, p)) for p in (0, 1)
    ]
    return min(
        _condition(scheme) for p in (0, 1) for scheme in factor._factorings(bank, rows[p], p)
    )


def test_textbook_euclid_that_always_cancels_the_same_end_explodes(monkeypatch):
    """Polynomial division from one end gives db12 a condition number above 1e11 where the search
    finds 20.
    """
    every = factor._followers
    monkeypatch.setattr(factor, "_followers", lambda partial: list(every(partial))[-1:])
    textbook = best_condition("db12")
    monkeypatch.undo()
    assert textbook > np.log(1e11)
    assert best_condition("db12") < np.log(30.0)


def test_a_search_that_keeps_one_candidate_explodes(monkeypatch):
    """Taking the best next step only gives coif8 a condition number above 1e14 where the beam finds
    under 1000.
    """
    monkeypatch.setattr(factor, "BEAM", 1)
    greedy = best_condition("coif8")
    monkeypatch.undo()
    assert greedy > np.log(1e14)
    assert best_condition("coif8") < np.log(1000.0)


@pytest.mark.parametrize("bank", ["dmey", "db38"])
def test_a_bank_that_cannot_be_factored_well_is_refused_with_the_error_reached(bank):
    """The table of dmey does not reconstruct (2e-3); db38 needs more digits than doubles have."""
    with pytest.raises(
        FitError,
        match=rf"wavelet '{bank}' cannot be factored .* an error of \d\.\de[-+]\d+ at condition",
    ):
        factor_bank(bank)


def test_polishing_recovers_the_digits_that_divisions_by_small_taps_lose(monkeypatch):
    """Without it db13 comes out of Euclid with errors above 1e-13, with it only rounding is
    left.
    """
    polished = factor_bank.__wrapped__("db13")
    monkeypatch.setattr(factor, "POLISHINGS", 0)
    monkeypatch.setattr(factor, "ACCEPTED", 1e-8)
    raw, bank = factor_bank.__wrapped__("db13"), pywt.Wavelet("db13")
    rows = (factor._polyphase(bank.dec_lo, raw.parity), factor._polyphase(bank.dec_hi, raw.parity))
    assert factor._error(raw, rows) > 1e-13
    assert factor._error(polished, rows) < 1e-15


@pytest.mark.parametrize(("limit", "value"), [("ACCEPTED", 1e-18), ("WORST_CONDITION", 1.0)])
def test_each_of_the_two_limits_refuses_by_itself(monkeypatch, limit, value):
    """A good bank is refused once the limit on its error or on its condition number is set below
    what it reaches.
    """
    monkeypatch.setattr(factor, limit, value)
    with pytest.raises(FitError, match="'db4' cannot be factored"):
        factor_bank.__wrapped__("db4")


def test_a_bank_is_factored_once_in_a_process():
    """A second request returns the very same record."""
    assert factor_bank("db6") is factor_bank("db6")
