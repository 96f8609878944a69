"""Tables that the recipes of every procedure share: logs, columns, site, exclusions, serial."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from calibkit import units
from calibkit.errors import RecipeError
from calibkit.recipe.logs import Logs
from calibkit.recipe.strict import NonNegative, Positive, Table
from calibkit.recipe.type_b import TypeB

__all__ = ["Column", "Exclude", "Logs", "NonNegative", "Pin", "Positive", "Recipe", "Site", "Table", "TypeB"]


class Column(Table):
    """Where a canonical column comes from: canonical = sign · (scale · value + offset) converted from `unit`.

    Without a unit the one that the log's header states holds, and without that the canonical one.
    """

    source: Annotated[str, Field(alias="from", min_length=1)]
    unit: str = ""
    sign: Literal[1, -1] = 1
    scale: float = 1.0
    offset: float = 0.0
    header_unit: Literal["must agree", "ignored"] = "must agree"
    time_format: str = ""
    date: str = ""
    accumulated: bool = False
    wraps_at: Positive | None = None
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

    latitude_deg: Annotated[float, Field(ge=-90.0, le=90.0)] | None = None
    height_m: float = 0.0
    gravity_mps2: Annotated[float, Field(gt=9.7, lt=9.9)] | None = None


class Exclude(Table):
    """A log, or a range of it, that is left out: by whom and why."""

    log: Annotated[str, Field(min_length=1)]
    from_s: float | None = None
    to_s: float | None = None
    reason: Annotated[str, Field(min_length=1)]
    person: Annotated[str, Field(min_length=1)]

    @model_validator(mode="after")
    def _ordered(self) -> Exclude:
        if self.from_s is not None and self.to_s is not None and self.to_s <= self.from_s:
            raise ValueError(f"to_s = {self.to_s:g} is not after from_s = {self.from_s:g}")
        return self


class Pin(Table):
    """A held condition that the recipe states, in place of those found in the log."""

    log: Annotated[str, Field(min_length=1)]
    kind: Literal["soak", "ramp", "rate", "dwell"]
    from_s: float
    to_s: float

    @model_validator(mode="after")
    def _ordered(self) -> Pin:
        if self.to_s <= self.from_s:
            raise ValueError(f"to_s = {self.to_s:g} is not after from_s = {self.from_s:g}")
        return self


class Recipe(Table):
    """What every recipe says, whatever the procedure."""

    procedure: str
    title: str = ""
    serial: str = ""
    reference_temp_degc: float = 25.0
    logs: Logs
    columns: dict[str, Column] = {}
    site: Site = Site()
    exclude: Annotated[tuple[Exclude, ...], Field(strict=False)] = ()
    segment: Annotated[tuple[Pin, ...], Field(strict=False)] = ()
    type_b: Annotated[tuple[TypeB, ...], Field(strict=False)] = ()

    @field_validator("type_b")
    @classmethod
    def _named_once(cls, terms: tuple[TypeB, ...]) -> tuple[TypeB, ...]:
        names = [term.name for term in terms]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise ValueError(f"type_b '{twice}' stands twice: one effect would count twice")
        return terms

    @field_validator("segment")
    @classmethod
    def _apart(cls, pins: tuple[Pin, ...]) -> tuple[Pin, ...]:
        for k, pin in enumerate(pins):
            for other in pins[:k]:
                if pin.log == other.log and pin.from_s < other.to_s and other.from_s < pin.to_s:
                    raise ValueError(f"two segments of {pin.log} overlap at {max(pin.from_s, other.from_s):g} s")
        return pins

    def own_columns(self) -> tuple[str, ...]:
        """Columns that a recipe names itself, beyond the canonical ones."""
        return ()
