"""Channels of a static instrument → bias.json: bias of each as a polynomial of any abscissa."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import chain, pairwise
from typing import Any

import numpy as np

from calibkit import units
from calibkit.arrays import Array
from calibkit.coefficients import (
    Component,
    Criterion,
    Model,
    Record,
    StageResult,
    at_most,
    over_stated_u,
)
from calibkit.errors import FitError
from calibkit.fit.shared import Shared
from calibkit.fit.solve import SharedSize
from calibkit.fit.unseen import unseen
from calibkit.forms import POLYNOMIAL, components_of, power_unit
from calibkit.frame import Log, values
from calibkit.instruments.bias_temperature import blocks as bias_blocks
from calibkit.instruments.bias_temperature.blocks import (
    COURSES,
    LEAST_LOGS,
    Blocks,
    between_logs,
    turn_on_bias,
)
from calibkit.instruments.bias_temperature.figures import BiasCurve
from calibkit.instruments.bias_temperature.overview import summarize_drifts
from calibkit.instruments.bias_temperature.quantities import reference_of
from calibkit.instruments.bias_temperature.recipe import (
    Bias,
    BiasAcceptance,
    BiasTemperatureRecipe,
    Polynomials,
)
from calibkit.numeric import chunks, dispersion, gum
from calibkit.numeric.chunks import mean, ranges_along
from calibkit.numeric.flicker import Turned
from calibkit.numeric.least_squares import fold, polynomial
from calibkit.numeric.least_squares.fit import rank
from calibkit.recipe.shared_errors import state_sizes, warn_of_few_levels
from calibkit.recipe.tables import Errors
from calibkit.recipe.type_b import RELATIVE, TypeB, combine_terms
from calibkit.report.summary import Summary, number
from calibkit.report.table import Table

BINS, POINTS = 200, 9

Allocate = Callable[[int], Array]


@dataclass(frozen=True, slots=True)
class _BiasFit:
    """One channel's polynomial: raw powers of the abscissa in its own unit, with their
    covariance.
    """

    indication: str
    abscissa: str
    coefficients: Array
    covariance: Array
    effective_dof: Array
    """[p], degrees of freedom of the standard uncertainties of the coefficients."""
    dof: int
    residual_rms: float
    over_noise: float
    """Residual rms over the noise within parts of the logs."""
    valid: tuple[float, float]
    curve: BiasCurve
    components: tuple[Component, ...]
    flags: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Rows:
    """Rows of all logs, one after the other."""

    abscissa: Array
    indication: Array
    bounds: tuple[tuple[int, int], ...]
    """First row of each log and row after its last."""
    allocate: Allocate


def fit(logs: Sequence[Log], spec: Polynomials, errors: Errors) -> list[_BiasFit]:
    """Fit each channel's polynomial by least squares on the abscissa mapped to [−1, 1], over the
    rows of all logs, each of which has a turn-on bias of its own.

    The covariance is that of white and flicker noise: the noise of a sensor that warms up is not
    white. Few cold rows leave few degrees of freedom.
    """
    allocate = next((log.allocate for log in logs if log.on_disk), np.empty)
    abscissa = _concatenate(logs, spec.abscissa, allocate)
    # the rows that are fitted: a file has more where some are excluded or lack a value
    ends = np.cumsum([0, *(len(log.frame) for log in logs)]).tolist()
    bounds = tuple(pairwise(ends))
    return [
        _fit_channel(
            entry,
            spec.abscissa,
            _Rows(abscissa, _concatenate(logs, entry.indication, allocate), bounds, allocate),
            errors,
        )
        for entry in spec.bias
    ]


def _concatenate(logs: Sequence[Log], column: str, allocate: Allocate) -> Array:
    """A column [n] of all logs, one after the other, in an array that `allocate` makes."""
    parts = [values(log.frame, column) for log in logs]
    if len(parts) == 1:
        return parts[0]
    whole = allocate(sum(part.size for part in parts))
    row = 0
    for part in parts:
        for start, stop in chunks.ranges_along(part):
            whole[row : row + stop - start] = part[start:stop]
            row += stop - start
            chunks.release(whole)
    return whole


def _fit_channel(entry: Bias, name: str, rows: _Rows, errors: Errors) -> _BiasFit:
    """One channel's polynomial over the abscissa of that name.

    Where logs have no error in common, as one log alone, the coefficients are those of ordinary
    least squares over all rows, which is how such polynomials are published; else those of
    generalised least squares over means of blocks.
    """
    unit, count = units.column_unit(entry.indication), entry.order + 1
    names = [f"p{k}" for k in range(count)]
    design, to_raw = polynomial.mapped_powers(rows.abscissa, entry.order)
    blocks = Blocks.of(design, rows.indication, rows.abscissa, rows.bounds)
    turned = Turned.of_logs(blocks.log, blocks.place, blocks.count)
    offered = [turn_on_bias(unit, blocks.log, turned.rows(np.ones(blocks.count.size)))]
    several = len(rows.bounds) > 1
    if several:
        offered += blocks.wander(turned, unit)
    stated = state_sizes(errors, offered)
    shared = stated if several else []
    if shared and shared[0].size is None:
        _require_levels_apart(shared[0], turned.rows(blocks.design), names)
    fitted = bias_blocks.fit(blocks, turned, unit, shared, names)
    coefficients, levels = fitted.parameters, np.zeros(len(rows.bounds))
    if shared:
        levels = fitted.mixed[0].errors[:, 0]
    else:
        coefficients = fold.linear(
            design, rows.indication, names=names, allocate=rows.allocate
        ).coefficients
        fitted = fitted.linear(_least_squares(blocks, turned), turned.rows(blocks.indication))
        fitted = fitted.widened_by([one for one in stated if one.size is not None])
    held = np.vander(np.linspace(*chunks.extremes(rows.abscissa), POINTS), count, increasing=True)
    along = np.vstack([np.eye(count), held]) @ np.asarray(to_raw, dtype=np.float64)
    covariance, dof = fitted.covariance, fitted.dof_along(along)
    wanders = any(size.error.effect in COURSES for size in fitted.mixed)
    if wanders and len(rows.bounds) >= LEAST_LOGS:
        covariance, dof = between_logs(fitted, turned.rows(blocks.design), blocks.log, along)
    raw, covariance = polynomial.in_raw_powers(coefficients, covariance, to_raw)
    dof[0] = dof[np.r_[0, count : dof.size]].min()  # p0 is in every value, itself beyond the logs
    shown, rms, over_noise = _bin_means(rows, levels, raw)
    sizes = fitted.mixed if several else _of_one_log(stated)
    return _BiasFit(
        entry.indication,
        name,
        raw,
        covariance,
        dof[:count],
        rows.indication.size - raw.size,
        rms,
        over_noise,
        chunks.extremes(rows.abscissa),
        BiasCurve(entry.indication, *shown, np.vander(shown[0], count, increasing=True) @ raw),
        components_of(sizes),
        tuple(f"{entry.indication}: {flag}" for flag in warn_of_few_levels(sizes)),
    )


def _least_squares(blocks: Blocks, turned: Turned) -> Array:
    """Matrix [p, m] by which ordinary least squares over the rows of all blocks makes coefficients
    of turned ones.
    """
    weighted = blocks.design * blocks.count[:, None]
    P = np.linalg.solve(weighted.T @ blocks.design, weighted.T)
    # P y = P (Uᵀ D^½)⁻¹ · turned y, log by log
    return np.hstack([np.linalg.solve(turn.T, P[:, rows].T).T for rows, turn in turned.parts])


def _of_one_log(stated: Sequence[Shared]) -> list[SharedSize]:
    """The turn-on bias of one log, whose rows show nothing of it, as large as it is stated."""
    return [SharedSize(one, one.size or 0.0, 0.0, 0, np.zeros((1, 1))) for one in stated]


def _require_levels_apart(error: Shared, design: Array, names: Sequence[str]) -> None:
    """Refuse turn-on biases that rows of a design [m, p] do not separate from its coefficients."""
    own = error.design(np.arange(len(design)))
    if rank(np.hstack([design, own])) == len(names):
        raise FitError(
            f"the {error.effect} of each {error.group} cannot be told from {', '.join(names)}:"
            f" {error.levels} of them, each at one value of the abscissa, expected more"
            f" than {len(names)}, or changes of the abscissa within each",
            hint="measure more of them, lower the order, or state how much the"
            f" {error.effect} differs in [[errors.component]]",
        )


def result(fits: Sequence[_BiasFit], flags: Sequence[str]) -> StageResult:
    """bias.json: one polynomial/1 model per channel, coefficients ascending, p<k> multiplies the
    k-th power.
    """
    return StageResult("bias", models=tuple(map(_model, fits)), flags=tuple(flags))


def _model(found: _BiasFit) -> Model:
    """polynomial/1 model of one channel."""
    unit, per = units.column_unit(found.indication), units.column_unit(found.abscissa)
    return POLYNOMIAL.write(
        found.indication,
        [
            (f"p{k}", value, power_unit(unit, per, k))
            for k, value in enumerate(found.coefficients.tolist())
        ],
        found.covariance,
        dof=found.dof,
        effective_dof=found.effective_dof,
        residual_rms=found.residual_rms,
        residual_unit=unit,
        valid={found.abscissa: found.valid},
        components=found.components,
    )


def _judge_noise(name: str, over_noise: float, limits: BiasAcceptance) -> tuple[Criterion, ...]:
    """Criterion that a channel's residuals are as small as its noise, where the recipe limits
    them.
    """
    limit = limits.max_residual_over_noise
    return (
        () if limit is None else (at_most(f"{name}: residual over noise", over_noise, limit, "1"),)
    )


def summary(
    spec: BiasTemperatureRecipe,
    fits: Sequence[_BiasFit],
    flags: Sequence[str],
    tables: Sequence[Table],
) -> Summary:
    """Summary of a fit with the tables of its results."""
    judged = (_judge_noise(one.indication, one.over_noise, spec.acceptance) for one in fits)
    first = summarize_drifts([(one.curve, one.residual_rms, one.over_noise) for one in fits])
    limits = tuple(chain.from_iterable(judged))
    return Summary(spec.title, tuple(tables), tuple(flags), limits, overview=first)


def compensate(
    log: Log, record: Record, spec: BiasTemperatureRecipe
) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Channels [rows] without their drift, which is zero at the reference; clamped to the fitted
    range and flagged.

    The reference is the recipe's temperature where the abscissa is a temperature in °C, else the
    middle of the range.
    """
    columns, flags = {}, []
    for entry in spec.polynomials.bias:
        model = record.model(entry.indication)
        abscissa = spec.polynomials.abscissa
        low, high = model.valid[abscissa]
        reference = reference_of(model, spec.reference_temp_degc)
        x, y, outside = values(log.frame, abscissa), values(log.frame, entry.indication), 0
        zero = POLYNOMIAL.evaluate(model, {abscissa: np.array([reference])})
        columns[entry.indication] = made = log.allocate(x.size)
        for a, b in chunks.ranges_along(x, y, made):
            bias = POLYNOMIAL.evaluate(model, {abscissa: np.clip(x[a:b], low, high)})
            made[a:b] = y[a:b] - (bias - zero)
            outside += int(np.count_nonzero((x[a:b] < low) | (x[a:b] > high)))
        if outside:
            share = 100.0 * outside / x.size
            flags.append(
                f"{log.file}: {abscissa} clamped to {low:g} … {high:g} over {share:.1f} % of the"
                " rows"
            )
    return columns, tuple(dict.fromkeys(flags))


