"""Drift models on logs that were not fitted, by noise-free truth, on two plants: the lumped gyro of
the shipped simulations and a coil through which heat diffuses.

    python benchmarks/drift_plants.py [gyros per row [first seed [row]]]

Any calibkit that the interpreter has is measured: it is called by its public interface alone.

Each gyro is fitted on ±1, ±5, ±8, ±10 °C/min with soaks of 30 min (the lumped one 10 and 60) and
judged on eight logs: ±2, ±3, ±6 °C/min, a mission of ramps and soaks, a sine of six hours.
Reduction: sd of the true drift over sd of what is left of it, 60 s means. Coverage: share of 60 s
means within U = 2 u, and of nine statements at rest of each gyro; share of 100 s means that
`validate` finds as near to their log's mean as noise and U say.
Rejected: gyros with a log whose 100 s means `validate` finds larger than stated.
"Allowed": gyros whose least reduction by a model that knows the physics is 13 or more.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import diffusion_coil
import drift_generalisation as lumped
import lumped_gyro
import numpy as np
from diffusion_coil import means

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

FIRST_SEED = 400_000
REST_DEGC = (-40.0, -30.0, -20.0, -10.0, 0.0, 10.0, 40.0, 50.0, 60.0)
ALLOWED = 13.0
ROWS = (
    ("diffusion", "plain", {}),
    ("diffusion", "plain", {"rates": (1.0, 10.0)}),
    ("diffusion", "plain", {"ways": (1,)}),
    ("diffusion", "plain", {"soak_s": 300.0}),
    ("diffusion", "plain", {"cycled": True}),
    ("diffusion", "weak", {}),
    ("diffusion", "none", {}),
    ("diffusion", "hysteresis", {}),
    ("diffusion", "strong hysteresis", {}),
    ("diffusion", "bump", {}),
    ("diffusion", "warm-up", {}),
    ("lumped", "plain", {}),
    ("lumped", "plain", {"rates": (1.0, 10.0)}),
)


@dataclass(frozen=True)
class Judged:
    """One gyro."""

    reductions: Array
    """Of the logs [8] that were not fitted; 1 without a drift term."""
    limits: Array
    """What the noise allows [8]."""
    covered: float
    """Share of the drift along the logs within U."""
    near_mean: float
    """Share within U about the logs' means, by `validate`."""
    rest: Array
    """Errors at rest and their U [2, 9, °/h]."""
    worse: int
    """Logs that are worse than uncorrected by more than U."""
    seconds: float
    """Processor time of the fit."""
    form: str
    rejected: bool


def judge(
    fitted: dict[str, pd.DataFrame],
    unseen: dict[str, tuple[pd.DataFrame, Array]],
    limits: Array,
    rest: Array,
) -> Judged:
    """Figures of one gyro from its logs; beside those that were not fitted stands their true drift
    [n, °/h]; `rest` [9, °/h] is the true drift at rest.
    """
    start = time.process_time()
    run = lumped.fit(fitted)
    seconds = time.process_time() - start
    form = lumped.exported_form(run)
    if form == "none":
        unknown = np.full((2, len(REST_DEGC)), np.nan)
        return Judged(np.ones(8), limits, np.nan, np.nan, unknown, 0, seconds, form, rejected=False)
    reductions, covered, worse = [], [], 0
    for frame, truth in unseen.values():
        drift, u = lumped.predict(run, frame)
        error, U = means(drift - truth), 2.0 * means(u)
        reductions.append(np.std(means(truth)) / np.std(error))
        covered.append(np.mean(np.abs(error) <= U))
        worse += bool(np.std(error) > np.std(means(truth)) + np.sqrt(np.mean(U**2)))
    logs = run.validate({name: frame for name, (frame, _) in unseen.items()})["logs"]
    stated = [log["uncertainty"] for log in logs]
    drift, U = state_at_rest(run)
    return Judged(
        np.array(reductions),
        limits,
        float(np.mean(covered)),
        float(np.mean([log["share_within_expanded_uncertainty"] for log in stated])),
        np.stack([drift - rest, U]),
        worse,
        seconds,
        form,
        rejected=any(
            log["rms_error_over_uncertainty"] > log["largest_rms_error_over_uncertainty"]
            for log in stated
        ),
    )


def state_at_rest(run: Any) -> tuple[Array, Array]:  # noqa: ANN401 (a run)
    """Drift at rest against 25 °C, and its expanded uncertainty [9, °/h]."""
    degc = [*REST_DEGC, 25.0]
    count = len(degc)
    # between two equal inputs the covariance is that of the coefficients alone
    stated = run.model("drift").evaluate(temp_case_degc=degc * 2)
    of_coefficients = stated.covariance[:count, count:]
    variance = np.diag(of_coefficients)
    others = stated.standard_uncertainty[:count] ** 2 - variance
    of_difference = variance + variance[-1] - 2.0 * of_coefficients[:, -1] + others
    drift = stated.value[:count] - stated.value[count - 1]
    return drift[:-1], 2.0 * np.sqrt(of_difference[:-1])


