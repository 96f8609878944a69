"""Angle sensor that an index table turns from stop to stop; `corrected` is its one statement."""

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from calibkit import recipe
from calibkit.certificate.quantities import Quantity, of_form, ranged
from calibkit.certificate.words import Words
from calibkit.check import find_missing_values
from calibkit.firmware import exact
from calibkit.firmware.draft import BEYOND, Draft, powers
from calibkit.fit.complex_step import derivative
from calibkit.fit.shared import Shared
from calibkit.fit.solve import predict, solve
from calibkit.fit.unseen import unseen
from calibkit.instruments import Fitted
from calibkit.logs import log_files, write_back
from calibkit.numeric import gum
from calibkit.planning import bench, schedule
from calibkit.recipe.shared_errors import state_sizes
from calibkit.records.coefficients import Input, StageResult
from calibkit.records.forms import Form
from calibkit.records.frame import Examined, refuse, values
from calibkit.report.summary import Summary

FILE, SENSOR, STOPS = "turned_sensor.json", "sensor_deg", ("from_stop_deg", "to_stop_deg")
NAMES, START = (("p0", "deg"), ("p1", "1")), np.array([0.0, 1.0])


def corrected(p, indication):
    """Angle [n, deg] by which the table turned: p0 + p1 · indication."""
    return p[0] + p[1] * indication


ANGLE = Form.of_equation("angle/1", lambda model, p, at: corrected(p, at[SENSOR]))
FORMS, KEY_FIGURES = (ANGLE,), (".+",)


class Recipe(recipe.Recipe):
    """Turns of a sensor on an index table."""

    error_groups: ClassVar = ("stop",)
    procedure: Literal["turned_sensor"]


@dataclass(frozen=True)
class Turns:
    """Indication [n] and nominal angle [n] of each turn, numbers [n, 2] of the stops."""

    indication: np.ndarray
    angle: np.ndarray
    stop: np.ndarray

    def residual(self, p):
        """What the corrected indications leave of the turns."""
        return corrected(p, self.indication) - self.angle

    def shared_errors(self):
        """A turn feels two stops: the error of that where it ends less that where it began."""
        loading = np.tile([[-1.0], [1.0]], (len(self.angle), 1, 1))
        return [Shared(group="stop", effect="index", level=self.stop, loading=loading, unit="deg")]


def turns_of(logs):
    """Turns of all logs."""
    stops = np.concatenate([np.column_stack([values(log.frame, s) for s in STOPS]) for log in logs])
    number = np.unique(np.round(stops % 360.0, 3), return_inverse=True)[1].reshape(stops.shape)
    indication = np.concatenate([values(log.frame, SENSOR) for log in logs])
    return Turns(indication, stops[:, 1] - stops[:, 0], number)


def read(spec, data, file):
    """One log of turns."""
    return log_files.read_log(spec, data / file, file, (SENSOR, *STOPS))


def faults(spec, log):
    """Values that are missing."""
    return Examined(tuple(find_missing_values(log, [SENSOR, *STOPS])))


def fit(spec, data, files, progress):
    """Fit the turns of all logs."""
    logs = [read(spec, data, file) for file in progress(files, "reading")]
    refuse(finding for log in logs for finding in faults(spec, log).findings)
    turns = turns_of(logs)
    fitted = solve(turns.residual, START, state_sizes(spec.errors, turns.shared_errors()))
    span = {SENSOR: (float(turns.indication.min()), float(turns.indication.max()))}
    noise = {"residual_rms": float(fitted.noise[0]), "residual_unit": "deg"}
    model = ANGLE.write_fit("sensor", fitted, NAMES, valid=span, **noise)
    stage = StageResult(FILE.removesuffix(".json"), models=(model,))
    return Fitted((stage,), tuple(map(Input.of, logs)), Summary(spec.title), None)


def correct(spec, records, data):
    """A log with corrected indications."""
    log = read(spec, data.parent, data.name)
    column = ANGLE.evaluate(records[FILE].models[0], {SENSOR: values(log.frame, SENSOR)})
    return write_back.rewrite_log(spec, data, log, {SENSOR: column}), ()


def validate(spec, records, logs):
    """Errors on unseen turns over what coefficients, stops and noise leave."""
    model, turns = records[FILE].models[0], turns_of(list(logs))
    at, rows = {SENSOR: turns.indication}, np.arange(len(turns.angle))
    by_model = ANGLE.gradient(model, at) @ gum.square_root(np.array(model.covariance))
    by_stops = turns.shared_errors()[0].design(rows) * model.components[0].value
    error = ANGLE.evaluate(model, at) - turns.angle
    judged = unseen(error, np.hstack([by_model, by_stops]), model.residual_rms**2)
    return {"logs": [], **judged.to_object()}, Summary("")


def results(records, spec):
    """Angle over the indication."""
    record = records[FILE]
    inputs = (ranged(record.models[0], SENSOR),)
    point = of_form(ANGLE, record.models[0], inputs)
    return (Quantity("angle", record.stage, "sensor", Words("angle"), "deg", inputs, point),)


def files(spec):
    """Coefficient file of the chain."""
    return (FILE,)


def chain(spec, records):
    """Angle by the coefficients."""
    model, draft = records[FILE].models[0], Draft()
    middle, half = exact.span(*model.valid[SENSOR])
    draft.input(SENSOR, "deg", "indication", (middle - BEYOND * half, middle + BEYOND * half))
    draft.map("u", SENSOR, model.valid[SENSOR], flag="TEMP_CLAMPED")
    terms = draft.polynomial("p", exact.mapped(powers(model, "p"), middle, half), "u")
    draft.output("angle_deg", "deg", draft.sum("angle", terms), "angle of the turn")
    return draft.chain([model.form], "angle of the sensor by its line")


class Bench(bench.Bench):
    """Campaigns of one to six rounds between six stops."""

    results, units = {"angle": "deg"}, {("stop", "index"): "deg"}

    def choices(self):
        """Numbers of rounds."""
        return range(1, 7)

    def rows_of_logs(self, logs):
        """Turns of all logs."""
        return turns_of(logs)

    def temperatures(self, rows):  # noqa: ARG002 (as every bench)
        """None has to be spanned."""
        return ()

    def design(self, degc, choice, dwell_s):  # noqa: ARG002 (as every bench)
        """A number of rounds, from every stop to every other."""
        clock = schedule.Clock(self.task.equipment)
        clock.add("soak", 600.0 * choice, "turns.csv")
        stop = np.array([(k, m) for k in range(6) for m in range(6) if k != m] * choice)
        angle = 60.0 * (stop[:, 1] - stop[:, 0])
        rows = Turns(angle, angle, stop)
        return bench.Design(f"{choice} rounds", clock.schedule(), ("turns.csv",), rows)

    def fit(self, rows):
        """What the turns will tell."""
        shared = self.device.state(rows.shared_errors())
        noise = np.full(len(rows.angle), self.device.noise)
        return predict(rows.residual, START, shared, noise=noise)

    @property
    def slopes(self):
        """Derivatives of the angle over all turns."""
        return {"angle": derivative(lambda p: corrected(p, np.linspace(-300.0, 300.0, 25)), START)}

    def coefficients(self, rows):
        """Uncertainties of the coefficients."""
        u = self.fit(rows).of(lambda p: p).u.tolist()
        return (bench.PredictedCoefficient("sensor", *n, x) for n, x in zip(NAMES, u, strict=True))


prepare_plan = Bench