def validation_entry(log: Log, record: Record, spec: BiasTemperatureRecipe) -> dict[str, Any]:
    """JSON object of one validated log: standard deviation of every channel before and after."""
    columns, flags = compensate(log, record, spec)
    return {
        "name": log.file,
        "sha256": log.sha256,
        "rows": log.rows,
        "channels": [
            {
                "name": name,
                "unit": units.column_unit(name),
                "before": _standard_deviation(values(log.frame, name)),
                "after": _standard_deviation(output),
                "residual_over_noise": dispersion.over_noise(
                    _standard_deviation(output),
                    (
                        dispersion.variances_within(output[a:b], output[a:b])
                        for a, b in ranges_along(output)
                    ),
                ),
                **_judge_drift(record.model(name), log, spec),
            }
            for name, output in columns.items()
        ],
        "flags": list(flags),
    }


def validation_summary(entries: Sequence[dict[str, Any]], spec: BiasTemperatureRecipe) -> Summary:
    """Summary of a validation."""
    rows = tuple(
        (entry["name"], c["name"], number(c["before"]), number(c["after"]), c["unit"])
        for entry in entries
        for c in entry["channels"]
    )
    judged = over_stated_u(
        (f"{entry['name']} {c['name']}: drift", c) for entry in entries for c in entry["channels"]
    )
    limited = (
        _judge_noise(f"{entry['name']} {c['name']}", c["residual_over_noise"], spec.acceptance)
        for entry in entries
        for c in entry["channels"]
    )
    return Summary(
        "",
        (Table("Standard deviation", ("log", "channel", "before", "after", "unit"), rows),),
        tuple(flag for entry in entries for flag in entry["flags"]),
        (*judged, *chain.from_iterable(limited)),
    )


