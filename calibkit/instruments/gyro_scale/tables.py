"""Fits and validations of a rate table → what the console, the report and the acceptance limits
say.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibkit.coefficients import at_most
from calibkit.errors import FitError
from calibkit.instruments.gyro_scale.figures import (
    GammaPoint,
    GyroReport,
    LineCurve,
    PairAngle,
    TemperatureCurve,
)
from calibkit.instruments.gyro_scale.numeric import gjb_figures
from calibkit.report.summary import number
from calibkit.report.table import Table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibkit.coefficients import Criterion, Figure, Model, StageResult
    from calibkit.instruments.gyro_scale.over_runs import GyroOverRuns
    from calibkit.instruments.gyro_scale.pair_files import PairFit
    from calibkit.instruments.gyro_scale.recipe import (
        PairAcceptance,
        RateTableAcceptance,
        TriadAcceptance,
    )
    from calibkit.instruments.gyro_scale.runs import TableRun
    from calibkit.numeric.least_squares.polynomial import TemperaturePolynomial

PPM = 1e6


def scale_table(models: Sequence[Model]) -> Table:
    """K and F0 of every line."""
    rows = []
    for model in (m for m in models if m.form == "gyro-scale/1"):
        K, F0 = model.coefficients
        relative = PPM * K.standard_uncertainty / abs(K.value) if K.value else float("inf")
        temperature = {p.name: p.value for p in model.parameters}.get("temp_case")
        rows.append(
            (
                model.name,
                f"{K.value:.4f}",
                f"{K.standard_uncertainty:.2g}",
                f"{relative:.2g}" if relative < 1e5 else "-",
                f"{F0.value:.3f}",
                f"{F0.standard_uncertainty:.2g}",
                f"{model.residual_rms:.2g}",
                "" if temperature is None else f"{temperature:.1f}",
            )
        )
    heads = ("", "K [1/deg]", "u(K)", "u [ppm]", "F0 [1/s]", "u(F0)", "residual rms", "°C")
    return Table(
        "Scale factors: F = K·rate + F0 (standard uncertainties of type A)", heads, tuple(rows)
    )


def temperature_table(models: Sequence[Model]) -> tuple[Table, ...]:
    """Polynomials over temperature, where there are any."""
    rows = [
        (
            model.name if k == 0 else "",
            c.name,
            f"{c.value:.8g}",
            f"{c.standard_uncertainty:.1e}",
            c.unit,
        )
        for model in models
        if model.form in ("polynomial/1", "gyro-response/1")
        for k, c in enumerate(model.coefficients)
    ]
    heads = ("", "", "value", "standard uncertainty", "unit")
    return (Table("Over temperature and rate", heads, tuple(rows)),) if rows else ()


def figure_table(figures: Sequence[Figure], names: Sequence[str], title: str) -> Table:
    """Figures in the standards' terms, one row a figure, one column a model."""
    chosen = {figure.name: figure for figure in figures}
    kinds = list(
        dict.fromkeys(
            (what, standard, figure.unit)
            for figure in figures
            for what, _, rest in [figure.name.partition(".")]
            for standard, _, model in [rest.partition(".")]
            if model in names
        )
    )
    rows = []
    for what, standard, unit in kinds:
        cells = (chosen.get(f"{what}.{standard}.{name}") for name in names)
        rows.append(
            (
                what.replace("_", " "),
                standard,
                *("" if c is None else _with_u(c) for c in cells),
                unit,
            )
        )
    return Table(title, ("figure", "standard", *names, "unit"), tuple(rows))


def _with_u(figure: Figure) -> str:
    """Value ± standard uncertainty."""
    digits = {"1/deg": 8, "arcsec": 7}.get(figure.unit, 3)
    u = figure.standard_uncertainty
    shown = f"{u:.0f}" if u >= 9.5 else f"{u:.1g}"
    return f"{number(figure.value, digits)} ± {shown}" if u else number(figure.value, digits)


def bias_table(figures: Sequence[Figure]) -> tuple[Table, ...]:
    """Biases without the earth's rate, where the latitude is known."""
    rows = [
        (
            figure.name.partition(".")[2],
            f"{figure.value:.4f}",
            f"{figure.standard_uncertainty:.1g}",
            figure.unit,
        )
        for figure in figures
        if figure.name.startswith("bias.")
    ]
    title = "Bias without the earth's rate about the table axis"
    return (
        (Table(title, ("", "bias", "standard uncertainty", "unit"), tuple(rows)),) if rows else ()
    )


