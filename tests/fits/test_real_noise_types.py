"""Noise types and Allan deviations of the published clock data that allantools keeps beside
Stable32's results: `allantools` is the folder `tests` of its source distribution 2024.6.
"""

import gzip

import numpy as np
import pytest

from calibkit.numeric.noise import allan, confidence

ENOUGH_BLOCKS = 30
"""Block means from which on allantools and Stable32 read the type off the lag-1 autocorrelation."""
CASES = {
    "PHASE.DAT": ("phasedat/PHASE.DAT", "phasedat/phase_dat_oadev_octave.txt"),
    "Cs5071A": ("Cs5071A/5071A_phase.txt.gz", "Cs5071A/oadev_decade.txt"),
    "TIC": (
        "Keysight53230A_ti_noise_floor/tic_phase.txt",
        "Keysight53230A_ti_noise_floor/tic_oadev.txt",
    ),
    "OCXO": ("ocxo/ocxo_frequency.txt", "ocxo/oadev_octave.txt"),
    "pink": ("pink_frequency/pink_frequency.txt", "pink_frequency/s32_oadev_octave.txt"),
    "GPS": ("gps/gps_1pps_phase_data.txt.gz", "gps/stable32_OADEV_octave.txt"),
}


def numbers(path):
    """First number of every line that is no comment."""
    with gzip.open(path, "rt") if path.suffix == ".gz" else path.open(encoding="utf-8") as lines:
        return np.array(
            [float(line.split()[0]) for line in lines if line.strip() and line[0] not in "#%"]
        )


@pytest.mark.parametrize("name", CASES)
def test_noise_types_and_deviations_are_those_of_stable32(real, name):
    """Overlapping deviations agree to their printed digits, and from 30 blocks on every noise type
    is Stable32's; never more than 1.5 degrees of freedom for a block.
    """
    data, results = (real / "allantools" / file for file in CASES[name])
    if not data.is_file():
        pytest.skip("allantools' test data are not among the real measurements")
    log = numbers(data)
    rate = {"OCXO": log / 1e7, "pink": log}.get(name, np.diff(log))
    rows = np.loadtxt(results)
    # rows of Stable32: factor, averaging time, pairs, exponent, lower limit, deviation, upper limit
    curve = allan.overlapping(rate, 1.0, tau_s=rows[:, 0])
    np.testing.assert_allclose(curve.deviation, rows[:, 5], rtol=3e-3 if name == "OCXO" else 1e-4)
    found = [2 - confidence.TYPES.index(noise) for noise in curve.noise]
    enough = rate.size // curve.factor >= ENOUGH_BLOCKS
    np.testing.assert_array_equal(np.array(found)[enough], rows[enough, 3])
    assert np.all(curve.dof <= 1.5 * rate.size / curve.factor)
