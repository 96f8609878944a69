"""A gyro of another physics than any fitted model: heat diffuses through a wound coil between case
and hub, and each layer has its own Shupe weight.

Soaks of 30 minutes do not settle every coil. Logs start at rest, or as the log before ended.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from calibkit.simulate import noise
from calibkit.simulate.chamber import Chamber, Programme

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

STEP_S = 5.0
NODES = 36
BLOCK_S = 60
"""Means that the limit of the noise is computed from."""
FINER = 8
"""Samples of flicker noise per such mean: with 100 its variogram is 2 % lower."""
REFERENCE_DEGC = 25.0
RATES = (1.0, 5.0, 8.0, 10.0)
SOAK_S = 1800.0
STATIC = (0.3, 0.12, 0.05, 0.02)
"""Standard deviations of the static powers [°/h]."""
QUADRUPOLE = (1.0, -1.0, -1.0, 1.0)
DRIFT_DPH = (0.2, 0.4)
"""Smallest and largest rms of a plain gyro's drift on ramps of ±5 °C/min."""


@dataclass(frozen=True)
class Coil:
    """One gyro: heat, weights and noise."""

    case_lag_s: float
    diffusion_s: float
    """Thickness of the coil squared over its diffusivity."""
    hub_lag_s: float
    weights: tuple[float, ...]
    """Drift of each layer, outermost first [°/h per °C/min]."""
    per_degc: float
    """Relative growth of the weights per °C above 25 °C."""
    static: tuple[float, ...]
    """Powers 1 … 4 of (mean coil temperature − 25 °C)/50 °C [°/h]."""
    turn_on_dph: float = 0.02
    walk: float = 0.006
    """Angle random walk [°/√h]."""
    flicker_dph: float = 0.001
    hysteresis_dph: float = 0.0
    """Half the bias heating less cooling, far from turning points."""
    bump_dph: float = 0.0
    bump_degc: float = 0.0
    warm_up_dph: float = 0.0
    warm_up_s: float = 900.0
    resolution_degc: float = 0.0625
    reading_degc: float = 0.02
    mean_dph: float = 8.0


def draw(seed: int, kind: str = "plain") -> Coil:
    """A gyro with 8 to 12 layers; `kind` adds or scales a part."""
    rng = np.random.default_rng([seed, 17])
    layers = int(rng.integers(8, 13))
    depth = np.linspace(-1.0, 1.0, layers)
    pattern = np.resize(QUADRUPOLE, layers)
    weights = (
        rng.normal(0.0, 0.015, layers)
        + rng.normal(0.0, 0.015) * depth
        + rng.normal(0.0, 0.01) * pattern
        + rng.normal(0.0, 0.004)
    )
    static = rng.normal(0.0, 1.0, 4) * STATIC
    coil = Coil(
        case_lag_s=rng.uniform(180.0, 480.0),
        diffusion_s=rng.uniform(1200.0, 4000.0),
        hub_lag_s=rng.uniform(900.0, 2500.0),
        weights=tuple(weights.tolist()),
        per_degc=rng.uniform(-0.004, 0.004),
        static=tuple(static.tolist()),
        flicker_dph=rng.uniform(0.0005, 0.002),
    )
    small = float(rng.uniform(0.03, 0.3))
    bump_degc = float(rng.uniform(-25.0, 45.0))
    scale = {"none": 0.0, "weak": small}.get(kind, 1.0) * rng.uniform(*DRIFT_DPH) / _size(coil)
    coil = replace(
        coil,
        weights=tuple(scale * w for w in coil.weights),
        static=tuple(scale * s for s in coil.static),
    )
    changes = {
        "hysteresis": {"hysteresis_dph": 0.05},
        "strong hysteresis": {"hysteresis_dph": 0.2},
        "bump": {"bump_dph": 0.25, "bump_degc": bump_degc},
        "warm-up": {"warm_up_dph": 0.2},
    }
    return replace(coil, **changes.get(kind, {}))


