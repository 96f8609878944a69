"""calibkit's drift models against the thermal models of autopilots, on the same logs of simulated
gyros.

    PYTHONPATH=. python benchmarks/drift_peers.py [gyros [first seed [environment]]]

Each gyro is fitted on ±1, ±5, ±8, ±10 °C/min and judged on ±3 and ±6 °C/min, drift rms by truth.
Peers: the temperature calibration of ardupilot-methodic-configurator (from the package index, run
as its users do, on a flight log that this script writes), and a cubic in temperature over an even
temperature grid, which is PX4's model. The peer is installed into an environment of its own, made
here unless a folder that holds one is named. Exit code 1 where calibkit leaves more than a peer.
"""

from __future__ import annotations

import re
import struct
import subprocess
import sys
import tempfile
import time
import venv
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calibkit.instruments.bias import simulate_fog as fog
from calibkit.instruments.bias.numeric import bank, choice
from calibkit.numeric import intervals
from calibkit.numeric.thermal import fits, pooled_fit
from calibkit.numeric.thermal.terms import TERMS
from calibkit.simulate.chamber import Chamber

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Drift = Callable[[Array], Array]

PEER = "ardupilot-methodic-configurator==5.0.1"
NEEDS = ("pymavlink", "matplotlib", "numpy<2.1")
"""What its temperature calibration imports; its other requirements serve its windows."""
FIRST_SEED = 84_000
INTERVAL_S = 10.0
DPH_PER_RADPS = 3600.0 * 180.0 / np.pi
PEER_REFERENCE_DEGC = 35.0
HEAD = b"\xa3\x95"


def environment(folder: Path) -> Path:
    """Python of an environment in which the peer is installed."""
    python = folder / "bin" / "python"
    if not python.is_file():
        venv.create(folder, with_pip=True)
        quiet = [str(python), "-m", "pip", "install", "--quiet"]
        subprocess.run([*quiet, "--no-deps", PEER], check=True)
        subprocess.run([*quiet, *NEEDS], check=True)
    return python


def flight_log(path: Path, seconds: Array, temperature: Array, rate_dph: Array) -> None:
    """Write a dataflash log with IMU messages whose gyro Z is the rate: a format message for each
    type, then the samples.
    """
    formats = {
        128: ("FMT", "BBnNZ", "Type,Length,Name,Format,Columns", struct.calcsize("<BB4s16s64s")),
        129: ("PARM", "QNff", "TimeUS,Name,Value,Default", struct.calcsize("<Q16sff")),
        130: (
            "IMU",
            "QBfffffff",
            "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,T",
            struct.calcsize("<QB7f"),
        ),
    }
    with path.open("wb") as out:
        for number, (name, kinds, columns, size) in formats.items():
            body = struct.pack(
                "<BB4s16s64s", number, size + 3, name.encode(), kinds.encode(), columns.encode()
            )
            out.write(HEAD + bytes([128]) + body)
        out.write(HEAD + bytes([129]) + struct.pack("<Q16sff", 0, b"AHRS_ORIENTATION", 0.0, 0.0))
        for t, degc, dph in zip(seconds, temperature, rate_dph, strict=True):
            sample = struct.pack(
                "<QB7f", round(t * 1e6), 0, 0.0, 0.0, dph / DPH_PER_RADPS, 0.0, 0.0, -9.80665, degc
            )
            out.write(HEAD + bytes([130]) + sample)


def packaged(python: Path, logs: dict[str, fog.SimulatedLog]) -> tuple[Drift, float]:
    """Drift over case temperature as the packaged peer finds it from all logs in one flight log,
    and the seconds it took.
    """
    columns = [log.columns for log in logs.values()]
    temperature, rate = (
        np.concatenate([c[name] for c in columns]) for name in ("temp_case_degc", "gyro_dph")
    )
    with tempfile.TemporaryDirectory() as folder:
        log, found = Path(folder) / "log.bin", Path(folder) / "tcal.parm"
        flight_log(log, np.arange(rate.size) + 1.0, temperature, rate)
        module = "ardupilot_methodic_configurator.tempcal_imu"
        start = time.perf_counter()
        subprocess.run(
            [str(python), "-m", module, "--no-graph", "--outfile", str(found), str(log)],
            check=True,
            capture_output=True,
        )
        took = time.perf_counter() - start
        text = found.read_text(encoding="utf-8")
    named = dict(re.findall(r"^INS_TCAL1_(\w+) (\S+)$", text, flags=re.MULTILINE))
    powers = np.array([0.0, *(float(named[f"GYR{k}_Z"]) * 1e-6 * DPH_PER_RADPS for k in (1, 2, 3))])
    low, high = float(named["TMIN"]), float(named["TMAX"])

    def drift(case: Array) -> Array:
        return np.polynomial.polynomial.polyval(
            np.clip(case, low, high) - PEER_REFERENCE_DEGC, powers
        )

    return drift, took


