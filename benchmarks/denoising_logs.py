"""Denoising of whole logs, soaks and ramp ends included, against what else is used: least error by
simulated truth.

    python benchmarks/denoising_logs.py [gyros [first seed]]

Each gyro's true drift on ±1, ±5, ±10 °C/min with white and flicker noise, 1 Hz. Every method has
one setting for all logs, which is the best of its list on other gyros. Printed: rms error [°/h]
over all logs, in the first and last ten minutes, and speed over that of PyWavelets. Exit code 1
where another method has less error than calibkit's default, or this is not 15 % below the
denoising of each segment by itself.
"""

from __future__ import annotations

import sys
import time
from functools import partial
from typing import TYPE_CHECKING

import lumped_gyro
import numpy as np

import calibkit
from calibkit.simulate import noise

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

RATES = (1.0, 5.0, 10.0)
SOAK_BEFORE = 600
ENDS = 600
CHOSEN_ON = range(85_000, 85_006)
FIRST_SEED = 86_000
TURNS = 3
DEFAULT = "calibkit, log in one piece"
SEGMENTS = "calibkit, each segment"


def whole(signal: Array, cuts: list[int]) -> Array:  # noqa: ARG001 (as every method)
    """What a fit does."""
    return calibkit.denoise(signal).signal


def segments(signal: Array, cuts: list[int]) -> Array:
    """Each soak and ramp by itself."""
    return np.concatenate([calibkit.denoise(part).signal for part in np.split(signal, cuts)])


def pywavelets(signal: Array, cuts: list[int], level: int) -> Array:  # noqa: ARG001
    """Universal soft threshold over all levels of bior4.4."""
    import pywt

    coarse, *details = pywt.wavedec(signal, "bior4.4", level=level)
    sigma = np.median(np.abs(details[-1])) / 0.6745
    limit = sigma * np.sqrt(2.0 * np.log(signal.size))
    shrunk = [pywt.threshold(detail, limit, "soft") for detail in details]
    return pywt.waverec([coarse, *shrunk], "bior4.4")[: signal.size]


def savitzky_golay(signal: Array, cuts: list[int], width: int) -> Array:  # noqa: ARG001
    """Cubic."""
    from scipy.signal import savgol_filter

    return savgol_filter(signal, width, 3)


def kalman(signal: Array, cuts: list[int], ratio: float) -> Array:  # noqa: ARG001
    """Smoother of a level with a slope that walks: the penalised least squares it is equal to."""
    from scipy.linalg import solveh_banded

    n = signal.size
    band = np.zeros((3, n))
    band[2] = 1.0 + ratio * np.r_[1.0, 5.0, np.full(n - 4, 6.0), 5.0, 1.0]
    band[1, 1:] = ratio * np.r_[-2.0, np.full(n - 3, -4.0), -2.0]
    band[0, 2:] = ratio
    return solveh_banded(band, signal)


def moving_average(signal: Array, cuts: list[int], width: int) -> Array:  # noqa: ARG001
    """Centred; the ends with what there is."""
    total = np.concatenate([[0.0], np.cumsum(signal)])
    row = np.arange(signal.size)
    first, last = np.maximum(row - width // 2, 0), np.minimum(row + width // 2 + 1, signal.size)
    return (total[last] - total[first]) / (last - first)


SETTINGS: dict[str, tuple[Callable[..., Array], tuple[float, ...]]] = {
    DEFAULT: (whole, ()),
    SEGMENTS: (segments, ()),
    "PyWavelets": (pywavelets, (6, 7, 8, 9)),
    "Savitzky–Golay": (savitzky_golay, (401, 601, 901, 1201, 1801)),
    "Kalman smoother": (kalman, (1e6, 1e7, 1e8, 1e9)),
    "moving average": (moving_average, (101, 201, 301, 451, 601)),
}


def logs(seed: int) -> Iterator[tuple[Array, Array, list[int]]]:
    """True drift [n, °/h], its noisy indication [n, °/h] and the ends of soak and ramp [rows]."""
    device = lumped_gyro.LumpedGyro.draw(seed)
    for name, log in lumped_gyro.record(device, lumped_gyro.ramps(RATES), seed).items():
        rate = float(name.removesuffix(".csv").rsplit("_", 1)[1])
        rng = np.random.default_rng([seed, *name.encode()])
        size = log.drift.size
        noisy = noise.angle_random_walk(lumped_gyro.ANGLE_RANDOM_WALK, size, rng)
        noisy += noise.flicker(device.flicker_dph, size, rng)
        yield log.drift, log.drift + noisy, [SOAK_BEFORE, SOAK_BEFORE + round(6000.0 / rate)]


def judged(acts: dict[str, Callable[..., Array]], seeds: range) -> dict[str, tuple[Array, float]]:
    """Rms errors [2, °/h] over whole logs and at their ends, and the seconds taken, the least of
    TURNS on each log.
    """
    squares: dict[str, list[tuple[float, float]]] = {name: [] for name in acts}
    taken = dict.fromkeys(acts, 0.0)
    for seed in seeds:
        for truth, signal, cuts in logs(seed):
            for name, act in acts.items():
                turns = []
                for _ in range(TURNS):
                    start = time.process_time()
                    error = act(signal, cuts) - truth
                    turns.append(time.process_time() - start)
                taken[name] += min(turns)
                ends = np.concatenate([error[:ENDS], error[-ENDS:]])
                squares[name].append((np.mean(error**2), np.mean(ends**2)))
    return {name: (np.sqrt(np.mean(own, axis=0)), taken[name]) for name, own in squares.items()}


def main() -> int:
    """Run and report."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    first = int(sys.argv[2]) if len(sys.argv) > 2 else FIRST_SEED
    acts, labels = {}, {}
    for name, (act, settings) in SETTINGS.items():
        tried = {f"{name} ({one:g})": partial(act, **_of(act, one)) for one in settings}
        errors = judged(tried or {name: act}, CHOSEN_ON)
        labels[name] = min(errors, key=lambda label, errors=errors: errors[label][0][0])
        acts[name] = tried.get(labels[name], act)
    found = judged(acts, range(first, first + count))
    reference = found["PyWavelets"][1]
    print(f"{count} gyros, {2 * len(RATES) * count} logs; rms error [°/h]")
    print("| method (setting chosen on other gyros) | error | at the ends | speed / PyWavelets |")
    print("|---|---|---|---|")
    for name, ((error, ends), taken) in found.items():
        print(f"| {labels[name]} | {error:.4f} | {ends:.4f} | {reference / taken:.2f} |")
    own = found[DEFAULT][0][0]
    others = [error[0] for name, (error, _) in found.items() if name != DEFAULT]
    return int(own > min(others) or own > 0.85 * found[SEGMENTS][0][0])


def _of(act: Callable[..., Array], value: float) -> dict[str, float]:
    """The one setting of a method, by name."""
    name = act.__code__.co_varnames[2]
    return {name: value if name == "ratio" else int(value)}


if __name__ == "__main__":
    sys.exit(main())
