"""Fits of gyros on a rate table → tables of the console and the report."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from calibkit.coefficients import Figure, Model, StageResult
from calibkit.forms import POLYNOMIAL
from calibkit.instruments.gyro_scale import forms, over_runs, pair_fit, triad_fit
from calibkit.instruments.gyro_scale.numeric.gjb_figures import PPM
from calibkit.report.run import list_components
from calibkit.report.summary import number
from calibkit.report.table import Table

COLUMNS = 3
"""Largest number of runs side by side in a table of the summary."""


def _table_of(
    title: str, heads: Sequence[str], rows: Iterable[tuple[str, ...]]
) -> tuple[Table, ...]:
    """A table as a tuple of one; empty where it has no rows."""
    made = Table(title, tuple(heads), tuple(rows))
    return (made,) if made.rows else ()


def _tabulate_lines(models: Sequence[Model]) -> Table:
    """Table of K and F0 of every line."""
    rows = []
    for model in (m for m in models if m.form == forms.LINE.name):
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


def _tabulate_curves(models: Sequence[Model]) -> tuple[Table, ...]:
    """Tables of polynomials over temperature and responses over rate; none where there are no such
    models.
    """
    rows = (
        (
            model.name if k == 0 else "",
            c.name,
            f"{c.value:.8g}",
            f"{c.standard_uncertainty:.1e}",
            c.unit,
        )
        for model in models
        if model.form in (POLYNOMIAL.name, forms.RESPONSE.name)
        for k, c in enumerate(model.coefficients)
    )
    return _table_of(
        "Over temperature and rate", ("", "", "value", "standard uncertainty", "unit"), rows
    )


def _tabulate_figures(
    figures: Sequence[Figure], names: Sequence[str], title: str
) -> tuple[Table, ...]:
    """Table of figures in the standards' terms, one row per figure and one column per model."""
    kinds: dict[tuple[str, str, str], dict[str, Figure]] = {}
    for figure in figures:
        what, standard, model = forms.read_figure_name(figure.name)
        if standard and model in names:
            kinds.setdefault((what, standard, figure.unit), {})[model] = figure
    rows = (
        (
            what.replace("_", " "),
            standard,
            *(_with_uncertainty(found[name]) if name in found else "" for name in names),
            unit,
        )
        for (what, standard, unit), found in kinds.items()
    )
    return _table_of(title, ("figure", "standard", *names, "unit"), rows)


def _with_uncertainty(figure: Figure) -> str:
    """Text of value ± standard uncertainty."""
    value = number(figure.value, {"1/deg": 8, "arcsec": 7}.get(figure.unit, 3))
    u = figure.standard_uncertainty
    if not u:
        return value
    return f"{value} ± {u:.0f}" if u >= 9.5 else f"{value} ± {u:.1g}"


def _tabulate_runs(
    gyros: Sequence[over_runs.GyroOverRuns], figures: Sequence[Figure]
) -> Iterator[Table]:
    """Tables of the figures over all runs of each gyro, then of the single runs."""
    for one in gyros:
        name = forms.line_name(one.gyro)
        yield from _tabulate_figures(figures, (name,), f"Figures of {name} over its runs")
        names = [f"{name}.{run.log.name}" for run in one.runs]
        for start in range(0, len(names), COLUMNS):
            yield from _tabulate_figures(
                figures, names[start : start + COLUMNS], "Figures of single runs"
            )


def _tabulate_biases(figures: Sequence[Figure]) -> tuple[Table, ...]:
    """Table of biases without the earth's rate; none where the latitude is unknown."""
    rows = (
        (
            figure.name.partition(".")[2],
            f"{figure.value:.4f}",
            f"{figure.standard_uncertainty:.1g}",
            figure.unit,
        )
        for figure in figures
        if figure.name.startswith("bias.")
    )
    return _table_of(
        "Bias without the earth's rate about the table axis",
        ("", "bias", "standard uncertainty", "unit"),
        rows,
    )


def _tabulate_pair(fitted: pair_fit.PairFit) -> Table:
    """Table of N, ε, γ, α, the orthogonality error and the second γ."""
    found, u = fitted.found, [f"{u:.1e}" for u in fitted.found.standard_uncertainty]
    low, high = found.alpha_interval_deg
    second = found.gamma_from_a
    rows = (
        ("N = K_B/K_A", f"{found.N:.9f}", u[0], "1"),
        ("epsilon = K_Ba/K_A", f"{found.epsilon:.9f}", u[1], "1"),
        ("gamma = epsilon/N", f"{found.gamma:.9f}", u[2], "1"),
        ("alpha = arccos gamma", f"{found.alpha_deg:.6f}", u[3], "deg"),
        ("alpha, 95 % interval", f"{low:.6f} to {high:.6f}", "", "deg"),
        ("orthogonality error 90° - alpha", f"{found.orthogonality_error_deg:.6f}", u[3], "deg"),
        ("gamma from A about B's axis", f"{second.value:.9f}", f"{second.u:.1e}", "1"),
    )
    return Table(
        f"Gyro B against gyro A: {found.side} side",
        ("", "value", "standard uncertainty", "unit"),
        rows,
    )


