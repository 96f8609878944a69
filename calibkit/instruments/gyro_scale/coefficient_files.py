"""What a fit finds of gyros, of each about each axis of the table and of all together, as it is
written into gyro_scale.json and, for several gyros about several axes, gyro_orthogonality.json.

    F = K Ω + F0                                    line of a gyro about an axis, gyro-scale/1
    F = K(T) Ω + Σ_k c_k(T) (Ω/Ω_max)^k + F0(T)     response (`equation`), gyro-response/2
    N = K_B/K_A, ε = K_Ba/K_A, γ = ε/N = cos α      pair (`published`), gyro-orthogonality/1
    s = (K_x, K_y, K_z), unit vector s/|s|          gyro of a triad

Ω table rate, F indication; K_Ba is K of gyro B about the axis of A. What runs leave uncertain comes
from `Fit.of` of these.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any

import numpy as np

from calibkit.errors import FitError
from calibkit.fit.complex_step import Numbers, arctan2, length
from calibkit.fit.shared import Shared
from calibkit.fit.solve import Fit
from calibkit.fit.value import Value
from calibkit.instruments.gyro_scale import equation, forms, published, table_runs
from calibkit.instruments.gyro_scale.lines import Lines
from calibkit.instruments.gyro_scale.ordering import Ordering
from calibkit.instruments.gyro_scale.published import Line
from calibkit.instruments.gyro_scale.recipe import GyroRecipe
from calibkit.instruments.gyro_scale.table_runs import TableRun
from calibkit.numeric.arrays import Array
from calibkit.numeric.constants import DPH_PER_DPS
from calibkit.numeric.dispersion import rms
from calibkit.numeric.least_squares import polynomial
from calibkit.records.coefficients import (
    Component,
    Condition,
    Figure,
    Model,
    Parameter,
    StageResult,
)
from calibkit.records.forms import POLYNOMIAL

Runs = Mapping[str, tuple[TableRun, ...]]
"""Table axis → its runs."""


@dataclass(frozen=True, slots=True)
class Channel:
    """A gyro in all runs about one axis of the table.

    Attributes
    ----------
    axis : empty where every gyro lies along the one axis.
    is_own_axis : whether it is the axis that the gyro senses most: figures of standards are of
        it.
    repeated : runs that `mean` is of.
    mean : K and F0 at the mean temperature of the repeated runs; None where runs about three
        axes give them together.
    fitted : equation (1) of all runs.
    in_time : whether K changes with time since the runs began.
    curves : K, and where there is a mean F0, over temperature, where it varies.
    figures : of all runs together.

    """

    gyro: str
    axis: str
    is_own_axis: bool
    runs: tuple[TableRun, ...]
    repeated: tuple[TableRun, ...] = ()
    mean: Model | None = None
    fitted: equation.ResponseFit | None = None
    in_time: Ordering | None = None
    curves: tuple[Model, ...] = ()
    figures: tuple[Figure, ...] = ()

    @property
    def name(self) -> str:
        """Name of its models."""
        return forms.line_name(self.gyro, self.axis)

    @property
    def response(self) -> equation.ResponseFit | None:
        """Equation (1) where it has powers of the rate."""
        return self.fitted if self.fitted is not None and self.fitted.terms.powers else None


@dataclass(frozen=True, slots=True)
class AxesSet:
    """Runs about three axes at one temperature.

    Attributes
    ----------
    temp_degc : mean of the runs [°C]; NaN where no temperature was logged.
    suffix : of the names of models and figures; empty for the set nearest the reference
        temperature.
    model : sensitivities and, where the latitude is known, biases.
    figures : name without the suffix → figure of the input axes, and of the biases.

    """

    temp_degc: float
    suffix: str
    model: Model
    figures: Mapping[str, Figure]

    def misalignment(self, gyro: str) -> Array:
        """Unit vector [3] of a gyro's input axis."""
        return np.array([self.figures[f"misalignment.{gyro}{a}"].value for a in forms.AXES])


