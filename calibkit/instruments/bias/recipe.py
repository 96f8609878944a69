"""Recipes of the bias of a static instrument: `bias_temperature`, polynomials of any abscissa, and
`thermal`, terms of one thermometer, its rate and lags.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, field_validator, model_validator

from calibkit.recipe.tables import NonNegative, Positive, Recipe, Table

GROUP, EFFECT = "power-on", "turn-on bias"
"""Error that all rows of a power-on share."""
Name = Annotated[str, Field(min_length=1)]


class Bias(Table):
    """One polynomial: which column, against which, to which order."""

    indication: Annotated[str, Field(min_length=1)]
    order: Annotated[int, Field(ge=0, le=9)]


class Polynomials(Table):
    """The polynomials that share an abscissa."""

    abscissa: Annotated[str, Field(min_length=1)]
    bias: Annotated[tuple[Bias, ...], Field(min_length=1, strict=False)]
    min_rows: Annotated[int, Field(ge=3)] = 10
    max_gap_s: Positive = 60.0


class BiasAcceptance(Table):
    """Limits on each channel; a limit that is not stated is not tested."""

    max_residual_over_noise: Positive | None = None


class _DriftOutput(Table):
    """Columns that `apply` adds to the compensated channels."""

    drift: bool = False


class BiasTemperatureRecipe(Recipe):
    """A static instrument that warms up: each channel's bias as a polynomial of a temperature."""

    error_groups: ClassVar[tuple[str, ...]] = ("log",)

    procedure: Literal["bias_temperature"]
    polynomials: Polynomials
    acceptance: BiasAcceptance = BiasAcceptance()
    output: _DriftOutput = _DriftOutput()

    def own_columns(self) -> tuple[str, ...]:
        """The abscissa and the indications, whatever they are called."""
        return (self.polynomials.abscissa, *(entry.indication for entry in self.polynomials.bias))

    def still_columns(self) -> tuple[str, ...]:
        """The indications, whatever they are called."""
        return tuple(entry.indication for entry in self.polynomials.bias)

    def largest_gap_s(self) -> float:
        """Largest gap [s] that a log may have."""
        return self.polynomials.max_gap_s


class _PowerOn(Table):
    """An instant at which the instrument was switched on again within a log."""

    log: Name
    at_s: float


class _Withheld(Table):
    """A stretch of a log whose indications are not fitted, but tested; its temperatures still drive
    the lags.
    """

    log: Name
    from_s: float
    to_s: float

    @model_validator(mode="after")
    def _ordered(self) -> _Withheld:
        if self.to_s <= self.from_s:
            raise ValueError(f"to_s = {self.to_s:.12g} is not after from_s = {self.from_s:.12g}")
        return self


class ThermalTable(Table):
    """Channels, choice of their terms, and power-ons."""

    channels: Annotated[tuple[Name, ...], Field(min_length=1, strict=False)]
    model: Literal["auto", "level", "lagged"] = "auto"
    interval_s: Positive | Literal["auto"] = "auto"
    min_rows: Annotated[int, Field(ge=3)] = 200
    min_span_degc: Positive = 5.0
    max_gap_s: Positive = 60.0
    sessions: Annotated[
        tuple[Annotated[tuple[Name, ...], Field(min_length=1, strict=False)], ...],
        Field(strict=False),
    ] = ()
    power_on: Annotated[tuple[_PowerOn, ...], Field(strict=False)] = ()
    withheld: Annotated[tuple[_Withheld, ...], Field(strict=False)] = ()

    @field_validator("channels")
    @classmethod
    def _indications(cls, channels: tuple[str, ...]) -> tuple[str, ...]:
        twice = next((name for name in channels if channels.count(name) > 1), None)
        if twice is not None:
            raise ValueError(f"channel '{twice}' stands twice")
        for name in channels:
            if name.startswith(("temp_", "time_")):
                raise ValueError(
                    f"channel '{name}' is a thermometer or a clock, expected an indication of the"
                    " instrument"
                )
        return channels

    @field_validator("sessions")
    @classmethod
    def _in_one_session(cls, sessions: tuple[tuple[str, ...], ...]) -> tuple[tuple[str, ...], ...]:
        logs = [log for session in sessions for log in session]
        twice = next((log for log in logs if logs.count(log) > 1), None)
        if twice is not None:
            raise ValueError(f"log '{twice}' is in two sessions")
        return sessions


class _ThermalOutput(_DriftOutput):
    """Columns that `apply` adds to the compensated channels."""

    rate_uncertainty: bool = False


class _ThermalAcceptance(Table):
    """Limits on each channel; a limit that is not stated is not tested."""

    min_reduction: NonNegative | None = None
    max_residual_over_noise: Positive | None = None


class ThermalRecipe(Recipe):
    """A static instrument whose temperature changes: bias of each channel against one
    thermometer.
    """

    error_groups: ClassVar[tuple[str, ...]] = (GROUP,)

    procedure: Literal["thermal"]
    thermal: ThermalTable
    output: _ThermalOutput = _ThermalOutput()
    acceptance: _ThermalAcceptance = _ThermalAcceptance()

    def own_columns(self) -> tuple[str, ...]:
        """The channels, whatever they are called."""
        return self.thermal.channels

    def still_columns(self) -> tuple[str, ...]:
        """The channels, whatever they are called."""
        return self.thermal.channels

    def largest_gap_s(self) -> float:
        """No gap is too large: a power-on begins after one."""
        return float("inf")

    def named_logs(self) -> tuple[tuple[tuple[str, ...], tuple[str, ...]], ...]:
        """Sessions, power-ons and withheld stretches, with the logs that they name."""
        table = self.thermal
        return (
            (("thermal", "sessions"), tuple(log for logs in table.sessions for log in logs)),
            (("thermal", "power_on"), tuple(entry.log for entry in table.power_on)),
            (("thermal", "withheld"), tuple(entry.log for entry in table.withheld)),
        )
