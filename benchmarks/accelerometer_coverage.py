"""Do the stated 95 % intervals cover the truth in 95 % of cases? Print the table for the
documentation.

    python benchmarks/accelerometer_coverage.py [--sets 1000]

Every set is a triad whose K is drawn anew, at 42 attitudes and 9 temperatures from −20 to 125 °C,
20 µg dwell noise. Coverage is pooled over the thirty coefficients of a set; a coefficient counts as
covered when its truth lies within Student's 95 % interval. The last rows fit the axes (Q) of the
same triads, and the nine parameters of magnitude-only sets.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import t

from calibkit.instruments.accelerometer.numeric import (
    affine,
    affine_model,
    k_factor,
    magnitude,
    q_factor,
)
from calibkit.numeric import attitude

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

NOISE_G = 2e-5
TABLE_NOISE_DEG = 0.01
TEMPERATURES_DEGC = np.array([-20.0, -5.0, 10.0, 25.0, 45.0, 65.0, 85.0, 105.0, 125.0])
SPOTS_DEG = np.array(
    [
        (0.0, 0.0),
        *((tilt, roll) for tilt in (30, 60, 90, 120, 150) for roll in range(0, 360, 45)),
        (180.0, 0.0),
    ],
    dtype=np.float64,
)
ANGLES_DEG = np.tile(SPOTS_DEG, (TEMPERATURES_DEGC.size, 1))
HELD_DEGC = np.repeat(TEMPERATURES_DEGC, len(SPOTS_DEG))
NOMINAL = np.array([1.0, 1e-4, 3e-7, 1e-9, 5e-3, 5e-5, 2e-7, 5e-10, 5e-3, 5e-3])
"""Size of K0 − 1, K1 … K9 of the drawn triads."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """One simulated set."""

    score: Array
    """Errors over standard uncertainties."""
    quantile: float
    """Student's, 95 % two-sided."""
    rms_over_noise: float


def triad(rng: np.random.Generator) -> Array:
    """K0 … K9 [3, 10] of a triad."""
    drawn = rng.normal(0.0, 1.0, (3, 10)) * NOMINAL
    drawn[:, 0] = 1.0 + 5e-3 * drawn[:, 0]
    return np.asarray(drawn, dtype=np.float64)


def k_set(rng: np.random.Generator, *, table_noise_deg: float = 0.0, how: str = "plain") -> Outcome:
    """K-factor of one triad, by least squares, robustly, or with the covariance of the jackknife
    over dwells.
    """
    truth = triad(rng)
    stood = ANGLES_DEG + rng.normal(0.0, table_noise_deg, ANGLES_DEG.shape)
    indication = k_factor.indications(truth, attitude.gravity_vector(*stood.T), HELD_DEGC)
    indication += rng.normal(0.0, NOISE_G, indication.shape)
    fitted = k_factor.fit(
        indication,
        HELD_DEGC,
        attitude.gravity_vector(*ANGLES_DEG.T),
        loss="robust" if how == "robust" else "least_squares",
        groups=np.arange(len(indication)) if how == "jackknife" else None,
    )
    score = np.concatenate(
        [(a.coefficients - k) / a.standard_uncertainty for a, k in zip(fitted, truth, strict=True)]
    )
    rms = np.sqrt(np.mean([a.residual_rms**2 for a in fitted]))
    return Outcome(score, float(t.ppf(0.975, fitted[0].dof)), float(rms / NOISE_G))


def q_set(rng: np.random.Generator) -> Outcome:
    """Q of one triad at one temperature, scale, bias and mounting free, against the table."""
    q = rng.normal(0.0, 5e-3, 3)
    scale, bias = 1.0 + rng.normal(0.0, 5e-3, 3), rng.normal(0.0, 5e-3, 3)
    reference = attitude.gravity_vector(*SPOTS_DEG.T)
    indication = (
        scale * (reference @ q_factor.axes_from_angles(q).T)
        + bias
        + rng.normal(0.0, NOISE_G, reference.shape)
    )
    terms = affine_model.AffineTerms(0, 0, 0)
    fitted = affine.fit(indication, np.zeros(len(reference)), reference, terms=terms)
    found, covariance = fitted.evaluate_q(0.0)
    score = (found - q) / np.sqrt(np.diag(covariance))
    return Outcome(score, float(t.ppf(0.975, fitted.dof)), fitted.residual_rms / NOISE_G)


def magnitude_set(rng: np.random.Generator) -> Outcome:
    """Nine parameters from the length of gravity in 42 unknown attitudes."""
    truth = np.concatenate(
        [1.0 + rng.normal(0.0, 5e-3, 3), rng.normal(0.0, 5e-3, 3), rng.normal(0.0, 5e-3, 3)]
    )
    reference = attitude.gravity_vector(*SPOTS_DEG.T)
    indication = truth[:3] * (reference @ q_factor.axes_from_angles(truth[6:]).T) + truth[3:6]
    fitted = magnitude.fit(indication + rng.normal(0.0, NOISE_G, indication.shape))
    score = (fitted.parameters - truth) / fitted.standard_uncertainty
    return Outcome(score, float(t.ppf(0.975, fitted.dof)), fitted.residual_rms / NOISE_G)


CASES: dict[str, Callable[[np.random.Generator], Outcome]] = {
    "K, 20 µg, exact table": k_set,
    "K, the same, robust loss": lambda rng: k_set(rng, how="robust"),
    "K, table noise 0.01°": lambda rng: k_set(rng, table_noise_deg=TABLE_NOISE_DEG),
    "K, table noise 0.01°, groups = dwells": lambda rng: k_set(
        rng, table_noise_deg=TABLE_NOISE_DEG, how="jackknife"
    ),
    "Q1…Q3 against the table": q_set,
    "k, b, Q from magnitude alone": magnitude_set,
}


def main() -> None:
    """Simulate, fit and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", type=int, default=1000)
    sets = parser.parse_args().sets
    print(
        f"| case ({sets} sets each) | covered by 95 % intervals | least, most of one coefficient |"
        " largest error, u | rms/noise |"
    )
    print("|---|---|---|---|---|")
    for number, (name, case) in enumerate(CASES.items()):
        begin = time.perf_counter()
        rng = np.random.default_rng([20261121, number])
        outcomes = [case(rng) for _ in range(sets)]
        score = np.array([o.score for o in outcomes])
        covered = np.abs(score) <= np.array([o.quantile for o in outcomes])[:, None]
        each = 100.0 * covered.mean(axis=0)
        ratio = [o.rms_over_noise for o in outcomes]
        print(
            f"| {name} | {100.0 * covered.mean():.2f} % | {each.min():.1f} %, {each.max():.1f} % "
            f"| {np.abs(score).max():.2f} | {min(ratio):.3f} … {max(ratio):.3f} |",
            flush=True,
        )
        print(f"<!-- {(time.perf_counter() - begin) / sets * 1e3:.1f} ms a set -->")


if __name__ == "__main__":
    main()
