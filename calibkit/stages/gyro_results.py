"""Scale factors of table runs → gyro_scale.json; those of two gyros about two axes → gyro_orthogonality.json."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibkit.coefficients import Coefficient, Condition, Figure, Model, Parameter, StageResult
from calibkit.errors import FitError
from calibkit.numeric import gum, gyro_figures, gyro_pair, gyro_scale
from calibkit.stages import gyro_shape
from calibkit.stages.gyro_runs import RATE, TEMPERATURE, vertical_rate_dps

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from calibkit.numeric.gyro_pair import GyroPair
    from calibkit.numeric.gyro_response import Response
    from calibkit.numeric.gyro_scale import ScaleFactor, ScaleOverTemperature
    from calibkit.recipe.gyro import GyroRecipe, OwnAxisRecipe
    from calibkit.stages.gyro_runs import TableRun

    Array = NDArray[np.float64]

GJB, IEEE = "GJB 2426A", "IEEE Std 952"
ROOM_DEGC = 5.0
"""Runs this near the reference temperature repeat each other (GJB 2426A)."""
VARIES_DEGC = 5.0
"""Span of the runs' temperatures from which K is fitted over temperature."""
OPPOSITE = 20.0
"""Standard uncertainties apart, while their sum is within as many, that make two gammas equal and opposite."""
ONE_TEMPERATURE_DEGC = 2.0
"""Difference of the two runs of a pair from which gamma carries the temperature of K."""
UNCERTAIN = 1e-3
"""Relative standard uncertainty from which a scale factor is flagged."""
PPM = 1e6
DPH_PER_DPS = 3600.0
PAIR_UNITS = {"N": "1", "epsilon": "1", "gamma": "1", "alpha_deg": "deg"}
MODELS = (("a", "a"), ("b", "b"), ("b", "a"), ("a", "b"))
"""Gyro and table axis of the models of a pair: own axes first."""


@dataclass(frozen=True, slots=True)
class PairFit:
    """Both runs of a pair, its ratios and angle, and γ again from gyro A about B's axis with its standard uncertainty."""

    runs: dict[str, TableRun]
    found: GyroPair
    gamma_from_a: tuple[float, float]
    flags: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class GyroOverRuns:
    """One gyro in all runs: which repeat each other at the reference temperature, their mean, K and F0 over temperature."""

    gyro: str
    runs: tuple[TableRun, ...]
    at_room: tuple[TableRun, ...]
    K: tuple[float, float]
    F0: tuple[float, float]
    K_over_temperature: ScaleOverTemperature | None
    F0_over_temperature: ScaleOverTemperature | None
    response: Response | None


def pair_fit(about_a: TableRun, about_b: TableRun) -> PairFit:
    """N, ε, γ and α from the runs about both table axes, with what the runs share in the covariance."""
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
            f"gamma is {found.gamma_indicated:.6g} from B about A's axis and {gamma:.6g} from A about B's: equal and opposite",
            hint="one gyro, or the table, has opposite signs in the two logs; state the sign in [columns]",
        )
    apart = about_a.temp_degc - about_b.temp_degc
    if abs(apart) > ONE_TEMPERATURE_DEGC:
        notes = (*notes, f"the two runs are {abs(apart):.1f} °C apart: gamma carries the change of K_B between them")
    own = uncertain([("a_about_a", about_a.scale("a")), ("b_about_b", about_b.scale("b"))])
    flags = (*about_a.flags, *about_b.flags, *found.flags, *notes, *own)
    return PairFit({"a": about_a, "b": about_b}, found, (gamma, uncertainty), tuple(dict.fromkeys(flags)))


def pair_scale_result(fitted: PairFit, spec: OwnAxisRecipe) -> StageResult:
    """gyro_scale.json of a pair: a line for each gyro about each axis, the figures of each about its own."""
    models = [scale_model(f"{g}_about_{axis}", fitted.runs[axis], g) for g, axis in MODELS]
    figures: list[Figure] = []
    for gyro in ("a", "b"):
        run, name = fitted.runs[gyro], f"{gyro}_about_{gyro}"
        figures += line_figures(run, gyro, name)
        response = gyro_shape.choose(spec, [(run, gyro)])
        if response is not None:
            models.append(gyro_shape.model(f"{name}.response", response, run))
    figures += [bias for g, axis in MODELS for bias in _bias(fitted, g, axis, spec)]
    return StageResult("gyro_scale", tuple(models), tuple(figures), fitted.flags, conditions(spec))


