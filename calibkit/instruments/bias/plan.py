"""Campaigns of a static instrument: soaks at which temperatures, how long, and how often it is
switched on.

What they will tell is predicted by the equation of the fit, y = Σ_k p_k x^k + b of the log + e,
with the assumed sizes of the turn-on bias b and of the noise e.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calibkit import units
from calibkit.arrays import Array, Integers
from calibkit.errors import FitError, UsageError
from calibkit.fit.solve import Fit, predict
from calibkit.frame import Log, values
from calibkit.instruments.bias import blocks
from calibkit.instruments.bias.recipe import BiasTemperatureRecipe
from calibkit.numeric.least_squares import polynomial
from calibkit.planning.bench import (
    LEVELS,
    ONE_LEVEL_DEGC,
    WITHHELD,
    Bench,
    Design,
    Task,
    Tour,
    count,
    join,
)
from calibkit.planning.equipment import Device
from calibkit.planning.schedule import Clock, Schedule
from calibkit.simulate.campaign import Campaign
from calibkit.simulate.chamber import follow_with_lag

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


prepare_plan = BiasBench


def simulate_plan(
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
