"""Air of a temperature chamber: it follows a programme of set points late, overshoots where a ramp
ends, and cycles.
"""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from calibkit.numeric.arrays import Array
from calibkit.numeric.constants import SECONDS_PER_MINUTE
from calibkit.simulate.noise import reading


@dataclass(frozen=True, slots=True)
class Programme:
    """Set points of a chamber, joined by straight lines; two at one time are a step."""

    time_s: tuple[float, ...]
    set_degc: tuple[float, ...]
    rate_degc_per_min: float
    """Signed rate between the ends: of the ramp, or of the whole staircase."""

    def set_points(self) -> tuple[Array, Array]:
        """Time [n] [s] at 1 Hz and set point [n] [°C] of a programme; at a step the new set point
        holds.
        """
        time = np.arange(np.floor(self.time_s[-1]) + 1.0)
        after = np.searchsorted(self.time_s, time, side="right").clip(1, len(self.time_s) - 1)
        t, value = np.asarray(self.time_s), np.asarray(self.set_degc)
        share = (time - t[after - 1]) / (t[after] - t[after - 1])
        set_degc: Array = (1.0 - share) * value[after - 1] + share * value[after]
        return time, set_degc

    @classmethod
    def ramp(
        cls,
        start_degc: float,
        end_degc: float,
        rate: float,
        *,
        soak_before_s: float,
        soak_after_s: float,
    ) -> Self:
        """One ramp at an unsigned rate [°C/min] between two soaks."""
        ramp_s = abs(end_degc - start_degc) / rate * SECONDS_PER_MINUTE
        return cls(
            (0.0, soak_before_s, soak_before_s + ramp_s, soak_before_s + ramp_s + soak_after_s),
            (start_degc, start_degc, end_degc, end_degc),
            float(np.copysign(rate, end_degc - start_degc)),
        )

    @classmethod
    def staircase(
        cls, start_degc: float, end_degc: float, *, step_degc: float = 1.0, dwell_s: float = 120.0
    ) -> Self:
        """Set points that go from one temperature to another in equal steps [°C], holding each for
        a dwell [s].
        """
        steps = round(abs(end_degc - start_degc) / step_degc)
        levels_degc = np.linspace(start_degc, end_degc, steps + 1)
        edges = np.arange(steps + 2) * dwell_s
        return cls(
            tuple(np.column_stack((edges[:-1], edges[1:])).ravel().tolist()),
            tuple(np.repeat(levels_degc, 2).tolist()),
            float(np.copysign(step_degc / dwell_s * SECONDS_PER_MINUTE, end_degc - start_degc)),
        )


@dataclass(frozen=True, slots=True)
class Chamber:
    """Constants of a chamber and its own thermometer."""

    lag_s: float = 15.0
    """How long the air is behind the set point on a steady ramp."""
    damping: float = 0.45
    """Damping ratio of the control loop; below one the air overshoots."""
    cycling_degc: float = 0.15
    """Amplitude of the on and off of the compressor."""
    cycling_period_s: float = 90.0
    turbulence_degc: float = 0.05
    """Standard deviation of the air at the gyro about the controlled temperature."""
    turbulence_s: float = 20.0
    """Correlation time of the turbulence."""
    reading_noise_degc: float = 0.03
    resolution_degc: float = 0.1

    def air(self, set_degc: Array, rng: np.random.Generator) -> Array:
        """Air temperature [n] [°C] at 1 Hz around the gyro: controlled, with the compressor's
        cycling and turbulence.
        """
        from scipy.signal import lfilter  # a slow import

        count = len(set_degc)
        phase = rng.uniform(0.0, 2.0 * np.pi)
        cycling = self.cycling_degc * np.sin(
            2.0 * np.pi * np.arange(count) / self.cycling_period_s + phase
        )
        memory = math.exp(-1.0 / self.turbulence_s)
        white = rng.normal(0.0, math.sqrt(1.0 - memory**2), count)
        white[0] = rng.normal(0.0, 1.0)
        turbulence: Array = np.asarray(lfilter([1.0], [1.0, -memory], white))
        disturbed: Array = _controlled(self, set_degc) + cycling + self.turbulence_degc * turbulence
        return disturbed

    def air_reading(self, air_degc: Array, rng: np.random.Generator) -> Array:
        """Read the air [n] [°C] as the chamber's own thermometer logs it [n] [°C]."""
        return reading(air_degc, self.resolution_degc, self.reading_noise_degc, rng)


def _controlled(chamber: Chamber, set_degc: Array) -> Array:
    """Air [n] [°C] at 1 Hz that follows set points [n] [°C], at rest at the first: T'' + 2ζω T' +
    ω² T = ω² set.

    On a steady ramp it is 2ζ/ω behind; ω follows from that lag. Bilinear discretisation, so that
    any set point is met without error after the transient.
    """
    from scipy.signal import bilinear, lfilter  # a slow import

    omega = 2.0 * chamber.damping / chamber.lag_s
    numerator, denominator = bilinear(
        [omega**2], [1.0, 2.0 * chamber.damping * omega, omega**2], fs=1.0
    )
    rise_degc: Array = np.asarray(lfilter(numerator, denominator, set_degc - set_degc[0]))
    return rise_degc + float(set_degc[0])


def follow_with_lag(degc: Array, lag_s: float) -> Array:
    """Temperature [n] at 1 Hz of a body that follows another with a lag, from equilibrium."""
    from scipy.signal import lfilter  # a slow import

    share = -math.expm1(-1.0 / lag_s)
    followed: Array = np.asarray(lfilter([share], [1.0, share - 1.0], degc - degc[0])) + degc[0]
    return followed
