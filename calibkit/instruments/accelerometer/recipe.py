"""Recipe of a triaxial accelerometer: K-factor, Q-factor and the affine triad over temperature."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from calibkit.recipe.tables import Positive, Recipe, Table

Order = Annotated[int, Field(ge=0, le=3)]
Inclination = Annotated[float, Field(gt=0.0, lt=180.0)]


class _Reference(Table):
    """Reference that the indications are fitted to, and sign convention of the indications."""

    kind: Literal["attitude", "magnitude"] = "attitude"
    convention: Literal["gravity", "specific_force"] = "gravity"
    solver: Literal["gauss_newton", "lmfit"] = "gauss_newton"


class _DwellSpec(Table):
    """How a log is cut into dwells: one row per dwell, or holds found in a continuous log."""

    mode: Literal["rows", "series"] = "rows"
    window_s: Positive = 1.0
    shortest_s: Positive = 2.0
    piece_s: Positive | None = None
    noise_limit_g: Positive | None = None
    max_gap_s: Positive = 1.0


class KAxisSpec(Table):
    """Polynomial orders of one axis."""

    scale_order: Order = 3
    zero_order: Order = 3
    cross: bool = True

    @property
    def fitted(self) -> tuple[int, ...]:
        """Numbers of the coefficients K that are fitted, ascending; the others are zero."""
        cross = (8, 9) if self.cross else ()
        return (*range(self.scale_order + 1), *range(4, 5 + self.zero_order), *cross)


class _KSpec(KAxisSpec):
    """Orders of the K-factor, common to the three axes or per axis."""

    enabled: bool = True
    groups: Literal["none", "log"] = "none"
    x: KAxisSpec | None = None
    y: KAxisSpec | None = None
    z: KAxisSpec | None = None

    @property
    def axes(self) -> tuple[KAxisSpec, KAxisSpec, KAxisSpec]:
        """Orders of x, y and z."""
        return self.x or self, self.y or self, self.z or self

    @property
    def not_fitted(self) -> tuple[str, ...]:
        """Coefficients that the orders leave out, one text for each axis that has any."""
        texts = []
        for name, orders in zip("xyz", self.axes, strict=True):
            missing = [f"K{n}" for n in range(10) if n not in orders.fitted]
            if missing:
                texts.append(f"accel_{name}: {', '.join(missing)} not fitted, taken as 0")
        return tuple(texts)


class _AffineSpec(Table):
    """The affine triad M(t)(V − b(t)): orders over temperature, higher-order terms, nuisance
    angles.
    """

    enabled: bool = True
    scale_order: Order = 3
    cross_order: Annotated[int, Field(ge=-1, le=3)] = 1
    bias_order: Order = 3
    second_order: bool = False
    third_order: bool = False
    tilt: bool = False
    fixture: bool = False


class _AccelAcceptance(Table):
    """Limits on the attitude after correction; a limit that is not stated is not tested."""

    max_inclination_error_deg: Positive | None = None
    max_toolface_error_sin_deg: Positive | None = None
    max_residual_rms_g: Positive | None = None
    max_residual_over_noise: Positive | None = None


class AccelerometerRecipe(Recipe):
    """Dwells of a triaxial accelerometer at attitudes and temperatures."""

    full_scales: ClassVar[Mapping[str, float]] = {"accel_g": 16.0}
    error_groups: ClassVar[tuple[str, ...]] = (
        *("soak", "session", "attitude"),
        *("fixture", "table", "sensor"),
    )

    procedure: Literal["accelerometer"]
    reference: _Reference = _Reference()
    dwells: _DwellSpec = _DwellSpec()
    loss: Literal["robust", "least_squares"] = "robust"
    k: _KSpec = _KSpec()
    affine: _AffineSpec = _AffineSpec()
    compensation: Literal["affine", "k", "kq"] = "affine"
    toolface_range_deg: Annotated[tuple[Inclination, Inclination], Field(strict=False)] = (
        10.0,
        170.0,
    )
    acceptance: _AccelAcceptance = _AccelAcceptance()

    @model_validator(mode="after")
    def _compensated_by_what_is_fitted(self) -> AccelerometerRecipe:
        attitude = self.reference.kind == "attitude"
        if self.compensation == "k" and not (attitude and self.k.enabled):
            raise ValueError(
                "compensation = 'k' needs k.enabled = true and reference.kind = 'attitude'"
            )
        if self.compensation == "affine" and attitude and not self.affine.enabled:
            raise ValueError("compensation = 'affine' needs affine.enabled = true")
        low, high = self.toolface_range_deg
        if not low < high:
            raise ValueError(f"toolface_range_deg = [{low:g}, {high:g}]: expected low below high")
        if (self.affine.tilt or self.affine.fixture) and not attitude:
            raise ValueError("affine.tilt and affine.fixture need reference.kind = 'attitude'")
        return self
