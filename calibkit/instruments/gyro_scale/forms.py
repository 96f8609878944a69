"""Model forms of gyros on a rate table, names of their models and figures, and matrices read from
the files of a run.

    F = K Ω + F0                                                        LINE
    F = K(T) Ω + Σ (c_k + d_k x + e_k x²) (Ω/Ω_max)^k + F0(T)           RESPONSE (`equation`, (1))
    F = S Ω + B                                                         TRIAD, `GyroMatrix`

F indication, Ω table rate, x the temperature mapped to [−1, 1]; S are the sensitivities of g gyros
about a axes: 1 by 1 for each gyro about its own axis, g by 3 for gyros about three axes of their
base.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibkit.errors import CalibkitError, CoefficientError
from calibkit.fit.complex_step import Numbers
from calibkit.instruments.gyro_scale import equation
from calibkit.instruments.gyro_scale.recipe import AnyRecipe, GyroTriadRecipe, OwnAxisRecipe
from calibkit.numeric.arrays import Array
from calibkit.records.coefficients import Model, Record
from calibkit.records.forms import POLYNOMIAL, Form, Inputs

SCALE_FILE, ORTHOGONALITY_FILE = "gyro_scale.json", "gyro_orthogonality.json"
RATE, TEMPERATURE = "table_rate_dps", "temp_case_degc"
TEMPERATURE_SLACK = 5.0
"""Temperatures [°C] beyond the calibrated range in which coefficients without a temperature model
are used without a flag.
"""
WITHIN_RUNS = "scale_factors_within_runs"
"""Figure, 1, of files whose scale factors hold within their runs: nothing tells how they repeat."""
BEND_LETTERS = "cde"
"""Coefficients of powers of the rate, by their power of temperature."""
AXES = ("x", "y", "z")
"""Axes of the base that a triad is turned about."""


def gyro_column(gyro: str) -> str:
    """Canonical column of a gyro's counts per second."""
    return f"gyro_{gyro}_lsb"


def line_name(gyro: str, axis: str = "") -> str:
    """Name of the line of a gyro about a table axis; without an axis name, about its own axis."""
    return f"{gyro}_about_{axis}" if axis else f"gyro_{gyro}"


def curve_name(line: str, letter: str) -> str:
    """Name of a polynomial over temperature: K or F0 of a line, or the bias of a gyro."""
    return f"{line}.{letter}_over_temperature"


def triad_names(gyros: Sequence[str]) -> tuple[list[str], list[str]]:
    """Names of the sensitivities of a triad, gyro by gyro, and names of its biases."""
    return [f"S_{gyro}{axis}" for gyro in gyros for axis in AXES], [f"B_{gyro}" for gyro in gyros]


def list_gyros(triad: Model) -> list[str]:
    """Names of the gyros of a triad, in the order of the rows of S."""
    rows = [c.name for c in triad.coefficients if c.name.startswith("S_")]
    return [name[2:-1] for name in rows[:: len(AXES)]]


def _bent(model: Model, p: Numbers, inputs: Inputs) -> Numbers:
    """F [n, 1/s] of `equation`, (1), with the terms that a model states; its coefficients stand in
    the order of the parameters.
    """
    letters = [c.name[0] for c in model.coefficients]
    middle_half, degc = (0.0, 1.0), np.zeros(len(inputs[RATE]))
    if TEMPERATURE in model.valid:
        middle_half = model.value("temp_middle_degc"), model.value("temp_half_degc")
        degc = inputs[TEMPERATURE]
    terms = equation.ResponseTerms(
        order=letters.count("K") - 1,
        middle_half=middle_half,
        shapes=tuple(int(c.name[1:]) for c in model.coefficients if c.name[0] == BEND_LETTERS[0]),
        fastest_dps=model.value("fastest_dps"),
        bends="polynomial" if BEND_LETTERS[1] in letters else "constant",
    )
    return equation.response(p, equation.RateRows.of_line(inputs[RATE], degc), terms)


def _sine_or_odd(model: Model, p: Numbers, inputs: Inputs) -> Numbers:
    """Indicated rate F0 + K1 Ω + K3 Ω³ + … or F0 + K Ω_s sin(Ω/Ω_s) [n, °/s]."""
    if model.value("sine"):
        zero, slope, scale = p
        return np.asarray(zero + slope * scale * np.sin(inputs[RATE] / scale))
    powers = [0, *range(1, 2 * len(p) - 2, 2)]
    return np.asarray(inputs[RATE][:, None] ** powers @ p)


def _triad(model: Model, p: Numbers, inputs: Inputs) -> Numbers:
    """F = S Ω + B [n, g, 1/s]; B is 0 where the biases are not known."""
    rates = np.column_stack([inputs[f"rate_{axis}_dps"] for axis in AXES])
    count = sum(c.name.startswith("S_") for c in model.coefficients)
    S = p[:count].reshape(-1, len(AXES))
    return np.asarray(rates @ S.T + (p[count:] if p.size > count else 0.0))