def _judge_drift(model: Model, log: Log, spec: BiasTemperatureRecipe) -> dict[str, float]:
    """How the polynomial of an unseen log differs from the frozen one, over its uncertainty: every
    power but the level, which a turn-on changes. Empty where nothing drifts.
    """
    abscissa = spec.polynomials.abscissa
    x, order = values(log.frame, abscissa), len(model.coefficients) - 1
    low, high = chunks.extremes(x)
    if order == 0 or low == high:
        return {}
    of_model = Bias(indication=model.name, order=order)
    rows = _Rows(x, values(log.frame, model.name), ((0, x.size),), log.allocate)
    own = _fit_channel(of_model, abscissa, rows, Errors())
    # the rows that it corrects, about their mean: of all powers but the level, which cancels
    powers = np.vander(np.linspace(low, high, BINS), order + 1, increasing=True)[:, 1:]
    along = powers - powers.mean(axis=0)
    both = own.covariance + np.array(model.covariance) + _type_b(model, abscissa, spec.type_b)
    judged = unseen(
        along @ (own.coefficients - POLYNOMIAL.read(model))[1:],
        along @ gum.square_root(both[1:, 1:]),
        dof=(max(1.0, min(map(model.dof_of, model.coefficients[1:]))), np.inf),
    )
    return judged.to_object()


