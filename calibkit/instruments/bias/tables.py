"""Tables, first screen and criteria of terms over temperature: of a fit and of a validation."""

from collections.abc import Mapping, Sequence
from typing import Any

from calibkit.certificate.words import unit_mark
from calibkit.coefficients import Criterion, at_least, at_most, over_stated_u
from calibkit.instruments.bias.channels import FittedChannel
from calibkit.instruments.bias.recipe import ThermalRecipe
from calibkit.report.overview import KeyValue, Overview
from calibkit.report.summary import Summary, number
from calibkit.report.table import Table


def fit_summary(
    spec: ThermalRecipe, channels: Sequence[FittedChannel], flags: Sequence[str]
) -> Summary:
    """Summary of a fit: the chosen terms of each channel, the errors of all candidates on left-out
    stretches, and what is left of withheld ones.
    """
    models, withheld, drifts, values = [], [], [], []
    criteria: list[Criterion] = []
    errors: dict[str, list[str]] = {}
    limits = spec.acceptance
    for k, channel in enumerate(channels):
        factor, unit = (1e6, "µg") if channel.unit == "g" else (1.0, unit_mark(channel.unit))
        before, after = factor * channel.before, factor * channel.after
        chosen_errors, model = channel.choice.chosen_errors, channel.choice.model
        models.append(
            (
                channel.name,
                chosen_errors.name,
                ", ".join(f"{lag:.0f}" for lag in model.lags),
                number(before),
                number(after),
                number(factor * model.model_error, 2),
                unit,
            )
        )
        for tested in channel.choice.tested:
            row = errors.setdefault(tested.name, [""] * len(channels))
            row[k] = f"{number(tested.pooled, 3)}{' *' if tested is chosen_errors else ''}"
        terms = chosen_errors.name if channel.varies else "no drift term needed"
        drifts.append(
            f"{channel.name}: drift in a power-on (rms) {before:.3g} {unit} before,"
            f" {after:.3g} {unit} after ({terms})."
        )
        values.append(KeyValue(f"drift of {channel.name}, after", after, unit))
        if channel.withheld is not None:
            cells = (number(rms) for rms in channel.withheld)
            withheld.append((channel.name, *cells, channel.unit))
        if limits.min_reduction is not None and channel.varies:
            name = f"{channel.name}: reduction on left-out stretches"
            reduction = channel.choice.constant.pooled / chosen_errors.pooled
            criteria.append(at_least(name, reduction, limits.min_reduction, "1"))
        if limits.max_residual_over_noise is not None:
            name, limit = f"{channel.name}: residual over noise", limits.max_residual_over_noise
            criteria.append(at_most(name, channel.over_noise, limit, "1"))
    chosen_terms = Table(
        "Bias of each channel: chosen terms, rms of the intervals about the turn-on biases",
        ("channel", "terms", "lags [s]", "before", "after", "model error", "unit"),
        tuple(models),
    )
    left_out = Table(
        "Errors on stretches left out in turn (100 s means, rms); * chosen: the simplest model"
        " within the noise of the best",
        ("terms", *(f"{channel.name} [{channel.unit}]" for channel in channels)),
        tuple((name, *cells) for name, cells in errors.items()),
    )
    tables = [chosen_terms, left_out]
    if withheld:
        title = "Withheld stretches: rms about the turn-on biases of the fitted ones"
        tables.append(Table(title, ("channel", "before", "after", "unit"), tuple(withheld)))
    first_screen = Overview(drifts[0], tuple(drifts[1:]), tuple(values[:4]), chosen_terms)
    return Summary(spec.title, tuple(tables), tuple(flags), tuple(criteria), overview=first_screen)


def validation_summary(
    entries: Sequence[Mapping[str, Any]],
    title: str,
    error_name: str,
    *,
    min_reduction: float | None = None,
    max_residual_over_noise: float | None = None,
) -> Summary:
    """Summary of a validation: each channel before and after, the error that its uncertainty is
    compared with, by its name, and criteria of the limits that are stated.
    """
    rows: list[tuple[str, ...]] = []
    errors, criteria = [], []
    for entry in entries:
        for channel in entry["channels"]:
            name = f"{entry['name']} {channel['name']}"
            cells = [number(channel["before"]), number(channel["after"]), channel["unit"]]
            if "share_within_expanded_uncertainty" in channel:
                cells.append(f"{channel['share_within_expanded_uncertainty']:.0%}")
            rows.append((entry["name"], channel["name"], *cells))
            errors.append((f"{name}: {error_name}", channel))
            if min_reduction is not None and channel["reduction"] is not None:
                criterion_name, ratio = f"{name}: reduction", channel["reduction"]
                criteria.append(at_least(criterion_name, ratio, min_reduction, "1"))
            if max_residual_over_noise is not None:
                criterion_name, ratio = (
                    f"{name}: residual over noise",
                    channel["residual_over_noise"],
                )
                criteria.append(at_most(criterion_name, ratio, max_residual_over_noise, "1"))
    heads = ("log", "channel", "before", "after", "unit", "within")
    width = max(map(len, rows), default=5)
    filled = tuple((*row, *[""] * (width - len(row))) for row in rows)
    table = Table(title, heads[:width], filled)
    flags = tuple(dict.fromkeys(flag for entry in entries for flag in entry["flags"]))
    return Summary("", (table,), flags, (*over_stated_u(errors), *criteria))
