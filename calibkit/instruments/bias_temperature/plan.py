"""Campaigns of a static instrument: soaks at which temperatures, how long, and how often it is
switched on.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, product
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit import units
from calibkit.errors import FitError, UsageError
from calibkit.fit.solve import Fit, predict
from calibkit.forms import power_unit
from calibkit.frame import values
from calibkit.instruments.bias_temperature import blocks
from calibkit.numeric.least_squares import polynomial
from calibkit.planning.assumptions import assume, read_earlier, read_sizes, seen_errors
from calibkit.planning.levels import (
    LEVELS,
    ONE_LEVEL_DEGC,
    Tour,
    choose_some,
    cover_range,
    list_tours,
    list_usual_levels,
    order_there_and_back,
    raw_uncertainties,
)
from calibkit.planning.proposal import WITHHELD, Candidate, Coefficient, Design, count
from calibkit.planning.schedule import Clock
from calibkit.planning.search import Bench, join
from calibkit.simulate.campaign import Campaign
from calibkit.simulate.chamber import follow_with_lag

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from calibkit.arrays import Array, Integers
    from calibkit.frame import Log
    from calibkit.instruments.bias_temperature.recipe import BiasTemperatureRecipe
    from calibkit.planning.equipment import Device
    from calibkit.planning.proposal import Task
    from calibkit.planning.schedule import Action, Schedule

RANGE_DEGC = (-40.0, 60.0)
FILE = "bias.json"
TURN_ON = (blocks.GROUP, blocks.TURN_ON)
MORE_LEVELS = 4
"""Temperatures that the search takes at most beyond one more than the order needs."""
TIMES = (1, 2, 3)
"""How often the temperatures are gone through, or how often it is switched on at each."""
BLOCKS = 64
"""Parts of a measured log whose mean temperatures are taken."""
USUAL_S = 3600.0
"""Length of each log of the usual campaign."""
RESTART = "the instrument is switched off and on before each log that a fit sees"
DRIFT = 50.0
"""Simulated drift over the range, in standard deviations of the noise of a minute."""
REACHED_DEGC, THERMOMETER_DEGC = 0.1, 0.01
"""Standard deviations of the temperature that is reached and of a reading."""


@dataclass(frozen=True, slots=True)
class Means:
    """Means over spans of logs."""

    degc: Array
    log: Integers
    noise: Array


@dataclass(frozen=True)
class BiasBench(Bench):
    """Campaigns of an instrument at rest."""

    order: int

    def powers(self, degc: Array) -> Array:
        """Powers [n, order + 1] of temperatures mapped from the range of use to [-1, 1]."""
        return polynomial.powers(self.assumed.mapped(degc), self.order)

    def fit(self, rows: Means) -> Fit:
        """What means of logs, each with its own turn-on bias, will tell of the polynomial."""
        every = np.ones(rows.log.size)
        turn_on = blocks.turn_on_bias(self.assumed.device.noise_unit, rows.log, every)
        powers, shared = self.powers(rows.degc), self.assumed.state([turn_on])
        start, names = np.zeros(self.order + 1), [f"p{k}" for k in range(self.order + 1)]
        return predict(lambda p: powers @ p, start, shared, noise=rows.noise, names=names)

    def covers(self, design: Design) -> bool:
        """Whether both ends of the range are reached, with a temperature more than the order
        needs.
        """
        return cover_range(self.rows(design).degc, self.order + 2, self.assumed.range_degc)

    @cached_property
    def slopes(self) -> dict[str, Array]:
        """Result → its derivatives [m, order + 1] over the range of use: of the drift from the
        reference temperature, and of the bias.
        """
        low, high = self.assumed.range_degc
        powers = self.powers(np.linspace(low, high, LEVELS))
        reference = np.clip(self.spec.reference_temp_degc, low, high)
        return {"drift": powers - self.powers(np.array([reference])), "bias": powers}

    def coefficients(self, design: Design) -> Iterator[Coefficient]:
        """In powers of °C, the same for all channels."""
        unit = self.assumed.device.noise_unit
        u = raw_uncertainties(self.fit(self.rows(design)).covariance, self.assumed.range_degc)
        for channel in self.spec.polynomials.bias:
            for k, size in enumerate(u[: channel.order + 1]):
                yield Coefficient(channel.indication, f"p{k}", power_unit(unit, "degC", k), size)

    def design(self, degc: Sequence[int], dwell_s: float) -> Design:
        """A log at each temperature in their order; where nothing is withheld yet, with the longest
        way between two of them that is.
        """
        device, clock = self.assumed.device, Clock(self.task.equipment)
        steps = [abs(b - a) for a, b in pairwise(degc)]
        longest = int(np.argmax(steps)) + 1 if steps and not self.task.withheld else -1
        stem = self.task.name_log("soak")
        for number, level in enumerate(degc):
            if number == longest:
                # the instrument stays on, and warms up when it is switched on anew
                clock.settle(device, level, f"{WITHHELD}{stem}_way_to_{level}.csv")
                clock.soak(device.warm_up_s)
            else:
                clock.settle(device, level, shortest_s=device.warm_up_s)
            clock.soak(dwell_s, f"{stem}_{number + 1:02d}_{level}.csv")
        noise = np.full(len(degc), self.assumed.noise_of(dwell_s))
        means = Means(np.array(degc, dtype=np.float64), np.arange(len(degc)), noise)
        logs, levels = count(len(degc), "log"), count(len({*degc}), "temperature")
        label = f"{logs} at {levels}, {dwell_s / 60.0:g} min each"
        settings = {"lag_s": max(device.lags_s), "noise_1s": self.assumed.noise_of(1.0)}
        return Design(label, clock.schedule(), (f"{stem}_*.csv",), means, settings)

    def sizes(self) -> dict[str, Iterator[Design]]:
        """Campaigns of all numbers of temperatures; beside what is measured, also those of the
        temperatures that it lacks.
        """

        def tours_of(levels: list[int]) -> Iterator[Tour]:
            tour = order_there_and_back(levels)
            yield from (tour[:-1] * number + tour[:1] for number in TIMES)
            yield from (tuple(np.repeat(tour, number).tolist()) for number in TIMES)
            yield from choose_some(tour[:-1]) if self.task.have else ()

        sized = list_tours(self.order, MORE_LEVELS, self.assumed.range_degc, tours_of)
        return {
            size: (self.design(*one) for one in product(tours, self.assumed.device.dwell_s))
            for size, tours in sized.items()
        }

    def usual(self) -> tuple[Design, ...]:
        """An hour at each of nine temperatures, from low to high."""
        return (self.design(list_usual_levels(self.assumed.range_degc), USUAL_S),)

    def notes(self, campaign: Candidate) -> tuple[str, ...]:
        """How the instrument is switched on."""
        return (RESTART,) if campaign.design.rows else ()


def prepare_plan(spec: BiasTemperatureRecipe, task: Task) -> BiasBench:
    """What the search needs; UsageError for what cannot be planned."""
    device, polynomials = task.equipment.known_device(spec.procedure), spec.polynomials
    other = [one for one in spec.still_columns() if units.column_unit(one) != device.noise_unit]
    order = max(one.order for one in polynomials.bias)
    if other or units.column_unit(polynomials.abscissa) != "degC" or order < 1:
        raise UsageError(
            f"a plan is for channels in {device.noise_unit} as polynomials of a temperature in"
            f" °C; the recipe has {', '.join(other) or polynomials.abscissa} of order {order}",
            hint=f"plan channels of one unit, that of noise_unit in [device.{spec.procedure}]",
        )
    seen = seen_errors(read_earlier(task, spec.procedure, FILE))
    earlier = [one for one in seen if (one.group, one.effect) == TURN_ON]
    units_of = {TURN_ON: device.noise_unit}
    assumed = assume(spec, task, device, units_of, default_degc=RANGE_DEGC, earlier=earlier)
    results = dict.fromkeys(("drift", "bias"), device.noise_unit)
    each = [_measure(log, polynomials.abscissa, device) for log in task.have]
    return BiasBench(spec, task, assumed, results, join(*each) if each else None, order)


def _measure(log: Log, abscissa: str, device: Device) -> Means:
    """Mean temperatures of parts of a measured log; FitError for a log without times."""
    if "time_s" not in log.frame.columns:
        raise FitError(
            f"{log.file}: no times, expected time_s to know how long it is",
            hint="map it under [columns.time_s], or plan without --have",
        )
    degc, time = values(log.frame, abscissa), values(log.frame, "time_s")
    parts = 1 if np.ptp(degc) < ONE_LEVEL_DEGC else min(BLOCKS, degc.size)
    means = np.array([part.mean() for part in np.array_split(degc, parts)])
    noise = device.noise * np.sqrt(device.noise_s * parts / (time[-1] - time[0]))
    return Means(means, np.zeros(parts, dtype=np.int64), np.full(parts, noise))


def simulate_plan(
    spec: BiasTemperatureRecipe, schedule: Schedule, document: Mapping[str, Any], seed: int
) -> Campaign:
    """Logs of an instrument whose bias is a polynomial of its case temperature, and its truth."""
    rng, settings = np.random.default_rng(seed), document["settings"]
    turn_on = read_sizes(document, {TURN_ON: document["noise"]["unit"]})[TURN_ON]
    size = DRIFT * settings["noise_1s"] / np.sqrt(60.0)
    truth = {
        one.indication: np.polynomial.Polynomial(
            rng.normal(0.0, size, one.order + 1) / (1.0 + np.arange(one.order + 1.0)),
            domain=document["range_degc"],
        )
        for one in spec.polynomials.bias
    }
    logs: dict[str, dict[str, Array]] = {}
    for name, recorded in schedule.by_log().items():
        case = _follow(recorded, settings["lag_s"]) + rng.normal(0.0, REACHED_DEGC)
        logs[name] = {
            "time_s": np.arange(float(case.size)),
            spec.polynomials.abscissa: case + rng.normal(0.0, THERMOMETER_DEGC, case.size),
        } | {
            channel: bias(case)
            + rng.normal(0.0, turn_on)
            + rng.normal(0.0, settings["noise_1s"], case.size)
            for channel, bias in truth.items()
        }
    decimals = {"time_s": 0, spec.polynomials.abscissa: 3} | dict.fromkeys(truth, 6)
    drawn = {
        name: {f"p{k}": value for k, value in enumerate(bias.convert().coef.tolist())}
        for name, bias in truth.items()
    }
    return Campaign(logs, decimals, {"coefficients": drawn})


def _follow(recorded: Sequence[Action], lag_s: float) -> Array:
    """Case temperature [n] [°C] at 1 Hz of a log: of a soak that is settled, or of a ramp and the
    soak after it.
    """
    first, last = recorded[0], recorded[-1]
    soak = np.full(int(last.duration_s), last.set_degc)
    if first.action != "ramp":
        return soak
    left = np.arange(first.duration_s, 0.0, -1.0)
    chamber = first.set_degc - first.ramp_degc_per_min / 60.0 * left
    return follow_with_lag(np.append(chamber, soak), lag_s)
