"""Procedure of single gyros on a rate table: logs → gyro_scale.json with K and F0 of F = K Ω + F0,
over temperature where it varies (`equation`, (1)). `instrument` does the work.
"""

from calibkit.instruments.gyro_scale.instrument import (
    FORMS,
    blocks,
    correct,
    faults,
    fit,
    read,
    results,
    validate,
)
from calibkit.instruments.gyro_scale.propose import propose_rate_table as propose
from calibkit.instruments.gyro_scale.published import LINE_KEYS
from calibkit.instruments.gyro_scale.recipe import RateTableRecipe as Recipe

__all__ = [
    "FORMS",
    "KEY_FIGURES",
    "Recipe",
    "blocks",
    "correct",
    "faults",
    "fit",
    "propose",
    "read",
    "results",
    "validate",
]

KEY_FIGURES = (
    r"gyro_scale\.gyro_[a-z0-9]+\.(K|F0|residual_rms)",
    r"gyro_scale\.(repeatability|temperature_sensitivity)\.GJB 2426A\..+",
    LINE_KEYS,
)