def _bias(fitted: PairFit, gyro: str, axis: str, spec: GyroRecipe) -> list[Figure]:
    """Bias of a gyro about one axis without the earth's rate; a projection is referred to the gyro's own K."""
    vertical = vertical_rate_dps(spec)
    if vertical is None:
        return []
    own = fitted.runs[gyro].scale(gyro).K if gyro != axis else None
    value, uncertainty = gyro_scale.bias_dps(fitted.runs[axis].scale(gyro), vertical, own_K=own)
    return [Figure(f"bias.{gyro}_about_{axis}", value * DPH_PER_DPS, "deg/h", uncertainty * DPH_PER_DPS)]


def orthogonality_result(fitted: PairFit, spec: GyroRecipe) -> StageResult:
    """gyro_orthogonality.json: N, ε, γ, α as a model with their covariance and as figures, the interval of α, both γ."""
    found, own = fitted.found, fitted.runs["b"].scale("b")
    values = (found.N, found.epsilon, found.gamma, found.alpha_deg)
    entries = [
        Coefficient(name, value, unit, float(u))
        for (name, unit), value, u in zip(PAIR_UNITS.items(), values, found.standard_uncertainty, strict=True)
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
        Figure("gamma_from_a_about_b", *_with_unit(fitted.gamma_from_a, "1")),
    )
    return StageResult("gyro_orthogonality", (model,), figures, fitted.flags, conditions(spec))


def uncertain(lines: Sequence[tuple[str, ScaleFactor]]) -> list[str]:
    """Flags for scale factors about a gyro's own axis that hardly are any: too slow, too short or too noisy a run."""
    return [
        f"{name}: K is known to {100.0 * u / abs(line.K):.2g} % only: hold faster rates, or hold them longer"
        for name, line in lines
        for u in [float(line.standard_uncertainty[0])]
        if not u < UNCERTAIN * abs(line.K)
    ]


def _with_unit(pair: tuple[float, float], unit: str) -> tuple[float, str, float]:
    """Value, unit and standard uncertainty in the order of a figure."""
    return pair[0], unit, pair[1]


def over_runs(gyro: str, runs: Sequence[TableRun], spec: OwnAxisRecipe) -> GyroOverRuns:
    """One gyro over all runs: the mean at the reference temperature, and K and F0 over temperature where it varies."""
    temperature = np.array([run.temp_degc for run in runs])
    near = np.isnan(temperature) | (np.abs(temperature - spec.reference_temp_degc) <= ROOM_DEGC)
    at_room = tuple(run for run, is_near in zip(runs, near, strict=True) if is_near) or tuple(runs)
    lines = [run.scale(gyro) for run in at_room]
    K = gyro_scale.mean_of_runs([s.K for s in lines], [float(s.standard_uncertainty[0]) for s in lines])
    F0 = gyro_scale.mean_of_runs([s.F0 for s in lines], [float(s.standard_uncertainty[1]) for s in lines])
    curves = _over_temperature([run.scale(gyro) for run in runs], temperature)
    return GyroOverRuns(
        gyro, tuple(runs), at_room, K, F0, *curves, gyro_shape.choose(spec, [(run, gyro) for run in runs])
    )


def _over_temperature(
    lines: Sequence[ScaleFactor], temperature: Array
) -> tuple[ScaleOverTemperature | None, ScaleOverTemperature | None]:
    """K and F0 as polynomials of temperature, or none where it was not logged or hardly varies."""
    if not np.isfinite(temperature).all() or np.ptp(temperature) < VARIES_DEGC:
        return None, None
    K, F0 = (np.array([getattr(line, name) for line in lines]) for name in ("K", "F0"))
    u_K, u_F0 = np.array([line.standard_uncertainty[:2] for line in lines]).T
    return gyro_scale.over_temperature(K, u_K, temperature), gyro_scale.over_temperature(F0, u_F0, temperature)


