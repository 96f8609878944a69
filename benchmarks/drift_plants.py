"""Drift models on logs that were not fitted, by noise-free truth, on two plants: the lumped gyro of
the shipped simulations and a coil through which heat diffuses.

    PYTHONPATH=. python benchmarks/drift_plants.py [gyros per row [first seed [row [release]]]]

`release` is a checkout of commit adbfa49, version 0.1.0, for its choice on the same logs.

Each gyro is fitted on ±1, ±5, ±8, ±10 °C/min with soaks of 30 min (the lumped one 10 and 60) and
judged on eight logs: ±2, ±3, ±6 °C/min, a mission of ramps and soaks, a sine of six hours.
Reduction: sd of the true drift over sd of what is left of it, 60 s means. Coverage: share of 60 s
means within U, about the log's mean (U of the drift less its mean) and absolutely, and of nine
statements at rest of each gyro.
Rejected: gyros with a log whose 100 s means `validate` finds larger than stated.
"Allowed": gyros whose least reduction by a model that knows the physics is 13 or more.
"""

from __future__ import annotations

import json
import math
import os
import pickle
import subprocess
import sys
import time
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import TYPE_CHECKING

import diffusion_coil
import drift_generalisation as lumped
import numpy as np

from calibkit.instruments.bias import compensate, drift_choice as decision, simulate_fog as fog
from calibkit.instruments.bias.numeric import bank, choice
from calibkit.numeric import gum, intervals
from calibkit.numeric.thermal import evaluate
from calibkit.simulate.chamber import Chamber

if TYPE_CHECKING:
    from calibkit.arrays import Array
    from calibkit.instruments.bias.numeric.bank import OnLevels
    from calibkit.numeric.thermal.evaluate import Evaluation
    from calibkit.numeric.thermal.pooled_fit import ThermalLog

FIRST_SEED = 400_000
GROUP = 6
BLOCKS = 10
"""Blocks of 10 s in the means that `validate` compares."""
RELEASED = """
import json, pickle, sys
from calibkit.numeric import thermal_choice, thermal_drift, thermal_fit
read = pickle.load(sys.stdin.buffer)
fitted, unseen = ([thermal_fit.ThermalLog(*log) for log in logs] for logs in read)
model = thermal_choice.choose(fitted).model
drifts = [0.0 * log.time if model is None else
          thermal_drift.evaluate(model, log.time, log.case, log.env).drift for log in unseen]
json.dump([drift.tolist() for drift in drifts], sys.stdout)
"""
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
    """One gyro: reductions [logs], what the noise allows [logs], coverage about the mean and
    absolutely, errors at rest with U [°/h], logs that are worse than uncorrected by more than U,
    what a choice without a bank reaches [logs], seconds of the choice, whether `validate` would
    reject a log, and what version 0.1.0 reaches [logs].
    """

    reductions: Array
    limits: Array
    about_mean: float
    absolute: float
    rest: Array
    worse: int
    without_bank: Array
    seconds: float
    name: str
    rejected: bool
    released: Array


def stated(model: OnLevels, found: Evaluation) -> Array:
    """Expanded uncertainty [n, °/h] of the drift."""
    _, _, parts, dofs = zip(*evaluate.contributions(model, found), strict=True)
    return gum.expand_along(np.stack(parts), np.array(dofs))[2]


def means(values: Array) -> Array:
    """Means of 60 s."""
    size = values.shape[0] // GROUP * GROUP
    return values[:size].reshape(-1, GROUP, *values.shape[1:]).mean(axis=1)


def reduction(model: OnLevels | None, log: ThermalLog, truth: Array) -> float:
    """Reduction of the true drift of a log; 1 without a model."""
    if model is None:
        return 1.0
    return reduce(truth, bank.evaluate(model, log.time, log.case, log.env).drift)


def reduce(truth: Array, drift: Array) -> float:
    """Reduction of a true drift [n, °/h] by a predicted one [n, °/h]."""
    return float(np.std(means(truth)) / np.std(means(truth - drift)))


