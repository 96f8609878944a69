"""Logs of any number of rows of a gyro on a rate table, of a triad on a two-axis table, of an
instrument at rest that is warmed, and of a gyro at rest, the same for the same seed.

The table turns at 25 rates from −100 to 100 °/s, the triad is held at 26 attitudes, each for an
equal share of the rows at 1 kHz. Gyro and triad are plain: a line with noise, a matrix with noise.
What is measured on them is memory, not errors.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibkit.numeric import attitude

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

SEED = 7
RATE_HZ = 1000.0
BLOCK = 100_000
RATES_DPS = np.linspace(-100.0, 100.0, 25)
SLEW_S = 5.0
"""Time from one held rate or attitude to the next."""
EARTH_DPS = 15.041067 / 3600.0 * np.cos(np.radians(34.2))
"""Horizontal part of the earth's rate."""
INCLINATIONS = (30.0, 60.0, 90.0, 120.0, 150.0)
ATTITUDES = [
    (0.0, 0.0),
    *((i, t) for i in INCLINATIONS for t in (0.0, 72.0, 144.0, 216.0, 288.0)),
    (180.0, 0.0),
]
TRIAD = np.array([[1.001, 0.0, 0.0], [0.002, 0.999, 0.0], [-0.001, 0.003, 1.0005]])


def _along(levels: Array, time: Array, hold_s: float) -> tuple[Array, Array]:
    """Level [m] and its integral [m] at times: each level held, straight between them."""
    corners = np.arange(levels.size)[:, None] * hold_s + np.array([0.0, hold_s - SLEW_S])
    held = np.repeat(levels, 2)
    total = np.concatenate(
        [[0.0], np.cumsum(np.diff(corners.ravel()) * (held[1:] + held[:-1]) / 2.0)]
    )
    level = np.interp(time, corners.ravel(), held)
    k = np.clip(np.searchsorted(corners.ravel(), time, side="right") - 1, 0, held.size - 1)
    return level, total[k] + (time - corners.ravel()[k]) * (held[k] + level) / 2.0


def table_rows(time: Array, hold_s: float, rng: np.random.Generator) -> list[Array]:
    """Columns of a gyro on a rate table at times [m, s]."""
    rate, angle = _along(RATES_DPS, time, hold_s)
    seen = rate + EARTH_DPS * np.cos(np.radians(angle)) + 0.004
    counts = 2000.0 * seen + rng.normal(0.0, 50.0, time.size)
    case = 25.0 + 0.1 * np.sin(time / 3000.0) + rng.normal(0.0, 0.01, time.size)
    return [time, rate, np.remainder(angle, 360.0), case, counts]


def triad_rows(time: Array, hold_s: float, rng: np.random.Generator) -> list[Array]:
    """Columns of a triad on a two-axis table at times [m, s]."""
    inclination, toolface = (
        _along(np.array(levels), time, hold_s)[0] for levels in zip(*ATTITUDES, strict=True)
    )
    case = 25.0 + 20.0 * np.sin(time / 500.0) + rng.normal(0.0, 0.01, time.size)
    shown = (
        attitude.gravity_vector(inclination, toolface)
        @ TRIAD.T
        * (1.0 + 1e-5 * (case - 25.0))[:, None]
    )
    shown = shown + rng.normal(0.0, 1e-4, shown.shape)
    return [time, case, inclination, toolface, *shown.T]


def rest_rows(
    time: Array,
    hold_s: float,  # noqa: ARG001 (as of the tables)
    rng: np.random.Generator,
) -> list[Array]:
    """Columns of a gyro at rest at times [m, s]."""
    return [time, 8.5 + 0.01 * np.sin(time / 2000.0) + rng.normal(0.0, 5.0, time.size)]


def warmed_rows(time: Array, hold_s: float, rng: np.random.Generator) -> list[Array]:
    """Columns of a gyro and an accelerometer at rest in a chamber that goes up and down at times
    [m, s].
    """
    case, inner = (
        25.0
        + 26.0 * np.sin(2.0 * np.pi * (time - late) / hold_s)
        + 8.0 * np.sin(14.0 * np.pi * (time - late) / hold_s)
        for late in (0.0, 200.0)
    )
    case += rng.normal(0.0, 0.01, time.size)
    gyro = 5.0 + 0.3 * (inner - 25.0) + rng.normal(0.0, 0.5, time.size)
    acceleration = 1.0 + 1e-5 * (inner - 25.0) + rng.normal(0.0, 1e-4, time.size)
    return [time, case, gyro, acceleration]


KINDS: dict[
    str, tuple[str, str, int, Callable[[Array, float, np.random.Generator], list[Array]]]
] = {
    "rate_table": (
        "time_s,table_rate_dps,table_angle_deg,temp_case_degc,gyro_x_lsb",
        "%.3f,%.5f,%.4f,%.3f,%.1f",
        len(RATES_DPS),
        table_rows,
    ),
    "accelerometer": (
        "time_s,temp_case_degc,inclination_deg,toolface_deg,accel_x_g,accel_y_g,accel_z_g",
        "%.3f,%.3f,%.4f,%.4f,%.7f,%.7f,%.7f",
        len(ATTITUDES),
        triad_rows,
    ),
    "thermal": (
        "time_s,temp_case_degc,gyro_x_dph,accel_x_g",
        "%.3f,%.3f,%.4f,%.7f",
        1,
        warmed_rows,
    ),
    "gyro_noise": ("time_s,gyro_dph", "%.3f,%.4f", 1, rest_rows),
}
"""What is logged → header, format of a line, levels held, columns at times."""


def write(folder: Path, kind: str, rows: int, seed: int = SEED) -> Path:
    """Write one log of so many rows unless it is there; returns the file."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{kind}.csv"
    if path.exists():
        return path
    header, line, levels, columns = KINDS[kind]
    rng, hold_s = np.random.default_rng(seed), rows / RATE_HZ / levels
    unfinished = path.with_suffix(".part")
    with unfinished.open("w", encoding="ascii") as stream:
        stream.write(header + "\n")
        for start in range(0, rows, BLOCK):
            time = np.arange(start, min(start + BLOCK, rows)) / RATE_HZ
            made = columns(time, hold_s, rng)
            stream.write(
                "".join(map((line + "\n").__mod__, zip(*(x.tolist() for x in made), strict=True)))
            )
    unfinished.rename(path)
    return path