def _type_b(model: Model, abscissa: str, terms: Sequence[TypeB]) -> Array:
    """Covariance [p, p] of the coefficients by type B terms: on the abscissa, which shifts the
    polynomial, on the indication or on single coefficients.
    """
    p = POLYNOMIAL.read(model)
    slopes = np.append(p[1:] * np.arange(1, p.size), 0.0)
    errors = []
    for term in terms:
        if term.quantity == abscissa:
            errors.append(slopes * term.u_of(0.0))
        elif term.quantity == model.name:
            scale = term.u_of(1.0) if term.unit in RELATIVE else 0.0
            errors.append(p * scale)
        else:
            errors.append(
                np.array(
                    [
                        combine_terms((term,), (f"{model.name}.{c.name}", c.name), c.value, c.unit)
                        for c in model.coefficients
                    ]
                )
            )
    return np.einsum("ti,tj->ij", errors, errors) if errors else np.zeros((p.size, p.size))


def _bin_means(rows: _Rows, level: Array, raw: Array) -> tuple[tuple[Array, Array], float, float]:
    """Means of abscissa and indication [bins] over equal steps of the abscissa, empty steps left
    out, rms of the residuals, and the same over their noise; of indications less the level of
    their log.
    """
    edges = np.linspace(*chunks.extremes(rows.abscissa), BINS + 1)
    count, sums, square = np.zeros(BINS, dtype=np.int64), np.zeros((2, BINS)), 0.0
    within = []
    for (first, end), shift in zip(rows.bounds, level, strict=True):
        x_of, y_of = rows.abscissa[first:end], rows.indication[first:end]
        for start, stop in chunks.ranges_along(x_of, y_of):
            x, y = x_of[start:stop], y_of[start:stop] - shift
            index = np.clip(np.digitize(x, edges) - 1, 0, BINS - 1)
            count += np.bincount(index, minlength=BINS)
            sums += [np.bincount(index, weights=values, minlength=BINS) for values in (x, y)]
            residual = y - np.polynomial.polynomial.polyval(x, raw)
            square += float(np.sum(residual**2))
            within.append(dispersion.variances_within(residual, y))
    full = count > 0
    means = sums[0][full] / count[full], sums[1][full] / count[full]
    rms = float(np.sqrt(square / rows.indication.size))
    return means, rms, dispersion.over_noise(rms, within)


def _standard_deviation(values: Array) -> float:
    """Standard deviation of values [n] about their mean (divided by n)."""
    centre = mean(values)
    square = sum(float(np.sum((values[a:b] - centre) ** 2)) for a, b in ranges_along(values))
    return float(np.sqrt(square / values.size))
