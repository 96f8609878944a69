"""Recipes of gyros on a rate table: runs of single gyros over temperature, two gyros on one base,
any number of gyros over three axes.
"""

from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from typing import Annotated, ClassVar, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from calibkit.errors import RecipeError
from calibkit.recipe.tables import NonNegative, Positive, Recipe, Table

Gyro = Annotated[str, Field(pattern=r"^[a-z0-9]+$")]
Patterns = Annotated[tuple[str, ...], Field(min_length=1, strict=False)]


def _refuse_doubles(gyros: tuple[str, ...]) -> tuple[str, ...]:
    """Raise an error for a gyro that is listed twice."""
    if len(set(gyros)) != len(gyros):
        raise ValueError(f"gyros = {list(gyros)}: a gyro stands twice")
    return gyros


Gyros = Annotated[
    tuple[Gyro, ...], Field(min_length=1, strict=False), AfterValidator(_refuse_doubles)
]


class _TableSpec(Table):
    """Rate table: direction of its axis for positive rates, and source of its reference rate."""

    #: Direction of the table axis for positive rates.
    axis: Literal["up", "down"] = "up"
    #: Source of the reference rate: the logged rate, or the logged angle.
    reference: Literal["rate", "angle"] = "rate"


class PlateauSpec(Table):
    """Criteria of a held rate."""

    #: Shortest held rate.
    shortest_s: Positive = 2.0
    #: Fewest rows of a held rate.
    shortest_samples: Annotated[int, Field(ge=4)] = 8
    #: Time behind each change of rate that is left out.
    settle_s: NonNegative = 1.0
    #: Largest variation of a held rate, as a share of it.
    relative: Positive = 1e-3
    #: Variation that is allowed at any rate.
    floor_dps: Positive = 1e-4
    #: Fewest different rates of a log.
    min_rates: Annotated[int, Field(ge=3)] = 3
    #: Each row is the mean over a held rate.
    one_row: bool = False


class GyroRecipe(Recipe):
    """Keys that all rate-table procedures share."""

    full_scales: ClassVar[Mapping[str, float]] = {"rate_dps": 2000.0}
    component_units: ClassVar[Mapping[tuple[str, str], str]] = {
        ("mounting", "angle"): "deg",
        ("run", "scale"): "ppm",
    }
    """Group and effect of a known component → the unit that it is stated in."""

    table: _TableSpec = _TableSpec()
    plateaus: PlateauSpec = PlateauSpec()
    #: Counts per degree that "before" is judged by; without it the fitted mean.
    nominal_scale_factor: float | None = None

    @property
    def logs_of_axes(self) -> Mapping[str, Sequence[str]]:
        """Table axis → names or patterns of its logs; one axis without a name has all of them."""
        return {"": ("*",)}

    def list_axes(self, file: str) -> list[str]:
        """Table axes that a log is of, by its name."""
        return [
            axis
            for axis, patterns in self.logs_of_axes.items()
            if any(file == pattern or fnmatchcase(file, pattern) for pattern in patterns)
        ]

    def find_axis(self, file: str) -> str:
        """Table axis of a log; RecipeError for a log of none or of two."""
        file_axes = self.list_axes(file)
        if len(file_axes) == 1:
            return file_axes[0]
        axes_text = (
            f"of the table axes {' and '.join(file_axes)}" if file_axes else "of no table axis"
        )
        raise RecipeError(
            f"{file}: a log {axes_text}",
            hint="name the logs of each table axis under [axes] or [pair]",
        )

    @model_validator(mode="after")
    def _components_have_units(self) -> Self:
        for entry in self.errors.component:
            unit = self.component_units.get((entry.group, entry.effect))
            if unit is None:
                expected = " or ".join(
                    f"{effect} in {unit} of group '{group}'"
                    for (group, effect), unit in self.component_units.items()
                )
                raise ValueError(
                    f"errors.component: effect '{entry.effect}' of group '{entry.group}', expected"
                    f" {expected}"
                )
            try:
                entry.value_in(unit)
            except RecipeError as error:
                raise ValueError(f"{error.message}; {error.hint}") from None
        return self

    def known_errors(self) -> dict[str, tuple[float, float]]:
        """Effect → standard deviation in the unit of `component_units`, and degrees of freedom, of
        each component that the recipe states.
        """
        return {
            entry.effect: (
                entry.value_in(self.component_units[entry.group, entry.effect]),
                entry.dof,
            )
            for entry in self.errors.component
        }

    @model_validator(mode="after")
    def _scale_factor_scales(self) -> Self:
        if self.nominal_scale_factor == 0.0:
            raise ValueError("a nominal_scale_factor of 0 turns no count into a rate")
        return self


class LineAcceptance(Table):
    """Limits on lines; a limit that is not stated is not tested."""

    #: Largest nonlinearity over full scale.
    max_nonlinearity_ppm: Positive | None = None
    #: Largest asymmetry (GJB 2426A).
    max_asymmetry_ppm: Positive | None = None
    #: Residuals about the line of a run over the noise of the means.
    max_residual_over_noise: Positive | None = None


