"""Logs of a gyro in a chamber → the recipe that fits them."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calibkit.ingest.proposal import Choice, Evidence

READ = ("time_s", "temp_case_degc", "temp_env_degc", "gyro_dph")


def propose(evidence: Evidence) -> Choice | None:
    """A gyro with times, case temperature and chamber air; the first of several gyros."""
    gyros, columns = evidence.gyros(), evidence.columns
    if not gyros or not {"time_s", "temp_case_degc", "temp_env_degc"} <= columns.keys():
        return None
    first = next(iter(gyros))
    base = {name: one for name, one in columns.items() if name not in gyros}
    choice = evidence.choose("fog_thermal", READ, base | {"gyro_dph": gyros[first]})
    return choice.with_others([pair for pair in gyros.items() if pair[0] != first])
