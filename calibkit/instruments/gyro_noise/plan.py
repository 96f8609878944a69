"""Records of gyros at rest: how long a log has to be for the wanted uncertainty of its terms."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.constants import SECONDS_PER_HOUR
from calibkit.errors import UsageError
from calibkit.frame import values
from calibkit.instruments.gyro_noise.forms import read_term, term_name
from calibkit.instruments.gyro_noise.sensors import GYRO, find_sensor
from calibkit.numeric.information import NOISE
from calibkit.numeric.noise.predicted import predict_terms
from calibkit.planning import recipe_text
from calibkit.planning.linear import assume_errors, refuse_range
from calibkit.planning.proposal import (
    NOTHING,
    Candidate,
    Coefficient,
    Predicted,
    Proposal,
    Task,
    Wish,
    choose,
    find_front,
)
from calibkit.planning.schedule import Clock
from calibkit.simulate import noise
from calibkit.simulate.campaign import Campaign

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from calibkit.coefficients import Record, StageResult
    from calibkit.instruments.gyro_noise.recipe import GyroNoiseRecipe
    from calibkit.planning.equipment import Device
    from calibkit.planning.schedule import Schedule
    from calibkit.recipe.tables import ErrorComponent

LOG = "static"
INTERVAL_S = 1.0
"""Sampling interval of a planned log."""
TERMS = ("angle_random_walk", "bias_instability", "rate_random_walk")
"""Noise terms that a gyro is assumed to have."""
UNITS = {law.name: law.unit for law in GYRO.laws if law.name in TERMS}
RESULTS = {name.replace("_", " "): unit for name, unit in UNITS.items()}
USUAL_S = 21600.0
"""Length of the usual log, which the sample log has."""
SHOWN = 3.2
"""Coefficient of a term over its standard uncertainty below which a log hardly shows it."""


@dataclass(frozen=True)
class _Bench:
    """What the search needs to know."""

    task: Task
    device: Device
    spec: GyroNoiseRecipe
    terms: Mapping[str, float]
    """Noise terms that are assumed, by name."""
    components: tuple[ErrorComponent, ...]
    measured: tuple[int, float]
    """Samples and sampling interval [s] of the longest log that is measured; none without any."""

    @cached_property
    def coefficients(self) -> tuple[float, ...]:
        """Coefficients of the power laws, in their order."""
        return tuple((self.terms.get(law.name, 0.0) / law.scale) ** 2 for law in GYRO.laws)

    def predict(self, samples: int, interval_s: float) -> tuple[Predicted, ...]:
        """Predicted uncertainty of each term of one log."""
        own = self.spec.noise
        u = predict_terms(
            self.coefficients,
            samples,
            interval_s,
            spacing=own.spacing,
            points=own.points,
            seed=self.task.seed,
        )
        return tuple(
            Predicted.of(
                law.name.replace("_", " "), law.unit, {NOISE: np.array([(law.scale * size) ** 2])}
            )
            for law, size in zip(GYRO.laws, u, strict=True)
            if law.name in self.terms
        )

    def candidate(self, length_s: float) -> Candidate:
        """One log of a length; of length 0, the longest that is measured."""
        samples, interval = (round(length_s / INTERVAL_S), INTERVAL_S)
        predicted = self.predict(*((samples, interval) if length_s else self.measured))
        label = f"one log of {length_s / SECONDS_PER_HOUR:g} h" if length_s else NOTHING
        largest = {one.name: one.largest_u for one in predicted}
        return Candidate(label, self.schedule(length_s).hours, largest, (length_s, predicted))

    def schedule(self, length_s: float) -> Schedule:
        """Schedule of one log at the reference temperature, after the instrument has warmed up."""
        clock, equipment = Clock(self.task.equipment), self.task.equipment
        if length_s:
            rate, degc = equipment.fastest(self.device), self.spec.reference_temp_degc
            settle_s = equipment.soak_s(self.device, degc - clock.degc, rate)
            clock.ramp(degc, rate)
            clock.soak(max(settle_s, self.device.warm_up_s))
            clock.soak(length_s, self.task.name_log(f"{LOG}.csv"))
        return clock.schedule()


def propose(spec: GyroNoiseRecipe, task: Task) -> tuple[Proposal, tuple[Wish, ...]]:
    """Shortest log of a recipe that meets the wishes, or the best within hours."""
    bench = _prepare(spec, task)
    offered = {name: unit for name, unit in RESULTS.items() if _key(name) in bench.terms}
    wishes = tuple(Wish.parse(text, offered) for text in task.wishes)
    name = wishes[0].name if wishes else next(iter(offered))
    lengths = [*((0.0,) if bench.measured[0] else ()), *sorted(bench.device.dwell_s)]
    labels = [f"{length / SECONDS_PER_HOUR:g} h" for length in lengths]
    listed = zip(lengths, task.progress(labels, "searching"), strict=True)
    found = [bench.candidate(length) for length, _ in listed]
    best = choose(found, wishes, task.within_h, name)
    length_s, predicted = best.design
    at, usual = spec.reference_temp_degc, bench.candidate(USUAL_S)
    log = [task.name_log(f"{LOG}.csv")] if length_s else []
    return Proposal(
        best.label,
        bench.schedule(length_s),
        predicted,
        tuple(
            Coefficient("gyro_noise", term_name(_key(one.name), LOG), one.unit, one.largest_u)
            for one in predicted
        ),
        (at, at),
        recipe_text.write_recipe(spec, log, (), {}, added=bool(task.have)),
        bench.device.noise,
        bench.device.noise_unit,
        bench.components,
        tuple(find_front(found, name)),
        () if task.have else (replace(usual, label=f"usual: {usual.label}"),),
        tuple(_list_notes(bench, predicted)),
        {"terms": dict(bench.terms), "interval_s": INTERVAL_S},
    ), wishes


def judge(spec: GyroNoiseRecipe, task: Task) -> tuple[Predicted, ...]:
    """What the longest log that is measured tells of the terms."""
    bench = _prepare(spec, task)
    return bench.predict(*bench.measured) if bench.measured[0] else ()


def _key(name: str) -> str:
    """Name of a term in coefficient files."""
    return name.replace(" ", "_")


def _list_notes(bench: _Bench, predicted: tuple[Predicted, ...]) -> Iterator[str]:
    """Terms that a log hardly shows, and the sampling that was assumed."""
    for one in predicted:
        value = bench.terms[_key(one.name)]
        if value < 2.0 * SHOWN * one.largest_u:
            yield (
                f"{one.name} of {value:g} {one.unit}, as it is assumed, is hardly observable in"
                " this log: log for longer"
            )
    yield f"planned for a sample every {INTERVAL_S:g} s and terms as assumed: {_sizes(bench.terms)}"


def _sizes(terms: Mapping[str, float]) -> str:
    """Terms with their sizes in words."""
    return ", ".join(
        f"{name.replace('_', ' ')} {value:.3g} {UNITS[name]}" for name, value in terms.items()
    )


def _prepare(spec: GyroNoiseRecipe, task: Task) -> _Bench:
    """What the search needs; UsageError for what cannot be planned."""
    device = task.equipment.known_device(spec.procedure)
    others = [one for one in spec.noise.columns if find_sensor(one) is not GYRO]
    if others or device.noise_unit != "deg/h":
        raise UsageError(
            f"a plan is for gyros with a noise in deg/h; there is {', '.join(others)}"
            f" {device.noise_unit}",
            hint="plan records of gyros alone",
        )
    refuse_range(task, spec.procedure)
    units = {("record", name.replace("_", " ")): unit for name, unit in UNITS.items()}
    stated = assume_errors(spec, device, (), units)
    # the mean over noise_s; IEEE Std 952: N/√τ
    walk = device.noise * float(np.sqrt(device.noise_s / SECONDS_PER_HOUR))
    terms = {TERMS[0]: walk} | {
        _key(effect): one.value_in(units[group, effect])
        for (group, effect), one in stated.items()
        if one.value > 0.0
    }
    if task.earlier is not None:
        terms |= _read_terms(task.earlier)
    logs = [values(log.frame, "time_s") for log in task.have]
    longest = max(logs, key=lambda time: float(time[-1] - time[0]), default=np.zeros(0))
    interval = float(np.median(np.diff(longest))) if longest.size else INTERVAL_S
    samples = round(float(longest[-1] - longest[0]) / interval) + 1 if longest.size else 0
    return _Bench(task, device, spec, terms, tuple(stated.values()), (samples, interval))


def _read_terms(records: Mapping[str, Record | StageResult]) -> dict[str, float]:
    """Largest noise terms of a run; UsageError for a run of another procedure."""
    if "gyro_noise.json" not in records:
        raise UsageError("that run has no gyro_noise.json", hint="name a run of gyro_noise")
    found: dict[str, float] = {}
    for figure in records["gyro_noise.json"].figures:
        name, _ = read_term(figure.name)
        if name in TERMS and figure.unit == UNITS[name]:
            found[name] = max(figure.value, found.get(name, 0.0))
    return found


def simulate(
    spec: GyroNoiseRecipe, schedule: Schedule, document: Mapping[str, Any], seed: int
) -> Campaign:
    """Log of gyros with the noise terms that the plan assumes."""
    rng, settings = np.random.default_rng(seed), document["settings"]
    terms = dict.fromkeys(TERMS, 0.0) | settings["terms"]
    (held,) = schedule.recorded("soak")
    count = round(held.duration_s / settings["interval_s"])
    interval = settings["interval_s"]
    rates = {
        column: noise.angle_random_walk(terms[TERMS[0]], count, rng, interval_s=interval)
        + noise.flicker(terms[TERMS[1]], count, rng)
        + noise.rate_random_walk(terms[TERMS[2]], count, rng, interval_s=interval)
        for column in spec.noise.columns
    }
    drawn = {term_name(name, LOG): value for name, value in settings["terms"].items()}
    facts = {"seed": seed, "plan": document["sha256"], "coefficients": {"gyro_noise": drawn}}
    logs = {held.log: {"time_s": interval * np.arange(count)} | rates}
    return Campaign(logs, {"time_s": 1} | dict.fromkeys(rates, 4), facts)