class OwnAxisRecipe(GyroRecipe):
    """Gyros that are compensated about their own axes, independently of each other."""

    #: "auto" also fits powers of the rate where left-out runs ask for them.
    response: Literal["line", "auto"] = "line"
    #: What stays in the rate: nothing of the laboratory, or the earth's rate.
    compensation: Literal["laboratory", "inertial"] = "laboratory"

    def own_axis(self, gyro: str) -> str:
        """Table axis that is the gyro's own."""
        return gyro if gyro in self.logs_of_axes else ""

    @model_validator(mode="after")
    def _earth_is_known(self) -> Self:
        if self.compensation == "inertial" and self.site.latitude_deg is None:
            raise ValueError(
                "compensation = 'inertial' needs [site] latitude_deg: the earth's rate is left in"
                " the output"
            )
        return self


class _OfBoth(Table):
    """A value for each gyro of a pair."""

    #: Value of gyro A.
    a: float
    #: Value of gyro B.
    b: float


class _PairLogs(Table):
    """Log of each table axis, or the pattern of its logs, and how the scale factors change with
    temperature, where runs are not at one temperature.
    """

    #: Log, or pattern of the logs, of the table axis of gyro A.
    axis_a: str = "table_axis_a.csv"
    #: Log, or pattern of the logs, of the table axis of gyro B.
    axis_b: str = "table_axis_b.csv"
    temperature_coefficients_ppm_degc: _OfBoth | None = None
    #: Standard uncertainty of stated temperature coefficients.
    temperature_coefficient_uncertainty_ppm_degc: Positive = 5.0
    #: What a scale factor can change by, where none are stated.
    largest_temperature_coefficient_ppm_degc: Positive = 100.0

    @model_validator(mode="after")
    def _two_logs(self) -> Self:
        if self.axis_a == self.axis_b:
            raise ValueError(
                f"axis_a and axis_b are both '{self.axis_a}': each table axis has its own log"
            )
        return self


class PairAcceptance(LineAcceptance):
    """Limits of a pair; a limit that is not stated is not tested."""

    #: Largest change of a scale factor on unseen logs.
    max_scale_factor_error_ppm: Positive | None = None
    #: Largest standard uncertainty of γ.
    max_gamma_uncertainty: Positive | None = None
    #: Largest orthogonality error.
    max_orthogonality_error_deg: Positive | None = None


class GyroPairRecipe(OwnAxisRecipe):
    """Two gyros, both logged while the table turns about A's reference axis and about B's own
    axis.
    """

    gyros: ClassVar[tuple[str, ...]] = ("a", "b")
    error_groups: ClassVar[tuple[str, ...]] = ("mounting", "run")

    procedure: Literal["gyro_pair"]
    pair: _PairLogs = _PairLogs()
    acceptance: PairAcceptance = PairAcceptance()

    @property
    def logs_of_axes(self) -> Mapping[str, Sequence[str]]:
        """The log of each axis, or the pattern of its logs."""
        return {"a": (self.pair.axis_a,), "b": (self.pair.axis_b,)}


class RateTableAcceptance(LineAcceptance):
    """Limits of rate-table runs; a limit that is not stated is not tested."""

    #: Largest change of K on unseen logs.
    max_scale_factor_error_ppm: Positive | None = None
    #: Largest repeatability over runs.
    max_repeatability_ppm: Positive | None = None
    #: Largest temperature sensitivity of K.
    max_temperature_sensitivity_ppm_degc: Positive | None = None


class RateTableRecipe(OwnAxisRecipe):
    """Runs of one or more gyros about the table axis, one log per run, repeated and over
    temperature.
    """

    error_groups: ClassVar[tuple[str, ...]] = ("run",)
    component_units: ClassVar[Mapping[tuple[str, str], str]] = {
        ("run", "scale"): "ppm",
        ("run", "zero"): "deg/h",
    }

    procedure: Literal["rate_table"]
    #: Gyros that the logs hold, by the name in their columns.
    gyros: Gyros = ("x",)
    acceptance: RateTableAcceptance = RateTableAcceptance()


class _TriadLogs(Table):
    """Logs of each table axis, by file name patterns."""

    #: Patterns of the logs in which the table turns about x.
    x: Patterns = ("about_x*.csv",)
    #: Patterns of the logs in which it turns about y.
    y: Patterns = ("about_y*.csv",)
    #: Patterns of the logs in which it turns about z.
    z: Patterns = ("about_z*.csv",)


class TriadAcceptance(LineAcceptance):
    """Limits of gyros over three table axes; a limit that is not stated is not tested."""

    #: Largest orthogonality error.
    max_orthogonality_error_deg: Positive | None = None
    #: Largest standard uncertainty of an angle.
    max_angle_uncertainty_deg: Positive | None = None
    #: Largest error of the rate along the turned axis, of full scale.
    max_rate_error_ppm: Positive | None = None
    #: Largest rate across the turned axis, of full scale.
    max_cross_axis_ppm: Positive | None = None


class GyroTriadRecipe(GyroRecipe):
    """Any number of gyros on one base, all logged while the table turns about each of three
    orthogonal axes of the base.
    """

    error_groups: ClassVar[tuple[str, ...]] = ("mounting", "run")

    procedure: Literal["gyro_triad"]
    #: Gyros that the logs hold, by the name in their columns.
    gyros: Gyros = ("x", "y", "z")
    axes: _TriadLogs = _TriadLogs()
    acceptance: TriadAcceptance = TriadAcceptance()

    @property
    def logs_of_axes(self) -> Mapping[str, Sequence[str]]:
        """Patterns of the logs of each axis."""
        return dict(self.axes)


AnyRecipe = RateTableRecipe | GyroPairRecipe | GyroTriadRecipe