LINE = replace(
    Form.of_equation("gyro-scale/1", lambda _, p, inputs: p[0] * inputs[RATE] + p[1]),
    measured={"temp_case": 0.1},
)
"""Indication [n, 1/s] over the table rate: F = K Ω + F0."""
RESPONSE = Form.of_equation("gyro-response/2", _bent)
"""Indication [n, 1/s] over the table rate and temperature,
F = K(T) Ω + Σ (c_k + d_k x + e_k x²) (Ω/Ω_max)^k + F0(T), x the temperature mapped to [−1, 1].
"""
RESPONSE_1 = Form.of_equation("gyro-response/1", _sine_or_odd)
"""Indicated rate (F − F0)/K [n, °/s] over the table rate, as calibkit 0.2 wrote it: an odd
polynomial, or the sine of an open-loop gyro.
"""
PAIR = Form.of_equation(
    "gyro-orthogonality/1", lambda _, p, inputs: np.tile(p, (len(next(iter(inputs.values()))), 1))
)
"""N, ε, γ and α [n, 4] of two gyros: its coefficients are its results."""
PAIR_UNITS = {"N": "1", "epsilon": "1", "gamma": "1", "alpha_deg": "deg"}
"""Coefficient of a pair → unit, in the order of the covariance."""
TRIAD = Form.of_equation("gyro-triad/1", _triad)
"""Indications [n, g, 1/s] over the rates about three axes: F = S Ω + B."""
FORMS = (LINE, POLYNOMIAL, RESPONSE, RESPONSE_1, PAIR, TRIAD)


@dataclass(frozen=True, slots=True)
class GyroMatrix:
    """Sensitivities S [g, a] and biases B [g] from the files of a run: F = S Ω + B, with rates Ω
    about a axes.

    Attributes
    ----------
    outputs : names of the rate columns [a].
    model : model of S and B at one temperature, with its ranges.
    names : coefficient names of the model: S row by row, then B.
    curves : polynomials of the same quantities over temperature; empty where they were not
        fitted.
    response : nonlinear response of a gyro about its own axis; None for a straight line.

    """

    gyros: tuple[str, ...]
    outputs: tuple[str, ...]
    model: Model
    names: tuple[str, ...]
    curves: tuple[Model, ...] = ()
    response: Model | None = None

    @property
    def temperature(self) -> tuple[float, float] | None:
        """Temperature range [°C]; None where temperature was not logged."""
        return (*self.curves, self.model)[0].valid.get(TEMPERATURE)

    @property
    def over_temperature(self) -> bool:
        """Whether S and B depend on temperature."""
        return any(len(curve.coefficients) > 1 for curve in self.curves)

    @property
    def rate_limits(self) -> tuple[float, float]:
        """Rate range [°/s] of the fit of a nonlinear response; unlimited for a straight line."""
        return (-np.inf, np.inf) if self.response is None else self.response.valid[RATE]

    @property
    def reference(self) -> tuple[Array, Array]:
        """S [g, a] and B [g] at the model's own temperature."""
        S, B = replace(self, curves=()).at(np.zeros(1))
        return S[0], B[0]

    def at(self, temperature: Array) -> tuple[Array, Array]:
        """S [n, g, a] and B [n, g] at temperatures [n, °C], clamped to the fitted range."""
        columns = [np.full(temperature.size, self.model.value(name)) for name in self.names]
        if self.curves:
            clamped_degc = np.clip(temperature, *self.curves[0].valid[TEMPERATURE])
            columns = [
                POLYNOMIAL.evaluate(curve, {TEMPERATURE: clamped_degc}) for curve in self.curves
            ]
        gyros, axes, rows = len(self.gyros), len(self.outputs), np.column_stack(columns)
        return rows[:, : gyros * axes].reshape(-1, gyros, axes), rows[:, gyros * axes :]

    def rates(self, indication: Array, temperature: Array) -> Array:
        """Rates [n, a, °/s] of indications [n, g, 1/s] at temperatures [n, °C]: of a gyro about its
        own axis, zero at rest on the laboratory's table; about the axes of a base, by least squares
        where g > a.
        """
        S, B = self.at(temperature)
        unbiased = indication - B
        if S.shape[1:] != (1, 1):
            transposed_S = np.swapaxes(S, 1, 2)
            rates = np.linalg.solve(transposed_S @ S, transposed_S @ unbiased[..., None])
            return np.asarray(rates[..., 0], dtype=np.float64)
        indicated = np.asarray(unbiased[:, 0] / S[:, 0, 0], dtype=np.float64)
        if self.response is not None:
            indicated = self._invert(self.response, indicated, temperature)
        return indicated[:, None]

    def _invert(self, response: Model, indicated: Array, temperature: Array) -> Array:
        """Rates [n] at which a bent response gives indicated rates [n] [°/s], by Newton's steps;
        outside the fitted rates the correction at the nearer limit is kept.

        Raises CoefficientError for a response that does not rise with the rate everywhere.
        """
        low, high = self.rate_limits
        grid = np.linspace(low, high, 201)
        # it bends with temperature to the second power, so that both ends of the range do not tell
        for degc in np.linspace(*response.valid.get(TEMPERATURE, (0.0, 0.0)), 5):
            if not (np.diff(self._indicated(grid, np.full(grid.shape, degc))) > 0.0).all():
                raise CoefficientError(
                    "the response is not monotonic over its rates",
                    hint="fit with response = 'line'",
                )
        at_low, at_high = (
            self._indicated(np.full(indicated.shape, limit), temperature) for limit in (low, high)
        )
        inside = np.clip(indicated, at_low, at_high)
        rate = low + (inside - at_low) / (at_high - at_low) * (high - low)
        # of central differences: far below the width of a bend, far above the rounding of rates
        step = 1e-4 * (high - low)
        # more than enough: each doubles the digits of a rate
        for _ in range(20):
            indicated_above, indicated_below = (
                self._indicated(rate + way, temperature) for way in (step, -step)
            )
            excess_dps = self._indicated(rate, temperature) - inside
            before = rate
            slope = (indicated_above - indicated_below) / (2.0 * step)
            rate = np.clip(rate - excess_dps / slope, low, high)
            if np.max(np.abs(rate - before), initial=0.0) <= 1e-14 * (high - low):
                break
        return np.asarray(rate + (indicated - inside), dtype=np.float64)

    def _indicated(self, rate_dps: Array, temperature: Array) -> Array:
        """Indicated rates (F − F0)/K [n, °/s] of a bent response at rates [n, °/s]."""
        assert self.response is not None  # noqa: S101 (who calls it has one)
        if self.response.form == RESPONSE_1.name:
            return RESPONSE_1.evaluate(self.response, {RATE: rate_dps})
        inputs = {RATE: rate_dps}
        if TEMPERATURE in self.response.valid:
            inputs[TEMPERATURE] = np.clip(temperature, *self.response.valid[TEMPERATURE])
        S, B = self.at(temperature)
        indication = RESPONSE.evaluate(self.response, inputs)
        return np.asarray((indication - B[:, 0]) / S[:, 0, 0], dtype=np.float64)

    def require_biases(self, error: type[CalibkitError] = CoefficientError) -> None:
        """Raise `error` where the biases are unknown: F0 still contains the earth's rate."""
        if len(self.names) == len(self.gyros) * len(self.outputs):
            raise error(
                "the run does not know the biases of its gyros:"
                " they are mixed with the earth's rate",
                hint="fit with [site] latitude_deg",
            )


