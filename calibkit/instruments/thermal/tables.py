"""Tables of a fit and of a validation, and what the figures show."""

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.certificate.words import unit_mark
from calibkit.coefficients import Criterion, at_least, at_most, over_stated_u
from calibkit.instruments.thermal import channels as fitting
from calibkit.instruments.thermal.channels import FittedChannel
from calibkit.instruments.thermal.figures import ChannelCurves, Course, ThermalReport
from calibkit.instruments.thermal.power_ons import PowerOn
from calibkit.instruments.thermal.recipe import ThermalRecipe
from calibkit.report.overview import KeyValue, Overview
from calibkit.report.summary import Summary, number
from calibkit.report.table import Table

if TYPE_CHECKING:
    from calibkit.arrays import Array


def fit_summary(
    spec: ThermalRecipe, found: Sequence[FittedChannel], flags: Sequence[str]
) -> Summary:
    """Summary of a fit."""
    return Summary(
        spec.title,
        (_models(found), _left_out(found), *_withheld(found)),
        tuple(flags),
        tuple(chain.from_iterable(_judge(one, spec) for one in found)),
        overview=_overview(found),
    )


def _overview(found: Sequence[FittedChannel]) -> Overview:
    """First screen of a fit: what each channel's drift is, and what is left of it."""
    drifts = []
    for one in found:
        factor, unit = _scale(one)
        terms = one.choice.chosen.candidate.name if one.varies else "no drift term needed"
        drifts.append(
            f"{one.name}: drift in a power-on (rms) {factor * one.before:.3g} {unit} before,"
            f" {factor * one.after:.3g} {unit} after ({terms})."
        )
    values = [
        KeyValue(f"drift of {one.name}, after", _scale(one)[0] * one.after, _scale(one)[1])
        for one in found
    ]
    return Overview(drifts[0], tuple(drifts[1:]), tuple(values[:4]), _models(found))


def _scale(one: FittedChannel) -> tuple[float, str]:
    """Factor and unit in which a channel's drift is shown."""
    return (1e6, "µg") if one.unit == "g" else (1.0, unit_mark(one.unit))


def _models(found: Sequence[FittedChannel]) -> Table:
    """Chosen model of each channel, rms before and after."""
    rows = []
    for one in found:
        model, (factor, unit) = one.choice.model, _scale(one)
        rows.append(
            (
                one.name,
                one.choice.chosen.candidate.name,
                ", ".join(f"{lag:.0f}" for lag in model.lags),
                number(factor * one.before),
                number(factor * one.after),
                number(factor * model.model_error, 2),
                unit,
            )
        )
    return Table(
        "Bias of each channel: chosen terms, rms of the intervals about the turn-on biases",
        ("channel", "terms", "lags [s]", "before", "after", "model error", "unit"),
        tuple(rows),
    )


def _left_out(found: Sequence[FittedChannel]) -> Table:
    """Errors of all candidates on left-out stretches, one column per channel."""
    names = dict.fromkeys(test.candidate.name for one in found for test in one.choice.tested)
    rows = []
    for name in names:
        cells = []
        for one in found:
            test = next((t for t in one.choice.tested if t.candidate.name == name), None)
            chosen = " *" if test is one.choice.chosen else ""
            cells.append("" if test is None else f"{number(test.pooled, 3)}{chosen}")
        rows.append((name, *cells))
    return Table(
        "Errors on stretches left out in turn (100 s means, rms); * chosen: the simplest model"
        " within the noise of the best",
        ("terms", *(f"{one.name} [{one.unit}]" for one in found)),
        tuple(rows),
    )


def _withheld(found: Sequence[FittedChannel]) -> tuple[Table, ...]:
    """Rms on withheld stretches before and after."""
    rows = [
        (one.name, number(one.withheld[0]), number(one.withheld[1]), one.unit)
        for one in found
        if one.withheld is not None
    ]
    title = "Withheld stretches: rms about the turn-on biases of the fitted ones"
    return (Table(title, ("channel", "before", "after", "unit"), tuple(rows)),) if rows else ()


def _judge(one: FittedChannel, spec: ThermalRecipe) -> list[Criterion]:
    """Criteria of one channel, where the recipe limits it."""
    limits, made = spec.acceptance, []
    if limits.min_reduction is not None and one.varies:
        made.append(
            at_least(
                f"{one.name}: reduction on left-out stretches",
                one.choice.constant.pooled / one.choice.chosen.pooled,
                limits.min_reduction,
                "1",
            )
        )
    if limits.max_residual_over_noise is not None:
        made.append(
            at_most(
                f"{one.name}: residual over noise",
                one.over_noise,
                limits.max_residual_over_noise,
                "1",
            )
        )
    return made


def report_data(
    found: Sequence[FittedChannel], power_ons: Sequence[PowerOn], reference_degc: float
) -> ThermalReport:
    """What the figures of a fit show."""
    courses = tuple(
        Course((one.blocks.time - one.blocks.time[0]) / 60.0, one.blocks.case, ~one.fitted)
        for one in power_ons
    )
    curves = []
    for channel in found:
        raw: list[Array] = []
        left: list[Array] = []
        for one in power_ons:
            log = one.of_channel(channel.name)
            drift = fitting.evaluate_wide(channel.choice.model, log, reference_degc).drift
            for curve, values in ((raw, log.indication), (left, log.indication - drift)):
                curve.append(np.asarray(values - values[one.fitted].mean()))
        curves.append(ChannelCurves(channel.name, channel.unit, tuple(raw), tuple(left)))
    return ThermalReport(courses, tuple(curves))


def validation_summary(entries: Sequence[Mapping[str, Any]], spec: ThermalRecipe) -> Summary:
    """Summary of a validation."""
    each = [
        (f"{entry['name']} {one['name']}", entry["name"], one)
        for entry in entries
        for one in entry["channels"]
    ]
    shares = [one.get("share_within_expanded_uncertainty") for _, _, one in each]
    table = Table(
        "Rms about the turn-on biases, and 100 s means within U and noise (95 % expected)",
        ("log", "channel", "before", "after", "unit", "within"),
        tuple(
            (
                log,
                one["name"],
                number(one["before"]),
                number(one["after"]),
                one["unit"],
                "" if share is None else f"{share:.0%}",
            )
            for (_, log, one), share in zip(each, shares, strict=True)
        ),
    )
    flags = tuple(dict.fromkeys(flag for entry in entries for flag in entry["flags"]))
    return Summary("", (table,), flags, tuple(_judge_unseen(each, spec)))


def _judge_unseen(
    each: Sequence[tuple[str, str, Mapping[str, Any]]], spec: ThermalRecipe
) -> list[Criterion]:
    """Criteria of unseen channels, each by its name, its log and its entry."""
    made = over_stated_u((f"{name}: rms error", one) for name, _, one in each)
    least = spec.acceptance.min_reduction
    if least is not None:
        made += [
            at_least(f"{name}: reduction", one["reduction"], least, "1")
            for name, _, one in each
            if one["reduction"] is not None
        ]
    return made
