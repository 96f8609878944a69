"""Scale factor, γ and α of simulated gyro pairs against their truth: errors, coverage of the stated
95 % intervals.

    PYTHONPATH=. python benchmarks/gyro_coverage.py [trials]

Each trial simulates both table runs (11 rates each way, 3 counts noise a sample, the earth's rate,
acceleration phases, an uneven table) and goes from the logs to the angle. Exit code 1 where a
target is missed.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from calibkit.frame import Log
from calibkit.instruments.gyro_scale import (
    fit,
    lines,
    simulate as simulated,
    table_runs,
)
from calibkit.instruments.gyro_scale.recipe import GyroPairRecipe

if TYPE_CHECKING:
    from calibkit.simulate.campaign import Campaign

SPEC = GyroPairRecipe(procedure="gyro_pair", logs={"files": ["*.csv"]})
ALPHAS_DEG = (90.0, 89.6, 60.0, 120.0, 30.0, 3.0)
QUANTILE = 1.959963984540054
FEW = "+1 +2 +5 +10"
UNEQUAL = {
    "both ways": simulated.both_ways(),
    "positive only": simulated.RATES_DPS,
    "negative only": tuple(-rate for rate in simulated.RATES_DPS),
    FEW: (1.0, 2.0, 5.0, 10.0),
    "+1..+100, -1..-20": (*simulated.RATES_DPS, -1.0, -2.0, -5.0, -10.0, -20.0),
}


def runs_of(logs: Campaign) -> dict[str, tuple[table_runs.TableRun, ...]]:
    """Runs about both axes."""
    runs = {}
    for axis in "ab":
        frame = pd.DataFrame(logs.logs[f"table_axis_{axis}.csv"])
        log = Log(axis, f"table_axis_{axis}.csv", axis, len(frame), frame)
        runs[axis] = (table_runs.fit_run(SPEC, log),)
    return runs


def normalized(seed: int, alpha_deg: float) -> dict[str, float]:
    """Errors over standard uncertainties of one trial."""
    logs = simulated.pair(seed, alpha_deg=alpha_deg, ideal=True)
    runs, truth, errors = runs_of(logs), logs.truth, {}
    for axis, (run,) in runs.items():
        for gyro in "ab":
            K = lines.Lines.of([[(0, run)]]).of_runs([run], gyro)
            true = truth["models"][f"{gyro}_about_{axis}"]["K"]
            errors[f"K {gyro}_about_{axis}"] = float((K.value[0] - true) / K.u[0])
    result = fit.fit_campaign(SPEC, runs).pair
    true_values = (truth["N"], truth["epsilon"], truth["gamma"], truth["alpha_deg"])
    for c, true in zip(result.coefficients, true_values, strict=True):
        errors[c.name] = (c.value - true) / c.standard_uncertainty
    return errors


def coverage(trials: int) -> bool:
    """Print coverage of each figure, pooled over the angles; whether all are within 93 to 97 % and
    4.5 u.
    """
    found = [
        normalized(1000 * k + i, alpha) for i, alpha in enumerate(ALPHAS_DEG) for k in range(trials)
    ]
    print(f"{len(found)} pairs, alpha {', '.join(f'{a:g}' for a in ALPHAS_DEG)} deg")
    good = True
    for name in found[0]:
        z = np.abs([errors[name] for errors in found])
        share = float(np.mean(z <= QUANTILE))
        print(f"  {name:14s} coverage {100 * share:5.1f} %   largest error {z.max():.2f} u")
        # 4 u is for one result; of hundreds a normal one may reach 4.2
        good &= 0.93 <= share <= 0.97 and z.max() < 4.5
    return good


def scale_errors(trials: int) -> bool:
    """Print the error of K of gyros that are not quite linear, for rates of both, one or unequal
    sign.
    """
    good = True
    for name, rates in UNEQUAL.items():
        errors, through_origin, normalized_errors = [], [], []
        for seed in range(trials):
            logs = simulated.pair(seed, rates_dps=rates)
            truth = logs.truth["models"]["a_about_a"]["K"]
            (run,) = runs_of(logs)["a"]
            K = lines.Lines.of([[(0, run)]]).of_runs([run], "a")
            errors.append((K.value[0] / truth - 1.0) * 1e6)
            normalized_errors.append(abs(K.value[0] - truth) / K.u[0])
            rate, F = run.rate_dps, run.plateaus.indication[:, 0]
            through_origin.append((rate @ F / (rate @ rate) / truth - 1.0) * 1e6)
        worst, naive = float(np.max(np.abs(errors))), float(np.max(np.abs(through_origin)))
        most = float(np.max(normalized_errors))
        print(
            f"  K, {name:18s} largest error {worst:6.2f} ppm, {most:.2f} u   (through the origin"
            f" {naive:7.1f} ppm)"
        )
        # four rates up to 10 °/s leave a noise of 4 ppm: there the stated uncertainty is the target
        good &= worst < 3.0 or (name == FEW and most < 4.5)
    return good


def main() -> int:
    """Run both and report."""
    trials = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    good = coverage(trials)
    return 0 if scale_errors(max(trials // 5, 5)) and good else 1


if __name__ == "__main__":
    sys.exit(main())
