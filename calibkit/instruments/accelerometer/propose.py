"""Logs of a triad of accelerometers → the recipe that fits them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from calibkit.instruments.accelerometer.forms import COMPONENTS

if TYPE_CHECKING:
    from calibkit.ingest.proposal import Choice, Evidence

ATTITUDE = ("temp_case_degc", "inclination_deg", "toolface_deg")


def propose(evidence: Evidence) -> Choice | None:
    """Choice of a recipe with reference attitudes and temperature; without these columns, of the
    magnitude-only recipe.
    """
    columns = evidence.columns
    if not set(COMPONENTS) <= columns.keys():
        return None
    if set(ATTITUDE) <= columns.keys():
        reason = "a triad of accelerometers beside reference attitudes"
        return evidence.choose("accelerometer", ("time_s", *ATTITUDE, *COMPONENTS), reason=reason)
    reason = "a triad of accelerometers without reference attitudes"
    read = ("time_s", *COMPONENTS, "temp_case_degc")
    choice = evidence.choose("accelerometer_magnitude", read, reason=reason)
    if "time_s" in columns:
        return choice
    return replace(
        choice,
        beside_files="# rate_hz = … # these logs have no time: state their sampling rate here",
    )