def _tabulate_triad(fitted: triad_fit.AxesFit) -> tuple[Table, ...]:
    """Tables of sensitivities, input axes and angles of every set of runs."""
    gyros = list(enumerate(fitted.gyros))

    def sensitivities(g: int, one: triad_fit.AxesSet) -> tuple[str, ...]:
        found = one.triad
        values = (*found.sensitivity[g], found.magnitude.value[g])
        return (*(f"{value:.4f}" for value in values), f"{found.magnitude.u[g]:.2g}")

    def directions(g: int, one: triad_fit.AxesSet) -> tuple[str, ...]:
        values = (f"{value:+.7f}" for value in one.triad.misalignment.value[g])
        return (*values, f"{np.max(one.triad.misalignment.u[g]):.1e}")

    def angles(pair: tuple[int, int], one: triad_fit.AxesSet) -> tuple[str, ...]:
        angle, u = (part[pair] for part in (one.triad.angles_deg.value, one.triad.angles_deg.u))
        return f"{angle:.6f}", f"{90.0 - angle:+.6f}", f"{u:.1e}"

    about = [f"about {axis} [1/deg]" for axis in forms.AXES]
    both = [((g, h), f"{fitted.gyros[g]} and {fitted.gyros[h]}") for g, h in fitted.pairs]
    return (
        *_table_of(
            "Sensitivity of each gyro about the axes of the base",
            ("gyro", "°C", *about, "|S| [1/deg]", "u(|S|)"),
            _rows_of_sets(fitted, gyros, sensitivities),
        ),
        *_table_of(
            "Misalignment matrix: unit vectors of the input axes",
            ("gyro", "°C", *forms.AXES, "largest u"),
            _rows_of_sets(fitted, gyros, directions),
        ),
        *_table_of(
            "Angles between input axes",
            ("gyros", "°C", "angle [°]", "90° - angle", "standard uncertainty"),
            _rows_of_sets(fitted, both, angles),
        ),
    )


def _rows_of_sets(
    fitted: triad_fit.AxesFit,
    things: Sequence[tuple[Any, str]],
    cells: Callable[[Any, triad_fit.AxesSet], tuple[str, ...]],
) -> Iterator[tuple[str, ...]]:
    """Table rows, one for each thing (index, name) and each set of runs."""
    for thing, name in things:
        for s, one in enumerate(fitted.sets):
            where = f"{one.temp_degc:.1f}" if np.isfinite(one.temp_degc) else ""
            yield (name if s == 0 else "", where, *cells(thing, one))


def summarize_rate_table(
    gyros: Sequence[over_runs.GyroOverRuns], scales: StageResult
) -> tuple[Table, ...]:
    """Tables of lines and curves, errors of the runs, figures over the runs and of single runs, and
    biases.
    """
    shared = list_components("Errors that held rates share", scales.models)
    return (
        _tabulate_lines(scales.models),
        *((shared,) if shared.rows else ()),
        *_tabulate_curves(scales.models),
        *_tabulate_runs(gyros, scales.figures),
        *_tabulate_biases(scales.figures),
    )


def summarize_pair(
    fitted: pair_fit.PairFit, scales: StageResult, gyros: Sequence[str]
) -> tuple[Table, ...]:
    """Tables of lines and curves, figures about the own axes, biases, and the angle."""
    own = [forms.line_name(gyro, gyro) for gyro in gyros]
    return (
        _tabulate_lines(scales.models),
        *_tabulate_curves(scales.models),
        *_tabulate_figures(scales.figures, own, "Figures of each gyro about its own axis"),
        *_tabulate_biases(scales.figures),
        _tabulate_pair(fitted),
    )


def summarize_triad(fitted: triad_fit.AxesFit, scales: StageResult) -> tuple[Table, ...]:
    """Tables of sensitivities, input axes and angles, biases, and curves."""
    return (
        *_tabulate_triad(fitted),
        *_tabulate_biases(scales.figures),
        *_tabulate_curves(scales.models),
    )