def pair_table(fitted: PairFit) -> Table:
    """N, ε, γ, α, the orthogonality error, the second γ."""
    found, u = fitted.found, fitted.found.standard_uncertainty
    low, high = found.alpha_interval_deg
    rows = (
        ("N = K_B/K_A", f"{found.N:.9f}", f"{u[0]:.1e}", "1"),
        ("epsilon = K_Ba/K_A", f"{found.epsilon:.9f}", f"{u[1]:.1e}", "1"),
        ("gamma = epsilon/N", f"{found.gamma:.9f}", f"{u[2]:.1e}", "1"),
        ("alpha = arccos gamma", f"{found.alpha_deg:.6f}", f"{u[3]:.1e}", "deg"),
        ("alpha, 95 % interval", f"{low:.6f} to {high:.6f}", "", "deg"),
        (
            "orthogonality error 90° - alpha",
            f"{found.orthogonality_error_deg:.6f}",
            f"{u[3]:.1e}",
            "deg",
        ),
        (
            "gamma from A about B's axis",
            f"{fitted.gamma_from_a[0]:.9f}",
            f"{fitted.gamma_from_a[1]:.1e}",
            "1",
        ),
    )
    title = f"Gyro B against gyro A: {found.side} side"
    return Table(title, ("", "value", "standard uncertainty", "unit"), rows)


def line_curve(run: TableRun, gyro: str) -> LineCurve:
    """Errors of one gyro's line over the rates of a run."""
    line, noise = run.scale(gyro), run.noise(gyro)
    full = PPM / float(np.max(np.abs(line.indication)))
    with np.errstate(divide="ignore", invalid="ignore"):
        of_point = PPM / np.abs(line.K * line.rate_dps)
    deviation = gjb_figures.nonlinearity_per_point(line)
    return LineCurve(
        gyro,
        run.log.name,
        line.rate_dps,
        line.residuals * full,
        noise * full,
        deviation,
        noise * of_point,
    )


def pair_drawing(fitted: PairFit) -> GyroReport:
    """What the figures of a pair show."""
    found = fitted.found
    points = (
        GammaPoint("B about A's axis", found.gamma_indicated, float(found.standard_uncertainty[2])),
        GammaPoint("A about B's axis", *fitted.gamma_from_a),
    )
    lines = tuple(line_curve(fitted.runs[gyro], gyro) for gyro in ("a", "b"))
    return GyroReport(
        lines, (), PairAngle(points, found.alpha_deg, found.alpha_interval_deg, found.side)
    )


def runs_drawing(gyros: Sequence[GyroOverRuns]) -> GyroReport:
    """What the figures of rate-table runs show."""
    lines = tuple(line_curve(run, one.gyro) for one in gyros for run in one.runs)
    return GyroReport(
        lines, tuple(curve for one in gyros for curve in _temperature_curve(one)), None
    )


def _temperature_curve(one: GyroOverRuns) -> list[TemperatureCurve]:
    """K of one gyro over temperature, relative to its mean at the reference temperature."""
    fit = one.K_over_temperature
    return [] if fit is None else [temperature_curve(one.gyro, one.runs, fit, one.K[0])]


def temperature_curve(
    gyro: str, runs: Sequence[TableRun], fit: TemperaturePolynomial, reference: float
) -> TemperatureCurve:
    """K of one gyro in every run and as a polynomial, in ppm from a reference K."""
    grid = np.linspace(*fit.valid_degc, 101)
    curve, u_curve = fit.at(grid)
    lines = [run.scale(gyro) for run in runs]
    K, u = (
        np.array(x) for x in zip(*((s.K, s.standard_uncertainty[0]) for s in lines), strict=True)
    )
    ppm, sign = PPM / abs(reference), float(np.sign(reference))
    temperature = np.array([run.temp_degc for run in runs])
    return TemperatureCurve(
        gyro,
        temperature,
        (K - reference) * sign * ppm,
        u * ppm,
        grid,
        (curve - reference) * sign * ppm,
        u_curve * ppm,
    )


def limit_on(name: str, value: float, limit: float | None, unit: str) -> list[Criterion]:
    """One limit that a value must not exceed, where it is stated."""
    return [] if limit is None else [at_most(name, value, limit, unit)]


