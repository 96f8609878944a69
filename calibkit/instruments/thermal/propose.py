"""Logs of a static instrument that is heated and cooled → the recipe that fits them."""

import json
from collections.abc import Sequence

from calibkit.ingest.evidence import Evidence
from calibkit.ingest.recipe_text import RecipeChoice

SHIPPED = [f"gyro_{axis}_dph" for axis in "xyz"] + [f"accel_{axis}_g" for axis in "xyz"]
"""Channels of the shipped recipe."""


def _keys_of(channels: Sequence[str]) -> dict[str, str]:
    """Channels, where they are not those of the shipped recipe."""
    return {} if sorted(channels) == sorted(SHIPPED) else {"channels": json.dumps(list(channels))}


def propose(evidence: Evidence) -> RecipeChoice | None:
    """Choice of the recipe for channels at rest beside one temperature that goes up and down; a
    single warm-up determines no more than a polynomial.
    """
    if not (evidence.cycles("temp_case_degc") or evidence.cycles("temp_env_degc")):
        return None
    return evidence.choose_at_rest("thermal", _keys_of)
