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
    limits = spec.acceptance
    for channel in channels:
        factor, unit = (1e6, "µg") if channel.unit == "g" else (1.0, unit_mark(channel.unit))
        before, after = factor * channel.before, factor * channel.after
        chosen, model = channel.choice.chosen, channel.choice.model
        models.append(
            (
                channel.name,
                chosen.name,
                ", ".join(f"{lag:.0f}" for lag in model.lags),
                number(before),
                number(after),
                number(factor * model.model_error, 2),
                unit,
            )
        )
        terms = chosen.name if channel.varies else "no drift term needed"
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
            reduction = channel.choice.constant.pooled / chosen.pooled
            criteria.append(at_least(name, reduction, limits.min_reduction, "1"))
        if limits.max_residual_over_noise is not None:
            name, limit = f"{channel.name}: residual over noise", limits.max_residual_over_noise
            criteria.append(at_most(name, channel.over_noise, limit, "1"))
    chosen_terms = Table(
        "Bias of each channel: chosen terms, rms of the intervals about the turn-on biases",
        ("channel", "terms", "lags [s]", "before", "after", "model error", "unit"),
        tuple(models),
    )
    tables = [chosen_terms, _tabulate_left_out(channels)]
    if withheld:
        title = "Withheld stretches: rms about the turn-on biases of the fitted ones"
        tables.append(Table(title, ("channel", "before", "after", "unit"), tuple(withheld)))
    first_screen = Overview(drifts[0], tuple(drifts[1:]), tuple(values[:4]), chosen_terms)
    return Summary(spec.title, tuple(tables), tuple(flags), tuple(criteria), overview=first_screen)


def _tabulate_left_out(channels: Sequence[FittedChannel]) -> Table:
    """Errors of all candidates on left-out stretches, one column per channel."""
    rows: dict[str, list[str]] = {}
    for k, channel in enumerate(channels):
        for tested in channel.choice.tested:
            row = rows.setdefault(tested.name, [""] * len(channels))
            chosen = " *" if tested is channel.choice.chosen else ""
            row[k] = f"{number(tested.pooled, 3)}{chosen}"
    return Table(
        "Errors on stretches left out in turn (100 s means, rms); * chosen: the simplest model"
        " within the noise of the best",
        ("terms", *(f"{channel.name} [{channel.unit}]" for channel in channels)),
        tuple((name, *cells) for name, cells in rows.items()),
    )


def validation_summary(entries: Sequence[Mapping[str, Any]], spec: ThermalRecipe) -> Summary:
    """Summary of a validation."""
    least = spec.acceptance.min_reduction
    rows, errors = [], []
    reductions: list[Criterion] = []
    for entry in entries:
        for channel in entry["channels"]:
            name = f"{entry['name']} {channel['name']}"
            share = channel.get("share_within_expanded_uncertainty")
            within = "" if share is None else f"{share:.0%}"
            sizes = number(channel["before"]), number(channel["after"])
            rows.append((entry["name"], channel["name"], *sizes, channel["unit"], within))
            errors.append((f"{name}: rms error", channel))
            if least is not None and channel["reduction"] is not None:
                reductions.append(at_least(f"{name}: reduction", channel["reduction"], least, "1"))
    table = Table(
        "Rms about the turn-on biases, and 100 s means within U and noise (95 % expected)",
        ("log", "channel", "before", "after", "unit", "within"),
        tuple(rows),
    )
    flags = tuple(dict.fromkeys(flag for entry in entries for flag in entry["flags"]))
    return Summary("", (table,), flags, (*over_stated_u(errors), *reductions))
