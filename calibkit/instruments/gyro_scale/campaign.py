"""What a fit finds of gyros in runs about the axes of a table: of each gyro about each axis, and of
the gyros together.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array
from calibkit.coefficients import Figure, Model
from calibkit.instruments.gyro_scale import equation, forms
from calibkit.instruments.gyro_scale.lines import Lines
from calibkit.instruments.gyro_scale.ordering import Ordering
from calibkit.instruments.gyro_scale.published import Line
from calibkit.instruments.gyro_scale.table_runs import TableRun

Runs = Mapping[str, tuple[TableRun, ...]]
"""Table axis → its runs."""


@dataclass(frozen=True, slots=True)
class Channel:
    """A gyro in all runs about one axis of the table."""

    gyro: str
    axis: str
    """Empty where every gyro lies along the one axis."""
    own: bool
    """Whether it is the axis that the gyro senses most: figures of standards are of it."""
    runs: tuple[TableRun, ...]
    repeated: tuple[TableRun, ...] = ()
    """Runs that `mean` is of."""
    mean: Model | None = None
    """K and F0 at the mean temperature of the repeated runs; None where runs about three axes give
    them together.
    """
    over: equation.Fitted | None = None
    """Equation (1) of all runs."""
    in_time: Ordering | None = None
    """Whether K changes with time since the runs began."""
    curves: tuple[Model, ...] = ()
    """K, and where there is a mean F0, over temperature, where it varies."""
    figures: tuple[Figure, ...] = ()
    """Of all runs together."""

    @property
    def name(self) -> str:
        """Name of its models."""
        return forms.line_name(self.gyro, self.axis)

    def name_in(self, run: TableRun) -> str:
        """Name of the model of one run."""
        single = self.axis and len(self.runs) == 1
        return self.name if single else f"{self.name}.{run.log.name}"

    @property
    def response(self) -> equation.Fitted | None:
        """Equation (1) where it has powers of the rate."""
        return self.over if self.over is not None and self.over.terms.powers else None


@dataclass(frozen=True, slots=True)
class AxesSet:
    """Runs about three axes at one temperature."""

    temp_degc: float
    """Mean of the runs [°C]; NaN where no temperature was logged."""
    suffix: str
    """Of the names of models and figures; empty for the set nearest the reference temperature."""
    model: Model
    """Sensitivities and, where the latitude is known, biases."""
    figures: Mapping[str, Figure]
    """Name without the suffix → figure of the input axes, and of the biases."""

    def misalignment(self, gyro: str) -> Array:
        """Unit vector [3] of a gyro's input axis."""
        return np.array([self.figures[f"misalignment.{gyro}{a}"].value for a in forms.AXES])


@dataclass(frozen=True, slots=True)
class Campaign:
    """Gyros in all runs."""

    channels: tuple[Channel, ...]
    run_lines: Lines
    """Lines of the single runs."""
    flags: tuple[str, ...] = ()
    within_runs: bool = False
    """Whether nothing tells how scale factors about several axes repeat from run to run."""
    pair: Model | None = None
    """N, ε, γ and α of two gyros."""
    pair_figures: tuple[Figure, ...] = ()
    """These, the interval of α, and γ of A about B's axis."""
    sets: tuple[AxesSet, ...] = ()
    """Runs about three axes, a set for each temperature."""
    over: equation.Fitted | None = None
    """Equation (1) of all runs about three axes over temperature."""
    bias_curves: tuple[Model, ...] = ()
    """Biases of the gyros over temperature."""

    @property
    def own(self) -> tuple[Channel, ...]:
        """Gyros about their own axes."""
        return tuple(channel for channel in self.channels if channel.own)

    @property
    def reference(self) -> AxesSet:
        """The set of runs nearest the reference temperature."""
        return next(one for one in self.sets if not one.suffix)

    def own_lines(self) -> Iterator[tuple[Channel, TableRun, Line]]:
        """Published lines of gyros about their own axes in each run."""
        for channel in self.own:
            for run in channel.runs:
                yield channel, run, self.run_lines.published(run, channel.gyro)

    def residuals(self) -> dict[str, Array]:
        """Columns of a tidy table, one row per held rate of a gyro in a run: indication less its
        straight line, in ppm of full scale.
        """
        lines = [
            (channel.gyro, run.log.name, line.rate_dps, *line.of_full_scale_ppm)
            for channel, run, line in self.own_lines()
        ]
        sizes = [rate.size for _, _, rate, _, _ in lines]
        gyro, run, rate, residual, u = zip(*lines, strict=True)
        return {
            "run": np.repeat(np.array(run, dtype=object), sizes),
            "gyro": np.repeat(np.array(gyro, dtype=object), sizes),
            "table_rate_dps": np.concatenate(rate),
            "residual_ppm": np.concatenate(residual),
            "standard_uncertainty_ppm": np.concatenate(u),
        }
