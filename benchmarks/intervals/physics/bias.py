"""Gyros over temperature: what moves the bias and the drift beside the heat in the coil.

The gyro is the coil of `diffusion_coil`, through which heat diffuses. Its soaks are long enough for
the coil to come to rest, unless the fault is that they are not.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import diffusion_coil
import numpy as np

from calibkit.simulate.chamber import Programme
from intervals.physics.campaigns import Applied, Campaign, Fault, Truth

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pandas as pd
    from diffusion_coil import Coil

COLD_DEGC, HOT_DEGC, BUMP_DEGC = -40.0, 60.0, 10.0
SOAK_S, SHORT_SOAK_S = 7200.0, 1800.0
ROW_S = 5
"""Time between two rows of a log."""
SETTLED_DEGC = (COLD_DEGC, HOT_DEGC)
BIAS, DRIFT, APPLIED = "bias at rest", "drift at rest", "drift of a log"
RAMPS = ((1.0, 1), (1.0, -1), (5.0, 1), (5.0, -1), (10.0, 1), (10.0, -1))
"""Rates [°C/min] and ways."""


def _draw(rng: np.random.Generator, **changes: float) -> Coil:
    """A gyro with some properties of its own."""
    return replace(diffusion_coil.draw(int(rng.integers(1 << 31))), **changes)


def _programme(rate: float, way: int, soak_s: float = SOAK_S) -> Programme:
    """A ramp between soaks."""
    ends = (COLD_DEGC, HOT_DEGC)[::way]
    return Programme.ramp(*ends, rate, soak_before_s=soak_s, soak_after_s=soak_s)


def _record(
    rng: np.random.Generator,
    coil: Coil,
    ramps: Sequence[tuple[float, int]] = RAMPS,
    soak_s: float = SOAK_S,
    *,
    cycled: bool = False,
) -> dict[str, pd.DataFrame]:
    """A log of each ramp; `cycled`: each starts as the one before ended."""
    logs, state = {}, None
    for number, (rate, way) in enumerate(ramps):
        recorded = diffusion_coil.record(coil, _programme(rate, way, soak_s), rng, state)
        state = recorded.last if cycled else None
        side = "heating" if way > 0 else "cooling"
        logs[f"{number}_{side}_{rate:g}.csv"] = recorded.frame(ROW_S)
    return logs


def _recipe(procedure: str = "fog_thermal", **tables: Any) -> dict[str, Any]:  # noqa: ANN401 (as in TOML)
    """Recipe of ramps."""
    return {"procedure": procedure, "logs": {"files": ["*.csv"]}, **tables}


def _at_rest(coil: Coil, quantity: str, at_degc: Sequence[float]) -> list[Truth]:
    """Bias or drift at rest at some temperatures."""
    mean, key = (coil.mean_dph, "*.bias") if quantity == BIAS else (0.0, "*.drift")
    rest = {"temp_rate_degc_min": 0.0, "gradient_degc": 0.0, "gradient_rate_degc_min": 0.0}
    return [
        Truth(
            quantity,
            key,
            mean + diffusion_coil.drift_at_rest(coil, degc),
            rest | {"temp_case_degc": degc},
        )
        for degc in at_degc
    ]


def _applied(rng: np.random.Generator, coil: Coil, programme: Programme) -> Applied:
    """Log that is compensated, and its true drift."""
    recorded = diffusion_coil.record(coil, programme, rng)
    return Applied(
        APPLIED,
        recorded.frame(ROW_S),
        "gyro_drift_dph",
        recorded.drift[::ROW_S],
        "gyro_standard_uncertainty_dph",
        {"output__drift": True, "output__rate_uncertainty": True},
    )


def _power_ons(
    rng: np.random.Generator, size: float, count: int, procedure: str = "fog_thermal"
) -> Campaign:
    """So many logs, each with a turn-on bias of `size` °/h; the drift is so large that a few
    logs show it.
    """
    coil = _draw(rng, turn_on_dph=size)
    coil = replace(
        coil,
        weights=tuple(4.0 * weight for weight in coil.weights),
        static=tuple(4.0 * power for power in coil.static),
    )
    logs = _record(rng, coil, ((5.0, 1), (10.0, -1), (10.0, 1), (5.0, -1))[:count])
    tables: dict[str, Any] = {"drift": {"model": "lagged"}}
    if procedure == "thermal":
        tables = {"thermal": {"channels": ["gyro_x_dph"]}}
        logs = {name: log.rename(columns={"gyro_dph": "gyro_x_dph"}) for name, log in logs.items()}
    return Campaign(_recipe(procedure, **tables), logs, _at_rest(coil, BIAS, SETTLED_DEGC))


def _anomaly(rng: np.random.Generator, size: float) -> Campaign:
    """A bump of `size` °/h in the drift about 10 °C; soaks at the ends alone."""
    coil = _draw(rng, bump_dph=size, bump_degc=BUMP_DEGC)
    return Campaign(_recipe(), _record(rng, coil), _at_rest(coil, DRIFT, (BUMP_DEGC,)))


def _anomaly_with_soaks(rng: np.random.Generator, size: float) -> Campaign:
    """The same with a log up and one down that soak at every tenth degree, as its remark asks, for
    as long as the coil needs.
    """
    coil = _draw(rng, bump_dph=size, bump_degc=BUMP_DEGC)
    logs = _record(rng, coil)
    levels = np.arange(COLD_DEGC, HOT_DEGC + 1.0, 10.0)
    ends_s = np.cumsum(np.tile([5400.0, 300.0], levels.size)[:-1])
    for name, degc in (("up", levels), ("down", levels[::-1])):
        time_s = (0.0, *ends_s.tolist())
        stairs = Programme(time_s, tuple(np.repeat(degc, 2).tolist()), np.sign(degc[-1]) * 2.0)
        logs[f"stairs_{name}.csv"] = diffusion_coil.record(coil, stairs, rng).frame(ROW_S)
    return Campaign(_recipe(), logs, _at_rest(coil, DRIFT, (BUMP_DEGC,)))


def _hysteresis(rng: np.random.Generator, size: float) -> Campaign:
    """Half a loop of `size` °/h; a mission that reverses within the range is compensated."""
    coil = _draw(rng, hysteresis_dph=size)
    corners = np.array([25.0, -10.0, 30.0, 10.0, 40.0, 0.0])
    ramps_s = np.abs(np.diff(corners)) / 3.0 * 60.0
    time_s = np.cumsum([0.0, SOAK_S, *ramps_s])
    mission = Programme(tuple(time_s.tolist()), (corners[0], *corners.tolist()), 0.0)
    return Campaign(_recipe(), _record(rng, coil), [], _applied(rng, coil, mission))


def _without_sign(rng: np.random.Generator, size: float) -> Campaign:
    """With a size of 1 the thermometers show no sign."""
    coil = _draw(rng)
    logs = _record(rng, coil)
    if size:
        for log in logs.values():
            for column in ("temp_case_degc", "temp_env_degc"):
                log[column] = log[column].abs()
    return Campaign(_recipe(), logs, _at_rest(coil, DRIFT, SETTLED_DEGC))


def _reversed(rng: np.random.Generator, size: float) -> Campaign:
    """With a size of 1 the sign of the gyro is turned in all cooling logs."""
    coil = _draw(rng)
    logs = _record(rng, coil)
    for name, log in logs.items():
        if size and "cooling" in name:
            log["gyro_dph"] *= -1.0
    return Campaign(_recipe(), logs, _at_rest(coil, DRIFT, SETTLED_DEGC))


def _unsettled(rng: np.random.Generator, size: float) -> Campaign:
    """With a size of 1 each log starts as the one before ended, after a soak of half an hour."""
    coil = _draw(rng)
    soak_s = SHORT_SOAK_S if size else SOAK_S
    logs = _record(rng, coil, soak_s=soak_s, cycled=bool(size))
    return Campaign(_recipe(), logs, [], _applied(rng, coil, _programme(3.0, 1)))


def _warm_up(rng: np.random.Generator, size: float) -> Campaign:
    """A bias that settles by `size` °/h after each power-on, in all logs alike."""
    coil = _draw(rng, warm_up_dph=size)
    return Campaign(_recipe(), _record(rng, coil), _at_rest(coil, BIAS, SETTLED_DEGC))


FEW_LOGS = "hardly determined|do not determine|hold together"
"""What two or three logs cannot determine."""
_row, _one_thermometer = partial(Fault, "fog_thermal"), partial(Fault, "thermal")
FAULTS = (
    _one_thermometer(
        "two power-ons",
        1.0,
        "°/h",
        partial(_power_ons, count=2, procedure="thermal"),
        "power-on|turn-on",
        0.02,
        FEW_LOGS,
    ),
    _row(
        "four power-ons",
        1.0,
        "°/h",
        partial(_power_ons, count=4),
        "power-on|turn-on",
        0.02,
        FEW_LOGS,
    ),
    _one_thermometer(
        "three power-ons",
        1.0,
        "°/h",
        partial(_power_ons, count=3, procedure="thermal"),
        "power-on|turn-on",
        0.02,
        FEW_LOGS,
    ),
    _row("bump of the drift between the soaks", 0.25, "°/h", _anomaly, "observed at|inferred"),
    _row(
        "bump of the drift with soaks every 10 °C",
        0.25,
        "°/h",
        _anomaly_with_soaks,
        "observed at|inferred",
    ),
    _row("hysteresis on a mission", 0.2, "°/h", _hysteresis, "hysteresis"),
    _row("thermometers without sign", 1.0, "", _without_sign, "sign"),
    _row("gyro reversed in all cooling logs", 1.0, "", _reversed, "opposite|sign"),
    _row("logs that start unsettled", 1.0, "", _unsettled, "soaks of|at rest"),
    _row("warm-up in all logs", 0.2, "°/h", _warm_up, "warm"),
)
