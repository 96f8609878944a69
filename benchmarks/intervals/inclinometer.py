"""One four-position inclinometer, its stations in several logs: s(T) of both gyros.

The tool and its stations are those of `physics.inclinometer`, with constant scale factors. Errors
act on the gyros: after each turn-on the scale factor is another, or both gyros are turned against
the accelerometers. The truth is the tool's own scale factor.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from intervals import exact
from intervals.physics import inclinometer
from intervals.physics.campaigns import Campaign, Truth, compare, fit
from intervals.physics.inclinometer import EARTH_DPH, GYRO_NOISE_DPH, LATITUDE_DEG, SENSORS_DEG
from intervals.rows import GROUPS, NONE, RATIOS, Case, Outcome

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import NDArray

    from intervals.physics.inclinometer import Stations

    Array = NDArray[np.float64]

EACH, NOISE = 8, 5e-4
"""Stations of a log, and the size that errors are stated in: near the noise of a root of s."""
AT_DEGC = (30.0, 70.0, 110.0)
SCALE, TURN = "scale factor of a log", "turn of the gyros"
NAME = "s(T)"
FEW = ("degrees of freedom",)


def list_cases() -> list[Case]:
    """Every error at every size and number of logs; with the component given, at seven."""
    found = []
    for logs in GROUPS:
        found.append(_case(NONE, 0.0, logs))
        found += [_case(error, ratio, logs) for error in (SCALE, TURN) for ratio in RATIOS]
    return found + [_case(SCALE, ratio, GROUPS[1], given=True) for ratio in (0.0, *RATIOS)]


def _case(error: str, ratio: float, logs: int, *, given: bool = False) -> Case:
    """Case with the degrees of freedom between its logs, which temperatures cross."""
    between = logs - 1 if error == SCALE else None
    return Case("inclinometer", NAME, error, ratio, logs, given=given, between=between)


def _recipe(case: Case) -> dict[str, object]:
    """Recipe of a case."""
    tables: dict[str, object] = {
        "procedure": "inclinometer",
        "logs": {"files": ["*.csv"]},
        "site": {"latitude_deg": LATITUDE_DEG},
        "reference": {"convention": "gravity"},
        "scale": {"order": 1},
    }
    if case.given:
        stated = {"group": "log", "effect": "scale", "unit": "1", "dof": 1000.0}
        tables["errors"] = {"component": [stated | {"value": case.ratio * NOISE}]}
    return tables


def _logs(case: Case, frame: pd.DataFrame, rng: np.random.Generator) -> dict[str, pd.DataFrame]:
    """Logs of stations in random order of temperature, with their errors."""
    order, logs = rng.permutation(EACH * case.groups), {}
    angle = case.ratio * NOISE * rng.normal() if case.error == TURN else 0.0
    for number in range(case.groups):
        part = frame[np.isin(frame["station"] - 1, order[number :: case.groups])].copy()
        off = case.ratio * NOISE * rng.normal() if case.error == SCALE else 0.0
        for gyro in ("gyro_x_dph", "gyro_y_dph"):
            four = part[gyro].to_numpy().reshape(-1, 4)
            turned = np.cos(angle) * four + np.sin(angle) * np.roll(four, -1, axis=1)
            part[gyro] = (turned / (1.0 + off)).ravel()
        logs[f"l{number}.csv"] = part
    return logs


def simulate(case: Case, number: int) -> Outcome:
    """Simulate and fit one campaign, and judge its results."""
    rng = np.random.default_rng([*case.seed, number])
    stations = inclinometer.draw(rng, EACH * case.groups)
    s = {sensor: float(1.0 + rng.normal(0.0, 3e-3)) for sensor in SENSORS_DEG}
    scale = {sensor: np.full(stations.degc.size, value) for sensor, value in s.items()}
    logs = _logs(case, inclinometer.log(rng, stations, scale, LATITUDE_DEG), rng)
    truth = [
        Truth(NAME, f".{sensor}.s", value, {"temp_case_degc": degc})
        for sensor, value in s.items()
        for degc in AT_DEGC
    ]
    known = np.tile(_exact(case, stations), len(s))
    return compare(fit(Campaign(_recipe(case), logs, truth)), {NAME: known}, FEW)


def _exact(case: Case, stations: Stations) -> Array:
    """Exact half-widths at the temperatures that are judged; logs are dealt out evenly.

    Four positions give the components x, y of the earth's rate across the tool over s, each with
    the noise of a reading over √2, in units of the earth's rate. Without the azimuth ψ,

        ((s x − sin φ sin θ)/cos θ)² + (s y)² = cos² φ

    so that s is off by the noise of x and y times the derivatives of this equation.
    """
    theta, psi = np.radians((stations.inclination, stations.azimuth))
    latitude = np.radians(LATITUDE_DEG)
    by_x, by_y = np.cos(psi) / np.cos(theta), np.sin(psi)
    x = np.cos(latitude) * np.cos(psi) * np.cos(theta) + np.sin(latitude) * np.sin(theta)
    by_s = by_x * x + by_y * np.cos(latitude) * np.sin(psi)
    noise = GYRO_NOISE_DPH / EARTH_DPH / np.sqrt(2.0) * np.hypot(by_x, by_y) / np.abs(by_s)
    own = (np.arange(noise.size)[:, None] % case.groups == np.arange(case.groups)).astype(float)
    size = case.ratio * NOISE if case.error == SCALE else 0.0
    design = np.vander(stations.degc, 2, increasing=True)
    return exact.half_widths(design, size * own, noise, np.vander(AT_DEGC, 2, increasing=True))
