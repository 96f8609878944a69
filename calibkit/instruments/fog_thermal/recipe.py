"""Recipe of the thermal drift of a fibre-optic gyro."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from calibkit.errors import FitError
from calibkit.recipe.tables import NonNegative, Positive, Recipe, Table

HIGHEST_RATE_ORDER = 5
"""Highest order of a_j as polynomials of the temperature rate."""


class _Checks(Table):
    """Requirements on a log for a fit."""

    min_rows: Annotated[int, Field(ge=3)] = 100
    max_gap_s: Positive = 60.0


class _Segments(Table):
    """Detection of soaks and ramps from the measured rate of the chamber air."""

    slope_window_s: Positive = 60.0
    ramp_min_degc_min: Positive = 0.3
    ramp_min_span_degc: Positive = 5.0


class Denoise(Table):
    """Lifting-wavelet denoising of the indication of each log."""

    enabled: bool = True
    wavelet: str = "cdf97"
    levels: Annotated[int, Field(ge=1, le=20)] | Literal["auto"] = "auto"
    threshold: Literal["universal", "sure", "bayes", "minimax"] = "universal"
    rule: Literal["soft", "hard", "garrote", "firm"] = "firm"
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
    """Choice of the drift model, and options of the published one (CN102095419A)."""

    model: Literal["auto", "gradient_rate", "level", "lagged", "bank"] = "auto"
    interval_s: Positive = 10.0
    estimate: Literal["levels", "increments"] = "levels"
    order: Annotated[int, Field(ge=0, le=HIGHEST_RATE_ORDER)] | Literal["auto"] = "auto"
    sides: Literal["separate", "joint"] = "separate"
    compensation: Literal["recursive", "one_step"] = "recursive"
    rates_degc_min: dict[str, float] = {}


class _InputAxis(Table):
    """Direction of the gyro's input axis: elevation above horizontal, azimuth from north [°]."""

    elevation_deg: Annotated[float, Field(ge=-90.0, le=90.0)]
    azimuth_deg: Annotated[float, Field(ge=-360.0, le=360.0)] | None = None

    @model_validator(mode="after")
    def _azimuth_known(self) -> _InputAxis:
        if abs(self.elevation_deg) < 90.0 and self.azimuth_deg is None:
            raise ValueError(
                "azimuth_deg is needed for an axis that is not vertical: the earth's horizontal"
                " rate is seen"
            )
        return self


class _FogOutput(Table):
    """Columns that `apply` adds to the compensated rate."""

    drift: bool = False
    rate_uncertainty: bool = False


class _FogAcceptance(Table):
    """Acceptance limits of fits and validations; a limit that is None is not tested."""

    min_reduction: NonNegative | None = None
    max_drift_rms_dph: Positive | None = None
    max_residual_over_noise: Positive | None = None
    min_share_within_uncertainty: Annotated[float, Field(gt=0.0, le=1.0)] | None = None
    rate_gain_tolerance: Positive = 1e-3


class FogThermalRecipe(Recipe):
    """Ramps of a fibre-optic gyro in a chamber, one or several ramps per log."""

    procedure: Literal["fog_thermal"]
    checks: _Checks = _Checks()
    segments: _Segments = _Segments()
    denoise: Denoise = Denoise()
    drift: Drift = Drift()
    input_axis: _InputAxis | None = None
    output: _FogOutput = _FogOutput()
    acceptance: _FogAcceptance = _FogAcceptance()

    def named_logs(self) -> tuple[tuple[tuple[str, ...], tuple[str, ...]], ...]:
        """Tables of the recipe that name logs: the stated temperature rates."""
        return ((("drift", "rates_degc_min"), tuple(self.drift.rates_degc_min)),)

    def largest_gap_s(self) -> float:
        """Largest gap [s] that a log may have."""
        return self.checks.max_gap_s
