"""Predicted uncertainty of planned campaigns against the scatter of campaigns run by them.

    python benchmarks/planned_campaigns.py accelerometer --campaigns 1000

Each campaign draws a device whose model is exact, and every error that the plan assumes; it is
fitted with the recipe of the plan. Printed are predicted over actual standard uncertainty (root
mean square over the coefficients, each in units of its predicted u), its own standard error, and
how often the interval of the fit covers the truth.
"""

import argparse
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from calibkit import instruments, recipe
from calibkit.commands import plans
from calibkit.fit.solve import solve
from calibkit.instruments.accelerometer import (
    dwells as triad_dwells,
    plan as triad_plan,
)
from calibkit.instruments.accelerometer.equation import read_terms
from calibkit.instruments.accelerometer.fit import fit_triad
from calibkit.instruments.bias import plan as fog_plan
from calibkit.instruments.bias.numeric import bank as forward, bank_fit
from calibkit.instruments.gyro_scale import equation, plan as gyro_plan
from calibkit.logs import log_files
from calibkit.numeric import flicker, gum
from calibkit.numeric.arrays import Array
from calibkit.numeric.least_squares import polynomial
from calibkit.numeric.thermal import coil, fits
from calibkit.numeric.thermal.pooled_fit import Stack
from calibkit.planning import document, equipment
from calibkit.planning.bench import Task, total_variance
from calibkit.records import new_files

FAINT = 6.4
"""Noise terms below so many predicted u are not judged: fits do not report most of them."""
ORDERS = {"inclinometer": ("scale.order=2",)}
"""Procedure → what its recipe states beside, so that a fit has all planned coefficients."""


