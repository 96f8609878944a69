"""Accelerometers and gyros calibrated in six positions and on a turntable, by truth: imucal and
calibkit on the same samples.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from speed import pairs, peers
from speed.page import table

from truth.product import DATE, calibkit

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

FIRST_SEED = 84_200
EARTH_DPS = 15.041067 / 3600.0
LATITUDE_DEG = 34.2


class Unit:
    """A simulated inertial unit: affine accelerometers and gyros, the earth's rate included in what
    the gyros see.
    """

    HERTZ = 10.0
    RATES_DPS = (20.0, 50.0, 100.0, -20.0, -50.0, -100.0)
    HELD_S = 72.0
    """Whole turns at every rate."""
    STILL_S = 120.0
    SCALE_LSB = 10_000.0
    """Counts per second at 1 °/s."""
    NOISE_G, NOISE_DPS = 5e-5, 5e-4

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng([seed, 11])
        self.accel = np.eye(3) + self.rng.uniform(-3e-3, 3e-3, (3, 3))
        self.gyro = np.eye(3) + self.rng.uniform(-3e-3, 3e-3, (3, 3))
        self.accel_bias = self.rng.uniform(-5e-3, 5e-3, 3)
        self.gyro_bias = self.rng.uniform(-10.0, 10.0, 3) / 3600.0
        self.start_deg = self.rng.uniform(0.0, 360.0)

    def still(self, axis: int, sign: float) -> Array:
        """Samples [n, 6] at rest with an axis up (1) or down (−1), at a heading that is not
        known.
        """
        return self._logged(
            axis, sign, np.zeros(round(self.STILL_S * self.HERTZ)), self.rng.uniform(0.0, 360.0)
        )

    def turned(self, axis: int) -> tuple[Array, Array]:
        """Table rates [n] [°/s] and samples [n, 6] of a log with rests between the rates, an axis
        up.
        """
        rest, held = np.zeros(round(20.0 * self.HERTZ)), round(self.HELD_S * self.HERTZ)
        rates = np.concatenate(
            [rest, *(part for rate in self.RATES_DPS for part in (np.full(held, rate), rest))]
        )
        return rates, self._logged(axis, 1.0, rates, self.start_deg)

    def _logged(self, axis: int, sign: float, rates: Array, start_deg: float) -> Array:
        """Indications: accelerometers read +1 g upwards; a sample is the mean over its interval."""
        angle = np.radians(start_deg + np.cumsum(rates) / self.HERTZ - rates / self.HERTZ / 2.0)
        width = np.radians(np.abs(rates)) / self.HERTZ
        horizontal = EARTH_DPS * np.cos(np.radians(LATITUDE_DEG)) * np.sinc(width / (2.0 * np.pi))
        up, one, other = axis, (axis + 1) % 3, (axis + 2) % 3
        omega = np.zeros((rates.size, 3))
        omega[:, up] = sign * (rates + EARTH_DPS * np.sin(np.radians(LATITUDE_DEG)))
        omega[:, one], omega[:, other] = (
            horizontal * np.cos(angle),
            -sign * horizontal * np.sin(angle),
        )
        force = np.zeros((rates.size, 3))
        force[:, up] = sign
        noise = self.rng.normal(size=(rates.size, 6)) * np.array(
            [self.NOISE_G] * 3 + [self.NOISE_DPS] * 3
        )
        return (
            np.concatenate(
                [force @ self.accel.T + self.accel_bias, omega @ self.gyro.T + self.gyro_bias], 1
            )
            + noise
        )


def errors(found: Array, truth: Array) -> tuple[float, float]:
    """Worst error of scale factors [ppm] and of axes [µrad] of a matrix that is used in place of
    the true one.
    """
    off = (np.linalg.solve(found, truth) - np.eye(3)) * 1e6
    return float(np.max(np.abs(np.diag(off)))), float(np.max(np.abs(off - np.diag(np.diag(off)))))


def accelerometers(folder: Path, still: Array) -> tuple[Array, Array]:
    """Matrix and bias by the recipe `accelerometer` from the means of six positions."""
    from calibkit import api

    angles = ((90.0, 180.0), (90.0, 0.0), (90.0, 90.0), (90.0, -90.0), (0.0, 0.0), (180.0, 0.0))
    rows = [
        [25.0, *angle, *mean]
        for angle, mean in zip(angles, still[:, :, :3].mean(axis=1), strict=True)
    ]
    head = "temp_case_degc,inclination_deg,toolface_deg,accel_x_g,accel_y_g,accel_z_g"
    (folder / "accelerometer").mkdir()
    np.savetxt(
        folder / "accelerometer" / "positions.csv", rows, "%.10f", ",", header=head, comments=""
    )
    orders = [f"--set={key}=0" for key in ("k.scale_order", "k.zero_order")]
    orders += [f"--set=affine.{key}_order=0" for key in ("scale", "cross", "bias")]
    out = folder / "runs"
    orders += ["--set=loss=least_squares"]
    places = ("--data", folder / "accelerometer", "--serial", "A", "--out", out)
    calibkit("fit", "accelerometer", *places, *DATE, *orders)
    model = api.load_coefficients(out / "A" / "r001" / "accel_affine.json").model("triad")
    value = {entry.name: entry.value for entry in model.coefficients}
    matrix = np.array([[value[f"m_{i}{j}0"] for j in "xyz"] for i in "xyz"])
    return np.linalg.inv(matrix), np.array([value[f"b_{i}0"] for i in "xyz"])


def gyros(folder: Path, unit: Unit, logs: Sequence[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Sensitivities and bias [°/s] by the recipe `gyro_triad` from the logs of the table."""
    from calibkit import api

    (folder / "gyros").mkdir()
    for axis, (rates, samples) in zip("xyz", logs, strict=True):
        time_s = np.arange(1, rates.size + 1) / unit.HERTZ
        values = np.column_stack([time_s, rates, samples[:, 3:] * unit.SCALE_LSB])
        head = "time_s,table_rate_dps,gyro_x_lsb,gyro_y_lsb,gyro_z_lsb"
        np.savetxt(
            folder / "gyros" / f"about_{axis}.csv", values, "%.6f", ",", header=head, comments=""
        )
    site = f"--set=site.latitude_deg={LATITUDE_DEG}"
    calibkit(
        "fit",
        "gyro_triad",
        "--data",
        folder / "gyros",
        "--serial",
        "T",
        "--out",
        folder / "runs",
        *DATE,
        site,
    )
    model = api.load_coefficients(folder / "runs" / "T" / "r001" / "gyro_orthogonality.json").model(
        "triad"
    )
    value = {entry.name: entry.value / unit.SCALE_LSB for entry in model.coefficients}
    matrix = np.array([[value[f"S_{g}{a}"] for a in "xyz"] for g in "xyz"])
    return matrix, np.array([value[f"B_{g}"] for g in "xyz"])


