"""Recipes of biases over temperature: `fog_thermal`, ramps of a fibre-optic gyro; `thermal`, terms
of one thermometer, its rate and lags; `bias_temperature`, polynomials of any abscissa.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, TypeAlias

from pydantic import Field, field_validator, model_validator

from calibkit.errors import FitError
from calibkit.recipe.tables import NonNegative, Positive, Recipe, Table

GROUP, EFFECT = "power-on", "turn-on bias"
"""Error that all rows of a power-on share."""
Name = Annotated[str, Field(min_length=1)]


class Bias(Table):
    """One polynomial: which column, against which, to which order."""

    #: Channel whose bias is fitted.
    indication: Annotated[str, Field(min_length=1)]
    #: Order of its polynomial.
    order: Annotated[int, Field(ge=0, le=9)]


class Polynomials(Table):
    """The polynomials that share an abscissa."""

    #: Column that the biases are polynomials of.
    abscissa: Annotated[str, Field(min_length=1)]
    bias: Annotated[tuple[Bias, ...], Field(min_length=1, strict=False)]
    #: A log with fewer rows is refused.
    min_rows: Annotated[int, Field(ge=3)] = 10
    #: A log with a longer gap is refused.
    max_gap_s: Positive = 60.0


class BiasAcceptance(Table):
    """Limits on each channel; a limit that is not stated is not tested."""

    #: Residual rms over the noise that the fit measures.
    max_residual_over_noise: Positive | None = None


class _DriftOutput(Table):
    """Columns that `apply` adds to the compensated channels."""

    #: Whether `apply` adds the drift that it took off.
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

    #: Log, by its file name.
    log: Name
    #: Time of the switch-on, counted from the first row.
    at_s: float


class _Withheld(Table):
    """A stretch of a log whose indications are not fitted, but tested; its temperatures still drive
    the lags.
    """

    #: Log, by its file name.
    log: Name
    #: Start, counted from the first row.
    from_s: float
    #: End.
    to_s: float

    @model_validator(mode="after")
    def _ordered(self) -> _Withheld:
        if self.to_s <= self.from_s:
            raise ValueError(f"to_s = {self.to_s:.12g} is not after from_s = {self.from_s:.12g}")
        return self


class ThermalTable(Table):
    """Channels, choice of their terms, and power-ons."""

    #: Columns whose bias is fitted.
    channels: Annotated[tuple[Name, ...], Field(min_length=1, strict=False)]
    #: "level": no lags; "lagged": first-order lags; "auto" chooses on left-out stretches.
    model: Literal["auto", "level", "lagged"] = "auto"
    #: Means that are fitted and that firmware updates by; "auto": 10 s, or the step of a slower
    #: log.
    interval_s: Positive | Literal["auto"] = "auto"
    #: A log with fewer rows is refused.
    min_rows: Annotated[int, Field(ge=3)] = 200
    #: Logs whose temperature changes by less are refused.
    min_span_degc: Positive = 5.0
    #: A longer gap is a new power-on.
    max_gap_s: Positive = 60.0
    #: Logs of one power-on, where their clocks do not tell.
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

    #: Whether `apply` adds the standard uncertainty of the correction.
    rate_uncertainty: bool = False


class _ThermalAcceptance(BiasAcceptance):
    """Limits on each channel; a limit that is not stated is not tested."""

    #: Smallest ratio of the errors on left-out data without and with the model.
    min_reduction: NonNegative | None = None


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

    def named_logs(self) -> tuple[tuple[tuple[str, ...], tuple[str, ...]], ...]:
        """Sessions, power-ons and withheld stretches, with the logs that they name."""
        table = self.thermal
        return (
            (("thermal", "sessions"), tuple(log for logs in table.sessions for log in logs)),
            (("thermal", "power_on"), tuple(entry.log for entry in table.power_on)),
            (("thermal", "withheld"), tuple(entry.log for entry in table.withheld)),
        )


HIGHEST_RATE_ORDER = 5
"""Highest order of a_j as polynomials of the temperature rate; firmware holds no more."""


class _Checks(Table):
    """Requirements on a log for a fit."""

    #: A log with fewer rows is refused.
    min_rows: Annotated[int, Field(ge=3)] = 100
    #: Longest gap in a log that is bridged, also by `apply` and firmware.
    max_gap_s: Positive = 60.0


class _Segments(Table):
    """Detection of soaks and ramps from the measured rate of the chamber air."""

    #: Window over which the rate of the chamber air is measured.
    slope_window_s: Positive = 60.0
    #: Smallest rate of a ramp.
    ramp_min_degc_min: Positive = 0.3
    #: Smallest change of temperature of a ramp.
    ramp_min_span_degc: Positive = 5.0


class Denoise(Table):
    """Lifting-wavelet denoising of the indication of each log."""

    #: Whether indications are denoised for the published scheme and the figures.
    enabled: bool = True
    #: `haar`, `cdf53`, `db2`, `cdf97`, or any discrete wavelet of PyWavelets.
    wavelet: str = "cdf97"
    #: Levels of the transform.
    levels: Annotated[int, Field(ge=1, le=20)] | Literal["auto"] = "auto"
    #: Rule that sets the threshold of a level.
    threshold: Literal["universal", "sure", "bayes", "minimax"] = "universal"
    #: What is done to details beyond the threshold.
    rule: Literal["soft", "hard", "garrote", "firm"] = "firm"
    #: How the log goes on beyond its ends.
    extension: Literal["trend", "antisymmetric", "symmetric"] = "trend"

    @field_validator("wavelet")
    @classmethod
    def _known(cls, wavelet: str) -> str:
        from calibkit.numeric.wavelet.lifting import find_wavelet

        try:
            find_wavelet(wavelet)
        except FitError as error:
            raise ValueError(f"{error.message}; {error.hint}") from None
        return wavelet


class Drift(Table):
    """Choice of the drift model, and options of the published one (CN102095419A), of which `order`
    is that of a_j over the temperature rate.
    """

    #: Drift model; "auto" chooses on left-out ramps, "gradient_rate" is the published scheme.
    model: Literal["auto", "gradient_rate", "level", "lagged", "bank"] = "auto"
    #: Model interval: means that are fitted and that firmware updates by.
    interval_s: Positive = 10.0
    #: Published scheme: its equation summed from the start of a ramp, or differences.
    estimate: Literal["levels", "increments"] = "levels"
    #: Published scheme: order of a_j over the temperature rate.
    order: Annotated[int, Field(ge=0, le=HIGHEST_RATE_ORDER)] | Literal["auto"] = "auto"
    #: Published scheme: heating and cooling apart, or together.
    sides: Literal["separate", "joint"] = "separate"
    #: "recursive" keeps the true rate; "one_step", as published, removes it.
    compensation: Literal["recursive", "one_step"] = "recursive"
    #: Log → temperature rate that was ordered, compared with the measured one.
    rates_degc_min: dict[str, float] = {}


class _InputAxis(Table):
    """Direction of the gyro's input axis: elevation above horizontal, azimuth from north [°]."""

    #: Elevation above the horizontal, 90 is up.
    elevation_deg: Annotated[float, Field(ge=-90.0, le=90.0)]
    #: Azimuth from north; needed where the axis is not vertical.
    azimuth_deg: Annotated[float, Field(ge=-360.0, le=360.0)] | None = None

    @model_validator(mode="after")
    def _azimuth_known(self) -> _InputAxis:
        if abs(self.elevation_deg) < 90.0 and self.azimuth_deg is None:
            raise ValueError(
                "azimuth_deg is needed for an axis that is not vertical: the earth's horizontal"
                " rate is seen"
            )
        return self


