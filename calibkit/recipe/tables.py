"""Tables that the recipes of every procedure share: logs, columns, site, exclusions, serial."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, field_validator, model_validator

from calibkit import units
from calibkit.errors import RecipeError
from calibkit.numeric.earth import local_gravity
from calibkit.recipe.correction import Correction
from calibkit.recipe.logs import Logs
from calibkit.recipe.strict import NonNegative, Positive, Table
from calibkit.recipe.type_b import TypeB

__all__ = [
    "ColumnMapping",
    "Errors",
    "Exclude",
    "Logs",
    "NonNegative",
    "Pin",
    "Positive",
    "Recipe",
    "Site",
    "Table",
    "TypeB",
]


class ColumnMapping(Table):
    """Where a canonical column comes from: canonical = sign · (scale · value + offset) converted
    from `unit`.

    Without a unit the one that the log's header states holds, and without that the canonical one.
    """

    #: Name of the column in the log; a unit in brackets behind it may be left out.
    source: Annotated[str, Field(alias="from", min_length=1)]
    #: Unit of the logged numbers; without it that of the header, else that of the key.
    unit: str = ""
    #: -1 turns the direction that counts as positive.
    sign: Literal[1, -1] = 1
    #: Factor on the logged number.
    scale: float = 1.0
    #: Added behind the factor, in `unit`.
    offset: float = 0.0
    #: "ignored" overrules a header that states a wrong unit.
    header_unit: Literal["must agree", "ignored"] = "must agree"
    #: Pattern of written times, in the letters of strptime; "excel": days of a spreadsheet.
    time_format: str = ""
    #: Column that holds the date of a time of day.
    date: str = ""
    #: The column is a running total, whose differences are the counts.
    accumulated: bool = False
    #: Number at which a counter or a clock begins again at 0.
    wraps_at: Positive | None = None
    #: Interval that counts per sample were counted in; without it the time since the row before.
    interval_s: Positive | None = None

    @field_validator("unit")
    @classmethod
    def _known(cls, unit: str) -> str:
        try:
            return units.known(unit) if unit else unit
        except RecipeError as error:
            raise ValueError(str(error)) from None

    @field_validator("scale")
    @classmethod
    def _nonzero(cls, scale: float) -> float:
        if scale == 0.0:
            raise ValueError("a scale of 0 erases the column")
        return scale


class Site(Table):
    """Where the laboratory, or the place of use, is."""

    #: Geographic latitude, north positive.
    latitude_deg: Annotated[float, Field(ge=-90.0, le=90.0)] | None = None
    #: Height above the ellipsoid, for gravity from the latitude.
    height_m: float = 0.0
    #: Local gravity as measured; without it computed from latitude and height.
    gravity_mps2: Annotated[float, Field(gt=9.7, lt=9.9)] | None = None

    def local_gravity(self) -> float | None:
        """Local gravity [m/s²] as measured, else from latitude and height; None if unknown."""
        if self.gravity_mps2 is not None or self.latitude_deg is None:
            return self.gravity_mps2
        return local_gravity(self.latitude_deg, self.height_m)


Numbers = Annotated[tuple[Annotated[int, Field(ge=0)] | str, ...], Field(strict=False)]
"""Whole numbers and ranges of them: [3, "7-12"]."""


class Exclude(Table):
    """A log, or a part of it, that is left out: by whom and why. The part is a range of time, or
    data rows (from 1), lines of the file, positions or stations.
    """

    #: Log, by its file name with or without the suffix.
    log: Annotated[str, Field(min_length=1)]
    #: Start of the range that is left out, counted from the first row.
    from_s: float | None = None
    #: End of that range.
    to_s: float | None = None
    #: Data rows, counted from 1; "7-12" is a range.
    rows: Numbers = ()
    #: Lines of the file as messages count them; they need not be rows.
    lines: Numbers = ()
    #: Numbers in the column `position`.
    positions: Numbers = ()
    #: Numbers in the column `station`.
    stations: Numbers = ()
    #: Why it is left out; stands in run.json and on the certificate.
    reason: Annotated[str, Field(min_length=1)]
    #: Who decided it.
    person: Annotated[str, Field(min_length=1)]

    @model_validator(mode="after")
    def _ordered(self) -> Exclude:
        if self.from_s is not None and self.to_s is not None and self.to_s <= self.from_s:
            raise ValueError(f"to_s = {self.to_s:.12g} is not after from_s = {self.from_s:.12g}")
        if len(self.parts) + self.timed > 1:
            raise ValueError(
                "one of from_s/to_s, rows, lines, positions, stations: write a table for each"
            )
        return self

    @field_validator("rows", "lines", "positions", "stations")
    @classmethod
    def _numbered(cls, entries: tuple[int | str, ...]) -> tuple[int | str, ...]:
        for entry in entries:
            _parse_range(entry)
        return entries

    @property
    def timed(self) -> bool:
        """Whether it is a range of time."""
        return self.from_s is not None or self.to_s is not None

    @property
    def parts(self) -> dict[str, tuple[tuple[int, int], ...]]:
        """Rows, lines, positions or stations that are left out, as ranges with both ends."""
        excluded = {
            "rows": self.rows,
            "lines": self.lines,
            "positions": self.positions,
            "stations": self.stations,
        }
        return {
            key: tuple(map(_parse_range, entries)) for key, entries in excluded.items() if entries
        }

    @property
    def whole(self) -> bool:
        """Whether the whole log is left out."""
        return not self.timed and not self.parts


def _parse_range(entry: int | str) -> tuple[int, int]:
    """Both ends of a range, `7` or `"7-12"`; raises ValueError for anything else."""
    first, dash, last = str(entry).partition("-")
    if not first.strip().isdigit() or (dash and not last.strip().isdigit()):
        raise ValueError(f"'{entry}': expected a whole number, or a range as \"7-12\"")
    ends = int(first), int(last or first)
    if ends[1] < ends[0]:
        raise ValueError(f"'{entry}': a range ascends")
    return ends


class SecondLogger(Logs):
    """A second logger, mostly the chamber's: which columns come from it, and how its clock is
    related to the log's.

    In `files`, "{log}" stands for the name of the log that a file belongs to.
    """

    #: Canonical columns that come from this logger.
    provides: Annotated[tuple[str, ...], Field(min_length=1, strict=False)]
    #: Mapping of its columns, as `[columns]` maps those of the log.
    columns: dict[str, ColumnMapping] = {}
    #: Offset of its clock: found from a shared quantity, stated, or zero.
    clock: Literal["estimate", "stated", "same"]
    #: Column of this logger that the log measured too.
    shared: str = ""
    #: The log's own column of the shared quantity.
    log_column: ColumnMapping | None = None
    #: Whether the clocks may run at different rates (clock = "estimate").
    drift: bool = True
    #: Added to the stamps of this logger: positive for a clock that is behind.
    offset_s: float = 0.0
    #: Rate of its clock less that of the log's (clock = "stated").
    drift_ppm: float = 0.0
    #: Standard uncertainty of a stated offset.
    standard_uncertainty_s: NonNegative | None = None
    #: Offsets are searched up to this far from `offset_s`.
    search_s: Positive = 120.0
    #: Largest standard uncertainty of an offset that is found.
    max_uncertainty_s: Positive = 1.0

    @model_validator(mode="after")
    def _of_the_clock(self) -> SecondLogger:
        if "time_s" in self.provides:
            raise ValueError("provides = ['time_s']: the log's own clock is kept")
        if self.clock == "estimate" and (not self.shared or self.log_column is None):
            raise ValueError(
                "clock = 'estimate' needs a quantity that both loggers measured: shared = a column"
                " of this logger, log_column = { from = the log's own column of the same quantity }"
            )
        if self.clock == "stated" and self.standard_uncertainty_s is None:
            raise ValueError(
                "clock = 'stated' needs standard_uncertainty_s beside offset_s and drift_ppm"
            )
        if self.clock == "same" and (self.offset_s or self.drift_ppm):
            raise ValueError(
                "clock = 'same' with an offset or a drift contradicts itself; say clock = 'stated'"
            )
        return self


class ErrorComponent(Table):
    """Standard deviation of an error that all observations of a group share, known beforehand, with
    the degrees of freedom of that knowledge.
    """

    #: Group of observations that share the error.
    group: Annotated[str, Field(min_length=1)]
    #: What the error does to them.
    effect: Annotated[str, Field(min_length=1)]
    #: Standard deviation of the error.
    value: NonNegative
    #: Unit of `value`; any unit of its kind.
    unit: str
    #: Degrees of freedom of that knowledge.
    dof: Positive

    @field_validator("unit")
    @classmethod
    def _known(cls, unit: str) -> str:
        return units.ALIASES.get(unit, unit)

    def value_in(self, unit: str) -> float:
        """Its value in a unit of the same kind; RecipeError with the units that are."""
        if self.unit == unit:
            return self.value
        try:
            return self.value * units.difference_factor(self.unit, unit)
        except RecipeError as error:
            raise RecipeError(
                f"[[errors.component]] '{self.effect}' of group '{self.group}': {error.message}",
                hint=error.hint,
            ) from None


class Errors(Table):
    """Errors that observations share: which groups are tried, and which components are known."""

    #: Groups whose shared errors are tried; [] for none.
    groups: Literal["auto"] | Annotated[tuple[str, ...], Field(strict=False)] = "auto"
    #: "history" pools the components of earlier runs of devices of this `type`.
    source: Annotated[Literal["none", "history"], Field(alias="from")] = "none"
    component: Annotated[tuple[ErrorComponent, ...], Field(strict=False)] = ()

    @field_validator("component")
    @classmethod
    def _stated_once(cls, components: tuple[ErrorComponent, ...]) -> tuple[ErrorComponent, ...]:
        names = [(entry.group, entry.effect) for entry in components]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise ValueError(f"the component '{twice[1]}' of group '{twice[0]}' is stated twice")
        return components


class Pin(Table):
    """A held condition that the recipe states, in place of those found in the log."""

    #: Log, by its file name with or without the suffix.
    log: Annotated[str, Field(min_length=1)]
    #: What was held: a temperature, a temperature rate, a table rate, an attitude.
    kind: Literal["soak", "ramp", "rate", "dwell"]
    #: Start, counted from the first row.
    from_s: float
    #: End.
    to_s: float

    @model_validator(mode="after")
    def _ordered(self) -> Pin:
        if self.to_s <= self.from_s:
            raise ValueError(f"to_s = {self.to_s:.12g} is not after from_s = {self.from_s:.12g}")
        return self


class ExportTable(Table):
    """How the corrections of a run become firmware."""

    #: Full scale of an indication, for the second error bound that a C header states.
    full_scale: dict[str, Positive] = {}
    #: "padded": devices of one model form share a loader; "fitted": terms that are 0 are left
    #: out.
    layout: Literal["padded", "fitted"] = "padded"


class Recipe(Table):
    """What every recipe states, whatever the procedure."""

    error_groups: ClassVar[tuple[str, ...]] = ()
    """Groups of observations whose shared errors the procedure estimates; without one it takes no
    [errors].
    """

    full_scales: ClassVar[Mapping[str, float]] = {}
    """Indication with its unit → full scale of the firmware where the recipe states none."""

    #: Procedure that fits the logs.
    procedure: str
    #: Type of device, for pooled components and shared firmware layouts.
    type: str = ""
    #: Title of the report.
    title: str = ""
    #: Serial number where --serial states none.
    serial: str = ""
    #: Temperature at which a drift is zero, clamped to the fitted range.
    reference_temp_degc: Annotated[float, Field(ge=-273.15)] = 25.0
    logs: Logs
    #: Mapping of columns that have other names, units or signs than the canonical ones.
    columns: dict[str, ColumnMapping] = {}
    site: Site = Site()
    exclude: Annotated[tuple[Exclude, ...], Field(strict=False)] = ()
    chamber: SecondLogger | None = None
    correction: Annotated[tuple[Correction, ...], Field(strict=False)] = ()
    segment: Annotated[tuple[Pin, ...], Field(strict=False)] = ()
    type_b: Annotated[tuple[TypeB, ...], Field(strict=False)] = ()
    errors: Errors = Errors()
    export: ExportTable = ExportTable()

    @field_validator("export")
    @classmethod
    def _of_corrected_indications(cls, export: ExportTable) -> ExportTable:
        for name in export.full_scale:
            if name not in cls.full_scales:
                expected = " or ".join(cls.full_scales) or "none: no indication enters the firmware"
                raise ValueError(f"full_scale of '{name}', expected {expected}")
        return export

    @field_validator("errors")
    @classmethod
    def _of_known_groups(cls, errors: Errors) -> Errors:
        if not cls.error_groups:
            raise ValueError("this procedure estimates no errors that observations share")
        groups = () if errors.groups == "auto" else errors.groups
        for group in (*groups, *(entry.group for entry in errors.component)):
            if group not in cls.error_groups:
                raise ValueError(f"group '{group}', expected {' or '.join(cls.error_groups)}")
        return errors

    def full_scale(self, name: str) -> float:
        """Full scale of an indication in firmware, stated or usual."""
        return self.export.full_scale.get(name, self.full_scales[name])

    @model_validator(mode="after")
    def _history_of_a_type(self) -> Self:
        if self.errors.source == "history" and not self.type:
            raise ValueError(
                "errors.from = 'history' needs type: runs of the same type of device are pooled"
            )
        return self

    @field_validator("columns")
    @classmethod
    def _keys_belong_to_column(cls, columns: dict[str, ColumnMapping]) -> dict[str, ColumnMapping]:
        for name, column in columns.items():
            if name != "time_s" and (column.time_format or column.date):
                raise ValueError(f"{name}: time_format and date belong to time_s")
            if name == "time_s" and (column.accumulated or column.interval_s is not None):
                raise ValueError("time_s: accumulated and interval_s belong to counts")
            if (
                column.interval_s is not None
                and column.unit != "1/sample"
                and not column.accumulated
            ):
                raise ValueError(
                    f"{name}: interval_s belongs to unit = '1/sample' or accumulated = true"
                )
        return columns

    @field_validator("type_b")
    @classmethod
    def _named_once(cls, terms: tuple[TypeB, ...]) -> tuple[TypeB, ...]:
        names = [term.name for term in terms]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise ValueError(f"type_b '{twice}' stands twice: one effect would count twice")
        return terms

    @field_validator("correction")
    @classmethod
    def _corrected_once(cls, corrections: tuple[Correction, ...]) -> tuple[Correction, ...]:
        columns = [entry.column for entry in corrections]
        twice = next((column for column in columns if columns.count(column) > 1), None)
        if twice is not None:
            raise ValueError(f"'{twice}' is corrected twice")
        return corrections

    @field_validator("segment")
    @classmethod
    def _segments_do_not_overlap(cls, pins: tuple[Pin, ...]) -> tuple[Pin, ...]:
        for k, pin in enumerate(pins):
            for other in pins[:k]:
                if pin.log == other.log and pin.from_s < other.to_s and other.from_s < pin.to_s:
                    overlap_s = max(pin.from_s, other.from_s)
                    raise ValueError(f"two segments of {pin.log} overlap at {overlap_s:.12g} s")
        return pins

    def named_logs(self) -> tuple[tuple[tuple[str, ...], tuple[str, ...]], ...]:
        """Tables of a recipe whose keys are names of logs, with those names."""
        return ()

    def own_columns(self) -> tuple[str, ...]:
        """Columns that a recipe names itself, beyond the canonical ones."""
        return ()

    def on_site(self) -> Self:
        """The recipe with the site's gravity computed from latitude and height where it was not
        measured.
        """
        site = self.site.model_copy(update={"gravity_mps2": self.site.local_gravity()})
        return self.model_copy(update={"site": site})