def make_plan(procedure: str, *stated: str, **asked: Any) -> document.Plan:  # noqa: ANN401
    """A plan of a recipe with stated keys, asked as a Request, that is written and read back."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "plan"
        source = recipe.find(procedure, (*ORDERS.get(procedure, ()), *stated))
        plans.plan(source, out, **asked)
        return document.load_plan(out)


def run_triad(plan: document.Plan, seed: int, spec: Any) -> tuple[Array, ...]:  # noqa: ANN401
    """Errors of the coefficients of one campaign, their predicted and their fitted u, and the
    coverage factors of the fit.
    """
    rng = np.random.default_rng(seed)
    predicted = {one["name"]: one["standard_uncertainty"] for one in plan.document["coefficients"]}
    terms = read_terms(tuple(predicted))
    typical = {"k": (3e-3, 1e-4, 1e-7, 1e-10), "z": (3e-3, 3e-5, 1e-8, 1e-10), "c": (3e-3, 1e-6)}
    size = [typical[kind][power] for kind, power in zip(terms.kind, terms.power, strict=True)]
    truth = terms.start() + rng.normal(0.0, size)

    def indicate(gravity: Array, degc: Array) -> Array:
        indication = gravity.copy()
        for _ in range(30):  # the equation is nearly the identity
            indication = indication - (terms.corrected(truth, indication, degc) - gravity)
        return indication

    held = plan.schedule.recorded("dwell")
    held = [one for one in held if one.log == held[0].log]
    spots = np.array([(one.inclination_deg, one.toolface_deg) for one in held])
    device = plan.device
    planned = triad_plan.planned_dwells(held, device.noise_of(held[0].duration_s))
    indication, degc, _ = triad_plan.simulate_dwells(rng, indicate, planned, spec, device)
    count = len(spots)
    dwells = triad_dwells.DwellSet(
        indication,
        degc,
        *spots.T,
        np.full((count, 3), np.nan),
        np.array([one.start_s for one in held]),
        np.zeros(count, dtype=np.int64),
        tuple(map(str, range(count))),
        (),
    )
    # the K-factor beside it takes as long again
    spec = spec.model_copy(update={"k": spec.k.model_copy(update={"enabled": False})})
    _, results = fit_triad(dwells, spec)
    (model,) = results[-1].models
    found = {one.name: one for one in model.coefficients}
    error = np.array([found[name].value for name in predicted]) - truth
    u = np.array([found[name].standard_uncertainty for name in predicted])
    dof = [found[name].effective_dof or model.dof for name in predicted]
    return error, np.array([*predicted.values()]), u, np.array(list(map(gum.coverage_factor, dof)))


def run_table(plan: document.Plan, seed: int, spec: Any) -> tuple[Array, ...]:  # noqa: ANN401
    """As `run_triad`, of K and F0 of a gyro at the reference temperature [ppm, °/h]: means over the
    held rates with all errors of the plan, fitted by the model of all runs.
    """
    rng = np.random.default_rng(seed)
    device = plan.device
    rows, order = gyro_plan.planned_holds(plan.schedule, device, lambda _: 0), device.order
    x = (rows.row_degc - 25.0) / 100.0
    K, F0 = rng.normal(0.0, 3e-3, order + 1), rng.normal(0.0, 1e-3, order + 1)
    scale = 1.0 + np.vander(x, order + 1, increasing=True) @ K
    size = {one["effect"]: one["value"] for one in plan.document["components"]}
    count, rate = int(rows.run.max()) + 1, rows.rate_dps[rows.run == 0]
    drawn = rng.normal(0.0, 1.0, (3, count))
    response = rng.normal(0.0, size["response"] / 3600.0, len(rate))
    indication = (
        (scale + 1e-6 * size["scale"] * drawn[0][rows.run]) * rows.rate_dps
        + np.vander(x, order + 1, increasing=True) @ F0
        + size["zero"] / 3600.0 * drawn[1][rows.run]
        + size["zero drift"] / 3600.0 * drawn[2][rows.run] * rows.hours
        + rows.noise * rng.normal(size=rows.run.size)
        + np.tile(response, count)
    )
    # the best straight line over the rates takes its part of the response
    slope, zero = np.polyfit(rate, response, 1)
    K0 = 1e4
    rows = replace(rows, indication=K0 * indication)
    shapes = (equation.ASYMMETRY,) if rows.shows_asymmetry else ()
    middle_half = polynomial.middle_and_half(rows.temp_degc)
    terms = equation.ResponseTerms(1, order, middle_half, shapes)
    known = {"scale": size["scale"], "zero": size["zero"]}
    shared = [
        replace(one, size=known[one.effect], size_dof=20.0)
        if one.group == "run" and one.effect in known
        else one
        for one in equation.shared_errors(rows, terms, np.array([K0]), np.array([K0]))
    ]
    fitted = solve(lambda p: equation.residual(p, rows, terms), terms.start, shared)
    at, best_line = spec.reference_temp_degc, equation.best_line(terms, rows.rate_dps)
    x = polynomial.powers(terms.mapped(np.array([at])), order)[0]
    found = fitted.of(lambda p: np.stack([x @ one[0] for one in best_line(p)]))
    powers = ((at - 25.0) / 100.0) ** np.arange(order + 1)
    truth = K0 * np.array([1.0 + powers @ K + slope, powers @ F0 + zero])
    unit = np.array([1e6, 3600.0]) / K0
    predicted = [part["standard_uncertainty"] for part in plan.document["coefficients"]]
    return (
        (found.value - truth) * unit,
        np.array(predicted),
        found.u * unit,
        np.array([gum.coverage_factor(dof) for dof in found.dof]),
    )


def run_gyro(plan: document.Plan, seed: int, spec: Any) -> tuple[Array, ...]:  # noqa: ANN401
    """As `run_triad`, of the drift [°/h] about its mean along the ramps on which it is used: a gyro
    drawn from the priors of the plan, fitted by a bank whose variances are sought.
    """
    rng = np.random.default_rng(seed)
    bench = fog_bench(plan, spec)
    sizes, white_dph = bench.device.size, bench.device.noise_of(fog_plan.BLOCK_S)
    held = [one for one in plan.schedule.actions if one.log and "withheld" not in one.log]
    ramps = [
        bench.ramps[b.ramp_degc_per_min, c.duration_s]
        for b, c in zip(held[1::3], held[2::3], strict=True)
    ]
    p, shared = len(fog_plan.BANK.terms), fog_plan.SHARED
    drawn = rng.normal(size=shared) / np.sqrt(bench.precision[:shared] + 1e-12)
    drawn[0] = 0.0
    lag = bank_fit.STATIC_MEAN + drawn[p:]
    lag[2] = np.clip(lag[2], 0.0, 1.0)
    logs = []
    for number, log in enumerate(ramp.log for ramp in ramps):
        time, case = log.time, log.case
        own = bench.columns([log])[1][:, shared:]
        own = own / np.sqrt(bench.precision[shared:])
        factor = np.linalg.cholesky(
            white_dph**2 * np.eye(time.size)
            + sizes("log", "flicker") ** 2 * flicker.kernel(time.size)
        )
        value = drift_of(time, case, drawn[:p], lag) + factor @ rng.normal(size=time.size)
        value += own @ rng.normal(size=own.shape[1])
        logs.append(replace(log, name=f"{number}", indication=value))
    stacked = Stack.of_logs(logs)
    found = bank_fit.solve(bank_fit.state_problem(fits.level_basis(stacked).rows)).finish()
    fitted_lag = np.array([*np.log(found.static_lag[:2]), found.static_lag[2]])
    back = np.diag([*np.ones(p), *(1.0 / np.array(found.static_lag[:2])), 1.0])
    covariance = back @ found.covariance @ back.T
    error, variance = [], []
    for used in fog_plan.USED:
        log = bench.log(*used)
        time, case = log.time, log.case
        off = drift_of(time, case, found.coefficients, fitted_lag)
        off = off - drift_of(time, case, drawn[:p], lag)
        slopes = slopes_of(time, case, found.coefficients, fitted_lag)
        slopes = (slopes - slopes.mean(axis=0))[:: fog_plan.EVERY]
        error.append((off - off.mean())[:: fog_plan.EVERY])
        variance.append(np.einsum("mp,pq,mq->m", slopes, covariance, slopes))
    predicted = np.sqrt(total_variance(bench.variances(ramps)["drift"]))
    u = np.sqrt(np.concatenate(variance))
    return np.concatenate(error), predicted, u, np.full(u.size, gum.coverage_factor(found.dof))


def run_logs(plan: document.Plan, seed: int, spec: Any) -> tuple[Array, ...]:  # noqa: ANN401
    """As `run_triad`, of all coefficients of a procedure whose simulation states their truth: its
    logs are written, and fitted as `calibkit fit` does.
    """
    instrument = instruments.find(spec.procedure)
    simulate = instruments.optional(spec.procedure, "simulate_plan")
    made = simulate(spec, plan.schedule, plan.device, seed)
    with tempfile.TemporaryDirectory() as folder:
        new_files.write_all({Path(folder) / key: own for key, own in made.files().items()})
        fitted = instrument.fit(
            spec, Path(folder), log_files.find_logs(spec, Path(folder)), instruments.silent
        )
    models = {one.name: one for result in fitted.results for one in result.models}
    figures = {one.name: one for result in fitted.results for one in result.figures}
    truth: Any = made.truth["coefficients"]
    rows = []
    for one in plan.document["coefficients"]:
        true, u = truth[one["model"]][one["name"]], one["standard_uncertainty"]
        if one["model"] in models:
            model = models[one["model"]]
            found = next(part for part in model.coefficients if part.name == one["name"])
            dof = model.dof_of(found)
        elif true < FAINT * u:
            continue
        elif one["name"] in figures:
            found = figures[one["name"]]
            dof = found.effective_dof or np.inf
        else:
            rows.append((np.nan, u, np.nan, np.nan))
            continue
        own = found.standard_uncertainty
        rows.append((found.value - true, u, own, gum.coverage_factor(dof)))
    return tuple(np.array(part) for part in zip(*rows, strict=True))


def fog_bench(plan: document.Plan, spec: Any) -> fog_plan.RampBench:  # noqa: ANN401
    """Campaigns of a gyro on ramps, as a plan on the sample bench assumes it."""
    low, high = plan.document["range_degc"]
    task = Task(equipment.read_equipment(None), range_degc=(low, high))
    return fog_plan.RampBench(spec, task)


def drivers_of(time: Array, case: Array, lag: Array) -> Any:  # noqa: ANN401
    """Drivers of one log for a static lag, and the derivatives of T by it."""
    along = coil.path([(time, case)])
    temperature = forward.static_temperature(along, lag)
    followed = forward.follow_lags(fog_plan.BANK, along)
    drivers = forward.log_drivers(fog_plan.BANK, [(time, case)], temperature, followed)
    return drivers, forward.static_derivatives(along, lag, temperature)


def drift_of(time: Array, case: Array, coefficients: Array, lag: Array) -> Array:
    """Drift [m, °/h] of one log."""
    return np.asarray(fog_plan.BANK.columns(drivers_of(time, case, lag)[0]) @ coefficients)


def slopes_of(time: Array, case: Array, coefficients: Array, lag: Array) -> Array:
    """Derivatives [m, p + 3] of the drift by coefficients and lag."""
    drivers, moved = drivers_of(time, case, lag)
    by_lag = moved * fog_plan.BANK.slope(coefficients, drivers)[:, None]
    return np.column_stack([fog_plan.BANK.columns(drivers), by_lag])


RUNS = {
    "accelerometer": (run_triad, "inclination<=0.01 deg", (-40.0, 125.0)),
    "accelerometer_magnitude": (run_logs, "component<=5e-5 g", None),
    "rate_table": (run_table, "scale factor<=1 ppm", (-40.0, 60.0)),
    "bias_temperature": (run_logs, "drift<=0.04 deg/h", (-40.0, 60.0)),
    "gyro_noise": (run_logs, "bias instability<=0.006 deg/h", None),
    "inclinometer": (run_logs, "azimuth<=0.05 deg", (20.0, 120.0)),
    "gyro_pair": (run_logs, "N<=2 ppm", None),
    "fog_thermal": (run_gyro, "drift<=0.03 deg/h", (-40.0, 60.0)),
}
"""Procedure → one campaign of it, wish and range of the plan."""


def judge(
    plan: document.Plan,
    campaigns: int,
    run: Callable[..., tuple[Array, ...]] = run_triad,
    first: int = 0,
) -> tuple[float, float, float]:
    """Predicted over actual u, its standard error, and the coverage of the fits."""
    spec = instruments.parse_recipe(plan.source)
    found = [run(plan, first + seed, spec) for seed in range(campaigns)]
    error, predicted, u, factor = (np.array(part) for part in zip(*found, strict=True))
    # campaigns are independent, the coefficients of one are not
    # a term that a fit does not report has no error
    square = np.nanmean((error / predicted) ** 2, axis=1)
    actual = float(np.sqrt(square.mean()))
    spread = float(square.std(ddof=1) / np.sqrt(campaigns) / (2.0 * square.mean()))
    coverage = float(np.mean((np.abs(error) <= factor * u)[np.isfinite(error)]))
    return 1.0 / actual, spread / actual, coverage


def main() -> None:
    """Print the figures of one procedure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("procedure", choices=list(RUNS))
    parser.add_argument("--campaigns", type=int, default=1000)
    parser.add_argument("--set", action="append", default=[], help="key of the recipe, as loss=...")
    asked = parser.parse_args()
    run, wish, range_degc = RUNS[asked.procedure]
    plan = make_plan(asked.procedure, *asked.set, wishes=(wish,), range_degc=range_degc)
    ratio, spread, coverage = judge(plan, asked.campaigns, run)
    print(
        f"{asked.procedure}, {plan.document['plan']}: predicted / actual u {ratio:.3f} ±"
        f" {spread:.3f}, coverage {coverage:.3f}, {asked.campaigns} campaigns"
    )


if __name__ == "__main__":
    main()
