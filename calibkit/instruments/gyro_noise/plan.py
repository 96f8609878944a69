"""Records of gyros at rest: how long a log has to be for the wanted uncertainty of its terms."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.constants import SECONDS_PER_HOUR
from calibkit.errors import UsageError
from calibkit.frame import values
from calibkit.instruments.gyro_noise.forms import read_term, term_name
from calibkit.instruments.gyro_noise.sensors import GYRO, find_sensor
from calibkit.numeric.noise.predicted import predict_terms
from calibkit.planning.assumptions import assume
from calibkit.planning.proposal import Coefficient, Design
from calibkit.planning.schedule import Clock
from calibkit.planning.search import NOISE, Bench
from calibkit.planning.simulation import as_planned
from calibkit.simulate import noise

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from calibkit.coefficients import Record, StageResult
    from calibkit.instruments.gyro_noise.recipe import GyroNoiseRecipe
    from calibkit.planning.proposal import Task
    from calibkit.planning.schedule import Schedule
    from calibkit.planning.search import Sources
    from calibkit.simulate.campaign import Campaign

LOG = "static"
INTERVAL_S = 1.0
"""Sampling interval of a planned log."""
WALK, INSTABILITY, RATE_WALK = TERMS = (
    "angle_random_walk",
    "bias_instability",
    "rate_random_walk",
)
"""Noise terms that a gyro is assumed to have."""
UNITS = {law.name: law.unit for law in GYRO.laws if law.name in TERMS}
USUAL_S = 21600.0
"""Length of the usual log, which the sample log has."""
SHOWN = 3.2
"""Coefficient of a term over its standard uncertainty below which a log hardly shows it."""


@dataclass(frozen=True)
class RecordBench(Bench):
    """Records of gyros."""

    terms: Mapping[str, float]
    """Noise terms that are assumed, by name."""

    def variances(self, design: Design) -> Mapping[str, Sources]:
        """Variance of each term of one log."""
        samples, interval_s = design.rows or self.have
        recipe = self.spec.noise
        u = predict_terms(
            tuple((self.terms.get(law.name, 0.0) / law.scale) ** 2 for law in GYRO.laws),
            samples,
            interval_s,
            spacing=recipe.spacing,
            points=recipe.points,
            seed=self.task.seed,
        )
        return {
            _words(law.name): {NOISE: np.array([(law.scale * size) ** 2])}
            for law, size in zip(GYRO.laws, u, strict=True)
            if law.name in self.terms
        }

    def coefficients(self, design: Design) -> Iterator[Coefficient]:
        """The terms of one log."""
        for one in self.predict(design):
            name = term_name(_key(one.name), LOG)
            yield Coefficient("gyro_noise", name, one.unit, one.largest_u)

    def design(self, length_s: float, label: str = "") -> Design:
        """One log at the reference temperature, after the instrument has warmed up."""
        equipment, device = self.task.equipment, self.assumed.device
        clock, log = Clock(equipment), self.task.name_log(f"{LOG}.csv")
        rate, degc = equipment.fastest(device), self.spec.reference_temp_degc
        settle_s = equipment.soak_s(device, degc - clock.degc, rate)
        clock.ramp(degc, rate)
        clock.soak(max(settle_s, device.warm_up_s))
        clock.soak(length_s, log)
        label += f"one log of {length_s / SECONDS_PER_HOUR:g} h"
        samples = round(length_s / INTERVAL_S)
        settings = {"terms": dict(self.terms), "interval_s": INTERVAL_S}
        return Design(label, clock.schedule(), (log,), (samples, INTERVAL_S), None, settings)

    def designs(self) -> Iterator[Design]:
        """Logs of all lengths; where one is measured, also `NOTHING`."""
        if self.task.have:
            yield Design.nothing()
        lengths = sorted(self.assumed.device.dwell_s)
        labels = [f"{length / SECONDS_PER_HOUR:g} h" for length in lengths]
        for length, _ in zip(lengths, self.task.progress(labels, "searching"), strict=True):
            yield self.design(length)

    def usual(self) -> Iterator[Design]:
        """As long as the sample log."""
        yield self.design(USUAL_S, label="usual: ")

    def notes(self, design: Design) -> Iterator[str]:
        """Terms that a log hardly shows, and the sampling that was assumed."""
        for one in self.predict(design):
            value = self.terms[_key(one.name)]
            if value < 2.0 * SHOWN * one.largest_u:
                yield (
                    f"{one.name} of {value:g} {one.unit}, as it is assumed, is hardly observable"
                    " in this log: log for longer"
                )
        sizes = ", ".join(
            f"{_words(name)} {value:.3g} {UNITS[name]}" for name, value in self.terms.items()
        )
        yield f"planned for a sample every {INTERVAL_S:g} s and terms as assumed: {sizes}"


def _words(name: str) -> str:
    """A term of coefficient files in words."""
    return name.replace("_", " ")


def _key(words: str) -> str:
    """Name of a term in coefficient files."""
    return words.replace(" ", "_")


def prepare_plan(spec: GyroNoiseRecipe, task: Task) -> RecordBench:
    """What the search needs; UsageError for what cannot be planned."""
    device = task.equipment.known_device(spec.procedure)
    others = [one for one in spec.noise.columns if find_sensor(one) is not GYRO]
    if others or device.noise_unit != "deg/h":
        raise UsageError(
            f"a plan is for gyros with a noise in deg/h; there is {', '.join(others)}"
            f" {device.noise_unit}",
            hint="plan records of gyros alone",
        )
    units = {("record", _words(name)): unit for name, unit in UNITS.items()}
    assumed = assume(spec, task, device, units, passed_on=())
    # the mean over noise_s; IEEE Std 952: N/√τ
    terms = {WALK: assumed.noise_of(SECONDS_PER_HOUR)}
    sizes = {_key(effect): assumed.size(group, effect) for group, effect in units}
    terms |= {name: size for name, size in sizes.items() if size > 0.0}
    if task.earlier is not None:
        terms |= _read_terms(task.earlier)
    results = {_words(name): unit for name, unit in UNITS.items() if name in terms}
    have = None
    if task.have:
        logs = [values(log.frame, "time_s") for log in task.have]
        longest = max(logs, key=lambda time: float(time[-1] - time[0]))
        interval = float(np.median(np.diff(longest)))
        have = round(float(longest[-1] - longest[0]) / interval) + 1, interval
    return RecordBench(spec, task, assumed, results, have, terms)


def _read_terms(records: Mapping[str, Record | StageResult]) -> dict[str, float]:
    """Largest noise terms of a run; UsageError for a run of another procedure."""
    if "gyro_noise.json" not in records:
        raise UsageError("that run has no gyro_noise.json", hint="name a run of gyro_noise")
    terms: dict[str, float] = {}
    for figure in records["gyro_noise.json"].figures:
        name, _ = read_term(figure.name)
        if name in TERMS and figure.unit == UNITS[name]:
            terms[name] = max(figure.value, terms.get(name, 0.0))
    return terms


def simulate_plan(
    spec: GyroNoiseRecipe, schedule: Schedule, document: Mapping[str, Any], seed: int
) -> Campaign:
    """Log of gyros with the noise terms that the plan assumes."""
    rng, settings = np.random.default_rng(seed), document["settings"]
    terms = dict.fromkeys(TERMS, 0.0) | settings["terms"]
    (record,) = schedule.recorded("soak")
    samples = round(record.duration_s / settings["interval_s"])
    interval = settings["interval_s"]
    rates = {
        column: noise.angle_random_walk(terms[WALK], samples, rng, interval_s=interval)
        + noise.flicker(terms[INSTABILITY], samples, rng)
        + noise.rate_random_walk(terms[RATE_WALK], samples, rng, interval_s=interval)
        for column in spec.noise.columns
    }
    drawn = {term_name(name, LOG): value for name, value in settings["terms"].items()}
    logs = {record.log: {"time_s": interval * np.arange(samples)} | rates}
    decimals = {"time_s": 1} | dict.fromkeys(rates, 4)
    return as_planned(document, seed, logs, decimals, {"coefficients": {"gyro_noise": drawn}})
