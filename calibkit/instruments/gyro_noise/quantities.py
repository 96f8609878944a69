"""Results of a run: noise terms and bias stability of each record, with the recipe's limits."""

from collections.abc import Mapping

from calibkit.certificate.quantities import Limit, Quantity, of_figure
from calibkit.certificate.words import Words
from calibkit.coefficients import Record
from calibkit.instruments.gyro_noise.forms import read_deviation, read_term
from calibkit.instruments.gyro_noise.recipe import GyroNoiseRecipe
from calibkit.instruments.gyro_noise.sensors import ACCELEROMETER, GYRO


def _limit(term: str, unit: str, spec: GyroNoiseRecipe) -> Limit | None:
    """Largest value of a term by the recipe; bias instability has a key per kind of sensor."""
    sensor = GYRO if unit.startswith("deg") else ACCELEROMETER
    key = next((key for name, key in sensor.limits.items() if term.startswith(name)), "")
    largest = getattr(spec.acceptance, key, None)
    return None if largest is None else Limit(f"acceptance.{key}", upper=largest)


def results(records: Mapping[str, Record], spec: GyroNoiseRecipe) -> tuple[Quantity, ...]:
    """Noise terms of each record; those of a run of one record are named without it."""
    record = records["gyro_noise.json"]
    terms = [one for one in record.figures if read_deviation(one.name) is None]
    several = len({read_term(one.name)[1] for one in terms}) > 1
    found = []
    for figure in terms:
        term, log = read_term(figure.name)
        if term not in (GYRO.mean, ACCELEROMETER.mean):  # the earth's rate and gravity are in it
            name = figure.name if several else term
            words = Words(f"{term.replace('_', ' ')}, {log}")
            limit = _limit(term, figure.unit, spec)
            found.append(of_figure(record, figure, words, name=name, limit=limit))
    return tuple(found)
