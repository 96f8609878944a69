"""Bias of the channels of a static instrument as a polynomial of any abscissa T: logs → bias.json.

    y = Σ_k p_k T^k + b_log + w_log(t) + flicker + white                             (1)

b_log is the turn-on bias of a log, w_log its wander with time (`blocks`). A turn-on bias is new in
every log, so that the degrees of freedom of p0 are those of the logs, never those of their rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit import check as checks, units
from calibkit.certificate.fit_tables import tabulate_fit
from calibkit.certificate.results import ListTable
from calibkit.check import copies
from calibkit.errors import FitError
from calibkit.fit.solve import SharedSize
from calibkit.fit.unseen import unseen
from calibkit.instruments import Fitted, Progress
from calibkit.instruments.bias import certificate, figures, sensitivities, tables
from calibkit.instruments.bias.blocks import (
    COURSES,
    LEAST_LOGS,
    BiasBlocks,
    between_logs,
    fit_blocks,
    turn_on_bias,
)
from calibkit.instruments.bias.figures import BiasCurve
from calibkit.instruments.bias.forms import POLYNOMIALS
from calibkit.instruments.bias.quantities import FittedBias
from calibkit.instruments.bias.recipe import Bias, BiasTemperatureRecipe, Polynomials
from calibkit.logs import log_files, write_back
from calibkit.numeric import chunks, dispersion, gum
from calibkit.numeric.arrays import Array
from calibkit.numeric.flicker import Turned
from calibkit.numeric.least_squares import polynomial
from calibkit.numeric.least_squares.fit import linear_in_blocks, rank
from calibkit.recipe.shared_errors import state_sizes, warn_of_few_levels
from calibkit.recipe.tables import Errors
from calibkit.recipe.type_b import RELATIVE, combine_terms
from calibkit.records.coefficients import Input, Model, Record, StageResult, at_most
from calibkit.records.forms import POLYNOMIAL, components_of, power_unit
from calibkit.records.frame import Examined, Finding, Log, refuse, values
from calibkit.report.overview import KeyValue, Overview
from calibkit.report.summary import Summary
from calibkit.units import unit_mark

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping
    from pathlib import Path

    from calibkit.certificate.results import Block
    from calibkit.certificate.stated import Stated
    from calibkit.logs.evidence import Evidence
    from calibkit.logs.recipe_text import RecipeChoice
    from calibkit.logs.write_back import Applied
    from calibkit.report.table import Table


Recipe = BiasTemperatureRecipe
KEY_FIGURES = (r"bias\..+(\.p\d|\.residual_rms| at \S+ degC)",)
FORMS = (POLYNOMIAL,)


def read(spec: BiasTemperatureRecipe, data: Path, file: str) -> Log:
    """One log in the recipe's columns; time is read where the log has it."""
    return log_files.read_log(
        spec, data / file, file, tuple(dict.fromkeys(spec.own_columns())), ("time_s",)
    )


@checks.in_stages
def _find_faults(spec: BiasTemperatureRecipe, log: Log) -> Iterator[list[Finding]]:
    """Yield what is wrong with a log."""
    table, timed = spec.polynomials, "time_s" in log.frame.columns
    yield checks.find_unusable(log, table.min_rows)
    findings = checks.find_gaps(log, table.max_gap_s) if timed else []
    yield [*findings, *checks.find_constant_columns(log, [table.abscissa])]
    findings = []
    for channel in spec.still_columns():
        findings += checks.series.check_indication(log, channel, units.column_unit(channel))
    if timed and units.column_unit(table.abscissa) == "degC":
        findings += checks.thermometers.check_steps(log, table.abscissa)
        findings += checks.thermometers.find_lost_sign(log, table.abscissa)
    yield [*findings, *checks.magnitude.find_compensated_names(log, spec, spec.still_columns())]


def faults(spec: BiasTemperatureRecipe, log: Log) -> Examined:
    """Find what is wrong with one log."""
    return Examined(tuple(_find_faults(spec, log)))


def fit(
    spec: BiasTemperatureRecipe, data: Path, files: Sequence[str], progress: Progress
) -> Fitted[figures.BiasReport]:
    """Fit every polynomial to the rows of all logs together."""
    logs, flags = [], []
    for log in copies.refuse_copies(
        log_files.read_ahead(progress(files, "reading"), lambda file: read(spec, data, file))
    ):
        findings = _find_faults(spec, log)
        refuse(findings)
        logs.append(log)
        flags += [f"{log.file}: {note}" for note in log.notes]
        flags += [str(finding) for finding in findings if finding.flagged]
    channels = fit_channels(logs, spec.polynomials, spec.errors)
    flags += [flag for channel in channels for flag in channel.flags]
    # one polynomial/1 model per channel, coefficients ascending: p<k> multiplies the k-th power
    models = tuple(channel.model for channel in channels)
    stage = StageResult("bias", models=models, flags=tuple(flags))
    influences = sensitivities.find(stage)
    result_tables = tabulate_fit([stage], spec, influences, _list_coefficients)
    return Fitted(
        (stage,),
        tuple(Input.of(log) for log in logs),
        summarize(spec, channels, flags, result_tables),
        figures.BiasReport(spec.polynomials.abscissa, tuple(channel.curve for channel in channels)),
        sensitivities=influences,
    )


