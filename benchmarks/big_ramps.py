"""Logs of a simulated gyro on temperature ramps as a 1 kHz logger writes them, of any number of
rows, the same for the same seed.

Gyro, chamber and heat are those of `calibkit simulate fog_thermal`; case and air are read, and the
white noise of the indication is drawn, at every sample. Four heating ramps (1, 5, 8, 10 °C/min) of
an hour are 14.4 million rows, 0.5 GB.

    python benchmarks/big_ramps.py FOLDER                    four logs of 3,600,000 rows
    python benchmarks/big_ramps.py FOLDER 900000             the same hours, sampled at 250 Hz
    python benchmarks/big_ramps.py FOLDER 3600000 5          one log, that of 5 °C/min
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calibkit.instruments.bias import simulate_fog
from calibkit.simulate import noise
from calibkit.simulate.chamber import Chamber, Programme

if TYPE_CHECKING:
    from collections.abc import Sequence

SEED = 7
DURATION_S = 3600
SOAK_S = 600.0
RATES = (1.0, 5.0, 8.0, 10.0)
HEADER = "time_s,temp_case_degc,temp_env_degc,gyro_dph\n"
BLOCK = 100_000


def write(folder: Path, rows: int = 3_600_000, rates: Sequence[float] = RATES) -> list[Path]:
    """Write one log of so many rows a heating rate [°C/min] unless it is there; returns the
    files.
    """
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for rate in rates:
        path = folder / f"ramp_heating_{rate:02g}.csv"
        if not path.exists():
            unfinished = path.with_suffix(".part")
            _write_one(unfinished, rate, rows)
            unfinished.rename(path)
        paths.append(path)
    return paths


def _write_one(path: Path, rate: float, rows: int) -> None:
    """Write one log, a block of rows at a time."""
    device, chamber = simulate_fog.FogGyro.draw(SEED), Chamber()
    rng = np.random.default_rng([SEED, round(1000.0 * rate)])
    ramp_s = min(
        (simulate_fog.HOT_DEGC - simulate_fog.COLD_DEGC) / rate * 60.0, DURATION_S - SOAK_S
    )
    end = simulate_fog.COLD_DEGC + rate * ramp_s / 60.0
    after = DURATION_S - SOAK_S - ramp_s + 60.0  # the chamber runs on when the log ends
    seconds, set_degc = Programme.ramp(
        simulate_fog.COLD_DEGC, end, rate, soak_before_s=SOAK_S, soak_after_s=after
    ).set_points()
    air = chamber.air(set_degc, rng)
    heat = device.heat_flow(air, simulate_fog.COLD_DEGC)
    bias = device.input_rate_dph + device.bias_dph + device.drift(heat)
    bias += noise.flicker(device.B, seconds.size, rng)
    step = DURATION_S / rows
    decimals = max(4, math.ceil(-math.log10(step)))
    line = f"%.{decimals}f,%.4f,%.3f,%.5f\n"
    with path.open("w", encoding="ascii") as stream:
        stream.write(HEADER)
        for start in range(0, rows, BLOCK):
            t = np.arange(start, min(start + BLOCK, rows)) * step
            case = noise.reading(
                np.interp(t, seconds, heat.case), device.case_resolution_degc, 0.02, rng
            )
            env = noise.reading(np.interp(t, seconds, air), 0.01, chamber.reading_noise_degc, rng)
            gyro = np.interp(t, seconds, bias) + noise.angle_random_walk(
                device.N, t.size, rng, interval_s=step
            )
            lists = (values.tolist() for values in (t, case, env, gyro))
            stream.write("".join(map(line.__mod__, zip(*lists, strict=True))))


def main() -> None:
    """Write the logs that the command line asks for and name them."""
    folder, *numbers = sys.argv[1:]
    rows = int(numbers[0]) if numbers else 3_600_000
    for path in write(Path(folder), rows, tuple(map(float, numbers[1:])) or RATES):
        print(path, path.stat().st_size)


if __name__ == "__main__":
    main()
