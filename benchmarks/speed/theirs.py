"""What the peers do, as their users would write it; each function runs in the peer's own
environment.

A side gets arrays and settings, and returns what is timed and what makes comparable arrays of its
result.
"""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    Array = np.ndarray[Any, Any]
    Answer = dict[str, Array]
    Prepared = tuple[Callable[[], Any], Callable[[Any], Answer]]


def write_log(
    time_s: Array, temp_case_degc: Array, temp_env_degc: Array, gyro_dph: Array, *, path: str
) -> Prepared:
    """Write a log of four decimals; nothing to compare."""
    import polars as pl

    columns = {
        "time_s": time_s,
        "temp_case_degc": temp_case_degc,
        "temp_env_degc": temp_env_degc,
        "gyro_dph": gyro_dph,
    }
    frame = pl.DataFrame(columns)
    return (lambda: frame.write_csv(path, float_precision=4)), lambda _: {}


def read_log(*, path: str) -> Prepared:
    """Polars: a comma-separated log into a frame."""
    import polars as pl

    def answer(frame: Any) -> Answer:  # noqa: ANN401 polars is not where this is checked
        return {name: _digest(frame[name].to_numpy()) for name in frame.columns}

    return (lambda: pl.read_csv(path)), answer


def _digest(column: Array) -> Array:
    """Digest of a column's numbers, bit for bit."""
    return np.frombuffer(
        hashlib.sha256(np.ascontiguousarray(column, dtype="<f8").tobytes()).digest(), np.uint8
    )


def denoise(signal: Array, *, levels: int, inside: list[list[int]]) -> Prepared:
    """PyWavelets: CDF 9/7, universal thresholds by the noise of every level, soft, the ends
    mirrored.

    The noise is told from the details `inside`, which are those whose filter lies wholly on the
    signal.
    """
    import pywt

    def run() -> Array:
        margin = pywt.Wavelet("bior4.4").dec_len << levels
        wide = np.pad(signal, margin, "reflect")
        parts = pywt.wavedec(wide, "bior4.4", mode="periodization", level=levels)
        for j, (low, high) in enumerate(inside):
            detail, first = parts[-1 - j], margin >> (j + 1)
            noise = np.median(np.abs(detail[first + low : first + high])) / 0.6745
            parts[-1 - j] = pywt.threshold(
                detail, noise * np.sqrt(2.0 * np.log(signal.size)), mode="soft"
            )
        rebuilt = pywt.waverec(parts, "bior4.4", mode="periodization")
        return np.asarray(rebuilt[margin : margin + signal.size])

    return run, lambda result: {"signal": result}


def linear(gradient: Array, increment: Array) -> Prepared:
    """numpy: a0 + a1 G + a2 G² by lstsq."""

    def run() -> Array:
        design = np.column_stack([np.ones_like(gradient), gradient, gradient**2])
        return np.linalg.lstsq(design, increment, rcond=None)[0]

    return run, lambda found: {"coefficients": found}


def accelerometer_k(indication: Array, temperature: Array, reference: Array) -> Prepared:
    """numpy: ten terms an axis by lstsq, temperature mapped to [−1, 1] so that its cube loses no
    digits.
    """
    crosses = ((1, 2), (2, 0), (0, 1))

    def run() -> Array:
        low, high = temperature.min(), temperature.max()
        powers = np.vander(
            (temperature - (high + low) / 2.0) / ((high - low) / 2.0), 4, increasing=True
        )
        found = []
        for axis, (one, other) in enumerate(crosses):
            own = indication[:, axis, None] * powers
            design = np.column_stack([own, -powers, -indication[:, one], -indication[:, other]])
            found.append(np.linalg.lstsq(design, reference[:, axis], rcond=None)[0])
        return np.array(found)

    return run, lambda found: {"coefficients": found}


