"""Logs of a gyro with one thermometer → the recipe that fits them."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calibkit.ingest.proposal import Choice, Evidence

READ = ("time_s", "temp_case_degc", "gyro_dph")


def propose(evidence: Evidence) -> Choice | None:
    """A gyro with times and one temperature; the first of several gyros."""
    gyros, columns = evidence.gyros(), evidence.columns
    temperature = columns.get("temp_case_degc") or columns.get("temp_env_degc")
    if not gyros or "time_s" not in columns or temperature is None:
        return None
    first = next(iter(gyros))
    base = {name: one for name, one in columns.items() if name not in gyros}
    base |= {"gyro_dph": gyros[first], "temp_case_degc": temperature}
    choice = evidence.choose("bias_temperature", READ, base)
    return choice.with_others([pair for pair in gyros.items() if pair[0] != first])