def _list_coefficients(basis: Stated) -> tuple[Block, ...]:
    """Blocks of the certificate without biases over temperature, which the figure shows: the page
    of one of many small devices stays small.
    """
    return tuple(
        replace(
            block, tables=tuple(table for table in block.tables if isinstance(table, ListTable))
        )
        for block in certificate.blocks(basis)
    )


def correct(spec: BiasTemperatureRecipe, records: Mapping[str, Record], data: Path) -> Applied:
    """Take each channel's polynomial, zero at the reference, out of every row."""
    log = read(spec, data.parent, data.name)
    refuse(_find_faults(spec, log))
    columns, flags = compensate(log, records[POLYNOMIALS], spec)
    added = {}
    for name, corrected in columns.items() if spec.output.drift else ():
        stem, unit = name.rsplit("_", 1)
        added[f"{stem}_drift_{unit}"] = values(log.frame, name) - corrected
    return write_back.rewrite_log(spec, data, log, columns, added), flags


def validate(
    spec: BiasTemperatureRecipe, records: Mapping[str, Record], logs: Iterable[Log]
) -> tuple[dict[str, Any], Summary]:
    """Standard deviation of each channel before and after, of logs that were not fitted."""
    entries = []
    for log in logs:
        refuse(_find_faults(spec, log))
        entries.append(validation_entry(log, records[POLYNOMIALS], spec))
    limit = spec.acceptance.max_residual_over_noise
    return {"logs": entries}, tables.validation_summary(
        entries, "Standard deviation", "drift", max_residual_over_noise=limit
    )


def propose(evidence: Evidence) -> RecipeChoice | None:
    """Recipe for a static instrument with times and one temperature: all that it measures."""

    def keys_of(channels: Sequence[str]) -> dict[str, str]:
        polynomial_entries = ", ".join(
            f'{{ indication = "{name}", order = 3 }}' for name in channels
        )
        return {} if list(channels) == ["gyro_dph"] else {"bias": f"[{polynomial_entries}]"}

    return evidence.choose_at_rest("bias_temperature", keys_of)


BINS = 200
"""Equal steps of the abscissa of which the figure and its table show means, and at which the
polynomial of an unseen log is compared with the frozen one.
"""
POINTS = 9
"""Abscissae at which the degrees of freedom of the bias are found, for those of p0."""

Rows = Sequence[tuple[Array, Array]]
"""Abscissa and indication [n] of each log."""


@dataclass(frozen=True, slots=True)
class ChannelFit:
    """Polynomial of one channel in raw powers of the abscissa."""

    model: Model
    over_noise: float
    """Residual rms over the noise within parts of the logs."""
    curve: BiasCurve
    flags: tuple[str, ...]


def fit_channels(logs: Sequence[Log], spec: Polynomials, errors: Errors) -> list[ChannelFit]:
    """Fit each channel's polynomial by least squares on the abscissa mapped to [−1, 1], over the
    rows of all logs, each of which has a turn-on bias of its own.

    The covariance is that of white and flicker noise: the noise of a sensor that warms up is not
    white. Few cold rows leave few degrees of freedom.
    """
    channels = []
    for entry in spec.bias:
        columns = spec.abscissa, entry.indication
        rows = [(values(log.frame, columns[0]), values(log.frame, columns[1])) for log in logs]
        channels.append(_fit_channel(entry, spec.abscissa, rows, errors))
    return channels