@dataclass(frozen=True, slots=True)
class CampaignFit:
    """Gyros in all runs.

    Attributes
    ----------
    run_lines : lines of the single runs.
    within_runs : whether nothing tells how scale factors about several axes repeat from run to
        run.
    pair : N, ε, γ and α of two gyros.
    pair_figures : these, the interval of α, and γ of A about B's axis.
    gammas : γ of a pair by the noise of held rates alone, of B about A's axis and of A about
        B's.
    sets : runs about three axes, a set for each temperature.
    fits : equation (1) as it was fitted.
    bias_curves : biases of the gyros over temperature.

    """

    channels: tuple[Channel, ...]
    run_lines: Lines
    flags: tuple[str, ...] = ()
    within_runs: bool = False
    pair: Model | None = None
    pair_figures: tuple[Figure, ...] = ()
    gammas: tuple[Value, Value] | None = None
    sets: tuple[AxesSet, ...] = ()
    fits: Mapping[str, equation.ResponseFit] = field(default_factory=dict)
    bias_curves: tuple[Model, ...] = ()

    @property
    def own_channels(self) -> tuple[Channel, ...]:
        """Gyros about their own axes."""
        return tuple(channel for channel in self.channels if channel.is_own_axis)

    @property
    def reference(self) -> AxesSet:
        """The set of runs nearest the reference temperature."""
        return next(axes_set for axes_set in self.sets if not axes_set.suffix)

    def own_lines(self) -> Iterator[tuple[Channel, TableRun, Line]]:
        """Published lines of gyros about their own axes in each run."""
        for channel in self.own_channels:
            for run in channel.runs:
                yield channel, run, self.run_lines.published(run, channel.gyro)

    def residuals(self) -> dict[str, Array]:
        """Columns of a tidy table, one row per held rate of a gyro in a run: indication less its
        straight line, in ppm of full scale.
        """
        columns: dict[str, list[Array]] = {}
        for channel, run, line in self.own_lines():
            residual, u = line.of_full_scale_ppm
            rows = {"run": np.full(u.size, run.log.name), "gyro": np.full(u.size, channel.gyro)}
            rows |= {"table_rate_dps": line.rate_dps, "residual_ppm": residual}
            for name, values in (rows | {"standard_uncertainty_ppm": u}).items():
                columns.setdefault(name, []).append(values)
        return {name: np.concatenate(parts) for name, parts in columns.items()}


