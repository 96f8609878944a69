"""What calibkit does on the same data: the functions that its procedures call.

A side gets arrays and settings, and returns what is timed and what makes comparable arrays of its
result.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from calibkit.instruments.accelerometer.triad import Triad
    from calibkit.numeric.noise.allan import DeviationCurve
    from calibkit.readers.table import Table

    Array = NDArray[np.float64]
    Answer = dict[str, NDArray[Any]]
    Prepared = tuple[Callable[[], Any], Callable[[Any], Answer]]


def read_log(*, path: str) -> Prepared:
    """A comma-separated log into a frame, every field counted, with the digest of its bytes."""
    import pandas as pd

    from calibkit.readers import clean

    del pd  # loaded now rather than in the call that is weighed

    def run() -> Table:
        table = clean.read(Path(path), "log.csv")
        if table is None:
            raise ValueError("not a clean log")
        return table

    def answer(table: Table) -> Answer:
        if table.sha256 != hashlib.sha256(Path(path).read_bytes()).hexdigest():
            raise ValueError("the digest is not that of the file")
        return {str(name): _digest(table.frame[name].to_numpy()) for name in table.frame.columns}

    return run, answer


def _digest(column: Array) -> NDArray[np.uint8]:
    """Digest of a column's numbers, bit for bit."""
    return np.frombuffer(
        hashlib.sha256(np.ascontiguousarray(column, dtype="<f8").tobytes()).digest(), np.uint8
    )


def denoise(signal: Array, *, levels: int, inside: list[list[int]]) -> Prepared:
    """Lifting CDF 9/7, universal thresholds by the noise of every level, soft, the ends mirrored
    as the peer mirrors them.
    """
    from calibkit.numeric.wavelet import denoise as stage

    del inside  # found by the stage itself

    def run() -> Array:
        return stage.denoise(
            signal,
            wavelet="cdf97",
            levels=levels,
            rule="soft",
            extension="symmetric",
            shifted=0,
        ).signal

    return run, lambda result: {"signal": result}


def linear(gradient: Array, increment: Array) -> Prepared:
    """a0 + a1 G + a2 G², with rank and condition, in the memory of a block."""
    from calibkit.numeric.least_squares import fit, polynomial

    def run() -> Array:
        design, to_raw = polynomial.mapped_powers(gradient, 2)
        return np.asarray(to_raw @ fit.linear_in_blocks(design, increment), dtype=np.float64)

    return run, lambda coefficients: {"coefficients": coefficients}


def accelerometer_k(indication: Array, temperature: Array, reference: Array) -> Prepared:
    """K-factor of three axes, with covariance, residuals and the check that attitudes and
    temperatures determine it.
    """
    from calibkit.instruments.accelerometer import determination, published
    from calibkit.instruments.accelerometer.equation import name_terms
    from calibkit.numeric.least_squares import fit, polynomial

    terms, conditions = name_terms((3,) * 3, (3,) * 3, (0,) * 3), (reference, temperature)

    def run() -> list[fit.LinearFit]:
        determination.find_undetermined(terms, *conditions)
        middle, half = polynomial.middle_and_half(temperature)
        t = (temperature - middle) / half
        return [
            fit.linear(published.columns(indication, t, axis), reference[:, axis])
            for axis in range(3)
        ]

    return run, lambda axes: {"coefficients": np.array([axis.coefficients for axis in axes])}


def magnitude(indication: Array) -> Prepared:
    """Nine parameters of a triad from the length of gravity."""
    from scipy import stats

    del stats  # loaded now rather than in the call that is weighed

    def answer(triad: Triad) -> Answer:
        k, z, c = np.split(triad.fit.parameters, 3)
        matrix = np.diag(k)
        matrix[1, 0], matrix[2, 0], matrix[2, 1] = -c * k[[0, 0, 1]]
        return {"parameters": np.concatenate([matrix[np.tril_indices(3)], z / k])}

    return (lambda: _triad(indication, None)), answer


def _triad(indication: Array, angles: Array | None) -> Triad:
    """A triad at one temperature, at attitudes [n, 2] [°] or by the length of gravity."""
    from calibkit.instruments.accelerometer.dwells import DwellSet
    from calibkit.instruments.accelerometer.equation import name_terms
    from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
    from calibkit.instruments.accelerometer.triad import solve_triad

    count, unknown = len(indication), np.full(len(indication), np.nan)
    inclination, toolface = (unknown, unknown) if angles is None else angles.T
    dwells = DwellSet(
        indication,
        np.zeros(count),
        inclination,
        toolface,
        np.full((count, 3), np.nan),
        unknown,
        np.zeros(count, dtype=np.int64),
        ("",) * count,
        (),
    )
    kind = "magnitude" if angles is None else "attitude"
    tables = {"title": "", "logs": {"files": ["a.csv"]}, "reference": {"kind": kind}}
    spec = AccelerometerRecipe.model_validate({"procedure": "accelerometer"} | tables)
    terms = name_terms((0,) * 3, (0,) * 3, (0,) * 3, triangular=angles is None)
    return solve_triad(dwells, terms, spec, loss="least_squares")


def mad(values: Array) -> Prepared:
    """Standard deviation of noise by the median absolute value."""
    from calibkit.numeric.wavelet import shrinkage

    return (lambda: shrinkage.estimate_noise(values)), lambda found: {"sigma": np.array([found])}


def allan(rate: Array, *, hertz: float) -> Prepared:
    """Overlapping Allan deviation at octaves, with the noise type at each and its limits."""
    from scipy import stats

    from calibkit.numeric.noise import allan as core

    del stats  # loaded now rather than in the call that is weighed

    def answer(curve: DeviationCurve) -> Answer:
        error = curve.deviation / np.sqrt(curve.pairs)  # as the peer's, which knows no noise type
        return {"tau": curve.tau_s, "deviation": curve.deviation, "error": error}

    return (lambda: core.overlapping(rate, 1.0 / hertz)), answer


def turntable(still: Array, turned: Array, *, hertz: float, angle_deg: float) -> Prepared:
    """Six positions and three turns; still [6, n, 6] and turned [3, n, 6], accelerometers [g] then
    gyros [°/s].
    """
    faces = np.array([(90, 180), (90, 0), (90, 90), (90, -90), (0, 0), (180, 0)], dtype=float)

    def run() -> Answer:
        means = still.mean(axis=1)
        k, z, c = np.split(_triad(means[:, :3], faces).fit.parameters, [3, 6])
        cross = np.zeros((3, 3))
        cross[~np.eye(3, dtype=bool)] = c
        matrix, bias = (np.eye(3) - cross) * k, z / k
        up, down = means[0::2, 3:].T, means[1::2, 3:].T
        # Ferraris, Grimaldi & Parvis 1995, equation 9
        zero, by_gravity = (up + down).mean(axis=1) / 2.0, (up - down) / 2.0
        columns = []
        for log in turned:
            offset = zero + (log[:, :3] - bias) @ matrix.T @ by_gravity.T
            columns.append(np.sum(log[:, 3:] - offset, axis=0) / hertz / angle_deg)
        return {
            "accelerometer_matrix": np.linalg.inv(matrix),
            "accelerometer_bias": bias,
            "gyro_matrix": np.column_stack(columns),
            "gyro_bias": zero,
        }

    return run, lambda found: found
