"""Quantization, angle random walk, bias instability, rate random walk and rate ramp from an Allan
deviation curve, by non-negative weighted least squares; `fit_noise` states how, and which terms are
reported, `predict_terms` what a record of a length will tell of them.

    σ²(τ) = 3 Q²/τ² + N²/τ + (2 ln 2/π) B² + K² τ/3 + R² τ²/2 = Σ_j c_j τ^exponent_j
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibkit.errors import FitError
from calibkit.numeric.arrays import Array, Mask
from calibkit.numeric.constants import SECONDS_PER_HOUR
from calibkit.numeric.noise.allan import DeviationCurve, Spacing, averaging_factors
from calibkit.numeric.noise.confidence import logarithmic_grid

SIGNIFICANCE = 0.00135
"""One-sided probability (3σ of a normal) under which chance is ruled out as the cause of a term or
of a misfit.
"""
MODEL_ERROR = 0.01
"""Part of σ² at each averaging time that the power laws are not trusted with: filters and samplers
bend the curve.
"""
GROSS_MISFIT = 10.0
"""Weighted square of the residuals over its expectation above which no scaling makes the terms mean
anything.
"""
MARGIN = 2
"""Averaging times left out beyond those that visibly miss the model."""
FREQUENCIES = 1500
"""Points of the logarithmic frequency grid that covariances are integrated on."""
ITERATIONS = 20
"""Rounds of reweighting, of which a handful settle six digits."""
FEWEST_TIMES = 6
"""Averaging times below which five coefficients leave nothing to judge the fit by."""
DRAWS, SEED = 400, 1
"""Curves of which a prediction is made, and of their random numbers."""


@dataclass(frozen=True, slots=True)
class PowerLaw:
    """One term of σ²(τ) = Σ c τ^exponent, with value = scale·√c in the unit given."""

    name: str
    symbol: str
    unit: str
    exponent: int
    scale: float


LAWS = (
    PowerLaw("quantization", "Q", "arcsec", -2, float(1.0 / np.sqrt(3.0))),
    PowerLaw("angle_random_walk", "N", "deg/sqrt(h)", -1, 1.0 / 60.0),
    PowerLaw("bias_instability", "B", "deg/h", 0, float(np.sqrt(np.pi / (2.0 * np.log(2.0))))),
    PowerLaw("rate_random_walk", "K", "deg/h/sqrt(h)", 1, 60.0 * float(np.sqrt(3.0))),
    PowerLaw("rate_ramp", "R", "deg/h/h", 2, SECONDS_PER_HOUR * float(np.sqrt(2.0))),
)
"""IEEE Std 952 annex C: 3Q²/τ² + N²/τ + (2 ln 2/π) B² + K² τ/3 + R² τ²/2, τ in s, σ in deg/h (1
deg/h·s = 1 arcsec).
"""
ACCELEROMETER_LAWS = (
    replace(LAWS[0], unit="mg*s"),
    PowerLaw("velocity_random_walk", "N", "ug/sqrt(Hz)", -1, 1000.0),
    replace(LAWS[2], unit="mg"),
    replace(LAWS[3], name="acceleration_random_walk", unit="mg/sqrt(h)"),
    replace(LAWS[4], name="acceleration_ramp", unit="mg/h"),
)
"""The same of an accelerometer, σ in mg: N² is σ² at 1 s, so that the one-sided amplitude spectral
density of a data sheet is √2 N (IEEE Std 1293).
"""


@dataclass(frozen=True, slots=True)
class NoiseTerm:
    """A noise term that the record shows, with its standard uncertainty (type A) and degrees of
    freedom.
    """

    name: str
    symbol: str
    value: float
    unit: str
    standard_uncertainty: float
    dof: float


@dataclass(frozen=True, slots=True)
class NotObservable:
    """A noise term that the record cannot show: a status and its reason, no number."""

    name: str
    symbol: str
    reason: str


@dataclass(frozen=True, slots=True)
class NoiseFit:
    """Terms observed and terms not observable, the fitted curve [m], and what a reader must know of
    the fit.
    """

    terms: tuple[NoiseTerm, ...]
    not_observable: tuple[NotObservable, ...]
    model: Array
    misfit: float
    flags: tuple[str, ...]


class _Attempt:
    """Fit of all five terms to the averaging times [m] of a curve from index `first` on.

    One-sided spectra per cycle/sample from the coefficients: white 2c/τ₀, flicker c/(2 ln 2 ν),
    random walk 3c τ₀/(2π² ν²), quantization (8c/3) sin²(πν)/τ₀² (NIST SP 1065 table 3; the last for
    differences of white angle). f frequencies ν.

    Attributes
    ----------
    tau, variance : [m], averaging times and Allan variances.
    design : [m, 5], powers of the averaging times.
    coefficients, uncertainty : [5], the latter scaled up by a misfit that surprises.
    misfit : weighted square of the residuals over its expectation.
    surprising : whether chance is ruled out as the cause of the misfit (Satterthwaite's χ²).

    Raises FitError for a curve that cannot be fitted.

    """

    def __init__(self, curve: DeviationCurve, first: int = 0) -> None:
        from scipy.special import gammaincc

        if curve.estimator != "overlapping Allan":
            raise FitError(
                f"a curve of '{curve.estimator}' where the overlapping Allan deviation was expected"
            )
        if curve.tau_s.size < FEWEST_TIMES:
            raise FitError(
                f"{curve.tau_s.size} averaging times, at least {FEWEST_TIMES} expected for five"
                " noise terms",
                hint="record for longer or ask for more averaging times",
            )
        if not np.all(curve.deviation > 0.0):
            raise FitError(
                "the Allan deviation is zero: the rate does not change",
                hint="check the log's resolution",
            )
        self.tau, self.variance = curve.tau_s[first:], curve.deviation[first:] ** 2
        self.design, interval = _powers(self.tau), curve.interval_s
        # variances of the Allan variances to begin with
        self._start = 2.0 * self.variance**2 / curve.dof[first:]
        nu, self._step = logarithmic_grid(0.01 / curve.samples, FREQUENCIES)
        # spectra of unit coefficients, in the order of LAWS (SP 1065 table 3); a ramp has none
        shapes = [
            8.0 / 3.0 * np.sin(np.pi * nu) ** 2 / interval**2,
            np.full(nu.size, 2.0 / interval),
            1.0 / (2.0 * np.log(2.0) * nu),
            3.0 * interval / (2.0 * np.pi**2 * nu**2),
            np.zeros(nu.size),
        ]
        self._shapes = np.stack(shapes)  # [5, f], spectra of unit coefficients
        factor = curve.factor[first:].astype(np.float64)
        pairs = curve.pairs[first:].astype(np.float64)
        # response of the difference of two neighbouring averages
        difference = 2.0 * np.sin(np.pi * np.outer(factor, nu)) * _averaging(factor, nu)
        self._response = difference**2 / 2.0  # [m, f], AVAR = ∫ S response
        # of the mean pair difference, which a ramp multiplies
        self._mean_response = difference * _averaging(pairs, nu)
        self._longer = np.maximum.outer(pairs, pairs)
        self.coefficients, spread, covariance = self.fit(np.ones(len(LAWS), dtype=bool))
        model = self.design @ self.coefficients
        active = self.coefficients > 0.0
        operator = _operator(self.design, spread, active)
        projection = np.eye(model.size) - self.design[:, active] @ operator
        expected = covariance + np.diag((MODEL_ERROR * model) ** 2)
        # the weighted square of correlated residuals: mean and variance by the traces, then χ² by
        # Satterthwaite
        scatter = projection @ expected @ projection.T / np.sqrt(np.outer(spread, spread))
        mean, square = float(np.trace(scatter)), float(np.sum(scatter**2))
        self.misfit = float(np.sum((self.variance - model) ** 2 / spread)) / mean
        half_dof = mean**2 / square / 2.0
        self.surprising = bool(gammaincc(half_dof, half_dof * self.misfit) < SIGNIFICANCE)
        self.uncertainty = np.zeros(len(LAWS))
        self.uncertainty[active] = np.sqrt(np.diag(operator @ covariance @ operator.T))
        self.uncertainty *= float(np.sqrt(self.misfit) if self.surprising else 1.0)

    def covariance(self, coefficients: Array) -> Array:
        """Covariance [m, m] of the Allan variances of a record with the given noise.

        Gaussian noise: Σ over pairs of 2 cov²/(4 M_a M_b) becomes ∫ S² A_a A_b dν / max(M_a, M_b)
        by Parseval, M the numbers of pairs. A ramp R adds R² τ_a τ_b cov(z̄_a, z̄_b), z̄ the mean pair
        difference.
        """
        spectrum = coefficients @ self._shapes
        weighted = self._response * (spectrum**2 * self._step)
        covariance: Array = weighted @ self._response.T / self._longer
        if coefficients[-1] == 0.0:
            return covariance
        mean = (self._mean_response * (spectrum * self._step)) @ self._mean_response.T
        ramp: Array = 2.0 * coefficients[-1] * np.outer(self.tau, self.tau) * mean
        return covariance + ramp

    def fit(self, free_terms: Mask) -> tuple[Array, Array, Array]:
        """Coefficients [5] ≥ 0 of the free terms, variances [m] they were weighted with, covariance
        [m, m].
        """
        spread = self._start + (MODEL_ERROR * self.variance) ** 2
        coefficients = _non_negative(self.design, self.variance, spread, free_terms)
        covariance = self.covariance(coefficients)
        for _ in range(ITERATIONS):
            spread = np.diag(covariance) + (MODEL_ERROR * (self.design @ coefficients)) ** 2
            last = coefficients
            coefficients = _non_negative(self.design, self.variance, spread, free_terms)
            covariance = self.covariance(coefficients)
            if np.allclose(coefficients, last, rtol=1e-6, atol=0.0):
                break
        return coefficients, spread, covariance

    def chance(self, term: int, other_terms: Mask) -> float:
        """Probability that a record of the other terms alone, refitted, shows as much of this term
        as the record does.
        """
        from scipy.special import gammaincc, ndtr

        coefficients, spread, covariance = self.fit(other_terms)
        active = coefficients > 0.0
        active[term] = True
        row = _operator(self.design, spread, active)[int(np.sum(active[:term]))]
        noise = float(row @ covariance @ row)
        model_error = float(row**2 @ (MODEL_ERROR * (self.design @ coefficients)) ** 2)
        # the coefficient that the other terms leave to this one, over its standard deviation
        # without it
        excess = float(row @ self.variance) / float(np.sqrt(noise + model_error))
        # third cumulant of a weighted sum of periodogram ordinates, each exponentially distributed
        skewness = 0.0
        if noise > 0.0:
            part = (coefficients @ self._shapes) * (row @ self._response)
            pairs = float(part**2 @ self._step) / noise
            skewness = 2.0 * float(part**3 @ self._step) / pairs**2 / noise**1.5
        if skewness < 1e-3:
            return float(ndtr(-excess))
        # Pearson type III of mean 0, variance 1 and this skewness
        shape = 4.0 / skewness**2
        return float(gammaincc(shape, max(shape + excess * np.sqrt(shape), 0.0)))


def fit_noise(curve: DeviationCurve, laws: tuple[PowerLaw, ...] = LAWS) -> NoiseFit:
    """Fit the five noise terms to an overlapping Allan deviation by non-negative weighted least
    squares.

    Parameters
    ----------
    curve : from `allan.overlapping`, at least six averaging times; octaves serve.
    laws : LAWS for a gyro in deg/h, ACCELEROMETER_LAWS for an accelerometer in mg.

    Raises
    ------
    FitError : another estimator's curve, too few averaging times, or a rate that never changes.

    Notes
    -----
    σ²(τ) is linear in five non-negative coefficients. Weights are the inverse variances of σ̂²
    under the fitted noise itself (reweighted until they settle) plus (1 % of σ²)², so that millions
    of pairs at the shortest times do not outvote the rest over a model error. Uncertainties come
    from the full covariance between averaging times.

    Criterion: all five terms stay in the fit; one is reported only where the others, refitted
    without it, leave an excess in its direction that noise of the refitted kind (1 % model error
    included) would show with a probability below 0.00135. What another term can stand in for is
    therefore not observable, and what is not reported still widens and unbiases what is. Terms that
    each explain alone what the reported ones leave have one reason, which names them all. The tail
    follows a Pearson type III law with the excess's own skewness: at the longest times σ̂² has two
    or three degrees of freedom, and a normal tail would see ramps in random walks.

    A curve that misses the model by more than noise can (same probability) is fitted without its
    shortest averaging times, which filters and samplers bend: as few as help and two for margin, at
    most half. Where that does not help, uncertainties are scaled up by the square root of the
    misfit; above a misfit of 10 no term is reported. Each is flagged.
    """
    attempt, flags = _Attempt(curve), []
    if attempt.surprising:
        most_left_out = min(curve.tau_s.size // 2, curve.tau_s.size - FEWEST_TIMES)
        for first in range(1, most_left_out + 1):
            if not _Attempt(curve, first).surprising:
                # the first that passes is still bent, by less than the noise
                attempt = _Attempt(curve, min(first + MARGIN, most_left_out))
                flags.append(
                    f"averaging times below {attempt.tau[0]:g} s left out: the noise"
                    " terms do not describe them"
                )
                break
    failed = attempt.surprising and attempt.misfit > GROSS_MISFIT
    if failed:
        flags.append("no noise term reported: the five of them do not describe the curve")
    elif attempt.surprising:
        scale = np.sqrt(attempt.misfit)
        flags.append(f"the noise terms miss the curve: uncertainties scaled up by {scale:.2g}")
    observable = (attempt.coefficients > 0.0) & (not failed)
    for j in np.flatnonzero(observable).tolist():
        observable[j] = attempt.chance(j, np.arange(len(LAWS)) != j) < SIGNIFICANCE

    # why each of the five terms would not be observable, given which are
    reasons = ["beside the reported terms the curve shows none of it above the noise"] * len(LAWS)
    if failed:
        reasons = ["the five noise terms do not describe the curve"] * len(LAWS)
    elif attempt.surprising or not observable.any():
        reasons = ["the other terms can stand in for it within the noise"] * len(LAWS)
    else:
        # each of these explains alone what the reported terms leave
        absent_terms = np.flatnonzero(~observable).tolist()
        candidates = [j for j in absent_terms if attempt.chance(j, observable) < SIGNIFICANCE]
        names = " or ".join(LAWS[j].symbol for j in candidates)
        undecided = "which" if len(candidates) > 1 else "it from others together"
        for j in candidates:
            reasons[j] = (
                f"beside the reported terms the curve shows {names}; the record cannot tell"
                f" {undecided}"
            )

    terms: list[NoiseTerm] = []
    absent: list[NotObservable] = []
    for j, law in enumerate(laws):
        if not observable[j]:
            absent.append(NotObservable(law.name, law.symbol, reasons[j]))
            continue
        value = law.scale * float(np.sqrt(attempt.coefficients[j]))
        relative = float(attempt.uncertainty[j]) / float(attempt.coefficients[j])
        # the degrees of freedom of a χ² with the coefficient's relative uncertainty
        u, dof = value * relative / 2.0, 2.0 / relative**2
        terms.append(NoiseTerm(law.name, law.symbol, value, law.unit, u, dof))
    model = np.sqrt(_powers(curve.tau_s) @ attempt.coefficients)
    return NoiseFit(tuple(terms), tuple(absent), model, attempt.misfit, tuple(flags))


def predict_terms(
    coefficients: Sequence[float],
    samples: int,
    interval_s: float,
    *,
    spacing: Spacing = "octave",
    points: int = 1,
) -> Array:
    """Predicted standard uncertainties [5] of the square roots of coefficients [5] of the laws that
    a record without gaps will show.

    The coefficients cannot be negative, so that errors do not propagate linearly: they are the rms
    error of fits to DRAWS curves, with normal errors of the covariance that the noise has.
    """
    true = np.asarray(coefficients, dtype=np.float64)
    factor = averaging_factors(samples, spacing=spacing, points=points)
    variance = _powers(np.asarray(factor * interval_s, dtype=np.float64)) @ true
    # neither degrees of freedom nor limits enter a prediction
    curve = DeviationCurve.of_variance(
        "overlapping Allan",
        interval_s,
        samples,
        factor,
        variance,
        samples - 2 * factor + 1,
        (),
        dof=np.ones(factor.size),
        probability=0.95,
    )
    attempt = _Attempt(curve)
    covariance = attempt.covariance(true)
    spread = np.diag(covariance) + (MODEL_ERROR * variance) ** 2
    drawn = np.random.default_rng(SEED).multivariate_normal(variance, covariance, DRAWS)
    all_terms = np.ones(true.size, dtype=np.bool_)
    fitted = [_non_negative(attempt.design, of_curve, spread, all_terms) for of_curve in drawn]
    return np.asarray(np.sqrt(np.mean((np.sqrt(fitted) - np.sqrt(true)) ** 2, axis=0)))


def _powers(tau: Array) -> Array:
    """Powers of the averaging times [m, 5], one column per term."""
    return np.asarray(tau[:, None] ** np.array([float(law.exponent) for law in LAWS]))


def _averaging(length: Array, nu: Array) -> Array:
    """Response [m, f] of the mean of `length` [m] successive samples (Dirichlet kernel)."""
    sine = np.sin(np.pi * np.outer(length, nu))
    return np.asarray(sine / np.outer(length, np.sin(np.pi * nu)))


def _non_negative(design: Array, variance: Array, spread: Array, free_terms: Mask) -> Array:
    """Weighted least squares with non-negative coefficients [5], zero where not allowed (Lawson &
    Hanson 1974).
    """
    from scipy.optimize import nnls

    weighted, scale, weight = _weighted(design, spread, free_terms)
    coefficients = np.zeros(design.shape[1])
    coefficients[free_terms] = nnls(weighted, variance * weight)[0] / scale
    return coefficients


def _operator(design: Array, spread: Array, active: Mask) -> Array:
    """Matrix [p, m] that takes Allan variances to the p active coefficients of the weighted fit."""
    weighted, scale, weight = _weighted(design, spread, active)
    return np.asarray(np.linalg.pinv(weighted) / scale[:, None] * weight, dtype=np.float64)


def _weighted(design: Array, spread: Array, active: Mask) -> tuple[Array, Array, Array]:
    """Active columns [m, p] of a design with weighted rows, of length 1; their lengths [p], and the
    weights [m].
    """
    weight = 1.0 / np.sqrt(spread)
    weighted = design[:, active] * weight[:, None]
    scale = np.linalg.norm(weighted, axis=0)
    return weighted / scale, scale, weight