def list_results(campaign: CampaignFit, spec: GyroRecipe) -> tuple[StageResult, ...]:
    """Coefficient files of a campaign: what each gyro is about each axis, as the mean over repeated
    runs, over temperature, in each run and as a response; and what is between the gyros of a pair
    or a triad.
    """
    vertical, latitude = table_runs.vertical_rate_dps(spec), spec.site.latitude_deg
    models: list[Model] = []
    figures: list[Figure] = []
    own_means = {channel.gyro: channel.mean for channel in campaign.own_channels}
    for channel in campaign.channels:
        models += [channel.mean] if channel.mean else []
        models += channel.curves
        figures += channel.figures
        for run in channel.runs:
            # the only run about an axis is its mean
            single = channel.axis and len(channel.runs) == 1
            name = channel.name if single else f"{channel.name}.{run.log.name}"
            fit = campaign.run_lines.line(run, channel.gyro)  # K, F0, F at rest
            if channel.mean is None or not single:
                line = fit.part(slice(2))
                models.append(line_model(name, line, campaign.run_lines, channel.gyro, [run]))
            if channel.is_own_axis:
                u_K = float(fit.of(lambda p: p[0]).u)
                published_line = campaign.run_lines.published(run, channel.gyro)
                figures += published.figures(published_line, u_K, name)
            mean = own_means[channel.gyro]
            if mean is not None and vertical is not None:
                # a projection's bias is referred to the gyro's own K
                K = None if channel.is_own_axis else mean.value("K")
                figures.append(bias_figure(name, fit, vertical, K))
        if channel.response is None:
            continue
        # the indication over table rate and temperature, with the parameters of the fit
        fitted, _, terms = channel.response
        powers, valid = range(terms.order + 1), table_runs.valid_ranges(channel.runs)
        units = [(f"K{k}", "1/deg") for k in powers] + [(f"F{k}", "1/s") for k in powers]
        letters = forms.BEND_LETTERS[: terms.bend_order + 1]
        units += [(f"{letter}{k}", "1/s") for letter in letters for k in terms.powers]
        parameters = [Parameter("fastest_dps", terms.fastest_dps, "deg/s")]
        if terms.order:
            ends = zip(("temp_middle_degc", "temp_half_degc"), terms.middle_half, strict=True)
            parameters += [Parameter(name, degc, "degC") for name, degc in ends]
        else:
            valid.pop(forms.TEMPERATURE, None)
        response = forms.RESPONSE.write_fit(
            f"{channel.name}.response",
            fitted,
            units,
            residual_rms=rms(fitted.noise_residual),
            residual_unit="1/s",
            valid=valid,
            parameters=tuple(parameters),
        )
        models.append(response)
    models += campaign.bias_curves
    angles = [*campaign.pair_figures]
    for axes_set in campaign.sets:
        for figure in axes_set.figures.values():
            suffixed_figure = replace(figure, name=figure.name + axes_set.suffix)
            (figures if figure.name.startswith("bias.") else angles).append(suffixed_figure)
    files = [("gyro_scale", models, figures)]
    orthogonality_models = (
        [campaign.pair] if campaign.pair else [axes_set.model for axes_set in campaign.sets]
    )
    files += [("gyro_orthogonality", orthogonality_models, angles)] if orthogonality_models else []
    # the latitude, and the earth's rate about the table axis, which F0 includes
    conditions: tuple[Condition, ...] = ()
    if vertical is not None and latitude is not None:
        conditions = (
            Condition("latitude", latitude, "deg"),
            Condition("earth_rate_about_table_axis", vertical, "deg/s"),
        )
    within_runs_figures = (
        (Figure(forms.WITHIN_RUNS, 1.0, "1", 0.0),) if campaign.within_runs else ()
    )
    return tuple(
        StageResult(
            stage,
            tuple(of_file),
            (*of_file_figures, *within_runs_figures),
            campaign.flags,
            conditions,
        )
        for stage, of_file, of_file_figures in files
    )


def line_model(
    name: str,
    line: Fit,
    run_lines: Lines,
    gyro: str,
    runs: Sequence[TableRun],
    components: tuple[Component, ...] | None = None,
) -> Model:
    """Line model (K and F0) of one gyro in one run, or of the mean over runs, whose uncertainty
    holds errors between them.
    """
    parameters: tuple[Parameter, ...] = ()
    if components is not None:
        parameters = (Parameter("runs", float(len(runs)), "1"),)
    degc = float(np.mean([run.temp_degc for run in runs]))
    if np.isfinite(degc):
        parameters = (*parameters, Parameter("temp_case", degc, "degC"))
    # residual rms and degrees of freedom are those of the published lines
    of_runs = [run_lines.published(run, gyro).fit for run in runs]
    model = forms.LINE.write_fit(
        name,
        line,
        (("K", "1/deg"), ("F0", "1/s")),
        residual_rms=rms([fit.residual_rms for fit in of_runs]),
        residual_unit="1/s",
        valid=table_runs.valid_ranges(runs),
        parameters=parameters,
    )
    return replace(model, dof=sum(fit.dof for fit in of_runs), components=components or ())


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


