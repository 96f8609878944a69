"""Results of a run: noise terms and bias stability of each record, with the recipe's limits."""

from collections.abc import Mapping
from dataclasses import replace

from calibkit.certificate.quantities import Quantity, ResultLimit, of_figure
from calibkit.certificate.words import Words
from calibkit.coefficients import Record
from calibkit.instruments.gyro_noise.forms import read_deviation, read_term
from calibkit.instruments.gyro_noise.recipe import ACCELEROMETER, GYRO, GyroNoiseRecipe

NAMES = {
    "angle_random_walk": Words("angle random walk N", "角度随机游走 N"),
    "bias_instability": Words("bias instability B", "零偏不稳定性 B"),
    "rate_random_walk": Words("rate random walk K", "速率随机游走 K"),
    "rate_ramp": Words("rate ramp R", "速率斜坡 R"),
    "quantization": Words("quantization Q", "量化噪声 Q"),
    "velocity_random_walk": Words("velocity random walk N", "速度随机游走 N"),
    "acceleration_random_walk": Words("acceleration random walk K", "加速度随机游走 K"),
    "acceleration_ramp": Words("acceleration ramp R", "加速度斜坡 R"),
    "mean_rate": Words("mean rate", "平均角速率"),
    "mean_acceleration": Words("mean acceleration", "平均加速度"),
    "bias_stability_10_s": Words(
        "bias stability, 10 s means (GJB 2426A)", "零偏稳定性（10 s 平均，GJB 2426A）"
    ),
    "bias_stability_100_s": Words(
        "bias stability, 100 s means (GJB 2426A)", "零偏稳定性（100 s 平均，GJB 2426A）"
    ),
}
PRINCIPAL = {"angle_random_walk", "velocity_random_walk", "bias_instability"}
FEW = 3.0
"""Standard uncertainties from zero within which a magnitude is stated by an interval."""


def _limit(term: str, unit: str, spec: GyroNoiseRecipe) -> ResultLimit | None:
    """Largest value of a term by the recipe; bias instability has a key per kind of sensor."""
    sensor = GYRO if unit.startswith("deg") else ACCELEROMETER
    key = next((key for name, key in sensor.limits.items() if term.startswith(name)), "")
    largest = getattr(spec.acceptance, key, None)
    return None if largest is None else ResultLimit(f"acceptance.{key}", upper=largest)


def list_terms(record: Record) -> list[Quantity]:
    """Mean, noise terms and bias stability of each record; by an interval where a term is within a
    few uncertainties of zero.
    """
    terms = []
    for figure in record.figures:
        if read_deviation(figure.name) is None:
            name, log = read_term(figure.name)
            words = NAMES.get(name, Words(name.replace("_", " "))) + Words(
                f", {log}" if log else ""
            )
            term = replace(
                of_figure(record, figure, words),
                magnitude=figure.value < FEW * figure.standard_uncertainty,
                principal=name in PRINCIPAL,
            )
            terms.append(term)
    return terms


def results(records: Mapping[str, Record], spec: GyroNoiseRecipe) -> tuple[Quantity, ...]:
    """Noise terms of each record but the mean, which holds the earth's rate or gravity; those of a
    run of one record are named without it.
    """
    terms = [(*read_term(term.name), term) for term in list_terms(records["gyro_noise.json"])]
    one_record = len({log for _, log, _ in terms}) == 1
    return tuple(
        replace(
            term,
            name=name if one_record else term.name,
            compared=(({},),),
            limit=_limit(name, term.unit, spec),
        )
        for name, _, term in terms
        if name not in (GYRO.mean, ACCELEROMETER.mean)
    )
