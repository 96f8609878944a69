"""A campaign of an inclinometer that was run by a plan, with the errors that it assumes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from calibkit.instruments.inclinometer import simulate
from calibkit.instruments.inclinometer.numeric import planned
from calibkit.numeric import earth
from calibkit.planning.linear import read_sizes
from calibkit.planning.proposal import WITHHELD
from calibkit.simulate.campaign import Campaign

if TYPE_CHECKING:
    from collections.abc import Mapping

    from calibkit.arrays import Array, Integers
    from calibkit.instruments.inclinometer.recipe import InclinometerRecipe
    from calibkit.planning.schedule import Schedule

SIZES = (3e-3, 3e-5, 1e-7, 1e-9)
"""Standard deviations of the coefficients of s(T) about 1, in powers of °C."""
BIAS = (1e-3, 0.3)
"""Standard deviations of the biases of an accelerometer [g] and a gyro [°/h]."""
REACHED_DEGC = 0.1
"""Standard deviation of the temperature that is reached."""


def campaign(
    spec: InclinometerRecipe, schedule: Schedule, document: Mapping[str, Any], seed: int
) -> Campaign:
    """Logs of the stations of a schedule, and the coefficients of s(T) of each gyro."""
    rng, settings = np.random.default_rng(seed), document["settings"]
    size = read_sizes(document, planned.UNITS)
    pairs = {axis: _Pair.draw(rng, settings["order"], size) for axis in spec.axes}
    sign = 1.0 if spec.reference.convention == "gravity" else -1.0
    logs: dict[str, dict[str, Array | Integers]] = {}
    for name in dict.fromkeys(one.log for one in schedule.recorded("dwell")):
        held = [one for one in schedule.recorded("dwell") if one.log == name]
        at, count = held[::4], len(held) // 4
        tilt, azimuth, set_degc = np.array(
            [(one.inclination_deg, one.azimuth_deg, one.set_degc) for one in at]
        ).T
        attitudes = simulate.Attitudes(tilt, np.zeros(count), azimuth)
        soak = np.unique(set_degc, return_inverse=True)[1]
        degc = np.round(set_degc + rng.normal(0.0, REACHED_DEGC, count)[soak], 2)
        index = rng.normal(0.0, size[planned.INDEX], (count, 4))
        logs[name] = columns = {
            "station": np.repeat(np.arange(1, count + 1), 4),
            "position_deg": np.tile(simulate.POSITIONS_DEG, count),
            "time_s": np.array([one.start_s for one in held]),
            "temp_case_degc": np.repeat(degc, 4),
        }
        for axis, pair in pairs.items():
            seen = (0.0 if axis == "x" else 90.0) + simulate.POSITIONS_DEG + index
            accel, gyro = pair.read(rng, attitudes, seen, degc, settings, size)
            columns[f"accel_{axis}_g"] = sign * accel.ravel()
            columns[f"gyro_{axis}_dph"] = gyro.ravel()
        for column in simulate.REFERENCE if name.startswith(WITHHELD) else ():
            columns[column] = np.repeat(getattr(attitudes, column), 4)
    drawn = {axis: pair.describe() for axis, pair in pairs.items()}
    facts = {"seed": seed, "plan": document["sha256"], "coefficients": drawn}
    return Campaign(logs, simulate.DECIMALS | dict.fromkeys(simulate.REFERENCE, 4), facts)


@dataclass(frozen=True, slots=True)
class _Pair:
    """A gyro and an accelerometer."""

    scale: Array
    """Coefficients of s(T)."""
    turn_deg: float
    """Of the gyro against the accelerometer."""
    bias: Array
    """Of the accelerometer [g] and of the gyro [°/h]."""

    @classmethod
    def draw(
        cls, rng: np.random.Generator, order: int, size: Mapping[tuple[str, str], float]
    ) -> Self:
        """Draw a pair."""
        scale = np.append(1.0, np.zeros(order)) + rng.normal(0.0, SIZES[: order + 1])
        return cls(scale, rng.normal(0.0, size[planned.TURN]), rng.normal(0.0, BIAS))

    def describe(self) -> dict[str, float]:
        """Coefficients of s(T) by name."""
        return {f"s{k}": value for k, value in enumerate(self.scale.tolist())}

    def read(
        self,
        rng: np.random.Generator,
        attitudes: simulate.Attitudes,
        seen_deg: Array,
        degc: Array,
        settings: Mapping[str, Any],
        size: Mapping[tuple[str, str], float],
    ) -> tuple[Array, Array]:
        """Accelerometer [g] and gyro [°/h] in directions [n, 4] [°] about the axis of the tool."""
        gravity = simulate.rotated(attitudes, np.array([0.0, 0.0, 1.0]))
        rate = simulate.rotated(attitudes, earth.north_east_down(settings["latitude_deg"]))
        accel = simulate.resolve_along(gravity, seen_deg, 0.0) + self.bias[0]
        accel += rng.normal(0.0, size[planned.ACCEL], seen_deg.shape)
        s = np.polynomial.polynomial.polyval(degc, self.scale)
        s = s + rng.normal(0.0, size[planned.SCATTER], degc.size)
        s = s + rng.normal(0.0, size[planned.OF_LOG])
        walk = np.cumsum(rng.normal(0.0, size[planned.WALK], seen_deg.shape), axis=1)
        gyro = simulate.resolve_along(rate, seen_deg + self.turn_deg, 0.0) / s[:, None] + walk
        gyro += self.bias[1] + rng.normal(0.0, settings["noise_dph"], seen_deg.shape)
        return accel, gyro
