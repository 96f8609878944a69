"""Do 95 % intervals of a bias over a warm-up cover the truth? Print the table for the
documentation.

    python benchmarks/warm_up_coverage.py [--sets 2000]

Every set is one warm-up, from 15 to 50 °C with a time constant of a tenth of the log: a tenth of
the rows are cold. A straight line or a cubic of temperature is fitted; its slope at the middle of
the range is covered where the truth lies within Student's 95 % interval of the fit.
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from scipy.signal import lfilter
from scipy.stats import t

from calibkit.frame import Log
from calibkit.instruments.bias import bias_temperature
from calibkit.instruments.bias.recipe import BiasTemperatureRecipe
from calibkit.simulate import noise as simulated

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

NOISE: dict[str, Callable[[Array], Array]] = {
    "white": lambda draws: draws[0],
    "first-order, 0.5": lambda draws: lfilter([1.0], [1.0, -0.5], draws[0]),
    "first-order, 0.8": lambda draws: lfilter([1.0], [1.0, -0.8], draws[0]),
    "white and first-order, 0.9": lambda draws: (
        draws[0] + lfilter([np.sqrt(0.19)], [1.0, -0.9], draws[1])
    ),
    "white and flicker": lambda draws: (
        draws[0] + simulated.flicker(1.0, draws.shape[1], np.random.default_rng(_seed_of(draws)))
    ),
}


def _seed_of(draws: Array) -> int:
    """Seed of a noise of its own for each set."""
    return int(abs(draws[1, 0]) * 1e9)


BEFORE = 200
"""Rows of noise before a log."""


def cover(
    rows: int, order: int, noise: Callable[[Array], Array], sets: int
) -> tuple[float, float, float]:
    """Share of sets whose slope is covered, mean half-width over that of known noise, and the
    median of the degrees of freedom.
    """
    rng = np.random.default_rng([rows, order])
    temperature = 50.0 - 35.0 * np.exp(-np.arange(rows) / (0.1 * rows))
    bias = {"abscissa": "temp_case_degc", "bias": [{"indication": "gyro_dph", "order": order}]}
    tables = {"procedure": "bias_temperature", "logs": {"files": ["*.csv"]}, "polynomials": bias}
    spec = BiasTemperatureRecipe.model_validate(tables, strict=False)
    # derivatives of the slope at 32.5 °C by the coefficients
    slope = np.arange(order + 1) * np.append(0.0, 32.5 ** np.arange(order))
    found, half, dofs = [], [], []
    for _ in range(sets):
        values = noise(rng.normal(size=(2, BEFORE + rows)))[BEFORE:]
        columns = {"temp_case_degc": temperature, "gyro_dph": values}
        log = Log("w", "w.csv", "", rows, pd.DataFrame(columns))
        (fitted,) = bias_temperature.fit_channels([log], spec.polynomials, spec.errors)
        coefficients = fitted.model.coefficients
        dofs.append(float(coefficients[1].effective_dof))
        found.append(slope @ np.array([c.value for c in coefficients]))
        u = np.sqrt(slope @ np.array(fitted.model.covariance) @ slope)
        half.append(t.ppf(0.975, dofs[-1]) * u)
    covered = float(np.mean(np.abs(found) < half))
    return covered, float(np.mean(half) / (1.96 * np.std(found))), float(np.median(dofs))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", type=int, default=2000)
    sets = parser.parse_args().sets
    print("| noise | rows | order | coverage | half-width, of known noise | degrees of freedom |")
    print("|---|---|---|---|---|---|")
    for name, noise in NOISE.items():
        for rows in (300, 600, 1000):
            for order in (1, 3):
                covered, width, dof = cover(rows, order, noise, sets)
                error = 100.0 * np.sqrt(covered * (1.0 - covered) / sets)
                print(
                    f"| {name} | {rows} | {order} | {100.0 * covered:.1f} ± {error:.1f} %"
                    f" | {width:.2f} | {dof:.0f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
