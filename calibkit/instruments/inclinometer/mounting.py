"""How gyros, accelerometers and stations go together: the turn of a gyro about the tool axis, index
errors of the positions, logs that share a scale factor; what a recipe states of them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np

from calibkit.arrays import Array, Integers, Mask
from calibkit.coefficients import Component
from calibkit.fit.shared import Shared
from calibkit.forms import components_of
from calibkit.frame import Remark
from calibkit.instruments.inclinometer.forms import MOUNTING
from calibkit.instruments.inclinometer.published import Components, Sensor
from calibkit.instruments.inclinometer.recipe import InclinometerRecipe
from calibkit.instruments.inclinometer.root_choice import Solution, root_slopes
from calibkit.instruments.inclinometer.scale_fit import ScaleOverTemperature
from calibkit.instruments.inclinometer.stations import Stations
from calibkit.recipe.shared_errors import state_sizes, warn_of_few_levels
from calibkit.recipe.type_b import terms_of

SMALL_WEIGHT = 0.25
"""Weight of a pair in the azimuth, that of 1.7 times the noise, from which its turn counts in full.
"""
SHOWN = 3.0
"""Standard uncertainties above which a turn is flagged; it is in the azimuth's from 2 on."""
ONE_ATTITUDE = "one attitude: a turn of the gyro is not separable, in U of the azimuth as stated"


def shared_errors(
    solution: Solution, stations: Stations, spec: InclinometerRecipe, axis: Sensor
) -> dict[str, Shared]:
    """Errors that stations of which s is known share, by group: the turn of the gyro, unless the
    recipe leaves it out, with the derivatives of the roots by it [1/°], and the scale of a log.
    """
    parts = stations.components[axis]
    by_turn, _ = slopes_of_roots(parts, spec.site.latitude_deg, solution.root >= 0)
    tool, loading = np.zeros(by_turn.size, dtype=np.int64), by_turn[:, None]
    candidates = [
        Shared(group=MOUNTING, effect="gyro turn", level=tool, loading=loading, unit="deg")
    ]
    if stations.log.max() > 0:
        candidates.append(scale_of_logs(stations.log))
    return {error.group: error for error in state_sizes(spec.errors, candidates)}


def state(
    scale_fit: ScaleOverTemperature, turn_deg: float
) -> tuple[tuple[Component, ...], tuple[str, ...]]:
    """Components of a coefficient file, and flags; `turn_deg` is the standard deviation of the turn
    that azimuths are corrected without.
    """
    angle, u = scale_fit.turn_deg
    components = components_of(scale_fit.fit.shared)
    if turn_deg:
        components = (
            *components,
            Component(MOUNTING, "gyro turn", turn_deg, "deg", u or turn_deg, 1),
        )
    of_logs = [size for size in scale_fit.fit.shared if size.error.group == "log"]
    flags = [*warn_of_few_levels(of_logs)]
    if scale_fit.separable is False:
        flags.append(Remark(ONE_ATTITUDE))
    if abs(angle) > SHOWN * u > 0.0:
        flags.append(
            f"the roots of s show a gyro that is turned by {angle:.3f}° ± {u:.2g}° against the"
            " accelerometers about the tool axis, expected 0°: it is in the uncertainty of the"
            " azimuth; align the sensors and measure again"
        )
    return components, tuple(flags)


@dataclass(frozen=True, slots=True)
class Mounted:
    """What n azimuths owe to how sensors and positions are mounted."""

    by_turn: Array
    """Derivatives [°/°] by a turn of the gyros, which both sensor pairs share."""
    variance: Array
    """[°²]."""
    stated: Array
    """Part of it that the recipe states [°²]."""

    @classmethod
    def of(
        cls,
        stations: Stations,
        solutions: Mapping[Sensor, Solution],
        spec: InclinometerRecipe,
        azimuth_weight: Array,
        turns_deg: Mapping[Sensor, float],
    ) -> Self:
        """Azimuths whose gyros are turned by unknown angles of standard deviations `turns_deg`,
        the larger of which counts; `[[errors.component]]` and type B terms on `azimuth_deg` and
        `position_deg` are stated.

        azimuth_weight : [pairs, n], of the pairs in the combined azimuth. A turn counts in full,
        but by its weight where that is small: a noisy gyro does not tell its turn, nor carry the
        azimuth.
        """
        changes = []
        for axis, solution in solutions.items():
            parts = stations.components[axis]
            with np.errstate(invalid="ignore"):
                changes.append(np.sum(solution.azimuth_slopes * moved(parts), axis=2))
        by_turn, by_index = np.moveaxis(np.array(changes), 0, 1)
        share = np.where(azimuth_weight < SMALL_WEIGHT, azimuth_weight, 1.0)
        counted = share * np.abs(by_turn)
        sizes_deg = np.array([[turns_deg[axis]] for axis in solutions])
        with_positions, of_azimuth = (
            sum((part.sensitivity * part.standard_uncertainty) ** 2 for part in terms.components)
            for terms in (
                terms_of(spec.type_b, "azimuth_deg", 0.0, {"position_deg": (0.0, 1.0)}),
                terms_of(spec.type_b, "azimuth_deg", 0.0),
            )
        )
        index = np.fmax.reduce(np.abs(by_index)) ** 2 * (with_positions - of_azimuth)
        of_mounting = [entry for entry in spec.errors.component if entry.group == MOUNTING]
        stated_deg = max((entry.value_in("deg") for entry in of_mounting), default=0.0)
        without_turn = of_azimuth + index
        return cls(
            np.fmax.reduce(by_turn),
            without_turn + np.fmax.reduce(sizes_deg * counted) ** 2,
            np.asarray(without_turn + (stated_deg * np.fmax.reduce(counted)) ** 2),
        )


def slopes_of_roots(parts: Components, latitude_deg: float, plus: Mask) -> Array:
    """Derivatives [2, n] of roots by a turn of the gyro and by an index error [1/°]."""
    latitude = np.full(plus.size, latitude_deg)
    with np.errstate(invalid="ignore"):
        gradient = root_slopes(parts, latitude, plus)[:, :4] * moved(parts)
    return np.asarray(np.radians(np.sum(gradient, axis=2)))


def moved(parts: Components) -> Array:
    """What the four components [2, n, 4] read more for each radian of a turn of the gyro, ω_x' =
    ω_x + δ ω_y, ω_y' = ω_y − δ ω_x, and of an index error, by half of which positions ±x and ±y are
    turned to different sides.
    """
    none = np.zeros_like(parts.gyro_x)
    by_turn = np.column_stack([none, none, parts.gyro_y, -parts.gyro_x])
    by_index = np.column_stack([parts.accel_y, parts.accel_x, parts.gyro_y, parts.gyro_x])
    return np.asarray(np.stack([by_turn, by_index / 2.0]))


def scale_of_logs(log: Integers) -> Shared:
    """Part of s that the stations of a log share, from the number [n] of the log of each."""
    return Shared(group="log", effect="scale", level=log, loading=np.ones((log.size, 1)), unit="1")
