"""Run folders for the firmware tests: one of every procedure and drift model, fitted once a session."""

from dataclasses import dataclass

from calibkit import pipeline, procedures, recipe, store
from calibkit.firmware import chains
from conftest import ROOT

RUNS = {
    "lagged": ("fog_thermal", ("drift.model=lagged",)),
    "level": ("fog_thermal", ("drift.model=level",)),
    "gradient": ("fog_thermal", ("drift.model=gradient_rate", "drift.order=2")),
    "affine": ("accelerometer", ("affine.second_order=true", "affine.third_order=true")),
    "k": ("accelerometer", ("compensation=k",)),
    "kq": ("accelerometer", ("compensation=kq", "k.cross=false")),
    "pair": ("gyro_pair", ()),
    "rate": ("rate_table", ()),
    "triad": ("gyro_triad", ("site.latitude_deg=34.2",)),
    "scale": ("inclinometer", ()),
}
"""Name → procedure and overrides."""
MEMORYLESS = ("affine", "k", "kq", "pair", "rate", "triad", "scale")


@dataclass(frozen=True)
class Fitted:
    """A run, its recipe and its chain."""

    run: store.Run
    spec: recipe.Recipe
    chain: object

    def record(self, name):
        """A coefficient file of the run."""
        return self.run.records[name]


_CACHE: dict[str, Fitted] = {}


def cached(name, factory):
    """Return one of RUNS, fitted once a session whichever module asks first."""
    if name not in _CACHE:
        _CACHE[name] = fitted(name, factory.mktemp(f"fw-{name}"))
    return _CACHE[name]


def fitted(name, folder):
    """Fit one of RUNS to its shipped data set."""
    procedure, overrides = RUNS[name]
    source = recipe.find(procedure, overrides)
    data = ROOT / "datasets" / procedure
    outcome = pipeline.fit(source, data, f"FW-{name}", folder, "2026-11-21", procedures.silent)
    run = store.load(outcome.folder)
    spec = pipeline.run_recipe(run, ())
    return Fitted(run, spec, chains.of(spec, run.records))