def _fit_channel(entry: Bias, abscissa: str, rows: Rows, errors: Errors) -> ChannelFit:
    """One channel's polynomial over the abscissa of that name.

    Where logs have no error in common, as one log alone, the coefficients are those of ordinary
    least squares over all rows, which is how such polynomials are published; else those of
    generalised least squares over means of blocks.
    """
    unit, count = units.column_unit(entry.indication), entry.order + 1
    names = [f"p{k}" for k in range(count)]
    low, high = zip(*(chunks.extremes(x) for x, _ in rows), strict=True)
    valid = min(low), max(high)
    designs = [polynomial.mapped_powers(x, entry.order, valid) for x, _ in rows]
    to_raw = designs[0][1]
    blocks = BiasBlocks.of([design for design, _ in designs], rows, valid)
    rotation = Turned.of_logs(blocks.log, blocks.place, blocks.count)
    log_errors = [turn_on_bias(unit, blocks.log, rotation.rows(np.ones(blocks.count.size)))]
    many_logs = len(rows) > 1
    if many_logs:
        log_errors += blocks.wander(rotation, unit)
    sized_errors = state_sizes(errors, log_errors)
    shared = sized_errors if many_logs else []
    if shared and shared[0].size is None:
        error, design = shared[0], rotation.rows(blocks.design)
        if rank(np.hstack([design, error.design(np.arange(len(design)))])) == count:
            raise FitError(
                f"the {error.effect} of each {error.group} cannot be separated from"
                f" {', '.join(names)}: {error.levels} of them, each at one value of the abscissa,"
                f" expected more than {count}, or changes of the abscissa within each",
                hint="measure more of them, lower the order, or state how much the"
                f" {error.effect} differs in [[errors.component]]",
            )
    estimate = fit_blocks(blocks, rotation, unit, shared, names)
    coefficients, turn_on, sizes = estimate.parameters, np.zeros(len(rows)), estimate.mixed
    if shared:
        turn_on = estimate.mixed[0].errors[:, 0]
    else:
        # one log: ordinary least squares over all rows, as such polynomials are published
        coefficients = linear_in_blocks(designs[0][0], rows[0][1], names=names)
        # ordinary least squares over all rows makes coefficients P y of the means y of blocks; of
        # turned ones it makes P (Uᵀ D^½)⁻¹ · turned y, log by log
        weighted = blocks.design * blocks.count[:, None]
        P = np.linalg.solve(weighted.T @ blocks.design, weighted.T)
        of_turned = [np.linalg.solve(turn.T, P[:, part].T).T for part, turn in rotation.parts]
        estimate = estimate.linear(np.hstack(of_turned), rotation.rows(blocks.indication))
        estimate = estimate.widened_by([error for error in sized_errors if error.size is not None])
    if not many_logs:  # the rows of one log show nothing of its turn-on bias: it is as stated
        sizes = tuple(SharedSize(e, e.size or 0.0, 0.0, 0, np.zeros((1, 1))) for e in sized_errors)
    # degrees of freedom of p0 are the least of any bias in the range, not those at 0 °C
    powers = np.vander(np.linspace(*valid, POINTS), count, increasing=True)
    combinations = np.vstack([np.eye(count), powers]) @ np.asarray(to_raw, dtype=np.float64)
    covariance, dof = estimate.covariance, estimate.dof_along(combinations)
    wanders = any(size.error.effect in COURSES for size in estimate.mixed)
    if wanders and len(rows) >= LEAST_LOGS:
        covariance, dof = between_logs(
            estimate, rotation.rows(blocks.design), blocks.log, combinations
        )
    raw, covariance = polynomial.in_raw_powers(coefficients, covariance, to_raw)
    dof[0] = dof[np.r_[0, count : dof.size]].min()  # p0 is in every value, itself beyond the logs
    means, residual_rms, over_noise = _bin_means(rows, valid, turn_on, raw)
    per = units.column_unit(abscissa)
    model = POLYNOMIAL.write(
        entry.indication,
        [(f"p{k}", p, power_unit(unit, per, k)) for k, p in enumerate(raw.tolist())],
        covariance,
        dof=sum(y.size for _, y in rows) - raw.size,
        effective_dof=dof[:count],
        residual_rms=residual_rms,
        residual_unit=unit,
        valid={abscissa: valid},
        components=components_of(sizes),
    )
    fitted = np.vander(means[0], count, increasing=True) @ raw
    return ChannelFit(
        model,
        over_noise,
        BiasCurve(entry.indication, *means, fitted),
        tuple(type(flag)(f"{entry.indication}: {flag}") for flag in warn_of_few_levels(sizes)),
    )


