"""The public interface: the commands as functions of paths and values, and the numeric core's most
wanted functions.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit import (
    coefficients,
    frame,
    inspection,
    instruments,
    pipeline,
    recipe as recipes,
    store,
)
from calibkit.arrays import Array
from calibkit.certificate import certify as certificates
from calibkit.check import examination
from calibkit.errors import CalibkitError, CoefficientError, UsageError
from calibkit.ingest import logs
from calibkit.instruments import silent
from calibkit.numeric.gum import Component as UncertaintyComponent, combine as combine_uncertainty
from calibkit.numeric.least_squares.regression import regress
from calibkit.numeric.noise.allan import overlapping as allan_deviation
from calibkit.numeric.wavelet.denoise import denoise
from calibkit.recipe import Source

if TYPE_CHECKING:
    import os
    from collections.abc import Mapping

    import pandas as pd
    from numpy.typing import ArrayLike

    from calibkit.certificate.certify import Issued
    from calibkit.certificate.words import Lang
    from calibkit.check.report import LogReport
    from calibkit.coefficients import Model, Record
    from calibkit.forms import Form
    from calibkit.simulate.campaign import Campaign
    from calibkit.store import Run

    AnyPath = str | os.PathLike[str]

__all__ = [
    "CalibkitError",
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


def load_recipe(name: AnyPath, **settings: object) -> Source:
    """Recipe of a file or of a shipped name, with settings on top.

    Parameters
    ----------
    name : path of a TOML file, or the name of a shipped recipe ("fog_thermal").
    settings : keys to override; a double underscore stands for the dot: site__latitude_deg=34.2.

    Raises
    ------
    CalibkitError : no such recipe, or one with a fault; the message names file, line, value and
        what is allowed.

    """
    source = recipes.find(str(name), _overrides(settings))
    instruments.parse_recipe(source)
    return source


def _overrides(settings: Mapping[str, object]) -> tuple[str, ...]:
    """Settings of Python as those of the command line."""
    return tuple(f"{key.replace('__', '.')}={_toml(value)}" for key, value in settings.items())


def _toml(value: object) -> str:
    """A Python value as TOML."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return f'"{value}"' if isinstance(value, str) else str(value)


def _source(given: Source | AnyPath) -> Source:
    """Recipe that was loaded, or is named."""
    return given if isinstance(given, Source) else recipes.find(str(given))


def examine(recipe: Source | AnyPath, data: AnyPath) -> tuple[LogReport, ...]:
    """What each log holds that a recipe would read from a folder, and what is wrong with it;
    `calibkit check`.
    """
    return inspection.check(_source(recipe), Path(data)).logs


def fit(
    recipe: Source | AnyPath,
    data: AnyPath,
    *,
    date: str | None = None,
    serial: str = "",
    runs: AnyPath = "runs",
) -> Run:
    """Fit a recipe to the logs of a folder and write the next run folder; `calibkit fit`.

    Parameters
    ----------
    recipe : from `load_recipe`, or its path or name.
    data : folder of the logs.
    date : YYYY-MM-DD from which the coefficients hold; by default the date of the logs' last row,
        and today's where they have none.
    serial : of the unit; the recipe's by default.
    runs : folder of all run folders.

    Returns
    -------
    Run: folder, records (one per stage) and document (run.json), whose "verdict" is accepted,
    rejected or no verdict.

    Raises
    ------
    CalibkitError : recipe, logs or fit at fault; nothing is written then.

    """
    return pipeline.fit(_source(recipe), Path(data), serial, Path(runs), date, silent).run


def find_run(name: AnyPath, runs: AnyPath = "runs") -> Run:
    """Run of a folder, a serial (its newest revision) or ``SERIAL@r003``; raises CalibkitError
    where a digest is wrong.
    """
    return store.load(store.find(str(name), Path(runs)))


def _run(given: Run | AnyPath) -> Run:
    """Run that was loaded, or that is in a folder."""
    return given if isinstance(given, store.Run) else store.load(Path(given))


def compensate(
    run: Run | AnyPath, log: AnyPath, out: AnyPath, **settings: object
) -> tuple[str, ...]:
    """Compensate every row of a log with a run's coefficients and write it; returns the flags;
    `calibkit apply`.

    settings give the place of use: site__latitude_deg=58.9. Nothing is overwritten.
    """
    return pipeline.apply(_run(run), Path(log), Path(out), _overrides(settings))[1]