def reductions_of_release(
    release: str, fitted: list[ThermalLog], unseen: list[tuple[ThermalLog, Array]]
) -> Array:
    """Reductions [logs] by the choice of version 0.1.0 in a folder; not a number without one."""
    if not release:
        return np.full(len(unseen), np.nan)
    logs = [fitted, [log for log, _ in unseen]]
    plain = [
        [(one.name, one.time, one.case, one.env, one.indication, one.part) for one in some]
        for some in logs
    ]
    done = subprocess.run(
        [sys.executable, "-c", RELEASED],
        input=pickle.dumps(plain),
        stdout=subprocess.PIPE,
        cwd=release,
        env=os.environ | {"PYTHONPATH": release},
        check=True,
    )
    drifts = map(np.array, json.loads(done.stdout))
    return np.array([reduce(truth, own) for (_, truth), own in zip(unseen, drifts, strict=True)])


def is_rejected(model: OnLevels, log: ThermalLog, there: Evaluation) -> bool:
    """Whether `validate` finds the errors of a log larger than stated."""
    along = evaluate.combine_along(model, there, ())
    left = log.indication - there.drift
    found, _, _ = compensate.compare_means(left, along, model.noise, BLOCKS)
    return bool(found["rms_error_over_uncertainty"] > found["largest_rms_error_over_uncertainty"])


def widened(model: OnLevels | None, logs: list[ThermalLog]) -> OnLevels | None:
    """Model as `fit` exports it: half of a difference of turn-on biases between the ways that is
    not chance is part of its model error.
    """
    ways = [
        SimpleNamespace(ramps=(SimpleNamespace(rate=log.case[-1] - log.case[0]),)) for log in logs
    ]
    found = None if model is None else decision.compare_turn_on(model, ways)  # type: ignore[arg-type]
    if model is None or found is None or abs(found[0]) <= found[2]:
        return model
    return replace(model, model_error=math.hypot(model.model_error, 0.5 * found[0]))


def judge(
    fitted: list[ThermalLog],
    unseen: list[tuple[ThermalLog, Array]],
    limits: Array,
    rest: Array,
    release: str,
) -> Judged:
    """Figures of one gyro; `rest` [9, °/h] is its true drift at rest."""
    released = reductions_of_release(release, fitted, unseen)
    start = time.process_time()
    found = choice.choose(fitted)
    taken = time.process_time() - start
    model = widened(found.model, fitted)
    name = found.chosen_errors.name if found.chosen_errors else ""
    others = choice.choose(fitted, [one for one in choice.CANDIDATES if one.form != "bank"]).model
    without = np.array([reduction(others, *one) for one in unseen])
    if model is None:
        nothing = np.full((2, len(REST_DEGC)), np.nan)
        untested = (np.ones(8), limits, np.nan, np.nan, nothing, 0, without, taken, name)
        return Judged(*untested, rejected=False, released=released)
    reached, mean, absolute, worse, rejected = [], [], [], 0, False
    for log, truth in unseen:
        there = bank.evaluate(model, log.time, log.case, log.env)
        error, U = there.drift - truth, stated(model, there)
        reached.append(reduction(model, log, truth))
        centred = stated(model, there.about_mean())
        mean.append(np.mean(np.abs(error - error.mean()) <= centred))
        absolute.append(np.mean(np.abs(error) <= U))
        rejected |= is_rejected(model, log, there)
        away = truth - truth.mean()
        worse += bool(np.std(error) > np.std(away) + np.sqrt(np.mean(U**2)))
    still = np.array([[model_at_rest(model, degc)] for degc in REST_DEGC])[:, 0].T
    return Judged(
        np.array(reached),
        limits,
        float(np.mean(mean)),
        float(np.mean(absolute)),
        np.stack([still[0] - rest, still[1]]),
        worse,
        without,
        taken,
        name,
        rejected,
        released,
    )


def model_at_rest(model: OnLevels, degc: float) -> tuple[float, float]:
    """Drift at rest against 25 °C and its expanded uncertainty [°/h]."""
    time_s, case = np.array([0.0, 1.0]), np.full(2, degc)
    if getattr(model, "bank", None) is not None and model.bank.widths + model.bank.warm_up:
        (rate, row), (zero, origin) = bank.at_rest(model, degc), bank.at_rest(model, 25.0)
        u = gum.uncertainty_along((row - origin)[None], model.covariance)[0]
        return rate - zero, 2.0 * float(np.hypot(u, model.model_error))
    found = bank.evaluate(model, time_s, case, case)
    return float(found.drift[1]), float(stated(model, found)[1])


