"""Uncertainty of the compensated rate (coefficients, model error on left-out ramps, clamping), and
the residual hysteresis.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array
from calibkit.constants import SECONDS_PER_MINUTE
from calibkit.errors import FitError
from calibkit.instruments.fog_thermal.numeric import evaluate, noise as thermal_noise
from calibkit.instruments.fog_thermal.numeric.bank import OnLevels
from calibkit.instruments.fog_thermal.numeric.evaluate import Evaluation
from calibkit.instruments.fog_thermal.numeric.pooled_fit import ThermalLog
from calibkit.numeric import gum

NEIGHBOURING = (1, 2, 3)
"""Lags, in 100 s means, of the products of left-out errors: 100 to 300 s."""
POSTERIOR_REACH = 6.0
"""Standard errors beyond which the posterior of the model error is negligible."""
POSTERIOR_LEVELS = 2001
MOVING_DEGC_MIN = 0.3
"""Temperature rate [°C/min] above which a block is heating, and below its negative cooling."""
HYSTERESIS_BIN_DEGC = 5.0
LEAST_BLOCKS = 5
"""Fewest heating and fewest cooling blocks in a bin of the hysteresis."""


def model_error(errors: Sequence[Array], explained: float = 0.0) -> float:
    """Model error [°/h] from the errors [m, °/h] of each left-out ramp: what persists beyond
    `explained` [(°/h)²].

    White noise cancels in the mean product of neighbouring errors; the persistent error of the
    model does not. Neither do flicker noise and the uncertainty of the coefficients, which are
    stated separately: their mean product `explained` is subtracted. The difference may be small or
    negative by chance; the model error is therefore the root mean square over its posterior for a
    flat prior, with the standard error from the scatter of the ramps.
    """
    products, counts = _products(errors)
    if counts.sum() == 0:
        return 0.0
    mean = float(products.sum() / counts.sum())
    scatter = float(np.sum((products - mean * counts) ** 2)) * counts.size / max(counts.size - 1, 1)
    error = float(np.sqrt(scatter)) / float(counts.sum())
    excess = mean - explained
    if error == 0.0:
        return float(np.sqrt(max(excess, 0.0)))
    levels = np.linspace(0.0, np.sqrt(max(excess, 0.0) + POSTERIOR_REACH * error), POSTERIOR_LEVELS)
    log_share = -0.5 * ((levels**2 - excess) / error) ** 2
    share = np.exp(log_share - log_share.max())
    return float(np.sqrt(share @ levels**2 / share.sum()))


def _products(errors: Sequence[Array]) -> tuple[Array, Array]:
    """Sums [ramps] of the products of neighbouring errors of each ramp, and the numbers of products
    [ramps].
    """
    sums = [sum(float(e[k:] @ e[: e.size - k]) for k in NEIGHBOURING if k < e.size) for e in errors]
    return np.array(sums), np.array(
        [sum(max(e.size - k, 0) for k in NEIGHBOURING) for e in errors], dtype=np.float64
    )


def explained(model: OnLevels, logs: Sequence[ThermalLog], group: int) -> float:
    """Mean product [(°/h)²] of neighbouring errors (means over a group of blocks) that type A
    uncertainty and flicker noise cause.

    The mean of each ramp is removed, as for left-out errors.
    """
    longest = max(log.time.size for log in logs) // group
    flicker = model.noise.flicker**2 * thermal_noise.flicker_kernel(max(longest, 1))
    total, count = 0.0, 0
    for log in logs:
        sensitivity = evaluate.evaluate(model, log.time, log.case, log.env).sensitivities
        for part in np.unique(log.part):
            rows = np.flatnonzero(log.part == part)
            whole, first = rows.size // group, int(rows[0]) // group
            s = sensitivity[rows[: whole * group]].reshape(whole, group, -1).mean(axis=1)
            s -= s.mean(axis=0)
            last = min(first + whole, longest)
            noise = about_its_mean(flicker[last - whole : last, last - whole : last])
            for k in NEIGHBOURING:
                if k < whole:
                    product = np.einsum("ij,jk,ik->i", s[k:], model.covariance, s[: whole - k])
                    total += float(product.sum() + np.trace(noise, k))
                    count += whole - k
    return total / count if count else 0.0


def about_its_mean(covariance: Array) -> Array:
    """Covariance [m, m] of values less their mean, from that of the values."""
    columns = covariance - covariance.mean(axis=0)
    return np.asarray(columns - columns.mean(axis=1)[:, None], dtype=np.float64)


def contributions(model: OnLevels, evaluation: Evaluation) -> list[tuple[str, str, Array, float]]:
    """Independent contributions to the uncertainty of the drift along a log, each with its name,
    kind, values [n, °/h] and degrees of freedom.

    They are: type A uncertainty of coefficients and lags, propagated (JCGM 100, 5.2.2); the model
    error on left-out ramps; and where a driver was clamped, a rectangular distribution whose half
    width is the change of drift by clamping. The type A variance already is the mean over the
    posterior of the noise (`noise.estimate`), so that k = 2 covers 95 %; its degrees of freedom
    count as infinite (Kacker & Jones 2003, Metrologia 40:235).
    """
    type_a = gum.uncertainty_along(evaluation.sensitivities, model.covariance)
    missed = np.full(type_a.size, model.model_error)
    return [
        ("coefficients", "A", type_a, np.inf),
        ("model error on ramps left out", "A", missed, model.model_error_dof),
        ("beyond the fitted ranges", "B", np.abs(evaluation.beyond) / np.sqrt(3.0), np.inf),
    ]


@dataclass(frozen=True, slots=True)
class Hysteresis:
    """Residual drift on cooling less that on heating ramps [m, °/h] at case temperatures [m, °C],
    with standard uncertainties [m, °/h].
    """

    temperature: Array
    difference: Array
    standard_uncertainty: Array

    @property
    def rms(self) -> float:
        """Root mean square [°/h] of the differences beyond their uncertainties; 0 if the
        uncertainties explain them.
        """
        excess = float(np.mean(self.difference**2 - self.standard_uncertainty**2))
        return float(np.sqrt(max(excess, 0.0)))


def hysteresis(model: OnLevels | None, logs: Sequence[ThermalLog]) -> Hysteresis:
    """Compare the residual drift of a model (without one, the indication) on heating and on cooling
    ramps at equal case temperature.

    The mean of each log, which contains its turn-on bias, is removed first: the result is the shape
    of the hysteresis without its constant part. Raises FitError if no temperature was passed in
    both directions.
    """
    parts = []
    for log in logs:
        left = log.indication
        if model is not None:
            left = left - evaluate.evaluate(model, log.time, log.case, log.env).drift
        rate = _smoothed(np.gradient(log.case, log.time)) * SECONDS_PER_MINUTE
        direction = np.sign(rate) * (np.abs(rate) >= MOVING_DEGC_MIN)
        parts.append((np.floor(log.case / HYSTERESIS_BIN_DEGC), direction, left - left.mean()))
    number, direction, left = (np.concatenate(part) for part in zip(*parts, strict=True))
    both = []
    for k in np.unique(number):
        down, up = (left[(number == k) & (direction == way)] for way in (-1.0, 1.0))
        if min(down.size, up.size) >= LEAST_BLOCKS:
            variance = np.var(down, ddof=1) / down.size + np.var(up, ddof=1) / up.size
            both.append(
                ((k + 0.5) * HYSTERESIS_BIN_DEGC, down.mean() - up.mean(), np.sqrt(variance))
            )
    if not both:
        raise FitError(
            "no temperature was passed heating and cooling", hint="hysteresis needs ramps both ways"
        )
    return Hysteresis(*np.array(both).T)


def _smoothed(values: Array) -> Array:
    """Running mean [n] over nine blocks, which suppresses the steps of a quantised thermometer."""
    return np.convolve(np.pad(values, 4, mode="edge"), np.full(9, 1.0 / 9.0), mode="valid")