def _size(coil: Coil) -> float:
    """Rms drift [°/h] on ramps of ±5 °C/min, each about its mean."""
    squares = []
    for way in (1, -1):
        ends = (-40.0, 60.0)[::way]
        soaks = {"soak_before_s": SOAK_S, "soak_after_s": SOAK_S}
        time, set_degc = Programme.ramp(*ends, 5.0, **soaks).set_points()
        coarse = np.arange(0.0, time[-1] + STEP_S, STEP_S)
        nodes = _layers(coil, np.interp(coarse, time, set_degc), np.full(NODES + 1, ends[0]))
        squares.append(np.var(_bias(coil, nodes, None)[0]))
    return float(np.sqrt(np.mean(squares)))


def _layers(coil: Coil, case: Array, start: Array) -> Array:
    """Coil nodes and hub [n, NODES + 1, °C] for a case temperature [n, °C] every STEP_S, implicit
    in time (backward Euler), from `start` [NODES + 1, °C]; the hub follows the case through its
    mounting, and is the inner end of the coil.
    """
    across = coil.diffusion_s
    r = STEP_S * NODES**2 / across
    matrix = np.zeros((NODES + 1, NODES + 1))
    for k in range(NODES):
        matrix[k, k] = 1.0 + 2.0 * r
        matrix[k, k + 1] = -r
        if k:
            matrix[k, k - 1] = -r
    hub = STEP_S / coil.hub_lag_s
    matrix[NODES, NODES] = 1.0 + hub
    inverse = np.linalg.inv(matrix)
    supply = inverse[:, 0] * r + inverse[:, NODES] * hub
    values, vectors = np.linalg.eig(inverse)
    back = np.linalg.inv(vectors)
    from scipy.signal import lfilter

    modes = np.empty((NODES + 1, case.size), dtype=complex)
    driven, begin = back @ supply, back @ start
    for k, value in enumerate(values):
        modes[k] = lfilter([driven[k]], [1.0, -value], case, zi=[value * begin[k]])[0]
    return np.asarray((vectors @ modes).T.real, dtype=np.float64)


def _bias(coil: Coil, nodes: Array, state: float | None) -> tuple[Array, Array, float]:
    """Drift [n, °/h] of coil nodes against rest at 25 °C, the terms [n, layers + 4] of a plain
    gyro, and the last state of the play operator.
    """
    inside = nodes[:, :NODES]
    place = (np.arange(len(coil.weights)) + 0.5) / len(coil.weights) * NODES - 0.5
    low = np.clip(place.astype(int), 0, NODES - 2)
    share = place - low
    layer = inside[:, low] * (1.0 - share) + inside[:, low + 1] * share
    rate = np.gradient(layer, STEP_S, axis=0) * 60.0
    above = layer - REFERENCE_DEGC
    mean = inside.mean(axis=1)
    z = (mean - REFERENCE_DEGC) / 50.0
    powers = z[:, None] ** np.arange(1, 5)
    terms = np.column_stack([rate * (1.0 + coil.per_degc * above), powers])
    drift = terms @ np.array([*coil.weights, *coil.static])
    if coil.bump_dph:
        drift += coil.bump_dph * (
            np.exp(-0.5 * ((mean - coil.bump_degc) / 6.0) ** 2)
            - math.exp(-0.5 * ((REFERENCE_DEGC - coil.bump_degc) / 6.0) ** 2)
        )
    last = REFERENCE_DEGC if state is None else state
    if coil.hysteresis_dph:
        width, followed = 8.0, np.empty(mean.size)
        for k, value in enumerate(mean.tolist()):
            last = min(max(last, value - width), value + width)
            followed[k] = last
        drift += coil.hysteresis_dph * (mean - followed) / width
    return drift, terms, last


