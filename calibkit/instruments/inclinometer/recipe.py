"""Recipe of a four-position inclinometer: stations, root of s, s(T), limits."""

from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from calibkit.numeric.least_squares.polynomial import HIGHEST_ORDER
from calibkit.recipe.tables import NonNegative, Positive, Recipe, Site, Table

Degrees = Annotated[float, Field(gt=0.0, le=90.0)]


class _Place(Site):
    """Site of the stations; the latitude is required for the earth's rate across the tool."""

    #: Geographic latitude of the stations, north positive; required.
    latitude_deg: Annotated[float, Field(ge=-90.0, le=90.0)]
    #: Its standard uncertainty.
    latitude_uncertainty_deg: NonNegative = 0.0


class _Sign(Table):
    """Sign convention of the accelerometer indications."""

    #: Sign of the accelerometers: positive along gravity, or specific force.
    convention: Literal["gravity", "specific_force"] = "gravity"


class _StationSpec(Table):
    """Sensor pairs that are read, and method by which a station's components are found from its
    positions.
    """

    #: Sensor pairs that are read.
    pairs: Literal["both", "x", "y"] = "both"
    #: Halved differences of four positions, or least squares on three or more.
    method: Literal["four_differences", "least_squares"] = "four_differences"
    #: Whether the bias of a gyro may drift within a station (least squares).
    gyro_ramp: bool = False
    #: Standard deviation of one gyro reading; "auto": from the closures.
    gyro_noise_dph: Positive | Literal["auto"] = "auto"
    #: Standard deviation of one accelerometer reading; "auto": from the closures.
    accel_noise_g: Positive | Literal["auto"] = "auto"
    #: Shortest stay in a position in a continuous log.
    dwell_s: Positive = 20.0
    #: Time that is left out at both ends of a stay.
    settle_s: NonNegative = 2.0

    @model_validator(mode="after")
    def _ramp_by_least_squares(self) -> Self:
        if self.gyro_ramp and self.method != "least_squares":
            raise ValueError("gyro_ramp = true needs method = 'least_squares'")
        return self


class _RootSpec(Table):
    """Criterion for the choice between two positive roots of s."""

    #: Of two positive roots the likelier by the history of s, or that of the azimuth nearer to
    #: `azimuth_deg`.
    choice: Literal["history", "heading"] = "history"


class HistorySpec(Table):
    """Prior of s before the first station of a calibration, and its rate of change per hour (per
    station without times).
    """

    #: s before the first station of a calibration.
    s: Positive = 1.0
    #: Standard uncertainty of that s.
    standard_uncertainty: Positive = 0.01
    #: Change of s per hour, or per station without times.
    rate: float = 0.0
    #: Standard uncertainty of that rate.
    rate_uncertainty: NonNegative = 1e-3
    #: Random walk of the rate per √h.
    rate_walk: NonNegative = 1e-3


class DepartureSpec(Table):
    """Relative departure of s from s(T) since the calibration: its uncertainty, and how it may
    change per hour.
    """

    s: ClassVar[float] = 1.0
    rate: ClassVar[float] = 0.0
    #: Departure from s(T) that is expected at the start of a log.
    standard_uncertainty: Positive = 1e-4
    #: Rate at which the departure may change, per hour.
    rate_uncertainty: NonNegative = 1e-5
    #: Random walk of that rate per √h.
    rate_walk: NonNegative = 1e-5


class _ScaleSpec(Table):
    """s(T): order of the polynomial over temperature, and plausible range of s."""

    #: Order of s(T); "auto" averages orders up to 3.
    order: Annotated[int, Field(ge=0, le=HIGHEST_ORDER)] | Literal["auto"] = "auto"
    #: Smallest plausible s.
    smallest: Positive = 0.8
    #: Largest plausible s.
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

    #: Largest latitude, north or south.
    latitude_deg: Degrees = 80.0
    #: Smallest inclination.
    vertical_deg: Degrees = 0.5
    #: Largest inclination.
    horizontal_deg: Degrees = 85.0
    #: Largest standard uncertainty of a root that is used.
    s_uncertainty: Positive = 0.02
    #: Roots closer than this many standard uncertainties are not used.
    separation: Positive = 6.0


class _OutputSpec(Table):
    """Columns that `apply` adds beside the angles, and whether it writes every row or one a
    station.
    """

    #: Whether `apply` adds the standard uncertainty of the azimuth.
    azimuth_uncertainty: bool = False
    #: Every row of the log, or one row per station.
    rows: Literal["all", "station"] = "all"


class _InclinometerAcceptance(Table):
    """Limits on the angles after correction; a limit that is not stated is not tested."""

    #: Largest rms error of the azimuth.
    max_azimuth_rms_deg: Positive | None = None
    #: Largest error of the azimuth.
    max_azimuth_error_deg: Positive | None = None
    #: Largest error of the inclination.
    max_inclination_error_deg: Positive | None = None
    #: Largest error of the toolface.
    max_toolface_error_deg: Positive | None = None
    #: Scatter of the roots about s(T) over their standard uncertainties.
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
