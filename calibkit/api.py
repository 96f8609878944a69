"""The public interface: the commands as functions of paths and values, and the numeric core's most
wanted functions.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from calibkit import instruments, recipe as recipes
from calibkit.certificate import certify as certificates
from calibkit.certificate.signature_trust import Demands
from calibkit.check import examination
from calibkit.commands import analysis, inspection, pipeline
from calibkit.commands.analysis import Run
from calibkit.errors import CalibkitError, UsageError
from calibkit.instruments import silent
from calibkit.logs import log_files
from calibkit.numeric.gum import UncertaintyComponent, combine as combine_uncertainty
from calibkit.numeric.least_squares.regression import regress
from calibkit.numeric.noise.allan import overlapping as allan_deviation
from calibkit.numeric.wavelet.denoise import denoise
from calibkit.readers import in_memory
from calibkit.recipe import Source, toml_text
from calibkit.records import clock, coefficients, frame, store

if TYPE_CHECKING:
    import datetime as dt
    import os

    import pandas as pd
    from numpy.typing import ArrayLike

    from calibkit.certificate.certify import Issued
    from calibkit.certificate.words import Lang
    from calibkit.check.report import LogReport
    from calibkit.numeric.arrays import Array
    from calibkit.records.coefficients import Record
    from calibkit.simulate.campaign import Campaign

    AnyPath = str | os.PathLike[str]
    AnyRecipe = Source | AnyPath | Mapping[str, Any]

__all__ = [
    "CalibkitError",
    "Run",
    "UncertaintyComponent",
    "allan_deviation",
    "certify",
    "combine_uncertainty",
    "compensate",
    "denoise",
    "evaluate",
    "examine",
    "export_firmware",
    "find_run",
    "fit",
    "load_coefficients",
    "load_recipe",
    "read_log",
    "regress",
    "simulated",
    "validate",
    "verify",
]

AXES = ("x", "y", "z", "a", "b")
"""Letters that axes of gyros and accelerometers usually have."""
KINDS = (("gyro", "dph"), ("gyro", "lsb"), ("accel", "g"), ("accel", "lsb"))
"""Canonical columns that are named after an axis."""


def load_recipe(name: AnyPath | Mapping[str, Any], **settings: object) -> Source:
    """Recipe of a file, of a shipped name or of a dictionary, with settings on top.

    Parameters
    ----------
    name : path of a TOML file, the name of a shipped recipe ("fog_thermal"), or a dictionary of the
        tables that such a file holds.
    settings : keys to override; a double underscore stands for the dot: site__latitude_deg=34.2.

    Raises
    ------
    CalibkitError : no such recipe, or one with a fault; the message names file, line, value and
        what is allowed.

    Examples
    --------
    >>> import calibkit
    >>> calibkit.load_recipe("gyro_pair", site__latitude_deg=34.2).overrides
    ('site.latitude_deg=34.2',)
    >>> calibkit.load_recipe({"procedure": "gyro_noise", "logs": {"files": ["*"]}}).name
    'recipe'

    """
    overrides = toml_text.write_overrides(settings)
    if isinstance(name, Mapping):
        source = toml_text.from_tables(name, overrides)
    else:
        source = recipes.find(str(name), overrides)
    instruments.parse_recipe(source)
    return source


def _source(recipe: AnyRecipe) -> Source:
    """Recipe that was loaded, or that is named or given."""
    return recipe if isinstance(recipe, Source) else load_recipe(recipe)


def examine(recipe: AnyRecipe, data: AnyPath) -> tuple[LogReport, ...]:
    """What each log holds that a recipe would read from a folder, and what is wrong with it;
    `calibkit check`.
    """
    return inspection.check(_source(recipe), Path(data)).logs


def fit(
    recipe: AnyRecipe,
    data: AnyPath | None = None,
    *,
    logs: Mapping[str, pd.DataFrame] | None = None,
    date: str | None = None,
    serial: str = "",
    runs: AnyPath | None = "runs",
) -> Run:
    """Fit a recipe to the logs of a folder, or to frames, and write the next run folder or none;
    `calibkit fit`.

    Parameters
    ----------
    recipe : from `load_recipe`, or its path or name, or a dictionary of its tables.
    data : folder of the logs.
    logs : name of a log → frame, in place of a folder; the name is that of the file that the recipe
        reads, with or without the suffix, the columns are canonical or those that it maps. The
        digest of such a log is that of the names and values of its columns.
    date : YYYY-MM-DD from which the coefficients hold; by default the date of the logs' last row,
        and today's where they have none.
    serial : of the unit; the recipe's by default, and "unsaved" where nothing is written.
    runs : folder of all run folders; with None nothing is written.

    Returns
    -------
    Run: folder, records (one per stage), document (run.json), whose "verdict" is accepted, rejected
    or no verdict, residuals and figures.

    Raises
    ------
    CalibkitError : recipe, logs or fit at fault; nothing is written then.

    Examples
    --------
    >>> import calibkit, pandas as pd
    >>> simulated = calibkit.simulated("gyro_pair", 7)
    >>> logs = {name: pd.DataFrame(columns) for name, columns in simulated.logs.items()}
    >>> run = calibkit.fit("gyro_pair", logs=logs, runs=None, date="2026-11-21")
    >>> run
    <unsaved@r001: gyro_pair, accepted, 2 logs, not written>
    >>> run.document["verdict"]
    'accepted'

    """
    if (data is None) == (logs is None):
        raise UsageError("give either data, a folder, or logs, {name: frame}")
    source, out = _source(recipe), Path(analysis.NOT_WRITTEN if runs is None else runs)
    spec = instruments.parse_recipe(source)
    date = None if date is None else clock.date_or_today(date, "date")
    serial = str(serial or spec.serial or ("unsaved" if runs is None else ""))
    with contextlib.ExitStack() as stack:
        folder = Path(data or "")
        if logs is not None:
            folder = stack.enter_context(in_memory.hold(logs, analysis.patterns(spec)))
        outcome = pipeline.fit(source, folder, serial, out, date, silent, dry_run=runs is None)
    return Run.of_fit(outcome)


def find_run(name: AnyPath, runs: AnyPath = "runs") -> Run:
    """Run of a folder, a serial (its newest revision) or ``SERIAL@r003``; raises CalibkitError
    where a digest is wrong.
    """
    return _run(store.find(str(name), Path(runs)))


def _run(run: Run | AnyPath) -> Run:
    """Run that was loaded, or that is in a folder."""
    if isinstance(run, Run):
        return run
    stored_run = store.load(Path(run))
    return Run(stored_run.folder, stored_run.document, stored_run.records)


def compensate(
    run: Run | AnyPath, log: AnyPath, out: AnyPath, **settings: object
) -> tuple[str, ...]:
    """Compensate every row of a log with a run's coefficients and write it; returns the flags;
    `calibkit apply`.

    settings give the place of use: site__latitude_deg=58.9. Nothing is overwritten.
    """
    return pipeline.apply(_run(run), Path(log), Path(out), toml_text.write_overrides(settings))[1]


def validate(
    run: Run | AnyPath, data: AnyPath, out: AnyPath, **settings: object
) -> Mapping[str, Any]:
    """Frozen coefficients on logs that they have not seen: the document that is written too;
    settings like ``logs__files=["*.csv"]`` override the run's recipe; `calibkit validate`.
    """
    overrides = toml_text.write_overrides(settings)
    return pipeline.validate(_run(run), Path(data), Path(out), silent, overrides)[0]


def certify(
    run: Run | AnyPath,
    out: AnyPath,
    *,
    date: str,
    profile: AnyPath | None = None,
    validation: AnyPath | None = None,
    lang: Lang = "en",
) -> Issued:
    """Write the certificate of a run; `missing` of what is returned lists what makes it a DRAFT;
    `calibkit certify`.
    """
    folder = run.folder if isinstance(run, Run) else Path(run)
    if isinstance(run, Run) and run.in_memory:
        raise UsageError(
            f"{run.name} was not written, and a certificate is of a run folder",
            hint='fit with runs="runs"',
        )
    return certificates.certify(
        folder,
        Path(out),
        instruments.certificate_layout,
        date=date,
        profile_path=None if profile is None else Path(profile),
        validation=None if validation is None else Path(validation),
        lang=lang,
    )


def export_firmware(
    run: Run | AnyPath,
    target: str,
    out: AnyPath,
    *,
    number: str = "f32",
    prefix: str = "cal",
    address: int | None = None,
) -> tuple[Path, ...]:
    """Write a run's correction chain for a firmware target, hex to an address; a rejected
    run is refused; `calibkit export`.
    """
    files = pipeline.export([_run(run)], target, number, prefix, Path(out), address=address)
    return tuple(files)


def verify(
    path: AnyPath,
    trust: Sequence[AnyPath] = (),
    *,
    require_signature: bool = False,
    at: dt.date | None = None,
) -> str:
    """What a file of calibkit's is; raises CalibkitError where its digest, signature or vectors are
    wrong, or a signature is not what is asked for (`calibkit verify`).
    """
    roots = tuple(map(Path, trust))
    demands = Demands(trust=roots, required=require_signature, at=at)
    verified = pipeline.verify(Path(path), demands)
    return "; ".join((verified.what, *verified.warnings))


def load_coefficients(path: AnyPath) -> Record:
    """Record of a coefficient file of any released format; raises CalibkitError where its digest is
    wrong.
    """
    return coefficients.loads(store.read_utf8(Path(path)), str(path))


def evaluate(run: Run | AnyPath, model: str, **at: ArrayLike) -> tuple[Array, Array]:
    """Result of a run's model at inputs, and its standard uncertainty: type A, and of a drift model
    on levels its error on left-out ramps and, at rest, its hysteresis.

    Parameters
    ----------
    run : from `fit` or `find_run`, or its folder.
    model : name of the model in the run's coefficient files; ``stage.model`` where several files
        have one of that name.
    at : canonical column = values [n] in its unit, one per input of the model's form; rates and
        gradients of a drift model on levels that are not given are 0, as at rest. Ranges are those
        of `valid` in the file; beyond them the form is extrapolated.

    Returns
    -------
    Result [n] ([n, m] of m components) and its standard uncertainty, of the same shape.

    Raises
    ------
    CalibkitError : no such model or one whose form has no result by itself; an input that is
        missing, unknown, or no numbers.

    See Also
    --------
    Run.model : the same with the covariance between inputs.

    """
    result = _run(run).model(model).evaluate(**at)
    return result.value, result.standard_uncertainty


def read_log(recipe: AnyRecipe, log: AnyPath) -> pd.DataFrame:
    """Tidy frame of a log: every canonical column that the recipe finds in it, in canonical units,
    which `attrs["units"]` states, and signs.

    Where the recipe's procedure finds held conditions, those that `calibkit check` lists (soaks,
    ramps, held rates, dwells, stations), `segment` is their number, from 1 in order of time, and
    NaN on rows between them. A log's own `segment` is kept.
    """
    spec = instruments.parse_recipe(_source(recipe))
    axis_columns = [f"{kind}_{axis}_{unit}" for kind, unit in KINDS for axis in AXES]
    columns = dict.fromkeys((*frame.CANONICAL, *axis_columns, *spec.columns, *spec.own_columns()))
    file = Path(log)
    tidy = log_files.read_log(spec, file, file.name, (), tuple(columns)).frame
    in_memory.label_units(tidy)
    if "segment" in tidy.columns:
        return tidy
    numbers = examination.segment_numbers(
        instruments.find(spec.procedure), spec, file.parent, file.name
    )
    return tidy if numbers is None else tidy.assign(segment=numbers.reindex(tidy.index))


def simulated(procedure: str, seed: int) -> Campaign:
    """Simulated logs of a procedure with the truth they were made from; `calibkit simulate`."""
    return pipeline.simulated(procedure, seed)
