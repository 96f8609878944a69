"""What the logs of a folder show when an instrument decides whether they are its own."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path
from typing import Self

import numpy as np

from calibkit.logs import column_names, time_units
from calibkit.logs.column_names import LogColumn
from calibkit.logs.glimpse import Glimpse
from calibkit.logs.log_groups import Group
from calibkit.logs.recipe_text import UNSTATED, Parse, RecipeChoice, write_recipe
from calibkit.numeric import attitude
from calibkit.recipe import Recipe, Source

_STEADY_DEGC = 5.0
"""Range of a temperature up to which it is that of a room."""
_ATTITUDES = ("inclination_deg", "toolface_deg", "table_angle_deg", "position_deg")
"""Canonical columns that an angle of an attitude may be taken for by its name."""
_NEAR_GRAVITY = 0.1
"""Usual distance [g] of a triad's directions from those that its attitudes say."""
_NO_CHANNEL = re.compile(r"sweep|scan|alarm|number|^no\.?$|index|clip|^#|column|press|humid|count")
"""Words of columns that no instrument measured, or not this one."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """What an instrument knows of logs when it decides whether they are its own."""

    folder: Path
    group: Group
    second_logger: bool
    """Whether logs of the folder look like those of a chamber's logger."""
    chamber_loggers: tuple[Group, ...]
    """Other logs that do."""
    glimpse: Glimpse
    """What the numbers of the logs show."""
    columns: Mapping[str, LogColumn]
    """Canonical column → column of the logs."""
    alternatives: tuple[tuple[str, LogColumn], ...]
    """Columns that could be canonical ones too."""
    parse: Parse

    @classmethod
    def of(cls, folder: Path, group: Group, groups: Sequence[Group], parse: Parse) -> Self:
        """Evidence of a group among all groups of a folder."""
        glimpse = group.glimpse
        # a thermometer's counts come behind its °C
        ordered = sorted(
            group.columns, key=lambda c: _is_temperature(c) and not glimpse.is_like_degc(c.name)
        )
        columns, alternatives = column_names.assign_columns(ordered)
        air = columns.get("temp_env_degc")
        if air is not None and _is_temperature(air) and not glimpse.is_like_degc(air.name):
            alternatives.append(("temp_case_degc", columns.pop("temp_env_degc")))
        _find_attitudes(columns, group.columns, glimpse)
        _find_positions(columns, group.columns, glimpse)
        _take_only_channel(columns, group.columns, glimpse)
        chamber_loggers = tuple(
            other for other in groups if other.second_logger and other is not group
        )
        second_logger = any(other.second_logger for other in groups)
        return cls(
            folder,
            group,
            second_logger,
            chamber_loggers,
            glimpse,
            columns,
            tuple(pair for pair in alternatives if pair[1] not in columns.values()),
            parse,
        )

    def triad(self) -> list[str]:
        """Own names of the columns of a triad of accelerometers; empty where there is none."""
        for unit in ("g", "lsb"):
            names = [f"accel_{axis}_{unit}" for axis in "xyz"]
            if set(names) <= self.columns.keys():
                return [self.columns[name].name for name in names]
        return []

    @property
    def turned(self) -> bool | None:
        """Whether a triad of accelerometers was turned; None where there is none, or its numbers
        are not known.
        """
        return self.glimpse.is_turned(self.triad())

    def warms(self, name: str) -> bool:
        """Whether a temperature changes by more than a room does, or is not known to stay."""
        column = self.columns.get(name)
        return column is not None and not self.glimpse.span(column.name) < _STEADY_DEGC

    def cycles(self, name: str) -> bool:
        """Whether a temperature is known to go up and down by more than that of a room."""
        column = self.columns.get(name)
        return column is not None and self.glimpse.swing(column.name) > _STEADY_DEGC

    def gyros(self, units: str = "lsb|dph") -> dict[str, LogColumn]:
        """Indications of gyros, in counts per second or as rates."""
        pattern = rf"gyro(_[a-z0-9]+)?_({units})"
        return {
            name: column for name, column in self.columns.items() if re.fullmatch(pattern, name)
        }

    def choose(
        self,
        name: str,
        canonical_names: Sequence[str],
        columns: Mapping[str, LogColumn] | None = None,
        keys: Mapping[str, str] | None = None,
        reason: str = "",
    ) -> RecipeChoice:
        """Choice of a shipped recipe that reads the wanted columns; the rest could be canonical
        columns too.
        """
        candidates = self.columns if columns is None else columns
        unread = [
            (name, column) for name, column in candidates.items() if name not in canonical_names
        ]
        mapping = {name: candidates[name] for name in canonical_names if name in candidates}
        return RecipeChoice(
            name,
            mapping,
            (*self.alternatives, *unread),
            keys or {},
            lines=self._guess_units(mapping),
            reason=reason,
        )

    def choose_at_rest(
        self, name: str, keys_of: Callable[[Sequence[str]], Mapping[str, str]]
    ) -> RecipeChoice | None:
        """Choice of a shipped recipe for all channels of an instrument that stands still beside one
        temperature, with its keys for these channels; None for other logs.
        """
        columns = self.columns
        channels = [name for name in columns if re.fullmatch(r"(gyro|accel)_.*", name)]
        temperature = columns.get("temp_case_degc") or columns.get("temp_env_degc")
        on_table = self.turned or bool({"table_rate_dps", "position_deg"} & columns.keys())
        if not channels or "time_s" not in columns or temperature is None or on_table:
            return None
        base = {name: column for name, column in columns.items() if not name.startswith("temp_")}
        base["temp_case_degc"] = temperature
        sensor = "a gyro" if channels[0].startswith("gyro") else "an accelerometer"
        channels_text = sensor if len(channels) == 1 else f"{len(channels)} channels at rest"
        read = ("time_s", "temp_case_degc", *channels)
        reason = f"{channels_text} beside one temperature"
        return self.choose(name, read, base, keys_of(channels), reason=reason)

    def _guess_units(self, mapping: Mapping[str, LogColumn]) -> dict[str, tuple[str, ...]]:
        """Units that the numbers of columns without one show: of times by their spacing, of a triad
        by the length of gravity.
        """
        silent = {
            name: column.name
            for name, column in mapping.items()
            if not (column.stated or column.is_time) and column.name in self.glimpse.first
        }
        lines = {}
        if "time_s" in silent:
            keys = time_units.guess_keys(self.glimpse.first[silent["time_s"]])
            lines["time_s"] = tuple(f"{key} # by its spacing" for key in keys.split(", ") if key)
        axes = [name for name in silent if re.fullmatch(r"accel_[xyz]_g", name)]
        if len(axes) == 3 and self.glimpse.is_gravity([silent[name] for name in axes]):
            lines |= dict.fromkeys(axes, ('unit = "m/s^2" # by the length of gravity',))
        return lines

    def recipe(self, choice: RecipeChoice) -> Recipe:
        """Recipe that a choice gives."""
        text = write_recipe(self.folder, choice, self.group, (), self.parse)
        # what a person has to state is taken as stated; a scale of 1 would not be
        completed_text = text.replace(f"{UNSTATED}scale = 1.0", 'header_unit = "ignored"')
        return self.parse(Source("proposed recipe", completed_text.replace(UNSTATED, "")))


