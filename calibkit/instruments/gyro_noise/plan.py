"""Records of gyros at rest: how long a log has to be for the wanted uncertainty of its terms.

No equation of rows tells it: the uncertainty of a term is the scatter of fits to drawn Allan
deviations (`predict_terms`).
"""

from collections.abc import Iterator, Sequence

import numpy as np

from calibkit.errors import UsageError
from calibkit.instruments.gyro_noise.forms import FigureName, read_name
from calibkit.instruments.gyro_noise.recipe import GYRO, GyroNoiseRecipe, find_sensor
from calibkit.numeric.arrays import Array
from calibkit.numeric.constants import SECONDS_PER_HOUR
from calibkit.numeric.noise.allan_fit import predict_terms
from calibkit.planning.bench import (
    NOISE,
    Bench,
    Design,
    PredictedCoefficient,
    Sources,
    Task,
    Tour,
    earlier_error,
)
from calibkit.planning.equipment import Device
from calibkit.planning.schedule import Clock, Schedule
from calibkit.recipe.tables import ErrorComponent
from calibkit.records.coefficients import Record, StageResult
from calibkit.records.frame import Log, values
from calibkit.simulate import noise
from calibkit.simulate.campaign import Campaign

LOG = "static"
GROUP = "record"
INTERVAL_S = 1.0
"""Sampling interval of a planned log."""
WALK, INSTABILITY, RATE_WALK = TERMS = (
    "angle_random_walk",
    "bias_instability",
    "rate_random_walk",
)
"""Noise terms that a gyro is assumed to have, as coefficient files name them."""
WORDS = {name: name.replace("_", " ") for name in TERMS}
LAWS = {law.name: law for law in GYRO.laws}
UNITS = {(GROUP, WORDS[name]): LAWS[name].unit for name in TERMS}
SHOWN = 3.2
"""Coefficient of a term over its standard uncertainty below which a log hardly shows it. The
coefficient is the square of the term, so that its u is twice as large, relative to it: as large as
U of the term.
"""