def magnitude(indication: Array) -> Prepared:
    """lmfit: nine parameters of a triad from the length of gravity, by leastsq with its own
    tolerances.
    """
    import lmfit

    rows, columns = (0, 1, 1, 2, 2, 2), (0, 0, 1, 0, 1, 2)

    def residuals(parameters: Any) -> Array:  # noqa: ANN401 lmfit has no types
        values = np.array([parameters[name].value for name in parameters])
        matrix = np.zeros((3, 3))
        matrix[rows, columns] = values[:6]
        corrected = (indication - values[6:]) @ matrix.T
        return np.sqrt(np.einsum("ij,ij->i", corrected, corrected)) - 1.0

    def run() -> Any:  # noqa: ANN401 lmfit has no types
        start = lmfit.Parameters()
        for i, j in zip(rows, columns, strict=True):
            start.add(f"t{i}{j}", value=float(i == j))
        for i in range(3):
            start.add(f"b{i}", value=0.0)
        return lmfit.minimize(residuals, start)

    return run, lambda found: {
        "parameters": np.array([found.params[name].value for name in found.params])
    }


def mad(values: Array) -> Prepared:
    """numpy: standard deviation of noise by the median absolute value."""
    return (lambda: np.median(np.abs(values)) / 0.6745), lambda found: {"sigma": np.array([found])}


def allan(rate: Array, *, hertz: float) -> Prepared:
    """allantools: overlapping Allan deviation at octaves, with the error that it gives."""
    import allantools

    factors = 2 ** np.arange(int(np.log2(rate.size // 3)) + 1)

    def run() -> Any:  # noqa: ANN401 allantools has no types
        return allantools.oadev(rate, rate=hertz, data_type="freq", taus=factors / hertz)

    names = ("tau", "deviation", "error")
    return run, lambda found: {
        name: np.asarray(part) for name, part in zip(names, found, strict=False)
    }


def allan_limits(rate: Array, *, hertz: float, factor: int) -> Prepared:
    """allantools: 95 % limits of one deviation by the degrees of freedom of white noise, put
    together by hand.
    """
    import allantools

    def run() -> Any:  # noqa: ANN401 allantools has no types
        deviation = allantools.oadev(rate, rate=hertz, data_type="freq", taus=[factor / hertz])[1][
            0
        ]
        dof = allantools.edf_greenhall(alpha=0, d=2, m=factor, N=rate.size + 1, overlapping=True)
        return allantools.confidence_interval(deviation, dof, ci=0.95)

    return run, lambda found: {"limits": np.asarray(found)}


def turntable(still: Array, turned: Array, *, hertz: float, angle_deg: float) -> Prepared:
    """imucal: six positions and three turns; still [6, n, 6] and turned [3, n, 6], accelerometers
    [g] then gyros [°/s].
    """
    import imucal

    names = ("x_p", "x_a", "y_p", "y_a", "z_p", "z_a")
    regions = {f"acc_{name}": still[k, :, :3] for k, name in enumerate(names)}
    regions |= {f"gyr_{name}": still[k, :, 3:] for k, name in enumerate(names)}
    regions |= {f"acc_{axis}_rot": turned[k, :, :3] for k, axis in enumerate("xyz")}
    regions |= {f"gyr_{axis}_rot": turned[k, :, 3:] for k, axis in enumerate("xyz")}
    calibration = imucal.FerrarisCalibration(grav=1.0, expected_angle=angle_deg)
    held = imucal.FerrarisSignalRegions(**regions)

    def run() -> Any:  # noqa: ANN401 imucal is not where this is checked
        return calibration.compute(held, hertz, from_acc_unit="m/s^2", from_gyr_unit="deg/s")

    def answer(found: Any) -> Answer:  # noqa: ANN401 imucal is not where this is checked
        return {
            "accelerometer_matrix": found.K_a @ found.R_a,
            "accelerometer_bias": found.b_a,
            "gyro_matrix": found.K_g @ found.R_g,
            "gyro_bias": found.b_g,
        }

    return run, answer