def curve_model(
    name: str,
    unit: str,
    curve: Fit,
    terms: equation.ResponseTerms,
    runs: Sequence[TableRun],
    of_runs: tuple[Array, Array],
) -> Model:
    """Polynomial of a fit in raw powers, valid over the range of all runs; its degrees of freedom
    are the fewest at the temperatures of the runs, its residual is that of what single runs gave:
    temperatures [r] and values [r].
    """
    order = curve.parameters.size - 1
    raw, covariance = polynomial.in_raw_powers(
        curve.parameters,
        curve.total_covariance,
        polynomial.to_raw_powers(*terms.middle_half, order),
    )
    run_degc, values = of_runs
    residual = values - polynomial.powers(terms.mapped(run_degc), order) @ curve.parameters
    temp_degc = [run.temp_degc for run in runs]
    x = terms.mapped(np.linspace(min(temp_degc), max(temp_degc), 9))
    dof = curve.of(lambda p: polynomial.powers(x, order) @ p).dof
    per = ["", "/degC", *(f"/degC^{k}" for k in range(2, order + 1))]
    return POLYNOMIAL.write(
        name,
        [(f"p{k}", value, f"{unit}{per[k]}") for k, value in enumerate(raw.tolist())],
        covariance,
        dof=max(int(np.min(dof)), 1),
        residual_rms=rms(residual),
        residual_unit=unit,
        valid={forms.TEMPERATURE: table_runs.valid_ranges(runs)[forms.TEMPERATURE]},
    )


def temperature_difference(runs: Runs) -> float:
    """How much warmer [°C] the runs about B's axis of a pair were; NaN where it is not known."""
    of_a, of_b = (float(np.mean([run.temp_degc for run in runs[axis]])) for axis in "ab")
    return of_b - of_a


def of_input_axes(fit: Fit, gyros: Sequence[str]) -> Iterator[Figure]:
    """Scale factors |s_g| about the input axes, unit vectors s_g/|s_g| (the misalignment matrix)
    and the angles between them, from scale factors about three orthogonal table axes, s_g gyro by
    gyro [3 g].

    Raises FitError for values that are not finite, or a gyro that senses none of the axes.
    """
    if not (np.isfinite(fit.parameters).all() and np.isfinite(fit.covariance).all()):
        raise FitError("a sensitivity is not finite", hint="check the run about each axis")
    size = np.linalg.norm(fit.parameters.reshape(-1, 3), axis=1)
    if not (size > 0.0).all():
        raise FitError(f"gyro {gyros[int(np.argmin(size))]} senses none of the three table axes")
    size, unit = fit.of(lambda p: length(p.reshape(-1, 3))), fit.of(_unit)
    for g, gyro in enumerate(gyros):
        yield figure_of(f"scale_factor.{gyro}", size, "1/deg", g)
        for a, axis in enumerate(forms.AXES):
            yield figure_of(f"misalignment.{gyro}{axis}", unit, "1", (g, a))
    for g, h in combinations(range(len(gyros)), 2):

        def angle_deg(p: Numbers, g: int = g, h: int = h) -> Numbers:
            """atan2(|u_g × u_h|, u_g · u_h), which loses no digits near 0° and 180°."""
            u_g, u_h = _unit(p)[[g, h]]
            return arctan2(length(np.cross(u_g, u_h)), np.sum(u_g * u_h)) * 180.0 / np.pi

        angle, pair = fit.of(angle_deg), f"{gyros[g]}_{gyros[h]}"
        yield figure_of(f"angle_deg.{pair}", angle, "deg")
        orthogonality_error = replace(angle, value=90.0 - angle.value)
        yield figure_of(f"orthogonality_error_deg.{pair}", orthogonality_error, "deg")


def figure_of(name: str, value: Value, unit: str, index: Any = ()) -> Figure:  # noqa: ANN401 (an index)
    """One of some values as a figure."""
    numbers = (float(part[index]) for part in (value.u, value.dof))
    return Figure(name, float(value.value[index]), unit, *numbers)


def bias_figure(name: str, line: Fit, vertical_dps: float, own_K: float | None = None) -> Figure:
    """A line's bias (F at rest − K ω)/K, ω the earth's rate about the table axis; `own_K` is the K
    that a projection is referred to.
    """

    def bias_dph(p: Numbers) -> Numbers:
        K, _, F_at_rest = p
        reference_K = K if own_K is None else own_K
        return np.asarray((F_at_rest - K * vertical_dps) / reference_K * DPH_PER_DPS)

    return figure_of(f"bias.{name}", line.of(bias_dph), "deg/h")


def _unit(p: Numbers) -> Numbers:
    """Unit vectors [g, 3] of sensitivities [3 g]."""
    s = p.reshape(-1, 3)
    return s / length(s)[:, None]