def validate(run: Run | AnyPath, data: AnyPath, out: AnyPath) -> Mapping[str, Any]:
    """Frozen coefficients on logs that they have not seen: the document that is written too;
    `calibkit validate`.
    """
    return pipeline.validate(_run(run), Path(data), Path(out), silent)[0]


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
    folder = run.folder if isinstance(run, store.Run) else Path(run)
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
    """Write a run's correction chain for a firmware target, hex and srec to an address; a rejected
    run is refused; `calibkit export`.
    """
    files = pipeline.export([_run(run)], target, number, prefix, Path(out), address=address)
    return tuple(files)


def verify(path: AnyPath) -> str:
    """What a file of calibkit's is; raises CalibkitError where its digest, signature or vectors are
    wrong.
    """
    found = pipeline.verify(Path(path))
    return "; ".join((found.what, *found.warnings))


def load_coefficients(path: AnyPath) -> Record:
    """Record of a coefficient file of any released format; raises CalibkitError where its digest is
    wrong.
    """
    file = Path(path)
    try:
        text = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise CoefficientError(
            f"{file}: cannot be read: {error}", hint="name a coefficient file"
        ) from None
    return coefficients.loads(text, str(file))


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

    """
    found_run = _run(run)
    models = {
        f"{record.stage}.{one.name}": one
        for record in found_run.records.values()
        for one in record.models
    }
    found = [one for name, one in models.items() if model in (name, one.name)]
    if len(found) != 1:
        raise CoefficientError(
            f"{len(found)} models are called '{model}'", hint=f"there are: {', '.join(models)}"
        )
    form = instruments.model_forms(found_run.document["procedure"]).get(found[0].form)
    if form is None:
        raise CoefficientError(
            f"model '{model}': form {found[0].form} is not known", hint="use a newer calibkit"
        )
    return _evaluate_form(form, found[0], at)


class _Inputs(dict[str, Array]):
    """Inputs of a model, and which of them its form asked for."""

    def __init__(self, *given: Any) -> None:  # noqa: ANN401 (as dict)
        super().__init__(*given)
        self.asked: set[str] = set()

    def __getitem__(self, name: str) -> Array:
        self.asked.add(name)
        return super().__getitem__(name)

    def get(self, name: str, default: Any = None) -> Any:  # noqa: ANN401 (as dict)
        """Input of a name that need not be given."""
        self.asked.add(name)
        return super().get(name, default)


def _evaluate_form(form: Form, model: Model, at: Mapping[str, ArrayLike]) -> tuple[Array, Array]:
    """Result of a model and its standard uncertainty; UsageError for inputs that it cannot have."""
    try:
        columns = [np.asarray(values, dtype=np.float64) for values in at.values()]
        inputs = _Inputs(zip(at, np.broadcast_arrays(*map(np.atleast_1d, columns)), strict=True))
        result = form.evaluate(model, inputs), form.standard_uncertainty(model, inputs)
    except KeyError as error:
        raise UsageError(f"model '{model.name}' needs {error}", hint="give it by name") from None
    except (TypeError, ValueError) as error:
        raise UsageError(
            f"model '{model.name}': {error}", hint="give real numbers, as many of each"
        ) from None
    if unknown := at.keys() - inputs.asked:
        raise UsageError(
            f"model '{model.name}' has no input {', '.join(sorted(unknown))}",
            hint=f"its inputs are {', '.join(sorted(inputs.asked))}",
        )
    return result


def read_log(recipe: Source | AnyPath, log: AnyPath) -> pd.DataFrame:
    """Tidy frame of a log: every canonical column that the recipe finds in it, in canonical units
    and signs.

    Where the recipe's procedure finds held conditions, those that `calibkit check` lists (soaks,
    ramps, held rates, dwells, stations), `segment` is their number, from 1 in order of time, and
    NaN on rows between them. A log's own `segment` is kept.
    """
    spec = instruments.parse_recipe(_source(recipe))
    named = [f"{kind}_{axis}_{unit}" for kind, unit in KINDS for axis in AXES]
    wanted = dict.fromkeys((*frame.CANONICAL, *named, *spec.columns, *spec.own_columns()))
    file = Path(log)
    tidy = logs.read_log(spec, file, file.name, (), tuple(wanted)).frame
    if "segment" in tidy.columns:
        return tidy
    numbers = examination.segment_numbers(
        instruments.find(spec.procedure), spec, file.parent, file.name
    )
    return tidy if numbers is None else tidy.assign(segment=numbers.reindex(tidy.index))


def simulated(procedure: str, seed: int) -> Campaign:
    """Simulated logs of a procedure with the truth they were made from; `calibkit simulate`."""
    return pipeline.simulated(procedure, seed)