def cubic(logs: dict[str, fog.SimulatedLog]) -> Drift:
    """Cubic in temperature, fitted to the rate brought to an even temperature grid: no temperature
    rules by its dwell.
    """
    temperature = np.concatenate([log.columns["temp_case_degc"] for log in logs.values()])
    rate = np.concatenate([log.columns["gyro_dph"] for log in logs.values()])
    edges = np.linspace(temperature.min(), temperature.max(), 101)
    index = np.clip(np.digitize(temperature, edges) - 1, 0, 99)
    count = np.bincount(index, minlength=100)
    full = count > 0
    means = np.bincount(index, weights=rate, minlength=100)[full] / count[full]
    middle = ((edges[1:] + edges[:-1]) / 2.0)[full]
    powers = np.polynomial.polynomial.polyfit(middle, means, 3)
    return lambda case: np.polynomial.polynomial.polyval(case, powers)


def thermal_log(name: str, log: fog.SimulatedLog) -> pooled_fit.ThermalLog:
    """Block means of a log."""
    c = log.columns
    seconds = c["time_s"].astype(np.float64)
    held = intervals.Intervals.find(seconds, INTERVAL_S)
    means = (held.means(column) for column in (seconds, c["temp_case_degc"], c["temp_env_degc"]))
    return pooled_fit.thermal_blocks(name, held, means, c["gyro_dph"])


def judged(
    logs: dict[str, fog.SimulatedLog], python: Path
) -> tuple[dict[str, Array], dict[str, float]]:
    """Drift rms [°/h] by truth of each model on each withheld ramp, and the seconds of each fit."""
    fitted = {name: log for name, log in logs.items() if not name.startswith("withheld/")}
    blocks = [thermal_log(name, log) for name, log in fitted.items()]
    start = time.perf_counter()
    model = choice.choose(blocks).model
    seconds = {"calibkit, chosen": time.perf_counter() - start}
    stacked = pooled_fit.Stack.of_logs(blocks)
    plain = fits.finish(fits.level_basis(stacked).solve(TERMS))
    peer, seconds["ardupilot"] = packaged(python, fitted)
    start = time.perf_counter()
    px4 = cubic(fitted)
    seconds["cubic"] = time.perf_counter() - start
    left: dict[str, list[float]] = {}
    for name, log in logs.items():
        if name.startswith("withheld/"):
            b = thermal_log(name, log)
            truth = intervals.Intervals.find(
                log.columns["time_s"].astype(np.float64), INTERVAL_S
            ).means(log.drift)
            found = {
                "uncompensated": np.zeros_like(truth),
                "cubic in temperature (PX4's model)": px4(b.case),
                f"{PEER} (packaged)": peer(b.case),
                "calibkit level": bank.evaluate(plain, b.time, b.case, b.env).drift,
                "calibkit, chosen": (
                    truth * 0.0
                    if model is None
                    else bank.evaluate(model, b.time, b.case, b.env).drift
                ),
            }
            for key, drift in found.items():
                left.setdefault(key, []).append(float(np.std(truth - drift)))
    return {key: np.array(values) for key, values in left.items()}, seconds


def main() -> int:
    """Run and report."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    first = int(sys.argv[2]) if len(sys.argv) > 2 else FIRST_SEED
    with tempfile.TemporaryDirectory() as scratch:
        python = environment(Path(sys.argv[3]) if len(sys.argv) > 3 else Path(scratch) / "peer")
        results = []
        for seed in range(first, first + count):
            made = fog.logs(
                fog.FogGyro.draw(seed),
                fog.programmes((1.0, 5.0, 8.0, 10.0), (3.0, 6.0)),
                seed,
                Chamber(),
            )
            results.append(judged(made, python))
    print(f"{count} gyros, {4 * count} withheld ramps (±3, ±6 °C/min); drift rms by truth [°/h]")
    print("| model | median | largest | raw / left, median | least |")
    print("|---|---|---|---|---|")
    pooled = {key: np.concatenate([left[key] for left, _ in results]) for key in results[0][0]}
    for key, left in pooled.items():
        ratio = pooled["uncompensated"] / left
        print(
            f"| {key} | {np.median(left):.4f} | {left.max():.4f} | {np.median(ratio):.1f} |"
            f" {ratio.min():.1f} |"
        )
    took = {key: np.median([seconds[key] for _, seconds in results]) for key in results[0][1]}
    print("seconds a fit, median:", ", ".join(f"{key} {value:.2f}" for key, value in took.items()))
    names = [key for key in pooled if not key.startswith("calibkit")]
    return int(any(np.any(pooled["calibkit, chosen"] > pooled[key]) for key in names))


if __name__ == "__main__":
    sys.exit(main())