def diffusion(seed: int, kind: str, options: dict[str, object], release: str) -> Judged:
    """Figures of a diffusion coil."""
    coil = diffusion_coil.draw(seed, kind)
    made = diffusion_coil.campaign(coil, seed, **options)  # type: ignore[arg-type]
    unseen = diffusion_coil.unseen(coil, seed)
    limits = np.full(8, np.nan)
    if kind == "plain":
        limits = diffusion_coil.noise_limit(coil, made, unseen)
    rest = np.array([diffusion_coil.drift_at_rest(coil, degc) for degc in REST_DEGC])
    pairs = [(one.log, one.drift) for one in unseen]
    return judge([one.log for one in made], pairs, limits, rest, release)


def of_lumped(seed: int, kind: str, options: dict[str, object], release: str) -> Judged:
    """Figures of a lumped gyro."""
    device = lumped.gyro(seed, kind)
    rates = options.get("rates", (1.0, 5.0, 8.0, 10.0))
    unseen = diffusion_coil.unseen_programmes(seed)
    programmes = fog.programmes(rates, ()) | {f"unseen/{n}": p for n, p in unseen.items()}  # type: ignore[arg-type]
    fitted, judged = [], []
    for name, log in fog.logs(device, programmes, seed, Chamber()).items():
        found = lumped.thermal_log(name, log)
        if name.startswith("unseen/"):
            held = intervals.Intervals.find(log.columns["time_s"].astype(np.float64), 10.0)
            judged.append((found, held.means(log.drift)))
        else:
            fitted.append(found)
    powers = [0.0, *device.static_dph]
    above = np.array(REST_DEGC) - 25.0
    rest = np.polynomial.polynomial.polyval(above, powers)
    return judge(fitted, judged, np.full(8, np.nan), rest, release)


def line(plant: str, kind: str, options: dict[str, object], found: list[Judged]) -> str:
    """One row of the table."""
    reached = np.array([one.reductions for one in found])
    least, limits = reached.min(axis=1), np.array([one.limits for one in found])
    allowed = limits.min(axis=1) >= ALLOWED
    ten = f"{np.mean(least[allowed] >= 10.0):.0%} of {allowed.sum()}" if allowed.any() else "–"
    rest = np.array([one.rest for one in found])
    known = np.isfinite(rest[:, 0, 0])
    errors, U = np.abs(rest[known, 0]), rest[known, 1]
    without = np.median(np.median([one.without_bank for one in found], axis=1))
    released = np.median(np.median([one.released for one in found], axis=1))
    changed = ", ".join(f"{key} {value}" for key, value in options.items())
    figures = (
        f"{least.min():.1f} / {np.quantile(least, 0.1):.1f} / {np.median(least):.1f}",
        ten,
        f"{np.median(np.median(reached, axis=1)):.1f}",
        f"{without:.1f}",
        f"{released:.1f}",
        f"{np.median(np.median(limits, axis=1)):.1f}",
        f"{np.nanmean([one.about_mean for one in found]):.3f}",
        f"{np.nanmean([one.absolute for one in found]):.3f}",
        f"{np.mean(errors <= U):.3f}",
        f"{np.median(errors):.4f} / {np.quantile(errors.max(axis=1), 0.9):.4f}"
        if known.any()
        else "–",
        str(sum(one.worse for one in found)),
        f"{np.mean([one.rejected for one in found]):.0%}",
        f"{np.mean([one.seconds for one in found]):.2f}",
    )
    row = f"{plant}, {kind}{': ' + changed if changed else ''}"
    return f"| {row} | {len(found)} | {' | '.join(figures)} |"


def main() -> int:
    """Run and print the table, one row at a time."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 16
    first = int(sys.argv[2]) if len(sys.argv) > 2 else FIRST_SEED
    chosen = int(sys.argv[3]) if len(sys.argv) > 3 else None
    release = sys.argv[4] if len(sys.argv) > 4 else ""
    print(
        "| plant, kind: campaign | gyros | least reduction: min / 10 % / median"
        " | ≥ 10 where allowed | median of medians | without a bank | 0.1.0 | noise limit"
        " | coverage about mean | absolute |"
        " at rest | error at rest: median / 90 % of largest | worse than raw by > U"
        " | rejected | s |"
    )
    print("|" + "---|" * 15)
    for number, (plant, kind, options) in enumerate(ROWS):
        if chosen is not None and number != chosen:
            continue
        act = diffusion if plant == "diffusion" else of_lumped
        found = [act(first + k, kind, options, release) for k in range(count)]
        print(line(plant, kind, options, found), flush=True)
        names: dict[str, int] = {}
        for one in found:
            names[one.name] = names.get(one.name, 0) + 1
        print(f"<!-- {names} -->", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
