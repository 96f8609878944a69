"""Two gyros on a rate table, about the axis of each: logs → gyro_scale.json,
gyro_orthogonality.json.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from calibkit.instruments.gyro_scale.acceptance import LINE_KEYS
from calibkit.instruments.gyro_scale.instrument import (
    FORMS,
    correct,
    faults,
    fit,
    read,
    validate,
)
from calibkit.instruments.gyro_scale.propose import propose_pair as propose
from calibkit.instruments.gyro_scale.recipe import GyroPairRecipe as Recipe

if TYPE_CHECKING:
    from collections.abc import Mapping

    from calibkit.planning.proposal import Task
    from calibkit.planning.schedule import Schedule
    from calibkit.planning.search import Bench
    from calibkit.simulate.campaign import Campaign

__all__ = [
    "FORMS",
    "KEY_FIGURES",
    "Recipe",
    "correct",
    "faults",
    "fit",
    "prepare_plan",
    "propose",
    "read",
    "simulate_plan",
    "validate",
]

KEY_FIGURES = (
    r"gyro_scale\.(a_about_a|b_about_b|b_about_a|a_about_b)\.(K|F0|residual_rms)",
    LINE_KEYS,
    r"gyro_orthogonality\.(N|epsilon|gamma|alpha_deg)",
)


def prepare_plan(spec: Recipe, task: Task) -> Bench:
    """Campaigns of two gyros, and what they will tell."""
    from calibkit.instruments.gyro_scale import plan_pair

    return plan_pair.prepare(spec, task)


def simulate_plan(
    spec: Recipe, schedule: Schedule, document: Mapping[str, Any], seed: int
) -> Campaign:
    """Logs of a campaign that was run by a plan, and their truth."""
    from calibkit.instruments.gyro_scale import plan_pair

    return plan_pair.simulate(spec, schedule, document, seed)
