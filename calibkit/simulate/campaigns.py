"""Which campaigns can be simulated, by name."""

from __future__ import annotations

import difflib
import importlib
from typing import TYPE_CHECKING

from calibkit.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable

    from calibkit.simulate.campaign import Campaign

MODULES = {
    "accelerometer": "accelerometer.simulate",
    "accelerometer_magnitude": "accelerometer.simulate_magnitude",
    "fog_thermal": "fog_thermal.simulate",
    "gyro_noise": "gyro_noise.simulate",
    "gyro_pair": "gyro_scale.simulate_pair",
    "gyro_triad": "gyro_scale.simulate_triad",
    "inclinometer": "inclinometer.simulate",
    "rate_table": "gyro_scale.simulate_rate_table",
}
NAMES = tuple(MODULES)


def of(name: str) -> Callable[[int], Campaign]:
    """Campaign of that name as a function of its seed, or UsageError with the names there are."""
    if name not in NAMES:
        close = difflib.get_close_matches(name, NAMES, n=1)
        guess = f"did you mean '{close[0]}'? " if close else ""
        raise UsageError(
            f"procedure '{name}' cannot be simulated", hint=f"{guess}there are: {', '.join(NAMES)}"
        )
    module = importlib.import_module(f"calibkit.instruments.{MODULES[name]}")
    campaign: Callable[[int], Campaign] = module.campaign
    return campaign
