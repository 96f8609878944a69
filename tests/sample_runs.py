"""Runs of the shipped recipes on their sample logs, each fitted once a session for all processes of
pytest-xdist, as a user fits it: with its report in ink.

Nothing may change them; a test that has to copies the folder first.
"""

import datetime as dt
import fcntl
import hashlib
import json
import os

import pytest

from calibkit import instruments, recipe
from calibkit.commands import pipeline
from calibkit.records import store
from conftest import REAL, ROOT, use_ink
from written_logs import warm_up

SERIAL = "S-1"
DATE = "2026-11-21"


def session_folder(factory):
    """Folder that all processes of a session share; `factory` is pytest's of temporary folders."""
    own = factory.getbasetemp()
    folder = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "sample_runs"
    folder.mkdir(exist_ok=True)
    return folder


def sample_run(factory, name, overrides=(), data=None):
    """Run of a shipped recipe, fitted by the first process that asks; `data` is a folder in place
    of the sample logs.
    """
    logs = data or sample_logs(factory, name)
    key = hashlib.sha256(json.dumps([name, *overrides, str(logs)]).encode()).hexdigest()[:12]
    folder = session_folder(factory) / f"{name}-{key}"
    folder.mkdir(exist_ok=True)
    run = folder / SERIAL / "r001"
    with (folder / "lock").open("w", encoding="utf-8") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not run.is_dir():
            fit_in_ink(recipe.find(name, overrides), logs, folder)
    return store.load(run)


def fit_in_ink(source, logs, out):
    """Fit and render the report, whether or not the test that asks does."""
    before = use_ink(drawn=True)
    try:
        pipeline.fit(source, logs, SERIAL, out, DATE, instruments.silent)
    finally:
        use_ink(before)


def sample_logs(factory, name):
    """Folder with logs of a shipped recipe: samples, a log of the field, or written ones."""
    if name == "mpu6050_warmup":
        if not REAL.is_dir():
            pytest.skip("the logs of the field are not beside the repository")
        return REAL / name
    samples = ROOT / "datasets" / name
    if samples.is_dir():
        return samples
    folder = session_folder(factory) / "warm_up"
    with (folder.parent / "warm_up.lock").open("w", encoding="utf-8") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not folder.is_dir():
            warm_up(folder)
    return folder


ISSUED = dt.date(2026, 11, 21)


def fitted(folder, name, data=None, serial="S-1", overrides=()):
    """Run of a procedure's sample logs."""
    source = recipe.find(str(ROOT / "recipes" / f"{name}.toml"), overrides)
    outcome = pipeline.fit(
        source, data or ROOT / "datasets" / name, serial, folder, DATE, instruments.silent
    )
    return store.load(outcome.run.folder)
