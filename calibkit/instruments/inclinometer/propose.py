"""Logs of a north-seeking inclinometer → the recipe that fits them."""

from calibkit.ingest.evidence import Evidence
from calibkit.ingest.recipe_text import Choice

READ = (
    *(
        "station",
        "position_deg",
        "time_s",
        "temp_case_degc",
        "inclination_deg",
        "toolface_deg",
        "azimuth_deg",
    ),
    *(f"{kind}_{axis}_{unit}" for axis in "xy" for kind, unit in (("accel", "g"), ("gyro", "dph"))),
)


def propose(evidence: Evidence) -> Choice | None:
    """Choice of the inclinometer recipe for logs with gyros, a rotation about the tool axis, and
    times or stations.
    """
    columns = evidence.columns
    if "position_deg" in columns and {"station", "time_s"} & columns.keys() and evidence.gyros():
        reason = "gyros beside rotations about the tool axis, with stations or times"
        return evidence.choose("inclinometer", READ, reason=reason)
    return None