def judge_coil(seed: int, kind: str, options: dict[str, Any]) -> Judged:
    """Figures of a diffusion coil."""
    coil = diffusion_coil.draw(seed, kind)
    fitted = diffusion_coil.campaign(coil, seed, **options)
    unseen = diffusion_coil.unseen(coil, seed)
    limits = np.full(8, np.nan)
    if kind == "plain":
        limits = diffusion_coil.noise_limit(coil, fitted, unseen)
    rest = np.array([diffusion_coil.drift_at_rest(coil, degc) for degc in REST_DEGC])
    frames = {name: log.frame() for name, log in fitted.items()}
    judged = {name: (log.frame(), log.drift) for name, log in unseen.items()}
    return judge(frames, judged, limits, rest)


def judge_lumped(seed: int, kind: str, options: dict[str, Any]) -> Judged:
    """Figures of a lumped gyro."""
    device = lumped.gyro(seed, kind)
    ramps = lumped_gyro.ramps(options.get("rates", diffusion_coil.RATES))
    unseen = {
        f"unseen/{name}": programme
        for name, programme in diffusion_coil.unseen_programmes(seed).items()
    }
    fitted = lumped_gyro.record(device, ramps, seed)
    judged = lumped_gyro.record(device, unseen, seed)
    above = np.array(REST_DEGC) - lumped_gyro.REFERENCE_DEGC
    rest = np.polynomial.polynomial.polyval(above, [0.0, *device.static_dph])
    return judge(
        {name: log.frame for name, log in fitted.items()},
        {name.removeprefix("unseen/"): (log.frame, log.drift) for name, log in judged.items()},
        np.full(8, np.nan),
        rest,
    )


def line(plant: str, kind: str, options: dict[str, Any], gyros: list[Judged]) -> str:
    """One row of the table."""
    reductions = np.array([gyro.reductions for gyro in gyros])
    least, limits = reductions.min(axis=1), np.array([gyro.limits for gyro in gyros])
    allowed = limits.min(axis=1) >= ALLOWED
    ten = f"{np.mean(least[allowed] >= 10.0):.0%} of {allowed.sum()}" if allowed.any() else "–"
    rest = np.array([gyro.rest for gyro in gyros])
    rest = rest[np.isfinite(rest[:, 0, 0])]
    errors = np.abs(rest[:, 0])
    at_rest = "–"
    if errors.size:
        at_rest = f"{np.median(errors):.4f} / {np.quantile(errors.max(axis=1), 0.9):.4f}"
    changed = ", ".join(f"{key} {value}" for key, value in options.items())
    figures = (
        f"{least.min():.1f} / {np.quantile(least, 0.1):.1f} / {np.median(least):.1f}",
        ten,
        f"{np.median(np.median(reductions, axis=1)):.1f}",
        f"{np.median(np.median(limits, axis=1)):.1f}",
        f"{np.nanmean([gyro.near_mean for gyro in gyros]):.3f}",
        f"{np.nanmean([gyro.covered for gyro in gyros]):.3f}",
        f"{np.mean(errors <= rest[:, 1]):.3f}",
        at_rest,
        str(sum(gyro.worse for gyro in gyros)),
        f"{np.mean([gyro.rejected for gyro in gyros]):.0%}",
        f"{np.mean([gyro.seconds for gyro in gyros]):.2f}",
    )
    row = f"{plant}, {kind}{': ' + changed if changed else ''}"
    return f"| {row} | {len(gyros)} | {' | '.join(figures)} |"


def main() -> int:
    """Run and print the table, one row at a time."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 16
    first = int(sys.argv[2]) if len(sys.argv) > 2 else FIRST_SEED
    chosen = int(sys.argv[3]) if len(sys.argv) > 3 else None
    print(
        "| plant, kind: campaign | gyros | least reduction: min / 10 % / median"
        " | ≥ 10 where allowed | median of medians | noise limit"
        " | coverage about mean, by validate | absolute |"
        " at rest | error at rest: median / 90 % of largest | worse than raw by > U"
        " | rejected | s |"
    )
    print("|" + "---|" * 13)
    for number, (plant, kind, options) in enumerate(ROWS):
        if chosen is not None and number != chosen:
            continue
        act = judge_coil if plant == "diffusion" else judge_lumped
        gyros = [act(first + k, kind, options) for k in range(count)]
        print(line(plant, kind, options, gyros), flush=True)
        forms: dict[str, int] = {}
        for gyro in gyros:
            forms[gyro.form] = forms.get(gyro.form, 0) + 1
        print(f"<!-- {forms} -->", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
