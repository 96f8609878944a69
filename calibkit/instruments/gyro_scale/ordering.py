"""Rates that rise with time: a scale factor that warms up looks like a bent response.

    F = K_r Ω + F_r + N or T_τ,   N = {Ω³, Ω |Ω|, |Ω|},   T_τ = {Ω φ, φ}                      (1)
    F = (RSS_line − min(RSS_N, RSS_T))/(3 s²) against F(3, ν),   D = (RSS_N − RSS_T)/s²       (2)

φ = exp(−t/τ) or t, t the time since a run began, N the powers of the rate where the response has
some, s² and ν are of the fit with both. Where F is not exceeded there is the line alone; D > 20 is
time, D < −20 the response, and between them nothing decides.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from calibkit.instruments.gyro_scale import equation
from calibkit.instruments.gyro_scale.published import PPM
from calibkit.numeric.arrays import Array
from calibkit.records.frame import Remark

CHANCE, CERTAIN = 1e-4, 20.0
"""Probability of so large an F by chance, and D from which one of both is certain."""
TAUS, LEAST_DOF = 30, 3
"""Number of time constants that are tried, and fewest degrees of freedom of s²."""
STEADY_DEGC = 0.1
"""Change of temperature in a run [°C] whose effect need not be known."""


@dataclass(frozen=True, slots=True)
class Ordering:
    """What held rates in their order tell of time and response.

    Attributes
    ----------
    shift : to K of the line, from that at the end of the run or from the mean of both readings.
    half_width : largest distance of K between the readings that remain.
    separable : share of Ω t that the line and N leave.

    """

    decision: Literal["line", "time", "response", "undecided"]
    shift: float
    half_width: float
    separable: float


def decide(
    rows: equation.RateRows,
    indication: Array,
    known_degc: float = STEADY_DEGC,
    powers: Sequence[int] = (),
) -> Ordering | None:
    """Decision of (2) on held rates of one gyro with indications [n], the mean over runs that turn
    through the same rates, whose response has some powers of the rate.

    None where times are not logged, the rates are too few, or the temperature changed in a run by
    more than is known of its effect [°C].
    """
    from scipy.special import fdtri

    count = np.bincount(rows.run)
    warming = np.ptp(rows.row_degc - rows.temp_degc[rows.run])
    begin = np.array([rows.hours[rows.run == r].min() for r in range(count.size)])
    t = rows.hours - begin[rows.run]
    if np.ptp(count) or not t.any() or warming > known_degc:
        return None
    by_run = np.column_stack((rows.rate_dps, t, indication)).reshape(count.size, -1, 3)
    rate_spread = np.max(np.ptp(by_run[:, :, 0], axis=0))
    rate, t, F = by_run.mean(axis=0).T
    unit = float(np.max(np.abs(rate)))
    if rate_spread > equation.SAME_RATE * unit:  # runs of both directions have no mean rates
        return None
    w = rate / unit
    # |Ω|: a scale factor that differs between the directions
    bent = np.column_stack([w**k for k in powers] if powers else [w**3, w * np.abs(w), np.abs(w)])
    dof = rate.size - 2 - 3 - bent.shape[1]  # the time constant counts
    if dof < LEAST_DOF:
        return None

    t = t / t.max()
    line = np.column_stack((w, np.ones_like(w)))
    unexplained = _residual(np.column_stack((line, bent)), w * t)
    separable = float(np.linalg.norm(unexplained) / np.linalg.norm(w * t))
    hold = float(np.min(np.diff(np.sort(t))))
    taus = np.geomspace(hold, 1.0, TAUS)
    designs, squares = [], []
    for phi in (*(np.exp(-t / tau) for tau in taus), t):
        design = np.column_stack((line, w * phi))
        # φ itself only where a line over the rates leaves most of it: it is no K then
        if np.linalg.norm(_residual(line, phi)) > 0.8 * np.linalg.norm(phi - phi.mean()):
            design = np.column_stack((design, phi))
        designs.append(design)
        squares.append(float(np.sum(_residual(design, F) ** 2)))
    best = int(np.argmin(squares))
    of_time, of_line = squares[best], float(np.sum(_residual(line, F) ** 2))
    of_bend = float(np.sum(_residual(np.column_stack((line, bent)), F) ** 2))
    of_time_and_bend = float(np.sum(_residual(np.column_stack((designs[best], bent)), F) ** 2))
    # not below the rounding of indications without noise
    noise = max(of_time_and_bend / dof, (1e-12 * float(np.max(np.abs(F)))) ** 2)
    ratio = (of_line - min(of_bend, of_time)) / (3.0 * noise)
    if ratio <= fdtri(3, dof, 1.0 - CHANCE):
        return Ordering("line", 0.0, 0.0, separable)
    D = (of_bend - of_time) / noise
    if D < -CERTAIN:
        return Ordering("response", 0.0, 0.0, separable)
    # K of time, at the end of the run: that without φ, and what φ is there; known to the change
    # since the beginning, or where φ has gone by half of the run, to what is left of it
    K, _, by_phi = np.linalg.lstsq(designs[best], F)[0][:3]
    at_begin, at_end = 0.0, 1.0
    if best < TAUS:
        at_begin, at_end = float(taus[best] >= 0.5), float(np.exp(-1.0 / taus[best]))
    shift = float(K + by_phi * at_end - np.linalg.lstsq(line, F)[0][0]) / unit
    half_width = float(abs(by_phi * (at_begin - at_end))) / unit
    decision: Literal["time", "undecided"] = "time"
    if D <= CERTAIN:  # K is the mean of both readings
        decision, shift, half_width = "undecided", 0.5 * shift, 0.5 * abs(shift) + half_width
    return Ordering(decision, shift, half_width, separable)


def flag(name: str, ordering: Ordering | None, K: float) -> Iterator[str]:
    """Flags for a scale factor that changes with time, and for rates that cannot tell."""
    cure = "run the rates in random order, or repeat the first rates at the end"
    if ordering is None:
        return
    if ordering.half_width:
        ppm = PPM / K
        explanation = (
            "as of a scale factor that warms up: K is that at the end of the runs"
            if ordering.decision == "time"
            else "or with a response that is bent or differs between the directions, and nothing"
            " separates the two: K is the mean of both"
        )
        yield (
            f"{name}: the indication changes with time since the runs began, {explanation},"
            f" {ordering.shift * ppm:+.2g} ppm off the straight line and known to"
            f" {abs(ordering.half_width * ppm):.2g} ppm; {cure}, after the warm-up"
        )
    elif ordering.separable < 0.1:
        yield Remark(
            f"{name}: rates follow time: a scale factor that warms up looks like a response that is"
            f" bent or differs between the directions; {cure}"
        )


def _residual(design: Array, values: Array) -> Array:
    """What a least-squares fit leaves of values [n]."""
    q, _ = np.linalg.qr(design)
    return np.asarray(values - q @ (q.T @ values), dtype=np.float64)
