"""Procedure of two gyros on a rate table, turned about the axis of each: logs → gyro_scale.json
with K and F0, gyro_orthogonality.json with N, ε, γ and α of `published`, (2). `instrument` does the
work.
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
from calibkit.instruments.gyro_scale.propose import propose_pair as propose
from calibkit.instruments.gyro_scale.published import LINE_KEYS
from calibkit.instruments.gyro_scale.recipe import GyroPairRecipe as Recipe

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
    r"gyro_scale\.(a_about_a|b_about_b|b_about_a|a_about_b)\.(K|F0|residual_rms)",
    LINE_KEYS,
    r"gyro_orthogonality\.(N|epsilon|gamma|alpha_deg)",
)
