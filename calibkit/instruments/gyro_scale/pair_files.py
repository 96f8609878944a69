"""Scale factors of table runs → gyro_scale.json; those of two gyros about two axes →
gyro_orthogonality.json.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibkit.coefficients import Coefficient, Condition, Figure, Model, Parameter, StageResult
from calibkit.constants import DPH_PER_DPS
from calibkit.errors import FitError
from calibkit.instruments.gyro_scale import shape
from calibkit.instruments.gyro_scale.numeric import gjb_figures, pair as gyro_pair, scale_factor
from calibkit.instruments.gyro_scale.runs import RATE, TEMPERATURE, vertical_rate_dps

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from calibkit.instruments.gyro_scale.numeric.pair import GyroPair
    from calibkit.instruments.gyro_scale.numeric.scale_factor import ScaleFactor
    from calibkit.instruments.gyro_scale.recipe import GyroRecipe, OwnAxisRecipe
    from calibkit.instruments.gyro_scale.runs import TableRun
    from calibkit.numeric.least_squares.polynomial import TemperaturePolynomial

    Array = NDArray[np.float64]

GJB, IEEE = "GJB 2426A", "IEEE Std 952"
OPPOSITE = 20.0
"""Standard uncertainties apart, while their sum is within as many, that make two gammas equal and
opposite.
"""
ONE_TEMPERATURE_DEGC = 2.0
"""Difference of the two runs of a pair from which gamma carries the temperature of K."""
UNCERTAIN = 1e-3
"""Relative standard uncertainty from which a scale factor is flagged."""
PPM = 1e6
PAIR_UNITS = {"N": "1", "epsilon": "1", "gamma": "1", "alpha_deg": "deg"}
MODELS = (("a", "a"), ("b", "b"), ("b", "a"), ("a", "b"))
"""Gyro and table axis of the models of a pair: own axes first."""


@dataclass(frozen=True, slots=True)
class PairFit:
    """Both runs of a pair, its ratios and angle, and γ again from gyro A about B's axis with its
    standard uncertainty.
    """

    runs: dict[str, TableRun]
    found: GyroPair
    gamma_from_a: tuple[float, float]
    flags: tuple[str, ...]


def pair_fit(about_a: TableRun, about_b: TableRun) -> PairFit:
    """N, ε, γ and α from the runs about both table axes, with what the runs share in the
    covariance.
    """
    K_A, K_Ba = about_a.scales.K
    K_Ab, K_B = about_b.scales.K
    shared = about_a.scales.covariance
    covariance = np.zeros((3, 3))
    covariance[np.ix_((0, 2), (0, 2))] = shared
    covariance[1, 1] = about_b.scales.covariance[1, 1]
    found = gyro_pair.pair(float(K_A), float(K_B), float(K_Ba), covariance)
    independent = np.diag([shared[0, 0], about_b.scales.covariance[0, 0]])
    gamma, uncertainty, notes = gyro_pair.cross_check(found, float(K_A), float(K_Ab), independent)
    spread = float(np.hypot(uncertainty, found.standard_uncertainty[2]))
    if abs(gamma - found.gamma_indicated) > OPPOSITE * spread > abs(gamma + found.gamma_indicated):
        raise FitError(
            f"gamma is {found.gamma_indicated:.6g} from B about A's axis and {gamma:.6g} from A"
            " about B's: equal and opposite",
            hint=(
                "one gyro, or the table, has opposite signs in the two logs; state the sign in"
                " [columns]"
            ),
        )
    apart = about_a.temp_degc - about_b.temp_degc
    if abs(apart) > ONE_TEMPERATURE_DEGC:
        notes = (
            *notes,
            (
                f"the two runs are {abs(apart):.1f} °C apart: gamma carries the change of K_B"
                " between them"
            ),
        )
    own = uncertain([("a_about_a", about_a.scale("a")), ("b_about_b", about_b.scale("b"))])
    flags = (*about_a.flags, *about_b.flags, *found.flags, *notes, *own)
    return PairFit(
        {"a": about_a, "b": about_b}, found, (gamma, uncertainty), tuple(dict.fromkeys(flags))
    )


def pair_scale_result(fitted: PairFit, spec: OwnAxisRecipe) -> StageResult:
    """gyro_scale.json of a pair: a line for each gyro about each axis, the figures of each about
    its own.
    """
    models = [scale_model(f"{g}_about_{axis}", fitted.runs[axis], g) for g, axis in MODELS]
    figures: list[Figure] = []
    for gyro in ("a", "b"):
        run, name = fitted.runs[gyro], f"{gyro}_about_{gyro}"
        figures += line_figures(run, gyro, name)
        response = shape.choose(spec, [(run, gyro)])
        if response is not None:
            models.append(shape.model(f"{name}.response", response, run))
    for g, axis in MODELS:
        # a projection is referred to the gyro's own K
        own = fitted.runs[g].scale(g).K if g != axis else None
        figures += bias_figures(f"{g}_about_{axis}", fitted.runs[axis].scale(g), spec, own)
    return StageResult("gyro_scale", tuple(models), tuple(figures), fitted.flags, conditions(spec))


def orthogonality_result(fitted: PairFit, spec: GyroRecipe) -> StageResult:
    """gyro_orthogonality.json: N, ε, γ, α as a model with their covariance and as figures, the
    interval of α, both γ.
    """
    found, own = fitted.found, fitted.runs["b"].scale("b")
    values = (found.N, found.epsilon, found.gamma, found.alpha_deg)
    entries = [
        Coefficient(name, value, unit, float(u))
        for (name, unit), value, u in zip(
            PAIR_UNITS.items(), values, found.standard_uncertainty, strict=True
        )
    ]
    model = Model(
        name="pair",
        form="gyro-orthogonality/1",
        coefficients=tuple(entries),
        covariance=tuple(map(tuple, found.covariance.tolist())),
        dof=min(run.scale(g).dof for run in fitted.runs.values() for g in ("a", "b")),
        residual_rms=own.residual_rms,
        residual_unit="1/s",
        valid=valid_of(list(fitted.runs.values())),
    )
    low, high = found.alpha_interval_deg
    u_alpha = entries[3].standard_uncertainty
    figures = (
        *entries,
        Figure("orthogonality_error_deg", found.orthogonality_error_deg, "deg", u_alpha),
        Figure("alpha_low_95_deg", low, "deg", 0.0),
        Figure("alpha_high_95_deg", high, "deg", 0.0),
        Figure("side", 1.0 if found.side == "same" else -1.0, "1", 0.0),
        Figure("clamped", 1.0 if found.clamped else 0.0, "1", 0.0),
        Figure("gamma_indicated", found.gamma_indicated, "1", entries[2].standard_uncertainty),
        Figure("gamma_from_a_about_b", *with_unit(fitted.gamma_from_a, "1")),
    )
    return StageResult("gyro_orthogonality", (model,), figures, fitted.flags, conditions(spec))


def uncertain(lines: Sequence[tuple[str, ScaleFactor]]) -> list[str]:
    """Flags for scale factors about a gyro's own axis that hardly are any: too slow, too short or
    too noisy a run.
    """
    return [
        f"{name}: K is known to {100.0 * u / abs(line.K):.2g} % only: hold faster rates, or hold"
        " them longer"
        for name, line in lines
        for u in [float(line.standard_uncertainty[0])]
        if not u < UNCERTAIN * abs(line.K)
    ]


def with_unit(pair: tuple[float, float], unit: str) -> tuple[float, str, float]:
    """Value, unit and standard uncertainty in the order of a figure."""
    return pair[0], unit, pair[1]


def bias_figures(
    name: str, line: ScaleFactor, spec: GyroRecipe, own_K: float | None = None
) -> list[Figure]:
    """Bias of a line without the earth's rate, where that is known; referred to another K where one
    is given.
    """
    vertical = vertical_rate_dps(spec)
    if vertical is None:
        return []
    value, uncertainty = scale_factor.bias_dps(line, vertical, own_K=own_K)
    return [Figure(f"bias.{name}", value * DPH_PER_DPS, "deg/h", uncertainty * DPH_PER_DPS)]


def conditions(spec: GyroRecipe) -> tuple[Condition, ...]:
    """Latitude and the earth's rate about the table axis, where they are known: F0 holds that
    rate.
    """
    vertical = vertical_rate_dps(spec)
    if vertical is None or spec.site.latitude_deg is None:
        return ()
    return (
        Condition("latitude", spec.site.latitude_deg, "deg"),
        Condition("earth_rate_about_table_axis", vertical, "deg/s"),
    )


def scale_model(name: str, run: TableRun, gyro: str) -> Model:
    """gyro-scale/1 model of one gyro in one run."""
    line = run.scale(gyro)
    u_K, u_F0 = (float(u) for u in line.standard_uncertainty[:2])
    known = np.isfinite(run.temp_degc)
    return Model(
        name=name,
        form="gyro-scale/1",
        coefficients=(
            Coefficient("K", line.K, "1/deg", u_K),
            Coefficient("F0", line.F0, "1/s", u_F0),
        ),
        covariance=tuple(map(tuple, line.covariance[:2, :2].tolist())),
        dof=line.dof,
        residual_rms=line.residual_rms,
        residual_unit="1/s",
        valid=valid_of([run]),
        parameters=(Parameter("temp_case", run.temp_degc, "degC"),) if known else (),
    )


def valid_of(runs: Sequence[TableRun]) -> dict[str, tuple[float, float]]:
    """Rates and temperatures that runs covered."""
    rate = np.concatenate([run.plateaus.rate_dps for run in runs])
    temperature = np.array([run.temp_range for run in runs])
    spans = {RATE: rate} | ({TEMPERATURE: temperature} if np.isfinite(temperature).all() else {})
    return {name: (float(span.min()), float(span.max())) for name, span in spans.items()}


def polynomial_model(
    name: str, unit: str, fit: TemperaturePolynomial, runs: Sequence[TableRun]
) -> Model:
    """polynomial/1 model of one quantity over case temperature, which holds over all that the runs
    covered.
    """
    u = np.sqrt(np.diag(fit.covariance))
    return Model(
        name=name,
        form="polynomial/1",
        coefficients=tuple(
            Coefficient(f"p{k}", float(value), _power_unit(unit, k), float(error))
            for k, (value, error) in enumerate(zip(fit.coefficients, u, strict=True))
        ),
        covariance=tuple(map(tuple, fit.covariance.tolist())),
        dof=fit.dof,
        residual_rms=fit.residual_rms,
        residual_unit=unit,
        valid={TEMPERATURE: valid_of(runs).get(TEMPERATURE, fit.valid_degc)},
    )


def _power_unit(unit: str, power: int) -> str:
    """Unit of the coefficient of a power of °C."""
    return unit if power == 0 else f"{unit}/degC" if power == 1 else f"{unit}/degC^{power}"


def line_figures(run: TableRun, gyro: str, name: str) -> list[Figure]:
    """Figures of one line in the terms of both standards, each named figure.standard.model."""
    found = gjb_figures.figures(run.scale(gyro), run.noise(gyro))
    return [
        Figure(
            f"{f.name.removesuffix('_gjb').removesuffix('_ieee')}.{f.standard}.{name}",
            f.value,
            f.unit,
            f.standard_uncertainty,
        )
        for f in found
    ]
