"""What planned dwells will tell of a triad: information with the model and the shared errors of the
fit.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.fit.shared import known_effects
from calibkit.instruments.accelerometer import shared_errors
from calibkit.instruments.accelerometer.equation import Terms
from calibkit.instruments.accelerometer.numeric import k_factor
from calibkit.instruments.accelerometer.shared_errors import INDEX, Circumstances
from calibkit.numeric import attitude
from calibkit.numeric.exchange import Pool
from calibkit.numeric.information import Information, find_information, invert, stack
from calibkit.numeric.least_squares import polynomial
from calibkit.numeric.least_squares.components import Effect, Known

TILTS_DEG = (0.0, 30.0, 60.0, 90.0, 120.0, 150.0, 180.0)
TOOLFACES_DEG = (0.0, 45.0, 90.0, 135.0, 180.0, 225.0, 270.0, 315.0)
DECIMALS = 12
LEVELS = 9
"""Attitudes and temperatures of use at which an uncertainty is predicted."""
RESULTS = {"inclination": "deg", "toolface times sin(inclination)": "deg", "component": "g"}
"""Results that a plan predicts, with their units."""

Sizes = Mapping[tuple[str, str], Known]
"""(group, effect) → its standard deviation."""


@dataclass(frozen=True, slots=True)
class Dwells:
    """Planned or measured dwells."""

    spots: Array
    """Inclination and toolface [n, 2] [°]."""
    temperature: Array
    """[n] [°C]."""
    soak: Integers
    """[n], number of the soak."""
    hours: Array
    """[n], time since the first dwell [h]."""
    noise_g: float
    """Standard deviation of the mean of a dwell."""

    @property
    def gravity(self) -> Array:
        """Reference vectors [n, 3] [g] without what rounding leaves of a right angle."""
        return np.round(attitude.gravity_vector(self.spots[:, 0], self.spots[:, 1]), DECIMALS)


@dataclass(frozen=True, slots=True)
class Parameter:
    """One coefficient of a planned model."""

    model: str
    """Name of its model in the coefficient file."""
    name: str
    unit: str
    symbol: str
    """What its powers of temperature have in common."""
    power: int


@dataclass(frozen=True, slots=True)
class Model:
    """The model that will be fitted, over which temperatures, and the shared errors."""

    parameters: tuple[Parameter, ...]
    jacobian: Callable[[Array, Array], Array]
    """Vectors [n, 3] [g] and mapped temperatures [n] → derivatives [n, 3, p] of corrected vectors
    by the coefficients in powers of the mapped temperature: that of the fit.
    """
    range_degc: tuple[float, float]
    """Range of use, by which temperatures are mapped to [−1, 1]."""
    sizes: Sizes

    @property
    def order(self) -> int:
        """Highest power of temperature."""
        return max(one.power for one in self.parameters)

    def slopes(self, gravity: Array, temperature: Array) -> Array:
        """Derivatives [n, 3, p] of corrected vectors by the coefficients, of sensors close to their
        nominal scale.
        """
        low, high = self.range_degc
        mapped = (2.0 * temperature - low - high) / max(high - low, 1.0)
        return self.jacobian(gravity, mapped)

    def in_degrees(self, covariance: Array) -> Array:
        """Standard uncertainties [p] of the coefficients in powers of °C."""
        low, high = self.range_degc
        powers = polynomial.to_raw_powers(
            (low + high) / 2.0, max(high - low, 1.0) / 2.0, self.order
        )
        same = [[a.symbol == b.symbol for b in self.parameters] for a in self.parameters]
        power = [one.power for one in self.parameters]
        to_raw = np.where(same, np.asarray(powers, dtype=np.float64)[np.ix_(power, power)], 0.0)
        variance = np.einsum("ip,pq,iq->i", to_raw, covariance, to_raw)
        return np.asarray(np.sqrt(variance), dtype=np.float64)

    def effects(self, dwells: Dwells) -> list[Effect]:
        """Errors that the dwells share, with their sizes, as the fit will list them."""
        count = len(dwells.soak)
        tilt, roll = np.radians(dwells.spots).T
        one_log = np.zeros(count, dtype=np.int64)
        where = Circumstances(dwells.soak, dwells.hours, dwells.gravity, one_log, tilt, roll)
        along = np.broadcast_to(np.eye(3), (count, 3, 3))
        return known_effects(shared_errors.list_errors(where, along), self.sizes)

    def information(self, dwells: Dwells) -> Information:
        """Information of dwells."""
        design = self.slopes(dwells.gravity, dwells.temperature)
        return find_information(
            design.reshape(-1, design.shape[2]), dwells.noise_g, self.effects(dwells)
        )

    def pool(self, spots: Array, soaks: "Soaks", noise_g: float, base: Information | None) -> Pool:
        """Candidates of a design: each attitude of spots [c, 2] held at all soaks; the criterion is
        the mean variance of the inclination.
        """
        count, levels = len(spots), len(soaks.degc)
        dwells = soaks.hold(spots, noise_g)
        effects = [one for one in self.effects(dwells) if (one.group, one.effect) != INDEX]
        design = self.slopes(dwells.gravity, dwells.temperature)
        design = design.reshape(-1, design.shape[2])
        found = stack(design, noise_g, effects)
        rows, prior = found.rows, found.prior
        # rows of an attitude lie together: attitude by attitude, soak by soak
        parts = rows.reshape(count, 3 * levels, -1)
        own = np.einsum("crq,crs->cqs", parts, parts)
        index = self.sizes.get(INDEX)
        if index is not None and index.value > 0.0:
            tilt, roll = np.radians(dwells.spots).T
            moved = np.stack(shared_errors.angle_slopes(tilt, roll), axis=2).reshape(-1, 2)
            z = moved.reshape(count, 3 * levels, 2) / noise_g
            across = np.einsum("crk,crq->ckq", z, parts)
            inner = np.einsum("crk,crl->ckl", z, z) + np.eye(2) * index.value**-2.0
            own = own - np.einsum("ckq,ckl,cls->cqs", across, np.linalg.inv(inner), across)
        start = np.diag(prior)
        p = design.shape[1]
        if base is not None:
            start[:p, :p] += reduce_to_coefficients(base)
        target = np.zeros_like(start)
        target[:p, :p] = self.mean_square("inclination")
        return Pool(start, own, target)

    def use(self) -> tuple[Array, Array]:
        """Attitudes [m, 2] [°] and temperatures [m] [°C] in the range of use."""
        tilts = [(tilt, roll) for tilt in TILTS_DEG[1:-1] for roll in TOOLFACES_DEG]
        spots = np.array([(0.0, 0.0), *tilts, (180.0, 0.0)])
        levels = np.linspace(*self.range_degc, LEVELS)
        return np.tile(spots, (LEVELS, 1)), np.repeat(levels, len(spots))

    def result_slopes(self, result: str) -> Array:
        """Derivatives [m, p] of a result by the coefficients where it is used."""
        spots, temperature = self.use()
        gravity = attitude.gravity_vector(spots[:, 0], spots[:, 1])
        vector = self.slopes(gravity, temperature)
        if result == "component":
            return vector.reshape(-1, vector.shape[2])
        up, across = shared_errors.angle_slopes(*np.radians(spots).T)
        along = up if result == "inclination" else across
        return np.asarray(np.degrees(np.einsum("ni,nip->np", along, vector)), dtype=np.float64)

    def mean_square(self, result: str) -> Array:
        """Mean product [p, p] of the derivatives of a result where it is used."""
        slopes = self.result_slopes(result)
        return np.asarray(slopes.T @ slopes / len(slopes), dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Soaks:
    """Soaks of a campaign in their order; each mounting has all of them."""

    degc: tuple[int, ...]
    start_h: tuple[float, ...]
    """Middle of the dwells of each soak [h]."""
    mounting: Integers
    """[c], number of the mounting of each attitude."""

    def hold(self, spots: Array, noise_g: float) -> Dwells:
        """Dwells at attitudes [c, 2], all soaks of an attitude together."""
        count, levels = len(spots), len(self.degc)
        soak = np.arange(levels) + levels * self.mounting[:, None]
        cycle = self.start_h[-1] + 1.0
        hours = np.array(self.start_h) + cycle * self.mounting[:, None]
        return Dwells(
            np.repeat(spots, levels, axis=0),
            np.tile(np.array(self.degc, dtype=np.float64), count),
            soak.ravel(),
            hours.ravel(),
            noise_g,
        )


def k_model(
    fitted: Sequence[tuple[int, ...]],
    named: Sequence[tuple[str, Sequence[str]]],
    range_degc: tuple[float, float],
    sizes: Sizes,
) -> Model:
    """K-factor with the coefficients of each axis at the given indices; `named` are the name of its
    model and the units of its ten coefficients.
    """
    ends = np.cumsum([0, *map(len, fitted)]).tolist()

    def jacobian(gravity: Array, mapped: Array) -> Array:
        found = np.zeros((len(gravity), 3, ends[-1]))
        for i, numbers in enumerate(fitted):
            found[:, i, ends[i] : ends[i + 1]] = k_factor.columns(gravity, mapped, i, numbers)
        return found

    def parameter(model: str, k: int, unit: str) -> Parameter:
        power = k % 4 if k < 8 else 0
        return Parameter(model, k_factor.NAMES[k], unit, f"{model} {k - power}", power)

    listed = [
        parameter(model, k, units[k])
        for numbers, (model, units) in zip(fitted, named, strict=True)
        for k in numbers
    ]
    return Model(tuple(listed), jacobian, range_degc, sizes)


def triad(terms: Terms, range_degc: tuple[float, float], sizes: Sizes) -> Model:
    """The triad over temperature with some terms."""

    def jacobian(gravity: Array, mapped: Array) -> Array:
        return terms.slopes(terms.nominal, gravity, mapped)

    listed = [Parameter("triad", t.name, t.unit, t.symbol, t.power) for t in terms.listed]
    return Model(tuple(listed), jacobian, range_degc, sizes)


def reduce_to_coefficients(found: Information) -> Array:
    """Information [p, p] on the coefficients alone, all other errors averaged over."""
    whole = found.data + np.diag(found.prior)
    p = int(np.sum(found.source < 0))
    inner = whole[p:, p:]
    if not len(inner):
        return whole
    return np.asarray(whole[:p, :p] - whole[:p, p:] @ invert(inner) @ whole[p:, :p])


def spread_apart(spots: Array, taken: Sequence[int], count: int) -> list[int]:
    """Attitudes [count] of spots [c, 2] that lie farthest from those that are taken."""
    gravity = attitude.gravity_vector(spots[:, 0], spots[:, 1])
    chosen, near = [], (gravity @ gravity[list(taken)].T).max(axis=1)
    for _ in range(min(count, len(spots) - len(taken))):
        chosen.append(int(np.argmin(np.round(near, 9))))
        near = np.maximum(near, gravity @ gravity[chosen[-1]])
    return chosen
