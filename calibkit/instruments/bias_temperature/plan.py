"""Campaigns of a static instrument: soaks at which temperatures, how long, and how often it is
switched on.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit import units
from calibkit.errors import FitError, UsageError
from calibkit.fit.shared import Shared
from calibkit.fit.solve import Fit, predict
from calibkit.forms import power_unit
from calibkit.frame import values
from calibkit.instruments.bias_temperature.polynomials import EFFECTS, GROUP
from calibkit.numeric.least_squares import polynomial
from calibkit.planning.assumptions import assume, read_errors, read_sizes
from calibkit.planning.levels import (
    LEVELS,
    choose_some,
    list_levels,
    list_usual_levels,
    order_there_and_back,
    raw_uncertainties,
)
from calibkit.planning.proposal import (
    ONE_LEVEL_DEGC,
    WITHHELD,
    Coefficient,
    Design,
    count,
    cover_range,
)
from calibkit.planning.schedule import Clock
from calibkit.planning.search import Bench, Sources, join, split_variance
from calibkit.planning.simulation import as_planned
from calibkit.simulate.chamber import follow_with_lag

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from calibkit.arrays import Array, Integers
    from calibkit.frame import Log
    from calibkit.instruments.bias_temperature.recipe import BiasTemperatureRecipe
    from calibkit.planning.equipment import Device
    from calibkit.planning.proposal import Task
    from calibkit.planning.schedule import Action, Schedule
    from calibkit.simulate.campaign import Campaign

RANGE_DEGC = (-40.0, 60.0)
FILE = "bias.json"
TURN_ON = (GROUP, EFFECTS[0])
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
        middle, half = polynomial.middle_and_half(np.array(self.assumed.range_degc))
        return polynomial.powers(degc, self.order, middle=middle, half=half)

    def fit(self, design: Design) -> Fit:
        """What means of logs, each with its own turn-on bias, will tell of the polynomial."""
        means: Means = self.rows(design)
        group, effect = TURN_ON
        turn_on = Shared(
            group=group,
            effect=effect,
            level=means.log,
            loading=np.ones((means.log.size, 1)),
            unit=self.assumed.device.noise_unit,
        )
        powers = self.powers(means.degc)
        start, names = np.zeros(self.order + 1), [f"p{k}" for k in range(self.order + 1)]
        shared = self.assumed.state([turn_on])
        return predict(lambda p: powers @ p, start, shared, noise=means.noise, names=names)

    def covers(self, design: Design) -> bool:
        """Whether both ends of the range are reached, with a temperature more than the order
        needs.
        """
        return cover_range(self.rows(design).degc, self.order + 2, self.assumed.range_degc)

    @cached_property
    def slopes(self) -> dict[str, Array]:
        """Result → its derivatives [m, order + 1] over the range of use."""
        low, high = self.assumed.range_degc
        bias = self.powers(np.linspace(low, high, LEVELS))
        reference = np.clip(self.spec.reference_temp_degc, low, high)
        return {"drift": bias - self.powers(np.array([reference])), "bias": bias}

    def variances(self, design: Design) -> Mapping[str, Sources]:
        """Variances of each result."""
        fit = self.fit(design)
        return {name: split_variance(fit, slopes) for name, slopes in self.slopes.items()}

    def coefficients(self, design: Design) -> Iterator[Coefficient]:
        """In powers of °C; of a channel of a lower order as of the highest."""
        every = raw_uncertainties(self.fit(design).covariance, self.assumed.range_degc)
        for channel in self.spec.polynomials.bias:
            for k, u in enumerate(every[: channel.order + 1]):
                unit = power_unit(self.assumed.device.noise_unit, "degC", k)
                yield Coefficient(channel.indication, f"p{k}", unit, u)

    def design(self, degc: tuple[int, ...], dwell_s: float) -> Design:
        """Logs at temperatures in their order; where nothing is withheld yet, with the longest way
        between two temperatures in a log that is.
        """
        equipment, device = self.task.equipment, self.assumed.device
        clock, rate = Clock(equipment), equipment.fastest(device)
        steps = [abs(b - a) for a, b in pairwise(degc)]
        longest = int(np.argmax(steps)) + 1 if steps and not self.task.withheld else -1
        stem = self.task.name_log("soak")
        for number, level in enumerate(degc):
            settle_s = equipment.soak_s(device, level - clock.degc, rate)
            way = f"{WITHHELD}{stem}_way_to_{level}.csv" if number == longest else ""
            clock.ramp(float(level), rate, way)
            clock.soak(settle_s, way)
            # while it settles the instrument warms up, but where it is on from before
            warm_s = device.warm_up_s - (0.0 if way else settle_s)
            clock.soak(max(warm_s, 0.0))
            clock.soak(dwell_s, f"{stem}_{number + 1:02d}_{level}.csv")
        noise = np.full(len(degc), self.assumed.noise_of(dwell_s))
        means = Means(np.array(degc, dtype=np.float64), np.arange(len(degc)), noise)
        logs, levels = count(len(degc), "log"), count(len({*degc}), "temperature")
        label = f"{logs} at {levels}, {dwell_s / 60.0:g} min each"
        settings = {"lag_s": max(device.lags_s), "noise_1s": self.assumed.noise_of(1.0)}
        return Design(label, clock.schedule(), (f"{stem}_*.csv",), means, None, settings)

    def designs(self) -> Iterator[Design]:
        """Campaigns of all sizes; beside what is measured, those of the temperatures that it lacks,
        and `NOTHING`.
        """
        if self.task.have:
            yield Design.nothing()
        seen: set[tuple[int, ...]] = set()
        for levels in list_levels(self.task, self.order, MORE_LEVELS, self.assumed.range_degc):
            tour = order_there_and_back(levels)
            listed = [tour[:-1] * number + tour[:1] for number in TIMES]
            listed += [tuple(np.repeat(tour, number).tolist()) for number in TIMES]
            listed += choose_some(tour[:-1]) if self.task.have else ()
            for degc in dict.fromkeys(listed):
                if degc not in seen:
                    seen.add(degc)
                    yield from (self.design(degc, t) for t in self.assumed.device.dwell_s)

    def usual(self) -> Iterator[Design]:
        """An hour at each of nine temperatures, from low to high."""
        yield self.design(list_usual_levels(self.assumed.range_degc), USUAL_S)

    def notes(self, design: Design) -> Iterable[str]:
        """How the instrument is switched on."""
        return ((RESTART,) if design.rows else ()) + self.assumed.notes


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
    seen = read_errors(task, FILE, spec.procedure)
    earlier = [one for one in seen if (one.group, one.effect) == TURN_ON]
    named = {TURN_ON: device.noise_unit}
    assumed = assume(spec, task, device, named, default_degc=RANGE_DEGC, earlier=earlier)
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
    return as_planned(document, seed, logs, decimals, {"coefficients": drawn})


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