class _FogAcceptance(_ThermalAcceptance):
    """Acceptance limits of fits and validations; a limit that is None is not tested."""

    #: Largest drift rms after compensation.
    max_drift_rms_dph: Positive | None = None
    #: Smallest share of the 100 s means of a log within U.
    min_share_within_uncertainty: Annotated[float, Field(gt=0.0, le=1.0)] | None = None
    #: Largest departure of the rate gain from 1.
    rate_gain_tolerance: Positive = 1e-3


class FogThermalRecipe(Recipe):
    """Ramps of a fibre-optic gyro in a chamber, one or several ramps per log."""

    procedure: Literal["fog_thermal"]
    checks: _Checks = _Checks()
    segments: _Segments = _Segments()
    denoise: Denoise = Denoise()
    drift: Drift = Drift()
    input_axis: _InputAxis | None = None
    output: _ThermalOutput = _ThermalOutput()
    acceptance: _FogAcceptance = _FogAcceptance()

    def named_logs(self) -> tuple[tuple[tuple[str, ...], tuple[str, ...]], ...]:
        """Tables of the recipe that name logs: the stated temperature rates."""
        return ((("drift", "rates_degc_min"), tuple(self.drift.rates_degc_min)),)

    def largest_gap_s(self) -> float:
        """Largest gap [s] that a log may have."""
        return self.checks.max_gap_s


BiasRecipe: TypeAlias = FogThermalRecipe | ThermalRecipe | BiasTemperatureRecipe
