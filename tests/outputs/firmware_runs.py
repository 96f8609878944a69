"""Run folders for the firmware tests: one of every procedure and drift model, fitted once a
session.
"""

from dataclasses import dataclass, replace

import numpy as np

from calibkit import instruments, recipe
from calibkit.commands import pipeline
from calibkit.instruments.bias import forms
from calibkit.records import store
from sample_runs import sample_run

HOWEVER_WELL = ("acceptance.max_residual_over_noise=100",)
RUNS = {
    "lagged": ("fog_thermal", ("drift.model=lagged",)),
    "bank": ("fog_thermal", ("drift.model=bank",)),
    "grown": ("fog_thermal", ("drift.model=bank",)),
    "level": ("fog_thermal", ("drift.model=level",)),
    "gradient": ("fog_thermal", ("drift.model=gradient_rate", "drift.order=2", *HOWEVER_WELL)),
    "affine": ("accelerometer", ("affine.second_order=true", "affine.third_order=true")),
    "k": ("accelerometer", ("compensation=k",)),
    "pair": ("gyro_pair", ()),
    "rate": ("rate_table", ()),
    "triad": ("gyro_triad", ("site.latitude_deg=34.2",)),
    "scale": ("inclinometer", ()),
}
"""Name → procedure and overrides."""
MEMORYLESS = ("affine", "k", "pair", "rate", "triad", "scale")


ORDERS = {"gyro_x_dph": 3, "gyro_y_dph": 3, "gyro_z_dph": 2, "accel_x_g": 3, "accel_z_g": 1}
"""Channels of the simulated warm-up and the degree of each bias."""
UNITS = ("IMU-1", "IMU-2", "IMU-3")


def truth(column, temperature, unit):
    """Bias of a channel: cubic for gyros, quadratic for accelerometers; each unit has its own."""
    d = temperature - 25.0
    size = 1.0 + 0.1 * unit
    if column.startswith("gyro"):
        return size * (50.0 + 8.0 * d - 0.2 * d**2 + 0.01 * d**3)
    return size * (1e-4 * d + 2e-6 * d**2)


def warmed_up(root):
    """Fit the biases of UNITS on simulated warm-ups below a folder; returns the folder of their
    runs.
    """
    entries = ",".join(f'{{indication="{name}",order={order}}}' for name, order in ORDERS.items())
    source = recipe.find("bias_temperature", (f"polynomials.bias=[{entries}]",))
    time = np.arange(3000) * 1.0
    temperature = 20.0 + 15.0 * (1.0 - np.exp(-time / 1500.0)) + 10.0 * np.sin(time / 1200.0)
    for number, unit in enumerate(UNITS):
        rng = np.random.default_rng(number)
        columns = {"time_s": time, "temp_case_degc": temperature}
        for name in ORDERS:
            noise = 20.0 if name.startswith("gyro") else 1e-3
            columns[name] = truth(name, temperature, number) + rng.normal(0.0, noise, time.size)
        folder = root / unit
        folder.mkdir()
        rows = "\n".join(
            ",".join(f"{x:.6f}" for x in row) for row in zip(*columns.values(), strict=True)
        )
        (folder / "warm.csv").write_text(",".join(columns) + "\n" + rows + "\n", encoding="utf-8")
        pipeline.fit(source, folder, unit, root / "runs", "2026-11-21", instruments.silent)
    return root / "runs"


@dataclass(frozen=True)
class Fitted:
    """A run, its recipe and its chain."""

    run: store.StoredRun
    spec: recipe.Recipe
    chain: object

    def record(self, name):
        """A coefficient file of the run."""
        return self.run.records[name]


_CACHE: dict[str, Fitted] = {}


def cached(name, factory):
    """Return one of RUNS, fitted once a session whichever module asks first."""
    if name not in _CACHE:
        procedure, overrides = RUNS[name]
        run = sample_run(factory, procedure, overrides)
        if name == "grown":
            run = replace(run, records={**run.records, forms.FILE: grown(run.records[forms.FILE])})
        spec = pipeline.run_recipe(run, ())
        chain = instruments.optional(procedure, "chain")(spec, run.records)
        _CACHE[name] = Fitted(run, spec, chain)
    return _CACHE[name]


def grown(record):
    """Record of a bank to whose terms a table, three play operators and a warm-up were added."""
    (model,) = record.models
    bank = forms.read_thermal(model)
    terms = replace(
        bank.bank,
        knots=(-30.0, -8.0, 20.0, 52.0),
        widths=(4.0, 8.0, 16.0),
        warm_up=(300.0, 1000.0, 3000.0),
    )
    more = [0.02, -0.03, 0.01, 0.02, 0.04, -0.06, 0.05, 0.03, -0.02, 0.04]
    coefficients = np.concatenate([bank.coefficients, more])
    bigger = replace(
        bank,
        bank=terms,
        coefficients=coefficients,
        covariance=1e-8 * np.eye(coefficients.size + len(bank.static_lag)),
    )
    return replace(record, models=(forms.write_thermal(bigger, model.value("interval")),))
