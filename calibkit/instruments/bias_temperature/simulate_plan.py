"""A campaign of a static instrument that was run by a plan."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.instruments.bias_temperature.plan import TURN_ON
from calibkit.planning.linear import read_sizes
from calibkit.simulate.campaign import Campaign
from calibkit.simulate.chamber import follow_with_lag

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from calibkit.arrays import Array
    from calibkit.instruments.bias_temperature.recipe import BiasTemperatureRecipe
    from calibkit.planning.schedule import Action, Schedule

DRIFT = 50.0
"""Drift over the range, in standard deviations of the noise of a minute."""
REACHED_DEGC, THERMOMETER_DEGC = 0.1, 0.01
"""Standard deviations of the temperature that is reached and of a reading."""


def campaign(
    spec: BiasTemperatureRecipe, schedule: Schedule, document: Mapping[str, Any], seed: int
) -> Campaign:
    """Logs of an instrument whose bias is a polynomial of its case temperature, and its truth."""
    rng, settings = np.random.default_rng(seed), document["settings"]
    low, high = document["range_degc"]
    turn_on = read_sizes(document, {TURN_ON: document["noise"]["unit"]})[TURN_ON]
    size = DRIFT * settings["noise_1s"] / np.sqrt(60.0)
    truth = {
        one.indication: np.polynomial.Polynomial(
            rng.normal(0.0, size, one.order + 1) / (1.0 + np.arange(one.order + 1.0)),
            domain=(low, high),
        )
        for one in spec.polynomials.bias
    }
    logs: dict[str, dict[str, Array]] = {}
    for name in dict.fromkeys(one.log for one in schedule.actions if one.log):
        own = [one for one in schedule.actions if one.log == name]
        case = _follow(own, settings["lag_s"]) + rng.normal(0.0, REACHED_DEGC)
        logs[name] = {
            "time_s": np.arange(float(case.size)),
            spec.polynomials.abscissa: case + rng.normal(0.0, THERMOMETER_DEGC, case.size),
        } | {
            channel: bias(case)
            + rng.normal(0.0, turn_on)
            + rng.normal(0.0, settings["noise_1s"], case.size)
            for channel, bias in truth.items()
        }
    decimals = {"time_s": 0, spec.polynomials.abscissa: 3} | dict.fromkeys(truth, 6)
    drawn = {
        name: {f"p{k}": value for k, value in enumerate(bias.convert().coef.tolist())}
        for name, bias in truth.items()
    }
    facts = {"seed": seed, "plan": document["sha256"], "coefficients": drawn}
    return Campaign(logs, decimals, facts)


def _follow(own: Sequence[Action], lag_s: float) -> Array:
    """Case temperature [n] [°C] at 1 Hz of a log: of a soak that is settled, or of a ramp and the
    soak after it.
    """
    first, last = own[0], own[-1]
    held = np.full(int(last.duration_s), last.set_degc)
    if first.action != "ramp":
        return held
    left = np.arange(first.duration_s, 0.0, -1.0)
    chamber = first.set_degc - first.ramp_degc_per_min / 60.0 * left
    return follow_with_lag(np.append(chamber, held), lag_s)