def summarize(
    spec: BiasTemperatureRecipe,
    channels: Sequence[ChannelFit],
    flags: Sequence[str],
    tables: Sequence[Table],
) -> Summary:
    """Summary of a fit with the tables of its results; on the first screen how far each channel
    drifts, and what is left.
    """
    drifts, key_values, limits = [], [], []
    for channel in channels:
        name, left = channel.model.name, channel.model.residual_rms
        unit, drift = unit_mark(units.column_unit(name)), float(np.ptp(channel.curve.polynomial))
        drifts.append(
            f"{name} drifts by {drift:.3g} {unit} over its range; {left:.3g} {unit} (rms) is"
            f" left, {channel.over_noise:.3g} times the noise."
        )
        key_values += [
            KeyValue(f"drift of {name}", drift, unit),
            KeyValue(f"residual rms of {name}", left, unit),
        ]
        limit = spec.acceptance.max_residual_over_noise
        if limit is not None:
            limits.append(at_most(f"{name}: residual over noise", channel.over_noise, limit, "1"))
    first_screen = Overview(drifts[0], tuple(drifts[1:]), tuple(key_values[:4]))
    return Summary(spec.title, tuple(tables), tuple(flags), tuple(limits), overview=first_screen)


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
        reference = FittedBias(model, spec.reference_temp_degc).reference
        x, y = values(log.frame, abscissa), values(log.frame, entry.indication)
        zero = POLYNOMIAL.evaluate(model, {abscissa: np.array([reference])})
        bias = POLYNOMIAL.evaluate(model, {abscissa: np.clip(x, low, high)})
        columns[entry.indication] = y - (bias - zero)
        # a cubic runs away beyond its rows: the bias at the end of the range is used
        share = 100.0 * float(np.mean((x < low) | (x > high)))
        if share:
            flags.append(
                f"{log.file}: {abscissa} clamped to {low:g} … {high:g} over {share:.1f} % of the"
                " rows"
            )
    return columns, tuple(dict.fromkeys(flags))


def validation_entry(log: Log, record: Record, spec: BiasTemperatureRecipe) -> dict[str, Any]:
    """JSON object of one validated log: standard deviation of every channel before and after."""
    columns, flags = compensate(log, record, spec)
    channels = []
    for name, output in columns.items():
        after, variances = float(np.std(output)), dispersion.variances_within(output, output)
        channels.append(
            {
                "name": name,
                "unit": units.column_unit(name),
                "before": float(np.std(values(log.frame, name))),
                "after": after,
                "residual_over_noise": dispersion.over_noise(after, [variances]),
                **_judge_drift(record.model(name), log, spec),
            }
        )
    return {
        "name": log.file,
        "sha256": log.sha256,
        "rows": log.rows,
        "channels": channels,
        "flags": list(flags),
    }


def _judge_drift(model: Model, log: Log, spec: BiasTemperatureRecipe) -> dict[str, float]:
    """How the polynomial of an unseen log differs from the frozen one, over its uncertainty: every
    power but the level, which a turn-on changes. Empty where nothing drifts.
    """
    abscissa = spec.polynomials.abscissa
    x, order = values(log.frame, abscissa), len(model.coefficients) - 1
    low, high = chunks.extremes(x)
    if order == 0 or low == high:
        return {}
    entry, rows = Bias(indication=model.name, order=order), [(x, values(log.frame, model.name))]
    of_log = _fit_channel(entry, abscissa, rows, Errors()).model
    # the rows that it corrects, about their mean: of all powers but the level, which cancels
    powers = np.vander(np.linspace(low, high, BINS), order + 1, increasing=True)[:, 1:]
    centred_powers = powers - powers.mean(axis=0)
    covariance = np.array(of_log.covariance) + np.array(model.covariance)
    # type B terms: on the abscissa, which shifts the polynomial, on the indication or on single
    # coefficients
    p = POLYNOMIAL.read(model)
    # p(x + e) = p(x) + e p'(x): an offset of the abscissa moves the coefficients by those of p'
    slopes = np.append(p[1:] * np.arange(1, p.size), 0.0)
    errors = [np.zeros(p.size)]
    for term in spec.type_b:
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
    covariance += np.einsum("ti,tj->ij", errors, errors)
    comparison = unseen(
        centred_powers @ (POLYNOMIAL.read(of_log) - p)[1:],
        centred_powers @ gum.square_root(covariance[1:, 1:]),
        dof=(max(1.0, min(map(model.dof_of, model.coefficients[1:]))), np.inf),
    )
    return comparison.to_object()


def _bin_means(
    rows: Rows, valid: tuple[float, float], level: Array, raw: Array
) -> tuple[tuple[Array, Array], float, float]:
    """Means of abscissa and indication [bins] over equal steps of the abscissa, empty steps left
    out, rms of the residuals, and the same over their noise; of indications less the level of
    their log.
    """
    x = np.concatenate([abscissa for abscissa, _ in rows])
    levelled = [indication - shift for (_, indication), shift in zip(rows, level, strict=True)]
    y = np.concatenate(levelled)
    step = np.clip(np.digitize(x, np.linspace(*valid, BINS + 1)) - 1, 0, BINS - 1)
    count = np.bincount(step, minlength=BINS)
    full = count > 0
    x_mean, y_mean = (np.bincount(step, of_rows, BINS)[full] / count[full] for of_rows in (x, y))
    residuals = [
        indication - np.polynomial.polynomial.polyval(abscissa, raw)
        for (abscissa, _), indication in zip(rows, levelled, strict=True)
    ]
    scatter = dispersion.rms(np.concatenate(residuals))
    variances = map(dispersion.variances_within, residuals, levelled)
    return (x_mean, y_mean), scatter, dispersion.over_noise(scatter, variances)