class RecordBench(Bench):
    """Records of gyros; rows are the number of samples of a log and their interval [s]."""

    units, files, noise_unit = UNITS, ("gyro_noise.json",), "deg/h"

    def __init__(self, spec: GyroNoiseRecipe, task: Task) -> None:
        """UsageError also for a recipe of accelerometers."""
        accelerometers = [
            column for column in spec.noise.columns if find_sensor(column) is not GYRO
        ]
        if accelerometers:
            raise UsageError(
                f"a plan is for gyros; there is {', '.join(accelerometers)}",
                hint="plan records of gyros alone",
            )
        super().__init__(spec, task)
        self.terms = assumed_terms(self.device)
        self.results = {WORDS[name]: LAWS[name].unit for name in self.terms}

    def errors_of_run(
        self, records: Sequence[Record | StageResult]
    ) -> tuple[list[ErrorComponent], None]:
        """The largest of all gyros and logs of an earlier run."""
        largest: dict[str, float] = {}
        for figure in (figure for record in records for figure in record.figures):
            name = read_name(figure.name).term
            if name in TERMS and figure.unit == LAWS[name].unit:
                largest[name] = max(figure.value, largest.get(name, 0.0))
        return [
            earlier_error(GROUP, WORDS[name], value, LAWS[name].unit)
            for name, value in largest.items()
        ], None

    def rows_of_logs(self, logs: Sequence[Log]) -> tuple[int, float]:
        """The longest log."""
        times = [values(log.frame, "time_s") for log in logs]
        # a fit takes each log alone, and the longest shows the slowest terms
        longest = max(times, key=lambda time: float(time[-1] - time[0]))
        interval = float(np.median(np.diff(longest)))
        return round(float(longest[-1] - longest[0]) / interval) + 1, interval

    def rows(self, design: Design) -> tuple[int, float]:
        """A fit judges each log alone."""
        rows: tuple[int, float] = design.rows or self.have
        return rows

    def temperatures(self, rows: tuple[int, float]) -> tuple[Array, ...]:  # noqa: ARG002 (as of Bench)
        """None has to be spanned."""
        return ()

    def variances(self, rows: tuple[int, float]) -> dict[str, Sources]:
        """Variance of each term of one log."""
        recipe = self.spec.noise
        u = predict_terms(
            tuple((self.terms.get(law.name, 0.0) / law.scale) ** 2 for law in GYRO.laws),
            *rows,
            spacing=recipe.spacing,
            points=recipe.points,
        )
        return {
            # u is of the square root of a coefficient of σ²; the scale brings it to the unit of
            # the term
            WORDS[law.name]: {NOISE: np.array([(law.scale * size) ** 2])}
            for law, size in zip(GYRO.laws, u, strict=True)
            if law.name in self.terms
        }

    def coefficients(self, rows: tuple[int, float]) -> Iterator[PredictedCoefficient]:
        """The terms of one log."""
        results = self.predict(rows)
        for name in self.terms:
            result = results[WORDS[name]]
            figure = str(FigureName(name, LOG))
            yield PredictedCoefficient("gyro_noise", figure, result.unit, result.u)

    def design(self, degc: Tour, choice: None, dwell_s: float) -> Design:  # noqa: ARG002 (as of Bench)
        """One log at the reference temperature, after the instrument has warmed up."""
        device, clock = self.device, Clock(self.task.equipment)
        # a warm-up would look like a rate ramp
        clock.settle(device, self.spec.reference_temp_degc, shortest_s=device.warm_up_s)
        log = self.task.name_log(f"{LOG}.csv")
        clock.add("soak", dwell_s, log)
        label = f"one log of {dwell_s / SECONDS_PER_HOUR:g} h"
        rows = round(dwell_s / INTERVAL_S), INTERVAL_S
        return Design(label, clock.schedule(), (log,), rows)

    def notes(self, campaign: Design) -> Iterator[str]:
        """Terms that a log hardly shows, and the sampling that was assumed."""
        for name, value in self.terms.items():
            result = campaign.results[WORDS[name]]
            if value < SHOWN * result.expanded:
                yield (
                    f"{result.name} of {value:g} {result.unit}, as it is assumed, is hardly"
                    " observable in this log: log for longer"
                )
        sizes = ", ".join(
            f"{WORDS[name]} {value:.3g} {LAWS[name].unit}" for name, value in self.terms.items()
        )
        yield f"planned for a sample every {INTERVAL_S:g} s and terms as assumed: {sizes}"


prepare_plan = RecordBench


def assumed_terms(device: Device) -> dict[str, float]:
    """Noise terms that are assumed, by name."""
    sizes = {name: device.size(GROUP, WORDS[name]) for name in TERMS}
    # the mean over an hour; IEEE Std 952: N/√τ
    sizes[WALK] = sizes[WALK] or device.noise_of(SECONDS_PER_HOUR)
    return {name: size for name, size in sizes.items() if size > 0.0}


def simulate_plan(spec: GyroNoiseRecipe, schedule: Schedule, device: Device, seed: int) -> Campaign:
    """Log of gyros with the noise terms that the plan assumes."""
    rng, drawn = np.random.default_rng(seed), assumed_terms(device)
    terms = dict.fromkeys(TERMS, 0.0) | drawn
    (record,) = schedule.recorded("soak")
    samples = round(record.duration_s / INTERVAL_S)
    rates = {
        column: noise.angle_random_walk(terms[WALK], samples, rng, interval_s=INTERVAL_S)
        + noise.flicker(terms[INSTABILITY], samples, rng)
        + noise.rate_random_walk(terms[RATE_WALK], samples, rng, interval_s=INTERVAL_S)
        for column in spec.noise.columns
    }
    logs = {record.log: {"time_s": INTERVAL_S * np.arange(samples)} | rates}
    decimals = {"time_s": 1} | dict.fromkeys(rates, 4)
    truth = {str(FigureName(name, LOG)): value for name, value in drawn.items()}
    return Campaign(logs, decimals, {"coefficients": {"gyro_noise": truth}})