@dataclass(frozen=True)
class Recorded:
    """One log at 1 Hz: what is read, the true drift [n, °/h], the terms [n, layers + 4] that it is
    the sum of, and the state (case, nodes, play) at the end.
    """

    time: Array
    case: Array
    env: Array
    indication: Array
    drift: Array
    terms: Array
    turn_on_dph: float
    last: tuple[float, Array, float | None]

    def frame(self, every: int = 1) -> pd.DataFrame:
        """What is logged, or every so many-th row of it."""
        import pandas as pd

        columns = {
            "time_s": self.time,
            "temp_case_degc": self.case,
            "temp_env_degc": self.env,
            "gyro_dph": self.indication,
        }
        return pd.DataFrame({name: values[::every] for name, values in columns.items()})


def record(
    coil: Coil,
    programme: Programme,
    rng: np.random.Generator,
    start: tuple[float, Array, float | None] | None = None,
) -> Recorded:
    """Log of a programme from a state, or from rest at its first set point."""
    from scipy.signal import lfilter

    time, set_degc = programme.set_points()
    air = Chamber().air(set_degc, rng)
    first = float(set_degc[0])
    case0, nodes0, play = start or (first, np.full(NODES + 1, first), None)
    keep = math.exp(-1.0 / coil.case_lag_s)
    case = lfilter([1.0 - keep], [1.0, -keep], air, zi=[keep * case0])[0]
    coarse = np.arange(0.0, time[-1] + STEP_S, STEP_S)
    nodes = _layers(coil, np.interp(coarse, time, case), nodes0)
    drift, terms, play = _bias(coil, nodes, play)
    own = np.interp(time, coarse, drift)
    if coil.warm_up_dph:
        own = own + coil.warm_up_dph * np.exp(-time / coil.warm_up_s)
    turn_on = float(rng.normal(0.0, coil.turn_on_dph))
    indication = (
        coil.mean_dph
        + turn_on
        + own
        + noise.angle_random_walk(coil.walk, time.size, rng)
        + noise.flicker(coil.flicker_dph, time.size, rng)
    )
    return Recorded(
        time,
        noise.reading(case, coil.resolution_degc, coil.reading_degc, rng),
        Chamber().air_reading(air, rng),
        indication,
        own,
        np.column_stack([np.interp(time, coarse, term) for term in terms.T]),
        turn_on,
        (float(case[-1]), nodes[-1], play),
    )


def means(values: Array, size: int = BLOCK_S) -> Array:
    """Means over groups of that size; the rest is left out."""
    whole = values.shape[0] // size * size
    return np.asarray(values[:whole].reshape(-1, size, *values.shape[1:]).mean(axis=1))


def campaign(
    coil: Coil,
    seed: int,
    *,
    rates: tuple[float, ...] = RATES,
    ways: tuple[int, ...] = (1, -1),
    soak_s: float = SOAK_S,
    cycled: bool = False,
) -> dict[str, Recorded]:
    """Heating and cooling logs at each rate, which start at rest; `cycled`: each starts as the log
    before ended.
    """
    logs: dict[str, Recorded] = {}
    state = None
    for rate in rates:
        for way in ways:
            ends = (-40.0, 60.0)[::way]
            programme = Programme.ramp(*ends, rate, soak_before_s=soak_s, soak_after_s=soak_s)
            rng = np.random.default_rng([seed, 23, round(10 * rate), way + 1])
            name = f"{'heating' if way > 0 else 'cooling'}_{rate:g}"
            logs[name] = record(coil, programme, rng, state)
            state = logs[name].last if cycled else None
    return logs