def read_matrices(spec: AnyRecipe, records: Mapping[str, Record]) -> tuple[GyroMatrix, ...]:
    """Matrices of a run: one for each gyro about its own axis, or one for all gyros about three
    axes, without the names of the biases where these are unknown; raises CoefficientError for a
    missing file or model.
    """
    triad = isinstance(spec, GyroTriadRecipe)
    for file in (SCALE_FILE, ORTHOGONALITY_FILE) if triad else (SCALE_FILE,):
        if file not in records:
            hint = f"it is not a run of {'gyro_triad' if triad else 'a rate table'}"
            raise CoefficientError(f"the run holds no {file}", hint=hint)
    scale = records[SCALE_FILE]
    models = {model.name: model for model in scale.models}

    def over_temperature(names: Sequence[str]) -> tuple[Model, ...]:
        """Polynomials with these names; empty where any of them is missing."""
        return tuple(models[name] for name in names) if models.keys() >= {*names} else ()

    if isinstance(spec, GyroTriadRecipe):
        model = records[ORTHOGONALITY_FILE].model("triad")
        sensitivities, biases = triad_names(spec.gyros)
        coefficients = {c.name for c in model.coefficients}
        names = [*sensitivities, *(name for name in biases if name in coefficients)]
        curves = [curve_name(line_name(gyro, axis), "K") for gyro in spec.gyros for axis in AXES]
        if len(names) > len(sensitivities):  # the latitude is known
            curves += [curve_name(gyro, "bias") for gyro in spec.gyros]
        outputs = tuple(f"rate_{axis}_dps" for axis in AXES)
        return (GyroMatrix(spec.gyros, outputs, model, tuple(names), over_temperature(curves)),)
    matrices = []
    for gyro in spec.gyros:
        name, outputs = line_name(gyro, spec.own_axis(gyro)), (f"gyro_{gyro}_dps",)
        polynomials = over_temperature([curve_name(name, "K"), curve_name(name, "F0")])
        line, response = scale.model(name), models.get(f"{name}.response")
        matrices.append(GyroMatrix((gyro,), outputs, line, ("K", "F0"), polynomials, response))
    return tuple(matrices)


def read_earth_rate(
    spec: OwnAxisRecipe, records: Mapping[str, Record], error: type[CalibkitError]
) -> float:
    """Earth rate about the laboratory's table axis [°/s], added to a compensated rate: zero unless
    the recipe asks for inertial rates; raises `error` where it is unknown.
    """
    if spec.compensation == "laboratory":
        return 0.0
    for condition in records[SCALE_FILE].conditions:
        if condition.name == "earth_rate_about_table_axis":
            return condition.value
    raise error(
        "the run does not know the earth's rate about its table axis",
        hint="fit with [site] latitude_deg",
    )