def _worst(figures: Sequence[Figure], start: str, limit: float | None, key: str) -> float:
    """Largest figure of a name; raises FitError where a limit is stated and no run shows the
    figure.
    """
    found = [figure.value for figure in figures if figure.name.startswith(start)]
    if limit is not None and not found:
        raise FitError(
            f"acceptance.{key} = {limit:g}: these logs cannot show that figure",
            hint="add the runs that it needs, or take the limit out of the recipe",
        )
    return max(found, default=0.0)


def line_criteria(
    figures: Sequence[Figure], limits: PairAcceptance | RateTableAcceptance | TriadAcceptance
) -> list[Criterion]:
    """Limits on the lines of a fit."""
    pairs = (
        ("nonlinearity over full scale", "nonlinearity_full_scale.", "max_nonlinearity_ppm"),
        ("asymmetry", "asymmetry.GJB", "max_asymmetry_ppm"),
    )
    return [
        criterion
        for name, start, key in pairs
        for limit in [getattr(limits, key)]
        for criterion in limit_on(name, _worst(figures, start, limit, key), limit, "ppm")
    ]


def pair_criteria(
    fitted: PairFit, scales: StageResult, limits: PairAcceptance
) -> tuple[Criterion, ...]:
    """Limits on a pair's fit."""
    u_gamma = float(fitted.found.standard_uncertainty[2])
    error = abs(fitted.found.orthogonality_error_deg)
    return (
        *line_criteria(scales.figures, limits),
        *limit_on("standard uncertainty of gamma", u_gamma, limits.max_gamma_uncertainty, "1"),
        *limit_on("orthogonality error", error, limits.max_orthogonality_error_deg, "deg"),
    )


def runs_criteria(scales: StageResult, limits: RateTableAcceptance) -> tuple[Criterion, ...]:
    """Limits on the runs of a rate table."""
    found = line_criteria(scales.figures, limits)
    pairs = (
        ("repeatability", "repeatability.", "max_repeatability_ppm", "ppm"),
        (
            "temperature sensitivity",
            "temperature_sensitivity.GJB",
            "max_temperature_sensitivity_ppm_degc",
            "ppm/degC",
        ),
    )
    for name, start, key, unit in pairs:
        limit = getattr(limits, key)
        found += limit_on(name, _worst(scales.figures, start, limit, key), limit, unit)
    return tuple(found)


def validation_criteria(
    stands: Sequence[dict[str, object]], limits: PairAcceptance | RateTableAcceptance
) -> tuple[Criterion, ...]:
    """Limits on runs that were not fitted: scale factor against the frozen one, and the run's own
    nonlinearity.
    """
    errors = [abs(float(str(stand["scale_factor_error_ppm"]))) for stand in stands]
    bent = [float(str(stand["nonlinearity_full_scale_ppm"])) for stand in stands]
    return (
        *limit_on("scale-factor error", max(errors), limits.max_scale_factor_error_ppm, "ppm"),
        *limit_on("nonlinearity over full scale", max(bent), limits.max_nonlinearity_ppm, "ppm"),
    )


def validation_table(named: Sequence[tuple[str, dict[str, object]]]) -> Table:
    """Frozen against found, before and after."""
    rows = []
    for name, stand in named:
        before, after = stand["before"], stand["after"]
        assert isinstance(before, dict)  # noqa: S101 (narrows the JSON objects that `stand` made)
        assert isinstance(after, dict)  # noqa: S101 (as above)
        u = float(str(stand["scale_factor_error_standard_uncertainty_ppm"]))
        rows.append(
            (
                f"{name} {stand['gyro']}",
                f"{float(str(stand['K'])):.4f}",
                f"{float(str(stand['K_frozen'])):.4f}",
                f"{before['scale_factor_error_ppm']:+.1f}",
                f"{after['scale_factor_error_ppm']:+.1f} ± {u:.1g}",
                f"{before['rate_error_max_ppm_of_full_scale']:.1f}",
                f"{after['rate_error_max_ppm_of_full_scale']:.1f}",
                f"{float(str(stand['rate_gain'])):.6f}",
            )
        )
    heads = ("", "K", "frozen", "K error", "after", "rate error", "after", "gain")
    return Table(
        "Frozen coefficients on unseen runs: K error in ppm, largest rate error in ppm of full"
        " scale",
        heads,
        tuple(rows),
    )
