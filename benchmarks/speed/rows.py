"""Rows of the table that run inside two workers: what is measured, on which data, beside which
peer, with which target.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.numeric import attitude
from calibkit.numeric.wavelet.lifting import clean_spans, find_wavelet
from speed.goals import Goal

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Data:
    """Arrays that both sides load, and what else they are told."""

    arrays: dict[str, Array]
    settings: dict[str, Any]
    rows: int
    """How many there are; near what was asked for."""


@dataclass(frozen=True, slots=True)
class Row:
    """A goal, and how both sides are given the same data."""

    goal: Goal
    side: str
    """Function of `ours` and `theirs`."""
    data: Callable[[int], Data]
    peer_rows: int = 10_000_000
    """The peer is not given more: it would take minutes a call."""


def _log(rows: int) -> Data:
    """Four columns of a gyro's log on a temperature ramp at 1 kHz, as a file that the worker of the
    peer writes.
    """
    rng = np.random.default_rng(1)
    time_s = np.arange(rows) * 0.001
    case = np.interp(time_s, (0.0, 0.1 * time_s[-1], 0.9 * time_s[-1]), (-40.0, -40.0, 60.0))
    columns = {
        "time_s": time_s,
        "temp_case_degc": case + rng.normal(0.0, 0.01, rows),
        "temp_env_degc": case + rng.normal(2.0, 0.05, rows),
        "gyro_dph": 7.5 + 0.02 * case + rng.normal(0.0, 18.0, rows),
    }
    return Data(columns, {}, rows)


def _ramp(rows: int) -> Data:
    """A drifting rate with white noise; as many samples as eight levels divide, and which details
    are free of the ends.
    """
    size = rows // 256 * 256
    rng = np.random.default_rng(2)
    phase = np.arange(size) / size
    signal = (
        np.sin(2.0 * np.pi * phase) + 0.3 * np.cos(6.0 * np.pi * phase) + rng.normal(0.0, 0.5, size)
    )
    clean = clean_spans(find_wavelet("cdf97"), size, 8)
    return Data(
        {"signal": signal}, {"levels": 8, "inside": [list(span) for span in clean[1:]]}, size
    )


def _gradients(rows: int) -> Data:
    """Temperature gradients [°C] of a ramp, and the increments of the drift that they cause
    [°/h].
    """
    rng = np.random.default_rng(3)
    gradient = 3.0 * np.sin(np.linspace(0.0, 9.0, rows)) + 4.0 + rng.normal(0.0, 0.05, rows)
    increment = 0.02 - 0.004 * gradient + 0.0007 * gradient**2 + rng.normal(0.0, 0.01, rows)
    return Data({"gradient": gradient, "increment": increment}, {}, rows)


def _dwells(rows: int) -> Data:
    """Indications of an accelerometer triad at attitudes all round and temperatures from −20 to 125
    °C.
    """
    rng = np.random.default_rng(4)
    reference = attitude.gravity_vector(
        np.degrees(np.arccos(rng.uniform(-1.0, 1.0, rows))), rng.uniform(-180, 180, rows)
    )
    temperature = rng.uniform(-20.0, 125.0, rows)
    share = (temperature - 25.0) / 100.0
    mixed = reference @ (np.eye(3) + rng.normal(0.0, 0.002, (3, 3)))
    indication = (
        mixed * (1.0 + 0.003 * share + 0.001 * share**2)[:, None]
        + 0.002 * (1.0 + share + share**3)[:, None]
    )
    indication += rng.normal(0.0, 2e-5, (rows, 3))
    return Data(
        {"indication": indication, "temperature": temperature, "reference": reference}, {}, rows
    )


def _lengths(rows: int) -> Data:
    """Indications of a triad at attitudes that nobody logged."""
    rng = np.random.default_rng(5)
    direction = rng.normal(size=(rows, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    indication = (
        direction @ np.array([[1.002, 0.0, 0.0], [0.003, 0.998, 0.0], [-0.002, 0.001, 1.001]]).T
    )
    indication += np.array([0.004, -0.003, 0.002]) + rng.normal(0.0, 1e-4, (rows, 3))
    return Data({"indication": indication}, {}, rows)


def _values(rows: int) -> Data:
    """Wavelet details: noise about zero, one in two hundred of a signal."""
    rng = np.random.default_rng(6)
    values = rng.normal(0.0, 1.0, rows)
    values[::200] += 50.0
    return Data({"values": values}, {}, rows)


def _record(rows: int) -> Data:
    """A static record at 100 Hz of white noise, flicker that is not there, and a slow walk."""
    rng = np.random.default_rng(7)
    rate = rng.normal(0.0, 1.0, rows) + 1e-4 * np.cumsum(rng.normal(0.0, 1.0, rows))
    return Data({"rate": rate}, {"hertz": 100.0}, rows)


def _turns(rows: int) -> Data:
    """Six positions and three turns of an inertial unit at 100 Hz, `rows` samples in all."""
    rng = np.random.default_rng(9)
    count, hertz = max(rows // 9, 100), 100.0
    faces = np.repeat(np.eye(3), 2, axis=0) * np.array([1.0, -1.0] * 3)[:, None]
    mixing = np.eye(3) + rng.normal(0.0, 0.002, (3, 3))
    still = np.concatenate([faces @ mixing.T + 0.003, np.full((6, 3), 0.05)], axis=1)[:, None, :]
    rates = np.concatenate(
        [faces[0::2] @ mixing.T + 0.003, np.eye(3) * 360.0 * hertz / count @ mixing + 0.05], axis=1
    )
    noise = np.array([1e-4] * 3 + [0.01] * 3)
    made = [
        base + noise * rng.normal(size=(len(base), count, 6)) for base in (still, rates[:, None, :])
    ]
    return Data(
        {"still": made[0], "turned": made[1]}, {"hertz": hertz, "angle_deg": 360.0}, 9 * count
    )


ROWS = (
    Row(
        Goal(
            "csv",
            "CSV → frame with SHA-256",
            "polars",
            1.5,
            10_000_000,
            digits=17.0,
            reach=1.1,
            faster=False,
            clock="wall",
            note=(
                "calibkit counts every field and hashes the bytes as well; both use every processor"
            ),
        ),
        "read_log",
        _log,
    ),
    Row(
        Goal(
            "denoise",
            "lifting denoise, 8 levels, CDF 9/7",
            "PyWavelets",
            2.5,
            10_000_000,
            digits=9.0,
            reach=3.5,
            note="PyWavelets' own filter table ends at 11 digits",
        ),
        "denoise",
        _ramp,
    ),
    Row(
        Goal(
            "linear",
            "linear fit, 3 terms",
            "numpy",
            5.0,
            10_000_000,
            digits=12.0,
            reach=10.0,
            note="lstsq; calibkit gives rank, condition and covariance too",
        ),
        "linear",
        _gradients,
    ),
    Row(
        Goal(
            "accelerometer_k",
            "accelerometer K fit",
            "numpy",
            6.0,
            1_000_000,
            digits=10.0,
            note="lstsq; calibkit gives condition, covariance and residuals too",
        ),
        "accelerometer_k",
        _dwells,
        peer_rows=1_000_000,
    ),
    Row(
        Goal(
            "magnitude",
            "magnitude-only Q fit",
            "lmfit",
            5.0,
            1_000_000,
            digits=6.0,
            reach=10.0,
            note="lmfit by its own tolerances and numerical derivatives",
        ),
        "magnitude",
        _lengths,
        peer_rows=1_000_000,
    ),
    Row(
        Goal(
            "mad",
            "MAD",
            "numpy",
            2.5,
            10_000_000,
            digits=17.0,
            note=(
                "np.median of the magnitudes; the deviation is from zero, as that of wavelet"
                " details is"
            ),
        ),
        "mad",
        _values,
    ),
    Row(
        Goal(
            "allan",
            "overlapping Allan deviation, octaves",
            "allantools",
            3.0,
            10_000_000,
            digits=9.0,
            note="calibkit tells the noise type and gives limits too",
        ),
        "allan",
        _record,
    ),
    Row(
        Goal(
            "turntable",
            "six positions and three turns",
            "imucal",
            None,
            1_000_000,
            digits=2.0,
            note=(
                "equal up to noise: imucal takes a bias from one pair of positions, calibkit"
                " from all"
            ),
        ),
        "turntable",
        _turns,
    ),
)