def measured(units: int, environments: Path) -> str:
    """Table of worst errors of calibrations on a turntable, by truth."""
    found: dict[str, list[tuple[float, ...]]] = {"imucal 2.6.0 (packaged)": [], "calibkit": []}
    with pairs.Worker(peers.environment("imucal", environments), "theirs") as peer:
        for seed in range(FIRST_SEED, FIRST_SEED + units):
            unit = Unit(seed)
            still = np.array([unit.still(axis, sign) for axis in range(3) for sign in (1.0, -1.0)])
            logs = [unit.turned(axis) for axis in range(3)]
            with tempfile.TemporaryDirectory() as name:
                folder = Path(name)
                fastest = np.array(
                    [samples[rates == max(unit.RATES_DPS)] for rates, samples in logs]
                )
                np.save(folder / "still.npy", still)
                np.save(folder / "turned.npy", fastest)
                settings = {"hertz": unit.HERTZ, "angle_deg": max(unit.RATES_DPS) * unit.HELD_S}
                files = {key: str(folder / f"{key}.npy") for key in ("still", "turned")}
                peer.ask("load", side="turntable", files=files, settings=settings)
                peer.ask("once", times=1)
                theirs = pairs.answers(peer)
                ours = (*accelerometers(folder, still), *gyros(folder, unit, logs))
            names = ("accelerometer_matrix", "accelerometer_bias", "gyro_matrix", "gyro_bias")
            for key, values in (
                ("imucal 2.6.0 (packaged)", tuple(theirs[k] for k in names)),
                ("calibkit", ours),
            ):
                accel, accel_bias, gyro, gyro_bias = values
                found[key].append(
                    (
                        *errors(accel, unit.accel),
                        1e6 * float(np.max(np.abs(accel_bias - unit.accel_bias))),
                        *errors(gyro, unit.gyro),
                        3600.0 * float(np.max(np.abs(gyro_bias - unit.gyro_bias))),
                    )
                )
    rows = [
        [key, *(f"{value:.3g}" for value in np.max(values, axis=0))]
        for key, values in found.items()
    ]
    head = (
        "tool",
        "accelerometers: scale [ppm]",
        "axes [µrad]",
        "bias [µg]",
        "gyros: scale [ppm]",
        "axes [µrad]",
        "bias [°/h]",
    )
    what = (
        (
            f"{units} simulated inertial units on a turntable at latitude {LATITUDE_DEG}°: six"
            f" positions of {Unit.STILL_S:g} s, and"
        ),
        (
            "about each axis ±20, ±50, ±100 °/s for whole turns. The largest error over all units"
            " and axes, by truth. imucal is"
        ),
        "given the fastest rate, whole turns of it, which suits it best.",
    )
    return f"{' '.join(what)}\n\n{table(head, rows)}"
