"""Logs of a rate table → the recipe that fits them: a pair for two gyros in two logs, a triad where
the names of the logs tell three table axes, else runs of single gyros.
"""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from calibkit import recipe
from calibkit.instruments.gyro_scale.recipe import GyroTriadRecipe
from calibkit.logs import mapping
from calibkit.logs.column_names import LogColumn
from calibkit.logs.evidence import Evidence
from calibkit.logs.log_groups import file_patterns
from calibkit.logs.recipe_text import RecipeChoice

TABLE_AXIS = re.compile(r"(?:^|[^a-z]|axis|achse|about|um)([xyz])(?![a-z])", re.IGNORECASE)
"""Table axis in the name of a log: a single letter, or a letter after a word for axis."""
REFERENCE = ("time_s", "table_rate_dps", "table_angle_deg", "temp_case_degc")
"""Columns that every rate-table recipe reads."""


def propose_pair(evidence: Evidence) -> RecipeChoice | None:
    """Choice of the pair recipe for two gyros in two logs."""
    axes, files = _axes(evidence), evidence.group.files
    if len(axes) != 2 or len(files) != 2:
        return None
    keys = {}
    if set(files) != {"table_axis_a.csv", "table_axis_b.csv"}:
        keys = {f"axis_{axis}": json.dumps(file) for axis, file in zip("ab", files, strict=True)}
    renamed = [(axis, column) for axis, (_, column) in zip("ab", axes, strict=True)]
    choice = _choose(evidence, "gyro_pair", renamed, keys)
    column_names = ", ".join(
        f"{axis}: {column.name}" for axis, column in zip("ab", dict(renamed).values(), strict=True)
    )
    return replace(
        choice, remark=f"# Gyro {column_names}; swap the logs where the table turned about b first."
    )


def propose_triad(evidence: Evidence) -> RecipeChoice | None:
    """Choice of the triad recipe for several gyros in logs named after three axes, with the keys
    that differ from the shipped recipe: gyros, and logs of each table axis.
    """
    axes, files = _axes(evidence), evidence.group.files
    axis_files: dict[str, list[str]] = {axis: [] for axis in "xyz"}
    for file in files:
        file_axes = {str(axis).lower() for axis in TABLE_AXIS.findall(mapping.log_name(file))}
        if len(file_axes) != 1:
            return None
        axis_files[file_axes.pop()].append(file)
    if len(axes) < 2 or not all(axis_files.values()):
        return None
    names = [axis for axis, _ in axes]
    keys = {} if names == ["x", "y", "z"] else {"gyros": json.dumps(names)}
    shipped = recipe.find("gyro_triad").table(GyroTriadRecipe)
    if any(shipped.list_axes(file) != [axis] for axis in axis_files for file in axis_files[axis]):
        all_files = [file for of_axis in axis_files.values() for file in of_axis]
        for axis, of_axis in axis_files.items():
            keys[axis] = json.dumps(file_patterns(of_axis, all_files), ensure_ascii=False)
    return _choose(evidence, "gyro_triad", axes, keys)


def propose_rate_table(evidence: Evidence) -> RecipeChoice | None:
    """Choice of the rate-table recipe for any other logs with gyros and a table rate."""
    axes = _axes(evidence)
    if not axes:
        return None
    names = [axis for axis, _ in axes]
    keys = {} if names == ["x"] else {"gyros": json.dumps(names)}
    return _choose(evidence, "rate_table", axes, keys)


def _axes(evidence: Evidence) -> list[tuple[str, LogColumn]]:
    """Axis and column of each gyro; empty for logs that are not of a rate table."""
    if "table_rate_dps" not in evidence.columns:
        return []
    # without times each row is a held rate: logs without a header, or of another rate in most rows
    rate = evidence.glimpse.first.get(evidence.columns["table_rate_dps"].name, np.empty(0))
    row_a_rate = rate.size > 1 and float(np.mean(np.diff(rate) != 0.0)) > 0.5
    if "time_s" not in evidence.columns and not (evidence.group.layout.names or row_a_rate):
        return []
    return [
        (name.split("_")[1] if name.count("_") > 1 else "x", column)
        for name, column in evidence.gyros().items()
    ]


def _choose(
    evidence: Evidence,
    name: str,
    axes: Sequence[tuple[str, LogColumn]],
    keys: Mapping[str, str],
) -> RecipeChoice:
    """Choice of a recipe that reads the gyros' columns in counts per second."""
    gyros = evidence.gyros()
    reference = {name: column for name, column in evidence.columns.items() if name not in gyros}
    renamed = {f"gyro_{axis}_lsb": column for axis, column in axes}
    count, logs = len(axes), len(evidence.group.files)
    reason = f"a table rate beside {count} gyro{'s' * (count > 1)}, in {logs} log{'s' * (logs > 1)}"
    columns = reference | renamed
    if "time_s" in evidence.columns:
        return evidence.choose(name, (*REFERENCE, *renamed), columns, keys, reason=reason)
    keys = {**keys, "one_row": "true"}
    choice = evidence.choose(name, (*REFERENCE, *renamed), columns, keys)
    return replace(
        choice,
        reason=f"rates in proportion to an indication, a row each, in {logs} log{'s' * (logs > 1)}",
        beside_files="rate_hz = 1.0 # a row is the mean over a held rate, and has no time",
    )
