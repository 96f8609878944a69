"""What a campaign is planned with: chamber, fixture, table, operator, and what is known of a
device.
"""

import math
from collections.abc import Sequence
from importlib import resources
from typing import Annotated, Self

from pydantic import Field, model_validator

from calibkit.errors import UsageError
from calibkit.fit.shared import Shared
from calibkit.recipe import Source
from calibkit.recipe.shared_errors import state_sizes
from calibkit.recipe.tables import ErrorComponent, Errors, NonNegative, Positive, Table

SAMPLE = "bench.toml"
"""The sample bench, which is assumed where no equipment file is given."""

Many = Field(min_length=1, strict=False)


class BenchChamber(Table):
    """A temperature chamber."""

    low_degc: Annotated[float, Field(ge=-273.15)]
    high_degc: float
    fastest_degc_per_min: Positive
    room_degc: float = 25.0
    settled_degc: Positive = 0.3

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.low_degc <= self.room_degc <= self.high_degc:
            raise ValueError("expected low_degc <= room_degc <= high_degc")
        return self


class Operator(Table):
    """Hours of the day in which a person is there."""

    from_h: Annotated[float, Field(ge=0.0, lt=24.0)] = 8.0
    to_h: Annotated[float, Field(gt=0.0, le=24.0)] = 17.0
    mount_h: NonNegative = 0.0
    remount_h: NonNegative = 0.5

    @model_validator(mode="after")
    def _a_day(self) -> Self:
        if self.to_h - self.from_h < max(self.mount_h, self.remount_h, 0.5):
            raise ValueError("the hours from from_h to to_h are too few for one mounting")
        return self


Spot = Annotated[
    tuple[Annotated[float, Field(ge=0.0, le=180.0)], Annotated[float, Field(ge=-360.0, le=360.0)]],
    Field(strict=False),
]
"""Inclination and toolface [°] of an attitude."""


class Fixture(Table):
    """A way to bring a device into attitudes."""

    move_s: NonNegative
    attended: bool = False
    step_deg: Annotated[int, Field(ge=1, le=90)] = 30
    spots: Annotated[tuple[Spot, ...], Field(strict=False)] = ()
    """Attitudes that it has, where they are not all those of the step."""


class RateTable(Table):
    """A rate table."""

    fastest_dps: Positive
    acceleration_dps2: Positive
    rates: Annotated[tuple[Annotated[int, Field(ge=2)], ...], Many] = (5, 7, 9, 11)


class Device(Table):
    """What is known of a type of device before it is measured."""

    lags_s: Annotated[tuple[Positive, ...], Many]
    fastest_degc_per_min: Positive
    noise: Positive
    noise_unit: str
    noise_s: Positive = 60.0
    dwell_s: Annotated[tuple[Positive, ...], Many] = (60.0,)
    warm_up_s: NonNegative = 0.0
    """Time after switching on that no log holds."""
    order: Annotated[int, Field(ge=1, le=3)] = 2
    """Highest power of temperature that is assumed where the recipe states none."""
    component: Annotated[tuple[ErrorComponent, ...], Field(strict=False)] = ()

    def noise_of(self, length_s: float) -> float:
        """Standard deviation of the mean over a time [s]: noise is white."""
        return self.noise * math.sqrt(self.noise_s / length_s)

    def size(self, group: str, effect: str) -> float:
        """Standard deviation of an error in its unit; 0 where none is assumed."""
        return {(e.group, e.effect): e.value for e in self.component}.get((group, effect), 0.0)

    @property
    def errors(self) -> Errors:
        """Errors as a recipe states them; rows need not have all of them, as those that others
        had.
        """
        # not checked as a recipe's: a recipe need not be able to state them
        return Errors.model_construct(groups="auto", source="history", component=self.component)

    def state(self, shared: Sequence[Shared]) -> list[Shared]:
        """Shared errors with the sizes that are assumed."""
        return state_sizes(self.errors, shared)


class Equipment(Table):
    """A laboratory as a plan needs it."""

    name: str = ""
    chamber: BenchChamber
    operator: Operator = Operator()
    attitudes: dict[str, Fixture]
    rate_table: RateTable | None = None
    device: dict[str, Device]

    def known_device(self, procedure: str, noise_unit: str | None = None) -> Device:
        """What is known of the devices of a procedure; UsageError where nothing is, or where the
        noise has another unit than the procedure needs.
        """
        if procedure not in self.device:
            raise UsageError(
                f"the equipment file has no [device.{procedure}]",
                hint="copy it from calibkit plan --print-equipment and state your own values",
            )
        device = self.device[procedure]
        if noise_unit is not None and device.noise_unit != noise_unit:
            raise UsageError(
                f"noise_unit = '{device.noise_unit}' of [device.{procedure}], expected"
                f" '{noise_unit}'",
                hint=f"state the noise of the mean over noise_s in {noise_unit}",
            )
        return device

    def fixture(self, name: str) -> Fixture:
        """A fixture of the laboratory by its name; UsageError where it has none."""
        if name not in self.attitudes:
            raise UsageError(
                f"the equipment file has no [attitudes.{name}]",
                hint=f"it has {', '.join(self.attitudes)}",
            )
        return self.attitudes[name]

    def fastest(self, device: Device) -> float:
        """Fastest ramp [°C/min] that the chamber makes and the device may see."""
        return min(self.chamber.fastest_degc_per_min, device.fastest_degc_per_min)

    def soak_s(self, device: Device, change_degc: float, rate: float) -> float:
        """Length [s] of a soak after a ramp at a rate [°C/min], in whole minutes: until the device
        with its longest lag is as near to the final temperature as the chamber table states.
        """
        lag = max(device.lags_s)
        ramp_s = abs(change_degc) / rate * 60.0
        # a first-order lag τ behind a ramp of rate r: r τ (1 - exp(-t/τ)), then exponential decay
        lag_degc = rate / 60.0 * lag * -math.expm1(-ramp_s / lag)
        wait = lag * math.log(max(lag_degc / self.chamber.settled_degc, 1.0))
        return 60.0 * math.ceil(wait / 60.0)


def sample_text() -> str:
    """Text of the sample bench."""
    return resources.files("calibkit.planning").joinpath(SAMPLE).read_text(encoding="utf-8")


def read_equipment(source: Source | None) -> Equipment:
    """Equipment of a file, of the sample bench without one; RecipeError with every fault."""
    return (source or Source(SAMPLE, sample_text())).table(Equipment)
