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

    #: "attitude": attitudes of the table; "magnitude": the length of gravity alone.
    kind: Literal["attitude", "magnitude"] = "attitude"
    #: Sign of the indications: positive along gravity, or specific force.
    convention: Literal["gravity", "specific_force"] = "gravity"
    #: Search for the lowest point of a fit to lengths of gravity.
    solver: Literal["gauss_newton", "lmfit"] = "gauss_newton"


class _DwellSpec(Table):
    """How a log is cut into dwells: one row per dwell, or holds found in a continuous log."""

    #: One row per dwell, or holds that are found in a continuous log.
    mode: Literal["rows", "series"] = "rows"
    #: Window in which the noise of a sample is judged.
    window_s: Positive = 1.0
    #: Shortest hold that counts as a dwell.
    shortest_s: Positive = 2.0
    #: Holds are cut into pieces of this length, for a sweep of temperature.
    piece_s: Positive | None = None
    #: Noise below which a triad is still; without it twice that of the quietest quarter.
    noise_limit_g: Positive | None = None
    #: A longer gap ends a hold.
    max_gap_s: Positive = 1.0


class KAxisSpec(Table):
    """Polynomial orders of one axis."""

    #: Highest power of temperature of the scale factor, K0 … K3.
    scale_order: Order = 3
    #: Highest power of temperature of the zero, K4 … K7.
    zero_order: Order = 3
    #: Whether K8 and K9 are fitted.
    cross: bool = True

    @property
    def fitted(self) -> tuple[int, ...]:
        """Numbers of the coefficients K that are fitted, ascending; the others are zero."""
        cross = (8, 9) if self.cross else ()
        return (*range(self.scale_order + 1), *range(4, 5 + self.zero_order), *cross)


class _KSpec(KAxisSpec):
    """Orders of the K-factor, common to the three axes or per axis."""

    #: Whether the K-factor is fitted.
    enabled: bool = True
    #: "log": uncertainty from leaving out one log at a time.
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

    #: Whether the triad over temperature is fitted.
    enabled: bool = True
    #: Highest power of temperature of the scale factors.
    scale_order: Order = 3
    #: Highest power of temperature of the cross-axis terms; -1 for none.
    cross_order: Annotated[int, Field(ge=-1, le=3)] = 1
    #: Highest power of temperature of the zeros.
    bias_order: Order = 3
    #: Whether quadratic terms and cross products are corrected.
    second_order: bool = False
    #: Whether cubic terms are corrected.
    third_order: bool = False
    #: Whether two tilts of the table are fitted.
    tilt: bool = False
    #: Whether three angles of the fixture are fitted.
    fixture: bool = False


class _AccelAcceptance(Table):
    """Limits on the attitude after correction; a limit that is not stated is not tested."""

    #: Largest error of the inclination.
    max_inclination_error_deg: Positive | None = None
    #: Largest error of the toolface times the sine of the inclination.
    max_toolface_error_sin_deg: Positive | None = None
    #: Largest residual rms of a component.
    max_residual_rms_g: Positive | None = None
    #: Residual rms of unseen dwells over that of the fit (`validate`).
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
    #: "robust" leaves out outliers and names them.
    loss: Literal["robust", "least_squares"] = "robust"
    k: _KSpec = _KSpec()
    affine: _AffineSpec = _AffineSpec()
    #: Model that `apply` corrects by.
    compensation: Literal["affine", "k", "kq"] = "affine"
    #: Inclinations between which errors of the toolface are stated.
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
