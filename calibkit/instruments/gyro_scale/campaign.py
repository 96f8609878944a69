"""What a fit finds of gyros in runs about the axes of a table: of each gyro about each axis, and of
the gyros together.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from calibkit.arrays import Array
from calibkit.coefficients import Component, Figure, Model
from calibkit.fit.shared import Shared
from calibkit.fit.solve import Fit
from calibkit.fit.value import Value
from calibkit.instruments.gyro_scale import equation, forms
from calibkit.instruments.gyro_scale.lines import Lines
from calibkit.instruments.gyro_scale.numeric.gjb_figures import Line
from calibkit.instruments.gyro_scale.ordering import Ordering
from calibkit.instruments.gyro_scale.table_runs import TableRun


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
    """Runs that `line` is the mean of."""
    line: Fit | None = None
    """K [1/deg] and F0 [1/s] at the mean temperature of the repeated runs."""
    over: equation.Fitted | None = None
    """Equation (1) of all runs."""
    in_time: Ordering | None = None
    """Whether K changes with time since the runs began."""
    curves: tuple[Model, ...] = ()
    """K, and where there is a line F0, over temperature, where it varies."""
    figures: tuple[Figure, ...] = ()
    """Of all runs together."""
    components: tuple[Component, ...] = ()
    """Errors between runs that the uncertainty of `line` holds."""

    @property
    def name(self) -> str:
        """Name of its models."""
        return forms.line_name(self.gyro, self.axis)

    def name_in(self, run: TableRun) -> str:
        """Name of the model of one run."""
        single = self.axis and len(self.runs) == 1
        return self.name if single else f"{self.name}.{run.log.name}"

    @property
    def K(self) -> Value:  # noqa: N802 - the letter of the standards
        """Scale factor [1/deg] of `line`."""
        assert self.line is not None  # noqa: S101 (who asks for it has one)
        return self.line.of(lambda p: p[0])

    @property
    def response(self) -> equation.Fitted | None:
        """Equation (1) where it has powers of the rate."""
        return self.over if self.over is not None and self.over.terms.powers else None


@dataclass(frozen=True, slots=True)
class GyroPair:
    """Ratios and angle of two gyros, from K_A and K_B about their own axes and K_Ba of gyro B about
    A's axis.
    """

    N: float
    """K_B/K_A."""
    epsilon: float
    """K_Ba/K_A."""
    gamma: float
    """K_Ba/K_B = cos α, within [−1, 1]."""
    alpha_deg: float
    """Angle of B's input axis to A's axis [°], 0 to 180."""
    covariance: Array
    """[4, 4] of N, ε, γ, α [°]; type A."""
    dof: tuple[float, ...]
    """Effective degrees of freedom of N, ε, γ, α."""
    alpha_interval_deg: tuple[float, float]
    """95 % interval of α; where |γ| is within noise of one it is one-sided, from 0° or up to 180°.
    """
    indicated: Value
    """K_Ba/K_B before it was clamped, with its uncertainty to first order."""
    from_a: Value
    """Second estimate of γ, from gyro A about B's axis, with its uncertainty by noise."""

    @property
    def values(self) -> tuple[float, float, float, float]:
        """N, ε, γ, α [°]."""
        return self.N, self.epsilon, self.gamma, self.alpha_deg

    @property
    def standard_uncertainty(self) -> Array:
        """Standard uncertainties [4] of N, ε, γ, α [°]."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def orthogonality_error_deg(self) -> float:
        """Orthogonality error 90° − α [°]."""
        return 90.0 - self.alpha_deg

    @property
    def same_side(self) -> bool:
        """Whether γ ≥ 0 (α ≤ 90°)."""
        return self.gamma >= 0.0


@dataclass(frozen=True, slots=True)
class Triad:
    """Sensitivity vectors of g gyros in the axes of the table."""

    fit: Fit
    """s_g = (K_gx, K_gy, K_gz), gyro by gyro [3 g]: scale factor about each table axis."""
    magnitude: Value
    """|s_g| [g]: scale factor about the gyro's own input axis."""
    misalignment: Value
    """Misalignment matrix [g, 3]: the unit vectors u_g = s_g/|s_g| as rows; the identity for an
    ideal triad.
    """
    angles_deg: Value
    """Angles between the input axes [g, g] [°]; first order, flagged where an angle is within noise
    of 0° or 180°.
    """
    flags: tuple[str, ...]

    @property
    def sensitivity(self) -> Array:
        """[g, 3]."""
        return self.fit.parameters.reshape(-1, 3)

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Numbers of each two gyros."""
        return list(combinations(range(len(self.sensitivity)), 2))


@dataclass(frozen=True, slots=True)
class AxesSet:
    """Runs about three axes at one temperature, with their triad and biases."""

    runs: tuple[TableRun, ...]
    temp_degc: float
    """Mean of the runs [°C]; NaN where no temperature was logged."""
    suffix: str
    """Of the names of models and figures; empty for the set nearest the reference temperature."""
    fit: Fit
    """Sensitivities [3 g] and, where the latitude is known, biases [g]."""
    triad: Triad
    bias: Value | None
    """[g, 1/s], without the earth's rate."""


@dataclass(frozen=True, slots=True)
class Campaign:
    """Gyros in all runs."""

    channels: tuple[Channel, ...]
    run_lines: Lines
    """Lines of the single runs."""
    flags: tuple[str, ...] = ()
    components: tuple[Component, ...] = ()
    """Errors of runs and mountings that the uncertainty of what is between gyros holds."""
    pair: GyroPair | None = None
    """N, ε, γ and α of two gyros."""
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


def stated_components(*errors: Shared | None) -> tuple[Component, ...]:
    """Components of errors that are in an uncertainty with their sizes."""
    return tuple(
        Component(
            error.group,
            error.effect,
            error.size,
            error.unit,
            error.size / float(np.sqrt(2.0 * error.size_dof)),
            error.levels,
        )
        for error in errors
        if error and error.size
    )
