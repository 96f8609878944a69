"""Which logs a run has not seen: told by their bytes, and by the fingerprint of their values that its run.json keeps."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

from calibkit.check import copies
from calibkit.errors import FitError, FrameError, LogFormatError, RecipeError
from calibkit.stages import ingest

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from calibkit.recipe import Recipe
    from calibkit.stages.examination import Examiner


def fitted_before(
    procedure: Examiner,
    specs: Sequence[Recipe],
    data: Path,
    files: Sequence[str],
    inputs: Sequence[Mapping[str, object]],
) -> dict[str, str]:
    """File → what is said of it, of the logs that a run was fitted to: the same bytes, or the same values written otherwise.

    `specs` are the recipe as it was fitted, with what it left out of the logs, and as it is validated, with nothing left out.
    """
    digests = {entry["sha256"] for entry in inputs}
    kept = len(copies.untold(inputs)) < len(inputs)
    seen = {}
    for file in files:
        digest = ingest.digest(specs[0], data, file)
        if digest in digests:
            seen[file] = f"{file} was fitted by this run and is left out"
        elif kept and (name := next(filter(None, (_fitted(procedure, s, data, file, inputs) for s in specs)), "")):
            seen[file] = f"{file} holds the values of {name}, which this run was fitted to, and is left out"
    return seen


def _fitted(procedure: Examiner, spec: Recipe, data: Path, file: str, inputs: Sequence[Mapping[str, object]]) -> str:
    """Name of the fitted log whose values a log holds, or nothing."""
    with contextlib.suppress(
        LogFormatError, FrameError, FitError, RecipeError
    ):  # the validation says why it cannot be read
        return copies.fitted("", procedure.read(spec, data, file).first_rows(), inputs)
    return ""


def untold(run: str, inputs: Sequence[Mapping[str, object]]) -> list[str]:
    """Flag of a run that keeps no fingerprints of its logs' values."""
    names = copies.untold(inputs)
    if not names:
        return []
    listed = f"{len(names)} of its logs" if len(names) > 1 else names[0]
    said = f"{run} keeps no fingerprint of {listed}: a copy with other line ends or separators passes for a log it has not seen"
    return [f"{said}; fit again to have them told"]
