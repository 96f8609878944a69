"""Procedure of any number of gyros on a rate table, turned about three axes: logs →
gyro_scale.json with K and F0, gyro_orthogonality.json with S, the unit vectors s/|s| of the input
axes and the angles between them (`coefficient_files`). `instrument` does the work.
"""

from __future__ import annotations

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
from calibkit.instruments.gyro_scale.propose import propose_triad as propose
from calibkit.instruments.gyro_scale.recipe import GyroTriadRecipe as Recipe

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
    r"gyro_orthogonality\.scale_factor\.[a-z0-9]+",
    r"gyro_orthogonality\.misalignment\.(?!(\w)\1$)[a-z0-9]+",
    r"gyro_orthogonality\.orthogonality_error_deg\.[a-z0-9]+_[a-z0-9]+",
)