def unseen_programmes(seed: int) -> dict[str, Programme]:
    """Eight programmes that are not fitted: ±2, ±3, ±6 °C/min, a mission of ramps and soaks, and a
    sine of six hours.
    """
    programmes = {
        f"{'heating' if way > 0 else 'cooling'}_{rate:g}": Programme.ramp(
            *(-40.0, 60.0)[::way], rate, soak_before_s=SOAK_S, soak_after_s=SOAK_S
        )
        for rate in (2.0, 3.0, 6.0)
        for way in (1, -1)
    }
    rng = np.random.default_rng([seed, 29])
    corners, times = [25.0], [0.0]
    for degc in (-30.0, 10.0, 55.0, 20.0, -10.0, 40.0):
        times += [times[-1] + 900.0]
        times += [times[-1] + abs(degc - corners[-1]) / rng.uniform(1.5, 7.0) * 60.0]
        corners += [corners[-1], degc]
    programmes["mission"] = Programme((*times, times[-1] + 900.0), (*corners, corners[-1]), 0.0)
    t = np.arange(0.0, 6.0 * 3600.0 + 60.0, 60.0)
    sine = 10.0 + 45.0 * np.sin(2.0 * np.pi * t / (6.0 * 3600.0))
    programmes["sine"] = Programme(tuple(t.tolist()), tuple(sine.tolist()), 0.0)
    return programmes


def unseen(coil: Coil, seed: int) -> dict[str, Recorded]:
    """Logs of the programmes that are not fitted, each from rest."""
    return {
        name: record(coil, programme, np.random.default_rng([seed, 31, k]))
        for k, (name, programme) in enumerate(unseen_programmes(seed).items())
    }


def flicker_covariance(count: int) -> Array:
    """Covariance [count, count] of successive means of flicker noise of level 1, that starts with
    the log.
    """
    from scipy.linalg import toeplitz

    lags = np.arange(1, count * FINER)
    response = np.concatenate(([1.0], np.cumprod((lags - 0.5) / lags)))
    # what each white sample has added to the integral of the flicker noise by the end of each mean
    integral = toeplitz(np.cumsum(response), np.zeros(count * FINER))[FINER - 1 :: FINER]
    loadings = np.diff(integral, axis=0, prepend=0.0) / FINER
    return np.asarray(loadings @ loadings.T)


def noise_limit(coil: Coil, fitted: dict[str, Recorded], judged: dict[str, Recorded]) -> Array:
    """Reduction of the drift [logs] that the noise of the fitted logs allows to a model that knows
    the physics, its temperatures, and how large each weight may be.
    """
    layers = len(coil.weights)
    sizes = np.array([np.std(coil.weights)] * layers + list(STATIC))
    precision = np.diag(np.concatenate([[0.0], sizes**-2.0, np.full(len(fitted), 2500.0)]))
    right = np.zeros(precision.shape[0])
    for k, log in enumerate(fitted.values()):
        terms, indication = means(log.terms), means(log.indication)
        columns = np.zeros((indication.size, precision.shape[0]))
        columns[:, 0] = columns[:, 1 + sizes.size + k] = 1.0
        columns[:, 1 : 1 + sizes.size] = terms
        covariance = (coil.walk * 60.0) ** 2 / BLOCK_S * np.eye(indication.size)
        covariance += coil.flicker_dph**2 * flicker_covariance(indication.size)
        weighted = np.linalg.solve(covariance, columns)
        precision += columns.T @ weighted
        right += weighted.T @ indication
    weights = np.linalg.solve(precision, right)[1 : 1 + sizes.size]
    return np.array(
        [np.std(log.drift) / np.std(log.drift - log.terms @ weights) for log in judged.values()]
    )


def drift_at_rest(coil: Coil, degc: float) -> float:
    """True drift at rest [°/h] against 25 °C, in the middle of any hysteresis."""
    z = (degc - REFERENCE_DEGC) / 50.0
    found = float(np.polynomial.polynomial.polyval(z, [0.0, *coil.static]))
    if coil.bump_dph:
        found += coil.bump_dph * (
            math.exp(-0.5 * ((degc - coil.bump_degc) / 6.0) ** 2)
            - math.exp(-0.5 * ((REFERENCE_DEGC - coil.bump_degc) / 6.0) ** 2)
        )
    return found