def rate_table_result(gyros: Sequence[GyroOverRuns], flags: Sequence[str], spec: OwnAxisRecipe) -> StageResult:
    """gyro_scale.json of runs: a line a gyro and run, the mean at the reference temperature, K and F0 over temperature."""
    models: list[Model] = []
    figures: list[Figure] = []
    for one in gyros:
        name = f"gyro_{one.gyro}"
        models += [_mean_model(name, one), *_temperature_models(name, one)]
        models += [scale_model(f"{name}.{run.log.name}", run, one.gyro) for run in one.runs]
        if one.response is not None:
            models.append(gyro_shape.model(f"{name}.response", one.response, one.runs[0]))
        figures += run_figures(name, one, spec)
        figures += [figure for run in one.runs for figure in line_figures(run, one.gyro, f"{name}.{run.log.name}")]
        figures += [figure for run in one.runs for figure in _run_bias(name, run, one.gyro, spec)]
    return StageResult("gyro_scale", tuple(models), tuple(figures), tuple(flags), conditions(spec))


def _run_bias(name: str, run: TableRun, gyro: str, spec: GyroRecipe) -> list[Figure]:
    """Bias of one run without the earth's rate."""
    vertical = vertical_rate_dps(spec)
    if vertical is None:
        return []
    value, uncertainty = gyro_scale.bias_dps(run.scale(gyro), vertical)
    return [Figure(f"bias.{name}.{run.log.name}", value * DPH_PER_DPS, "deg/h", uncertainty * DPH_PER_DPS)]


def conditions(spec: GyroRecipe) -> tuple[Condition, ...]:
    """Latitude and the earth's rate about the table axis, where they are known: F0 holds that rate."""
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
        coefficients=(Coefficient("K", line.K, "1/deg", u_K), Coefficient("F0", line.F0, "1/s", u_F0)),
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


def _mean_model(name: str, one: GyroOverRuns) -> Model:
    """gyro-scale/1 model of the mean of the runs at the reference temperature."""
    lines = [run.scale(one.gyro) for run in one.at_room]
    noise = np.sum([line.covariance[:2, :2] for line in lines], axis=0)
    correlation = float(noise[0, 1] / np.sqrt(noise[0, 0] * noise[1, 1])) if noise[0, 0] * noise[1, 1] > 0.0 else 0.0
    cross = correlation * one.K[1] * one.F0[1]
    return Model(
        name=name,
        form="gyro-scale/1",
        coefficients=(Coefficient("K", *_with_unit(one.K, "1/deg")), Coefficient("F0", *_with_unit(one.F0, "1/s"))),
        covariance=((one.K[1] ** 2, cross), (cross, one.F0[1] ** 2)),
        dof=sum(line.dof for line in lines),
        residual_rms=float(np.sqrt(np.mean([line.residual_rms**2 for line in lines]))),
        residual_unit="1/s",
        valid=valid_of(one.at_room),
        parameters=(Parameter("runs", float(len(lines)), "1"),),
    )


def _temperature_models(name: str, one: GyroOverRuns) -> list[Model]:
    """polynomial/1 models of K and F0 over case temperature, where it varies."""
    curves = (("K", "1/deg", one.K_over_temperature), ("F0", "1/s", one.F0_over_temperature))
    return [
        polynomial_model(f"{name}.{letter}_over_temperature", unit, fit, one.runs)
        for letter, unit, fit in curves
        if fit is not None
    ]


def polynomial_model(name: str, unit: str, fit: ScaleOverTemperature, runs: Sequence[TableRun]) -> Model:
    """polynomial/1 model of one quantity over case temperature, which holds over all that the runs covered."""
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
    found = gyro_figures.figures(run.scale(gyro), run.noise(gyro))
    return [
        Figure(
            f"{f.name.removesuffix('_gjb').removesuffix('_ieee')}.{f.standard}.{name}",
            f.value,
            f.unit,
            f.standard_uncertainty,
        )
        for f in found
    ]