def _is_temperature(column: LogColumn) -> bool:
    """Whether a column is a temperature by its name, without a unit."""
    return not column.stated and column.guess_canonical().startswith("temp_")


def _find_attitudes(
    columns: dict[str, LogColumn], log_columns: Sequence[LogColumn], glimpse: Glimpse
) -> None:
    """Enter the two columns of angles that say where a triad that was turned has gravity, whatever
    they are called, as its inclination and toolface.
    """
    axes = [f"accel_{axis}_g" for axis in "xyz"]
    if {"inclination_deg", "toolface_deg"} <= columns.keys() or not set(axes) <= columns.keys():
        return
    triad = [columns[axis].name for axis in axes]
    if not glimpse.is_turned(triad):
        return
    numbers = glimpse.first
    vectors = np.column_stack([numbers[name] for name in triad])
    direction = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    taken = {column.name for name, column in columns.items() if name not in _ATTITUDES}
    angles = [
        column
        for column in log_columns
        if column.name in numbers and column.name not in taken and column.stated in ("", "deg")
    ]
    for inclination, toolface in permutations(angles, 2):
        gravity = attitude.gravity_vector(numbers[inclination.name], numbers[toolface.name])
        # the log's sign is mapped by the recipe: it may be that of specific force
        misfit = (np.linalg.norm(direction - sign * gravity, axis=1) for sign in (1.0, -1.0))
        if min(map(np.nanmedian, misfit)) < _NEAR_GRAVITY:
            for name in _ATTITUDES:
                if columns.get(name) in (inclination, toolface):
                    del columns[name]
            columns |= {"inclination_deg": inclination, "toolface_deg": toolface}
            return


def _find_positions(
    columns: dict[str, LogColumn], log_columns: Sequence[LogColumn], glimpse: Glimpse
) -> None:
    """Enter a column of angles that stands at quarter turns as the rotation about a tool's axis."""
    if "position_deg" in columns or not {"accel_x_g", "accel_y_g"} <= columns.keys():
        return
    assigned = {column.name for column in columns.values()}
    for column in log_columns:
        free = column.name not in assigned or column is columns.get("table_angle_deg")
        if free and column.dimension in ("", "angle") and glimpse.is_quartered(column.name):
            columns.pop("table_angle_deg", None)
            columns["position_deg"] = column
            return


def _take_only_channel(
    columns: dict[str, LogColumn], log_columns: Sequence[LogColumn], glimpse: Glimpse
) -> None:
    """Enter the only unknown column beside a time and a temperature as a gyro's."""
    if any(name.startswith(("gyro_", "accel_")) for name in columns):
        return
    if not {"temp_case_degc", "temp_env_degc"} & columns.keys():
        return
    assigned = {column.name for column in columns.values()}
    unknown = [
        column
        for column in log_columns
        if column.name not in assigned
        and column.kind == "number"
        and column.dimension in ("", "voltage", "current")
        and not (_NO_CHANNEL.search(column.plain) or glimpse.is_counter(column.name))
        and not column.guess_canonical()
    ]
    if len(unknown) == 1 and unknown[0].name in glimpse.first:
        columns["gyro_dph"] = unknown[0]
