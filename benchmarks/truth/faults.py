"""Data that are not what they seem: what peers make of them without a word, and what calibkit
says.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from speed import pairs, peers
from speed.page import table

from calibkit.numeric.least_squares import polynomial
from calibkit.numeric.least_squares.fit import linear_in_blocks
from truth.product import DATE, run


def measured(units: int, environments: Path) -> str:
    """What tools say of data that are not what they seem."""
    del units
    rows = [_rank()]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        good = "time_s,temp_case_degc,temp_env_degc,gyro_dph\n" + "".join(
            f"{k}.0,{20 + k / 50:.2f},{21 + k / 50:.2f},7.{k:04d}\n" for k in range(1000)
        )
        lines = good.splitlines(keepends=True)
        cut = "".join(lines[:-1]) + lines[-1][:-4]
        short = "".join([*lines[:500], lines[500].rpartition(",")[0] + "\n", *lines[501:]])
        text = "".join([*lines[:500], lines[500].replace("7.", "7.x"), *lines[501:]])
        cases = {
            "last number cut in half": cut,
            "a row that lost its last field": short,
            "a letter in a number": text,
        }
        with pairs.Worker(peers.environment("polars", environments), "theirs") as peer:
            for what, content in cases.items():
                (folder / "logs").mkdir(exist_ok=True)
                path = folder / "logs" / "log.csv"
                path.write_text(content, encoding="utf-8")
                rows.append(
                    [what, "polars `read_csv`", _polars(peer, path), _refused(folder / "logs")]
                )
    return table(("what is wrong", "tool", "what it says", "calibkit"), rows)


def _rank() -> list[str]:
    """A quadratic in seconds over a long log, by lstsq as it is called."""
    t = np.arange(10_000_000.0)
    values = 1.0 + 2e-3 * t - 1e-10 * t**2
    coefficients, _, rank, _ = np.linalg.lstsq(
        np.column_stack([np.ones_like(t), t, t * t]), values, rcond=None
    )
    columns, to_raw = polynomial.mapped_powers(t, 2)
    ours = to_raw @ linear_in_blocks(columns, values)
    worst = float(np.max(np.abs(ours / np.array([1.0, 2e-3, -1e-10]) - 1.0)))
    return [
        "a quadratic in time, 10 M seconds, no noise",
        "numpy `lstsq`, `rcond=None`",
        (
            f"rank {rank} of 3 beside the coefficients"
            f" {', '.join(f'{c:.3g}' for c in coefficients)}; the truth is 1, 0.002, -1e-10"
        ),
        f"right to {worst:.0e}",
    ]


def _polars(peer: pairs.Worker, path: Path) -> str:
    """What polars makes of a file."""
    try:
        peer.ask("load", side="read_log", files={}, settings={"path": str(path)})
        peer.ask("once", times=1)
        shape = peer.ask("shape")["shape"]
    except pairs.WorkerError as error:
        return f"refused: {str(error).split(':')[1].strip()}"
    return shape


def _refused(data: Path) -> str:
    """What `calibkit fit` says of a folder with one log."""
    done = run(
        "fit", "fog_thermal", "--data", data, "--serial", "G", "--out", data.parent / "runs", *DATE
    )
    said = done.stderr.strip().splitlines()[0].removeprefix("calibkit: ")
    return f"refused, exit code {done.returncode}: {said}" if done.returncode else said