def run_figures(name: str, one: GyroOverRuns, spec: GyroRecipe) -> list[Figure]:
    """Repeatability and temperature sensitivity, where the runs can show them."""
    figures = []
    if len(one.at_room) > 1 and _repeats(one):
        K = np.array([run.scale(one.gyro).K for run in one.at_room])
        value = gyro_figures.repeatability(K)
        u = value / float(np.sqrt(2.0 * (K.size - 1)))
        figures.append(Figure(f"repeatability.{GJB}.{name}", value, "ppm", u))
    if one.K_over_temperature is None:
        return figures
    K, u_K, temperature = (np.array(x) for x in zip(*(_point(run, one.gyro) for run in one.runs), strict=True))

    def slope(values: Array) -> float:
        line = gyro_scale.over_temperature(values, u_K, temperature, order=1)
        return float(line.coefficients[1] / abs(one.K[0])) * PPM

    def largest(values: Array) -> float:
        return gyro_figures.temperature_sensitivity(values, temperature, spec.reference_temp_degc)

    u_K = np.hypot(u_K, _scatter(one))
    room = np.abs(temperature - spec.reference_temp_degc) <= ROOM_DEGC
    if room.any() and not room.all():
        value, u = _propagated(largest, K, u_K)
        figures.append(Figure(f"temperature_sensitivity.{GJB}.{name}", value, "ppm/degC", u))
    value, u = _propagated(slope, K, u_K)
    figures.append(Figure(f"temperature_sensitivity.{IEEE}.{name}", value, "ppm/degC", u))
    return figures


def _scatter(one: GyroOverRuns) -> float:
    """How much K differs from run to run, at the reference temperature and about K(T); few runs widen it by Student's t."""
    found = []
    if len(one.at_room) > 1 and _repeats(one):
        K = np.array([run.scale(one.gyro).K for run in one.at_room])
        found.append((K.size - 1, float(np.var(K, ddof=1))))
    curve = one.K_over_temperature
    if curve is not None and curve.dof > 0:
        found.append((curve.dof, curve.residual_rms**2 * (1.0 + curve.coefficients.size / curve.dof)))
    if not found:
        return 0.0
    # runs at the reference temperature are in both: the larger count is that of independent ones
    dof = max(count for count, _ in found)
    variance = sum(count * square for count, square in found) / sum(count for count, _ in found)
    return float(np.sqrt(variance)) * gum.widening(dof)


def _repeats(one: GyroOverRuns) -> bool:
    """Whether the runs of the mean are at one temperature, or at none that is known."""
    temperature = np.array([run.temp_degc for run in one.at_room])
    return bool(np.isnan(temperature).any() or np.ptp(temperature) <= 2.0 * ROOM_DEGC)


def _point(run: TableRun, gyro: str) -> tuple[float, float, float]:
    """K, its standard uncertainty and the temperature of one run."""
    line = run.scale(gyro)
    return line.K, float(line.standard_uncertainty[0]), run.temp_degc


def _propagated(function: Callable[[Array], float], values: Array, uncertainty: Array) -> tuple[float, float]:
    """Value of a function and its standard uncertainty from those of independent values, by finite differences."""
    at = function(values)
    steps = [function(values + u * row) - at for u, row in zip(uncertainty, np.eye(values.size), strict=True)]
    return at, float(np.sqrt(np.sum(np.square(steps))))


def _apart(one: GyroOverRuns) -> list[str]:
    """Flag for a run at the reference temperature whose K is not that of the others: another gyro or setting."""
    K = np.array([run.scale(one.gyro).K for run in one.at_room])
    off = np.abs(K / np.median(K) - 1.0)
    if len(K) < 2 or not _repeats(one) or not off.max() > UNCERTAIN:
        return []
    name = one.at_room[int(np.argmax(off))].log.file
    return [f"gyro_{one.gyro}: K of {name} is {PPM * off.max():.0f} ppm off the other runs: another gyro or setting?"]


def run_flags(gyros: Sequence[GyroOverRuns], spec: GyroRecipe) -> list[str]:
    """What a reader of figures over several runs must know."""
    temperature = np.array([run.temp_degc for run in gyros[0].runs])
    flags = uncertain(
        [(f"gyro_{one.gyro} in {run.log.file}", run.scale(one.gyro)) for one in gyros for run in one.runs]
    )
    flags += [flag for one in gyros for flag in _apart(one)]
    if len(temperature) > 1 and np.isnan(temperature).any():
        flags.append("temperature is not logged in every run: nothing is fitted over it, all runs count as repeated")
    elif not (np.abs(temperature - spec.reference_temp_degc) <= ROOM_DEGC).any() and np.isfinite(temperature).all():
        flags.append(
            f"no run within {ROOM_DEGC:g} °C of {spec.reference_temp_degc:g} °C: the mean is that of all runs, "
            f"{temperature.min():.1f} to {temperature.max():.1f} °C"
        )
    return flags
