"""Power laws of averaging time that noise terms of gyros and accelerometers have, and their
units.
"""

from dataclasses import dataclass, replace

import numpy as np

from calibkit.constants import SECONDS_PER_HOUR


@dataclass(frozen=True, slots=True)
class PowerLaw:
    """One term of σ²(τ) = Σ c τ^exponent, with value = scale·√c in the unit given."""

    name: str
    symbol: str
    unit: str
    exponent: int
    scale: float


LAWS = (
    PowerLaw("quantization", "Q", "arcsec", -2, float(1.0 / np.sqrt(3.0))),
    PowerLaw("angle_random_walk", "N", "deg/sqrt(h)", -1, 1.0 / 60.0),
    PowerLaw("bias_instability", "B", "deg/h", 0, float(np.sqrt(np.pi / (2.0 * np.log(2.0))))),
    PowerLaw("rate_random_walk", "K", "deg/h/sqrt(h)", 1, 60.0 * float(np.sqrt(3.0))),
    PowerLaw("rate_ramp", "R", "deg/h/h", 2, SECONDS_PER_HOUR * float(np.sqrt(2.0))),
)
"""IEEE Std 952 annex C: 3Q²/τ² + N²/τ + (2 ln 2/π) B² + K² τ/3 + R² τ²/2, τ in s, σ in deg/h (1
deg/h·s = 1 arcsec).
"""
ACCELEROMETER_LAWS = (
    replace(LAWS[0], unit="mg*s"),
    PowerLaw("velocity_random_walk", "N", "ug/sqrt(Hz)", -1, 1000.0),
    replace(LAWS[2], unit="mg"),
    replace(LAWS[3], name="acceleration_random_walk", unit="mg/sqrt(h)"),
    replace(LAWS[4], name="acceleration_ramp", unit="mg/h"),
)
"""The same of an accelerometer, σ in mg: N² is σ² at 1 s, so that the one-sided amplitude spectral
density of a data sheet is √2 N (IEEE Std 1293).
"""
