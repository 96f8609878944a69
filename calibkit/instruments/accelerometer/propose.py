"""Logs of a triad of accelerometers → the recipe that fits them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from calibkit.instruments.accelerometer.forms import COMPONENTS
from calibkit.logs.nameless import find_sphere

if TYPE_CHECKING:
    from calibkit.logs.evidence import Evidence
    from calibkit.logs.recipe_text import RecipeChoice

TEMPERATURE, AIR = "temp_case_degc", "temp_env_degc"
ATTITUDE = ("temp_case_degc", "inclination_deg", "toolface_deg")


def propose(evidence: Evidence) -> RecipeChoice | None:
    """Choice of a recipe with reference attitudes and temperature; without these columns, of the
    magnitude-only recipe.
    """
    columns, lines = dict(evidence.columns), {}
    counts = [f"accel_{axis}_lsb" for axis in "xyz"]
    if set(counts) <= columns.keys() and evidence.turned:
        # scaled to g by the sphere on which the counts of a triad lie that was turned
        names = [columns[count].name for count in counts]
        sphere = find_sphere(np.column_stack([evidence.glimpse.first[name] for name in names]))
        for count, component, middle in zip(counts, COMPONENTS, sphere[:3], strict=True):
            columns[component], scale = columns.pop(count), 1.0 / sphere[3]
            lines[component] = (f"scale = {scale:.6g}", f"offset = {-middle * scale:.6g}")
    if not set(COMPONENTS) <= columns.keys():
        return None
    if set(ATTITUDE) <= columns.keys():
        reason = "a triad of accelerometers beside reference attitudes"
        return evidence.choose("accelerometer", ("time_s", *ATTITUDE, *COMPONENTS), reason=reason)
    if evidence.turned is False and (evidence.warms(TEMPERATURE) or evidence.warms(AIR)):
        return None
    reason = "a triad of accelerometers that was turned, without reference attitudes"
    read = ("time_s", *COMPONENTS, "temp_case_degc")
    # each row is a dwell where rows are few and have no time
    rows = len(next(iter(evidence.glimpse.first.values()), ()))
    keys = {"mode": '"rows"'} if "time_s" not in columns and 0 < rows <= _MOST_LISTED else {}
    choice = evidence.choose("accelerometer_magnitude", read, columns, keys, reason=reason)
    choice = replace(
        choice,
        lines={**choice.lines, **lines},
        remark=_NOMINAL if lines else "",
        guessed=bool(lines),
    )
    if "time_s" in columns or keys:
        return choice
    return replace(
        choice,
        beside_files="# rate_hz = … # these logs have no time: state their sampling rate here",
    )


_NOMINAL = "# Counts are scaled to g by the sphere that they lie on; the fit finds what is left."
_MOST_LISTED = 200
"""Rows up to which a log without times is a list of dwells."""
