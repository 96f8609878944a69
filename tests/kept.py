"""Runs of a made-up unit for the tests of what is kept: one stage, one model, coefficients as the
test states them.
"""

import hashlib
from dataclasses import replace
from pathlib import Path

from calibkit.records import run_document, sealed, store
from calibkit.records.coefficients import (
    Coefficient,
    Identity,
    Input,
    Model,
    Parameter,
    StageResult,
)

RECIPE = 'procedure = "rate_table"\n'


def model(values, *, name="gyro_x", form="gyro-scale/1", covariance=None, dof=20, parameters=()):
    """Model of `name → (value, unit, u)`; covariance diagonal where none is given."""
    entries = tuple(Coefficient(key, *rest) for key, rest in values.items())
    if covariance is None:
        covariance = [
            [c.standard_uncertainty**2 if c is d else 0.0 for d in entries] for c in entries
        ]
    return Model(
        name,
        form,
        entries,
        tuple(map(tuple, covariance)),
        dof,
        0.1,
        "1/s",
        {"temp_case_degc": (20.0, 30.0)},
        tuple(Parameter(*parameter) for parameter in parameters),
    )


def keep(
    out,
    *models,
    serial="S-1",
    date="2024-01-01",
    logs=(),
    verdict="no verdict",
    figures=(),
    stage="gyro_scale",
    procedure="rate_table",
    recipe=RECIPE,
):
    """Commit a run of these models and return its folder; without `logs` its log is its own."""

    def files(revision, superseded):
        inputs = tuple(
            Input(f"{log}.csv", log, 10) for log in logs or (f"{serial}-log-{revision}",)
        )
        identity = Identity(serial, revision, date, "calibkit 0", "00", inputs)
        result = StageResult(
            stage, tuple(models), tuple(Coefficient(*figure) for figure in figures)
        )
        record = result.as_record(identity, superseded.get(stage, ""))
        contents = {f"{stage}.json": record.dumps().encode(), "report.txt": b"hello\n"}
        return {"run.json": sealed.seal(document(identity, contents)).encode(), **contents}

    def document(identity, contents):
        return {
            "format": run_document.FORMAT,
            "serial": serial,
            "revision": identity.revision,
            "procedure": procedure,
            "effective_from": date,
            "software": "calibkit 0",
            "python": "3.11.7",
            "libraries": {"numpy": "2.1"},
            "recipe": {"name": "x.toml", "sha256": "00", "overrides": [], "text": recipe},
            "inputs": [entry.identity() for entry in identity.inputs],
            "excluded": [],
            "type_b": [],
            "verdict": verdict,
            "accepted": run_document.ACCEPTED[verdict],
            "acceptance": [],
            "uncertainty": [],
            "flags": [],
            "files": [
                {"name": name, "sha256": hashlib.sha256(content).hexdigest()}
                for name, content in contents.items()
            ],
        }

    for revision, superseded in store.next_revisions(out, serial):
        folder = store.save(out, serial, revision, files(revision, superseded))
        if folder is not None:
            return folder
    return None


RECIPES = Path(__file__).resolve().parents[1] / "recipes"


LIMITED = "[acceptance]\nmax_scale_factor_error_ppm = 30.0"


def rate_table(K, u=0.05, low=20.0, high=30.0, **more):
    """Model of a gyro on a rate table."""
    return replace(
        model({"K": (K, "1/deg", u), "F0": (5.0, "1/s", 0.5)}, name="gyro_x", **more),
        valid={"table_rate_dps": (-100.0, 100.0), "temp_case_degc": (low, high)},
    )
