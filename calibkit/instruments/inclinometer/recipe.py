"""Recipe of a four-position inclinometer: stations, root of s, s(T), limits."""

from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from calibkit.numeric.least_squares.polynomial import HIGHEST_ORDER
from calibkit.recipe.tables import NonNegative, Positive, Recipe, Site, Table

Degrees = Annotated[float, Field(gt=0.0, le=90.0)]


class _Place(Site):
    """Site of the stations; the latitude is required for the earth's rate across the tool."""

    latitude_deg: Annotated[float, Field(ge=-90.0, le=90.0)]
    latitude_uncertainty_deg: NonNegative = 0.0


class _Sign(Table):
    """Sign convention of the accelerometer indications."""

    convention: Literal["gravity", "specific_force"] = "gravity"


class _StationSpec(Table):
    """Sensor pairs that are read, and method by which a station's components are found from its
    positions.
    """

    pairs: Literal["both", "x", "y"] = "both"
    method: Literal["four_differences", "least_squares"] = "four_differences"
    gyro_ramp: bool = False
    gyro_noise_dph: Positive | Literal["auto"] = "auto"
    accel_noise_g: Positive | Literal["auto"] = "auto"
    dwell_s: Positive = 20.0
    settle_s: NonNegative = 2.0

    @model_validator(mode="after")
    def _ramp_by_least_squares(self) -> Self:
        if self.gyro_ramp and self.method != "least_squares":
            raise ValueError("gyro_ramp = true needs method = 'least_squares'")
        return self


class _RootSpec(Table):
    """Criterion for the choice between two positive roots of s."""

    choice: Literal["history", "heading"] = "history"


class HistorySpec(Table):
    """Prior of s before the first station of a calibration, and its rate of change per hour (per
    station without times).
    """

    s: Positive = 1.0
    standard_uncertainty: Positive = 0.01
    rate: float = 0.0
    rate_uncertainty: NonNegative = 1e-3
    rate_walk: NonNegative = 1e-3


class DepartureSpec(Table):
    """Relative departure of s from s(T) since the calibration: its uncertainty, and how it may
    change per hour.
    """

    s: ClassVar[float] = 1.0
    rate: ClassVar[float] = 0.0
    standard_uncertainty: Positive = 1e-4
    rate_uncertainty: NonNegative = 1e-5
    rate_walk: NonNegative = 1e-5


class _ScaleSpec(Table):
    """s(T): order of the polynomial over temperature, and plausible range of s."""

    order: Annotated[int, Field(ge=0, le=HIGHEST_ORDER)] | Literal["auto"] = "auto"
    smallest: Positive = 0.8
    largest: Positive = 1.25

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.largest <= self.smallest:
            raise ValueError(
                f"largest = {self.largest:g} is not above smallest = {self.smallest:g}"
            )
        return self


class LimitSpec(Table):
    """Limits beyond which a station is refused, or its own s is not used."""

    latitude_deg: Degrees = 80.0
    vertical_deg: Degrees = 0.5
    horizontal_deg: Degrees = 85.0
    s_uncertainty: Positive = 0.02
    separation: Positive = 6.0


class _OutputSpec(Table):
    """Columns that `apply` adds beside the angles, and whether it writes every row or one a
    station.
    """

    azimuth_uncertainty: bool = False
    rows: Literal["all", "station"] = "all"


class _InclinometerAcceptance(Table):
    """Limits on the angles after correction; a limit that is not stated is not tested."""

    max_azimuth_rms_deg: Positive | None = None
    max_azimuth_error_deg: Positive | None = None
    max_inclination_error_deg: Positive | None = None
    max_toolface_error_deg: Positive | None = None
    max_residual_over_noise: Positive | None = None


class InclinometerRecipe(Recipe):
    """Stations of a north-seeking inclinometer, each read in several rotations about the tool
    axis.
    """

    error_groups: ClassVar[tuple[str, ...]] = ("log", "mounting")

    procedure: Literal["inclinometer"]
    # empty by default, so that the loader names the missing key in it and not the table
    site: _Place = Field(default={}, validate_default=True)
    reference: _Sign = _Sign()
    stations: _StationSpec = _StationSpec()
    root: _RootSpec = _RootSpec()
    history: HistorySpec = HistorySpec()
    departure: DepartureSpec = DepartureSpec()
    scale: _ScaleSpec = _ScaleSpec()
    limits: LimitSpec = LimitSpec()
    output: _OutputSpec = _OutputSpec()
    acceptance: _InclinometerAcceptance = _InclinometerAcceptance()

    @property
    def axes(self) -> tuple[Literal["x", "y"], ...]:
        """Axes of the sensor pairs that are read."""
        return ("x", "y") if self.stations.pairs == "both" else (self.stations.pairs,)
