"""Campaigns of an instrument at rest: soaks at which temperatures, how long, and how often it is
switched on (`BiasBench`); of a gyro in a chamber: which ramps with which soaks (`RampBench`).

What soaks will tell is predicted by the equation of the fit, y = Σ_k p_k x^k + b of the log + e,
with the assumed sizes of the turn-on bias b and of the noise e. The information of each ramp on the
`bank` model of the drift is found once, by the columns of the fit on a planned log; that of a
campaign is their sum.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, product, zip_longest

import numpy as np

from calibkit import units
from calibkit.errors import FitError, UsageError
from calibkit.fit.solve import Fit, predict
from calibkit.instruments.bias import blocks, compensate, forms, ramps, simulate_fog as simulated
from calibkit.instruments.bias.numeric import bank as forward, bank_fit, evidence
from calibkit.instruments.bias.recipe import BiasTemperatureRecipe, FogThermalRecipe
from calibkit.instruments.bias.simulate_fog import FogGyro
from calibkit.numeric.arrays import Array, Integers
from calibkit.numeric.constants import SECONDS_PER_HOUR, SECONDS_PER_MINUTE
from calibkit.numeric.dispersion import rms
from calibkit.numeric.least_squares import polynomial
from calibkit.numeric.thermal import coil
from calibkit.numeric.thermal.pooled_fit import BlockNoise, Stack, ThermalLog, WhitenedRows
from calibkit.planning.bench import (
    LEVELS,
    ONE_LEVEL_DEGC,
    WITHHELD,
    Bench,
    Design,
    PredictedCoefficient,
    Sources,
    Task,
    Tour,
    count,
    join,
)
from calibkit.planning.equipment import Device
from calibkit.planning.exchange import invert
from calibkit.planning.schedule import Clock, Schedule
from calibkit.recipe.tables import ErrorComponent
from calibkit.records.coefficients import Record, StageResult
from calibkit.records.frame import Log, refuse, values
from calibkit.simulate.campaign import Campaign
from calibkit.simulate.chamber import Chamber, Programme, follow_with_lag

TURN_ON = (blocks.GROUP, blocks.TURN_ON)


@dataclass(frozen=True, slots=True)
class Means:
    """Means [n] over spans of logs."""

    temperature: Array
    """[°C]."""
    log: Integers
    noise: Array


class BiasBench(Bench):
    """Campaigns of an instrument at rest: y = Σ_k p_k x^k + b of the log + e, x the temperature
    mapped to [-1, 1].
    """

    default_degc, files = (-40.0, 60.0), ("bias.json",)

    def __init__(self, spec: BiasTemperatureRecipe, task: Task) -> None:
        """UsageError also for channels of several units, and for polynomials of no temperature."""
        self.unit = unit = task.equipment.known_device(spec.procedure).noise_unit
        self.results = dict.fromkeys(("drift", "bias"), unit)
        self.units = {TURN_ON: unit}
        channels = spec.polynomials.bias
        self.order = max(channel.order for channel in channels)
        self.polynomials = [(c.indication, "p", unit, c.order + 1) for c in channels]
        abscissa = spec.polynomials.abscissa
        other = [column for column in spec.still_columns() if units.column_unit(column) != unit]
        if other or units.column_unit(abscissa) != "degC" or self.order < 1:
            raise UsageError(
                f"a plan is for channels in {unit} as polynomials of a temperature in °C; the"
                f" recipe has {', '.join(other) or abscissa} of order {self.order}",
                hint=f"plan channels of one unit, that of noise_unit in [device.{spec.procedure}]",
            )
        super().__init__(spec, task)

    def rows_of_logs(self, logs: Sequence[Log]) -> Means:
        """Means of up to 64 parts of each log; FitError for a log without times."""
        means, device = [], self.device
        for log in logs:
            if "time_s" not in log.frame.columns:
                raise FitError(
                    f"{log.file}: no times, expected time_s to know how long it is",
                    hint="map it under [columns.time_s], or plan without --have",
                )
            degc, time = (
                values(log.frame, name) for name in (self.spec.polynomials.abscissa, "time_s")
            )
            parts = 1 if np.ptp(degc) < ONE_LEVEL_DEGC else min(64, degc.size)
            level = np.array([part.mean() for part in np.array_split(degc, parts)])
            noise = device.noise * np.sqrt(device.noise_s * parts / (time[-1] - time[0]))
            means.append(Means(level, np.zeros(parts, dtype=np.int64), np.full(parts, noise)))
        rows: Means = join(means)
        return rows

    def fit(self, rows: Means) -> Fit:
        """What means of logs, each with its own turn-on bias, will tell of the polynomial."""
        turn_on = blocks.turn_on_bias(self.unit, rows.log, np.ones(rows.log.size))
        powers, shared = self.powers(rows.temperature), self.device.state([turn_on])
        start, names = np.zeros(self.order + 1), [f"p{k}" for k in range(self.order + 1)]
        return predict(lambda p: powers @ p, start, shared, noise=rows.noise, names=names)

    @cached_property
    def slopes(self) -> dict[str, Array]:
        """Result → its derivatives [m, order + 1] over the range of use: of the drift from the
        reference temperature, and of the bias.
        """
        low, high = self.range_degc
        reference = np.clip(self.spec.reference_temp_degc, low, high)
        powers = self.powers(np.linspace(low, high, LEVELS))
        return {"drift": powers - self.powers(np.array([reference])), "bias": powers}

    def powers(self, degc: Array) -> Array:
        """Powers [n, order + 1] of x."""
        return polynomial.powers(self.mapped(degc), self.order)

    def choices(self) -> tuple[int, ...]:
        """How often it is switched on at each temperature."""
        return 1, 2, 3

    def design(self, degc: Tour, choice: int, dwell_s: float) -> Design:
        """Logs at each temperature in their order; where nothing is withheld yet, with the longest
        way between two of them that is.
        """
        levels = np.repeat(degc, choice).tolist()
        device, clock = self.device, Clock(self.task.equipment)
        steps = np.abs(np.diff(levels))
        longest = int(np.argmax(steps)) + 1 if steps.size and not self.task.withheld else -1
        stem = self.task.name_log("soak")
        for number, level in enumerate(levels):
            if number == longest:
                # the instrument stays on, and warms up when it is switched on anew
                clock.settle(device, level, f"{WITHHELD}{stem}_way_to_{level}.csv")
                clock.add("soak", device.warm_up_s)
            else:
                clock.settle(device, level, shortest_s=device.warm_up_s)
            clock.add("soak", dwell_s, f"{stem}_{number + 1:02d}_{level}.csv")
        noise = np.full(len(levels), self.device.noise_of(dwell_s))
        means = Means(np.array(levels, dtype=np.float64), np.arange(len(levels)), noise)
        logs, places = count(len(levels), "log"), count(len({*levels}), "temperature")
        label = f"{logs} at {places}, {dwell_s / 60.0:g} min each"
        return Design(label, clock.schedule(), (f"{stem}_*.csv",), means)

    def notes(self, campaign: Design) -> tuple[str, ...]:
        """How the instrument is switched on."""
        note = "the instrument is switched off and on before each log that a fit sees"
        return (note,) if campaign.rows else ()


def _simulate_soaks(
    spec: BiasTemperatureRecipe, schedule: Schedule, device: Device, seed: int
) -> Campaign:
    """Logs of an instrument whose bias is a polynomial of its case temperature, and its truth."""
    rng = np.random.default_rng(seed)
    turn_on, noise = device.size(*TURN_ON), device.noise_of(1.0)
    set_degc = [action.set_degc for action in schedule.actions if action.log]
    # the drift is large beside the noise of a minute
    size, abscissa = 50.0 * device.noise_of(60.0), spec.polynomials.abscissa
    biases = {
        channel.indication: np.polynomial.Polynomial(
            rng.normal(0.0, size, channel.order + 1) / (1.0 + np.arange(channel.order + 1.0)),
            domain=(min(set_degc), max(set_degc)),
        )
        for channel in spec.polynomials.bias
    }
    logs: dict[str, dict[str, Array]] = {}
    for name, actions in schedule.by_log().items():
        # the case follows the chamber at 1 Hz; a soak without a ramp before it is settled
        chamber = [
            np.linspace(action.start_degc, action.set_degc, int(action.duration_s), endpoint=False)
            for action in actions
        ]
        case = follow_with_lag(np.concatenate(chamber), max(device.lags_s))
        # the chamber settles a little off its set point, a reading has a hundredth
        case += rng.normal(0.0, 0.1)
        log = {"time_s": np.arange(float(case.size))}
        log[abscissa] = case + rng.normal(0.0, 0.01, case.size)
        for channel, bias in biases.items():
            shifted = bias(case) + rng.normal(0.0, turn_on)
            log[channel] = shifted + rng.normal(0.0, noise, case.size)
        logs[name] = log
    decimals = {"time_s": 0, abscissa: 3} | dict.fromkeys(biases, 6)
    drawn = {
        name: {f"p{k}": value for k, value in enumerate(bias.convert().coef.tolist())}
        for name, bias in biases.items()
    }
    return Campaign(logs, decimals, {"coefficients": drawn})


RATES = (1, 2, 3, 5, 8, 10)
"""Unsigned rates [°C/min] that the search takes."""
FEWEST_RATES = 2
"""Rates of each direction that a fit needs, so that one can be left out."""
BEFORE_S = 600.0
"""Soak before a ramp that belongs to its log."""
EVERY = 5
"""Rows between two at which an uncertainty is predicted."""
LEVELS_AT_REST = 9
"""Temperatures at which the drift at rest is predicted."""
BLOCK_S = 60.0
"""Interval of the means of a planned log: shorter than the lags that matter."""
BANK = forward.Bank(bank_fit.LAGS_S)
SHARED = len(BANK.terms) + len(bank_fit.STATIC_MEAN)
"""Coefficients and static lags, which all logs share."""
DRIFT, TURNED_ON = ("coil", "drift"), ("log", "turn-on")
INITIAL, FLICKER = ("log", "initial state"), ("log", "flicker")
SOURCES = ("noise", "turn-on bias", "start of the log", "size of the drift", "static lag")
"""What limits a result: of each log, and of the coefficients before any is measured."""
UNITS = dict.fromkeys((DRIFT, TURNED_ON, INITIAL, FLICKER), "deg/h")
"""(group, effect) of the errors that can be assumed, and the units they are stated in."""
BEFORE, NOISE = "drift_rms_before.", "noise_rms."
"""Figures of the drift rms of a log and of the noise in it begin with these."""
USED = tuple((sign * rate, 1800.0) for rate in (2.0, 4.0, 7.0) for sign in (1.0, -1.0))
"""Signed rates [°C/min] of the ramps on which the drift is used, and soaks [s] after them."""


@dataclass(frozen=True, slots=True)
class PlannedRamp:
    """One log, planned or measured: a ramp between two soaks."""

    rates: tuple[float, ...]
    """Signed rate [°C/min]; of what is measured each that was found."""
    log: ThermalLog
    information: Array
    """[3, p, p], see `RampBench.ramp`."""


class RampBench(Bench):
    """Campaigns of a gyro on ramps, as the fit of the `bank` model with its priors will see them:
    sizes of turn-on biases and initial states are assumed, all others are the priors' medians.

        S = A - B (C + D)⁻¹ Bᵀ       information of one log on coefficients and static lag
        M = Σ_logs S + P             of all, P the precision of what is known before

    [[A, B], [Bᵀ, C]] are the moments of the rows, C of the errors of the log with precision D.
    """

    results = {"drift": "deg/h", "drift at rest": "deg/h"}
    units, default_degc = UNITS, (-40.0, 60.0)
    files, noise_unit = (forms.FILE,), "deg/h"

    def __init__(self, spec: FogThermalRecipe, task: Task) -> None:
        """UsageError also for equipment that does not state drift and turn-on biases, from which
        the priors follow, or that allows a single rate.
        """
        super().__init__(spec, task)
        if not (self.device.size(*DRIFT) and self.device.size(*TURNED_ON)):
            raise UsageError(
                f"components of [device.{spec.procedure}]:"
                f" {', '.join(f'{effect} of {group}' for group, effect in self.device.component)}",
                hint="expected drift of coil and turn-on of log, with initial state and flicker of"
                " log",
            )
        # unsigned [°C/min]
        fastest = task.equipment.fastest(self.device)
        self.rates = tuple(rate for rate in RATES if rate <= fastest)
        if len(self.rates) < FEWEST_RATES:
            raise UsageError(
                f"fastest_degc_per_min leaves one of the rates {', '.join(map(str, RATES))} °C/min,"
                f" expected {FEWEST_RATES}: a fit leaves out a ramp of each direction",
                hint="state the fastest ramp of chamber and device in the equipment file",
            )

    def errors_of_run(
        self, records: Sequence[Record | StageResult]
    ) -> tuple[list[ErrorComponent], float]:
        """White noise, and sizes of drift, turn-on bias and flicker noise of a run; UsageError for
        one that does not state them.
        """
        (record,), levels = records, {form.name for form in forms.ON_LEVELS.values()}
        model = next((fitted for fitted in record.models if fitted.form in levels), None)
        if model is None:
            raise UsageError(
                "that run has no level, lagged or bank model of a gyro's drift, which states noise"
                " and turn-on biases",
                hint="name another run, or state the sizes in [device] of the equipment file",
            )
        parameters = {parameter.name: parameter.value for parameter in model.parameters}
        figures = {figure.name: figure.value for figure in record.figures}
        names = [name.removeprefix(BEFORE) for name in figures if name.startswith(BEFORE)]
        squares = [figures[BEFORE + name] ** 2 - figures[NOISE + name] ** 2 for name in names]
        turn_on = [value for name, value in figures.items() if name.startswith(compensate.TURN_ON)]
        spread = float(np.std(turn_on, ddof=1)) if len(turn_on) > 1 else 0.0
        sizes = {
            DRIFT: max(float(np.mean(squares)), 0.0) ** 0.5 if squares else 0.0,
            TURNED_ON: parameters.get("turn_on", spread),
            FLICKER: parameters["flicker"],
        }
        dof = float(max(len(names) - 1, 1))
        errors = [
            ErrorComponent(group=group, effect=effect, value=value, unit="deg/h", dof=dof)
            for (group, effect), value in sizes.items()
            # what was not seen is as the equipment file states it
            if value > 0.0
        ]
        white = float(
            np.sqrt(parameters["white_variance"] * parameters["interval"] / self.device.noise_s)
        )
        return errors, white

    def rows_of_logs(self, logs: Sequence[Log]) -> tuple[PlannedRamp, ...]:
        """Ramps of logs, by the case temperature that was logged."""
        measured = []
        for log in logs:
            examined = ramps.examine(self.spec, log)
            refuse(examined.findings)
            rates = [stretch.level for stretch in examined.held if stretch.kind == "ramp"]
            means = ramps.block_means(log, self.spec, rated=False)[1]
            measured.append(self.ramp(silent_log(log.file, means.time, means.case), *rates))
        return tuple(measured)

    def log(self, rate: float, after_s: float) -> ThermalLog:
        """Log of a ramp at a signed rate [°C/min] with a soak [s] after it: the case follows the
        set point with its lag.
        """
        start, end = self.range_degc if rate > 0.0 else self.range_degc[::-1]
        corners = np.cumsum([0.0, BEFORE_S, (end - start) / rate * SECONDS_PER_MINUTE, after_s])
        time = np.arange(0.0, corners[-1], BLOCK_S)
        chamber = np.interp(time, corners, [start, start, end, end]).astype(np.float64)
        drivers = coil.path([(time, chamber)]).drivers(min(self.device.lags_s), None)
        return silent_log("", time, drivers.temperature)

    def columns(self, logs: Sequence[ThermalLog]) -> tuple[bank_fit.Problem, Array]:
        """Problem of the fit to logs, and its columns [n, P] at a static drift of the assumed size:
        coefficients, static lag, then errors of the logs.
        """
        stacked = Stack.of_logs(logs)
        rows = WhitenedRows.of_stack(stacked, stacked.fitted)
        block_s, drift = float(logs[0].time[1] - logs[0].time[0]), self.device.size(*DRIFT)
        noise = BlockNoise(self.device.noise_of(block_s) ** 2, self.device.size(*FLICKER))
        problem = bank_fit.state_problem(replace(rows, noise=noise), drift=drift)
        coefficients = np.zeros(len(BANK.terms))
        coefficients[BANK.part("s").start] = drift
        return problem, problem.columns(bank_fit.STATIC_MEAN, coefficients)

    @cached_property
    def precision(self) -> Array:
        """Precision [q] of what is known of the columns of one log before any is measured, 0 of
        the constant.
        """
        prior = self.columns([self.log(*USED[0])])[0].prior
        theta = prior.mean.copy()
        for place, error in ((bank_fit.TURN_ON, TURNED_ON), (bank_fit.INITIAL, INITIAL)):
            theta[place] = 2.0 * np.log(max(self.device.size(*error), 1e-9))
        return np.exp(-evidence.log_variances(prior, theta))

    def ramp(self, log: ThermalLog, *rates: float) -> PlannedRamp:
        """A ramp with the information of its log: what its noise, its turn-on bias and its initial
        state make of a variance, which add up to all of it.

            S = noise + Σ_k D_k o_k o_kᵀ,   o = (C + D)⁻¹ Bᵀ
        """
        problem, columns = self.columns([log])
        moments = problem.gram(bank_fit.STATIC_MEAN, columns).matrix
        B, C, D = moments[SHARED:, :SHARED], moments[SHARED:, SHARED:], self.precision[SHARED:]
        o = np.linalg.solve(C + np.diag(D), B)
        # the errors of a log are its turn-on bias, then its initial states
        by_error = [np.outer(row, row) * precision for row, precision in zip(o, D, strict=True)]
        turn_on, start = by_error[0], np.sum(by_error[1:], axis=0)
        noise = moments[:SHARED, :SHARED] - B.T @ o - turn_on - start
        return PlannedRamp(rates, log, np.stack([noise, turn_on, start]))

    @cached_property
    def ramps(self) -> dict[tuple[float, float], PlannedRamp]:
        """(rate, soak after it) → ramp that the search takes."""
        signed = [sign * rate for rate in self.rates for sign in (1.0, -1.0)]
        pairs = product(signed, self.device.dwell_s)
        return {(rate, soak_s): self.ramp(self.log(rate, soak_s), rate) for rate, soak_s in pairs}

    def rows(self, design: Design) -> tuple[PlannedRamp, ...]:
        """Ramps that are measured already, and those of a design."""
        return (*(self.have or ()), *(design.rows or ()))

    def posterior(self, rows: Sequence[PlannedRamp]) -> tuple[Array, Array]:
        """Covariance [p, p] of coefficients and static lag, and what of the information on them
        each of `SOURCES` states [5, p, p].
        """
        known = np.zeros((2, SHARED, SHARED))
        for k, part in enumerate((range(len(BANK.terms)), range(len(BANK.terms), SHARED))):
            known[k, part, part] = self.precision[part]
        of_ramps = np.sum([ramp.information for ramp in rows], axis=0)
        information = np.concatenate([of_ramps, known])
        return invert(information.sum(axis=0)), information

    @cached_property
    def slopes(self) -> dict[str, Array]:
        """Result → its derivatives [m, p + 3] where it is used: of the drift about its mean along
        ramps, or at rest relative to 25 °C.
        """
        problem, columns = self.columns([self.log(*used) for used in USED])
        columns_of_ramps = [columns[rows, :SHARED] for rows in problem.stacked.log_rows]
        z = np.linspace(*self.range_degc, LEVELS_AT_REST) - forward.ORIGIN_DEGC
        at_rest = np.zeros((LEVELS_AT_REST, SHARED))
        powers = np.arange(1, forward.POWERS + 1)
        at_rest[:, BANK.part("s")] = (z[:, None] / forward.SCALE_DEGC) ** powers
        of_drift = np.concatenate([(log - log.mean(axis=0))[::EVERY] for log in columns_of_ramps])
        return {"drift": of_drift, "drift at rest": at_rest}

    def variances(self, rows: Sequence[PlannedRamp]) -> dict[str, Sources]:
        """Variances of each result, in the order of `SOURCES`: of the noise, of turn-on biases, of
        initial states, and of what is known of coefficients and static lag before any is measured.
        """
        (covariance, information), by_result = self.posterior(rows), dict[str, Sources]()
        for name, slopes in self.slopes.items():
            pull = covariance @ slopes.T
            parts = np.sum(pull * (information @ pull), axis=1)
            by_result[name] = dict(zip(SOURCES, parts, strict=True))
        return by_result

    def coefficients(self, rows: Sequence[PlannedRamp]) -> Iterator[PredictedCoefficient]:
        """Of the bank, without its constant."""
        u = np.sqrt(np.diag(self.posterior(rows)[0])).tolist()
        for (name, unit), size in list(zip(BANK.terms, u, strict=False))[1:]:
            yield PredictedCoefficient("bank", name, unit, size)

    def temperatures(self, rows: Sequence[PlannedRamp]) -> list[Array]:
        """Ends of all logs."""
        return [np.array([end(ramp.log.case) for ramp in rows for end in (np.min, np.max)])]

    def covers(self, rows: Sequence[PlannedRamp]) -> bool:
        """Whether ramps reach all of the range, and those of each direction have two rates, so
        that a fit can leave one out.
        """
        if not super().covers(rows):
            return False
        rates = np.sort([rate for ramp in rows for rate in ramp.rates])
        for sizes in (rates[rates > 0.0], -rates[rates < 0.0][::-1]):
            # rates within a tenth are one
            if np.sum(sizes[1:] > 1.1 * sizes[:-1]) + bool(sizes.size) < FEWEST_RATES:
                return False
        return True

    def tours(self) -> list[Tour]:
        """Every ramp spans the range."""
        return [()]

    def choices(self) -> Iterator[tuple[Sequence[int], Sequence[int]]]:
        """Up to four rates of each direction; where something is measured already and withheld,
        also of one heating ramp more.
        """
        sets = [rates for size in range(1, 5) for rates in combinations(self.rates, size)]
        heating_surplus = (0, 1) if self.have and self.task.withheld else (0,)
        for heating, cooling in product(sets, [(), *sets]):
            if len(heating) - len(cooling) in heating_surplus:
                yield heating, cooling

    def design(
        self,
        degc: Tour,  # noqa: ARG002 (as of Bench)
        choice: tuple[Sequence[int], Sequence[int]],
        dwell_s: float,
    ) -> Design:
        """Heating and cooling ramps by turns, of unsigned rates [°C/min], with a soak after each;
        where nothing is withheld yet, with one heating ramp at the end that is.
        """
        (low, high), clock = self.range_degc, Clock(self.task.equipment)
        heating, cooling = choice
        clock.settle(self.device, low)
        pairs = zip_longest(heating, [-rate for rate in cooling])
        by_turns = [float(rate) for pair in pairs for rate in pair if rate]
        recorded = [(rate, "") for rate in by_turns]
        if not self.task.withheld:
            # between the rates of the design, and none of them
            spare = [rate for rate in self.rates if rate not in heating] or [heating[0]]
            middle = float(np.sqrt(heating[0] * heating[-1]))
            unseen = min(spare, key=lambda rate: abs(np.log(rate / middle)))
            recorded.append((float(unseen), WITHHELD))
        for rate, folder in recorded:
            sense, end = ("heating", high) if rate > 0.0 else ("cooling", low)
            log = folder + self.task.name_log(f"ramp_{sense}_{abs(rate):02g}.csv")
            clock.add("soak", BEFORE_S, log)
            clock.ramp(end, abs(rate), log)
            clock.add("soak", dwell_s, log)
        rates = [f"±{rate}" for rate in heating]
        if tuple(heating) != tuple(cooling):
            rates = [*(f"+{rate}" for rate in heating), *(f"−{rate}" for rate in cooling)]
        label = f"ramps of {', '.join(rates)} °C/min, soaks of {dwell_s / 60.0:g} min"
        rows = tuple(self.ramps[rate, dwell_s] for rate in by_turns)
        return Design(label, clock.schedule(), (self.task.name_log("ramp_*.csv"),), rows)


def silent_log(name: str, time: Array, case: Array) -> ThermalLog:
    """Log of one ramp at times [m, s] and case temperatures [m, °C], whose indication is not
    known.
    """
    none = np.zeros(time.size)
    return ThermalLog(name, time, case, case, none, none.astype(np.int64))


def _simulate_ramps(schedule: Schedule, device: Device, seed: int) -> Campaign:
    """Logs of a simulated gyro on the ramps of a schedule, with the noise, the turn-on bias, the
    drift and the lag of the case that the plan assumes, and its truth, which states what it does
    not take from the plan.
    """
    runs: dict[str, Programme] = {}
    for name, (before, ramp, after) in schedule.by_log().items():
        runs[name] = Programme.ramp(
            before.set_degc,
            ramp.set_degc,
            abs(ramp.ramp_degc_per_min),
            soak_before_s=before.duration_s,
            soak_after_s=after.duration_s,
        )
    gyro = replace(
        FogGyro.draw(seed),
        # the mean over an hour; IEEE Std 952: N/√τ
        N=device.noise_of(SECONDS_PER_HOUR),
        B=device.size(*FLICKER),
        K=0.0,
        turn_on_dph=device.size(*TURNED_ON),
        tau_case_s=min(device.lags_s),
    )
    # the drift is proportional to its scale: its rms over the ramps, about the mean of each, is
    # brought to the size that is assumed
    drawn = simulated.logs(gyro, runs, seed, Chamber()).values()
    drift_rms = rms(np.concatenate([log.drift - log.drift.mean() for log in drawn]))
    gyro = gyro.scale_drift(drift_scale=device.size(*DRIFT) / drift_rms)
    campaign = simulated.campaign(seed, gyro, runs)
    not_of_the_plan = (
        "the initial state of a log: each begins in equilibrium; the lags of the coil and the shape"
        " of its drift, which are drawn; resolution of the gyro and the thermometer"
    )
    return replace(campaign, truth={**campaign.truth, "not_of_the_plan": not_of_the_plan})


def prepare_plan(spec: FogThermalRecipe | BiasTemperatureRecipe, task: Task) -> Bench:
    """Campaigns of a procedure."""
    if isinstance(spec, FogThermalRecipe):
        return RampBench(spec, task)
    return BiasBench(spec, task)


def simulate_plan(
    spec: FogThermalRecipe | BiasTemperatureRecipe, schedule: Schedule, device: Device, seed: int
) -> Campaign:
    """Logs of a campaign that was run by a plan, and its truth."""
    if isinstance(spec, FogThermalRecipe):
        return _simulate_ramps(schedule, device, seed)
    return _simulate_soaks(spec, schedule, device, seed)
