"""Recipe of a bias as a polynomial of any abscissa."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from calibkit.recipe.tables import Positive, Recipe, Table


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


class _Output(Table):
    """Columns that `apply` adds to the compensated channels."""

    drift: bool = False


class BiasTemperatureRecipe(Recipe):
    """A static instrument that warms up: each channel's bias as a polynomial of a temperature."""

    along_chunks: ClassVar[bool] = True
    error_groups: ClassVar[tuple[str, ...]] = ("log",)

    procedure: Literal["bias_temperature"]
    polynomials: Polynomials
    acceptance: BiasAcceptance = BiasAcceptance()
    output: _Output = _Output()

    def own_columns(self) -> tuple[str, ...]:
        """The abscissa and the indications, whatever they are called."""
        return (self.polynomials.abscissa, *(entry.indication for entry in self.polynomials.bias))

    def still_columns(self) -> tuple[str, ...]:
        """The indications, whatever they are called."""
        return tuple(entry.indication for entry in self.polynomials.bias)

    def largest_gap_s(self) -> float:
        """Largest gap [s] that a log may have."""
        return self.polynomials.max_gap_s
