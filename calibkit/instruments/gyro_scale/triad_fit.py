"""Table runs about three axes of one base → sensitivities of any number of gyros and angles between
them, also over temperature.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from calibkit.arrays import Array
from calibkit.constants import DPH_PER_DPS
from calibkit.errors import FitError, advise_exclude
from calibkit.instruments.gyro_scale import forms, over_runs, table_runs
from calibkit.instruments.gyro_scale.numeric import scale_factor, triad as gyro_triad
from calibkit.instruments.gyro_scale.recipe import GyroTriadRecipe
from calibkit.numeric.least_squares.polynomial import TemperaturePolynomial

ONE_SET_DEGC = 5.0
"""Largest difference in temperature [°C] between the runs of one set."""


@dataclass(frozen=True, slots=True)
class AxesSet:
    """Runs about all three axes at one temperature, with their triad and biases."""

    runs: tuple[table_runs.TableRun, ...]
    temp_degc: float
    """Mean of the runs [°C]; NaN where no temperature was logged."""
    triad: gyro_triad.Triad
    bias: Array
    """[g, 1/s], without the earth's rate; NaN where the latitude is unknown."""
    bias_uncertainty: Array

    @property
    def prefix(self) -> str:
        """Prefix of the set's flags."""
        return f"{self.temp_degc:.0f} °C: " if np.isfinite(self.temp_degc) else ""


@dataclass(frozen=True, slots=True)
class AxesFit:
    """Gyros over three axes: all runs, the sets of runs, index of the reference set, and
    polynomials over temperature.
    """

    gyros: tuple[str, ...]
    runs: Mapping[str, tuple[table_runs.TableRun, ...]]
    """Table axis → its runs."""
    sets: tuple[AxesSet, ...]
    reference: int
    over: gyro_triad.TriadOverTemperature | None
    bias_over: tuple[TemperaturePolynomial, ...]
    flags: tuple[str, ...]

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Index pairs (g, h) of all pairs of gyros."""
        return list(combinations(range(len(self.gyros)), 2))

    def main_axis(self, gyro: str) -> str:
        """Table axis that a gyro senses most."""
        row = self.sets[self.reference].triad.sensitivity[self.gyros.index(gyro)]
        return forms.AXES[int(np.argmax(np.abs(row)))]

    def name(self, gyro: str, axis: str, run: table_runs.TableRun) -> str:
        """Name of the model of one gyro in one run."""
        name = forms.line_name(gyro, axis)
        return name if len(self.runs[axis]) == 1 else f"{name}.{run.log.name}"

    def named(self, name: str, one: AxesSet) -> str:
        """Name of a model or figure; outside the reference set with the set's temperature."""
        return name if (one is self.sets[self.reference]) else f"{name}.at_{one.temp_degc:.0f}"


def fit_axes(spec: GyroTriadRecipe, runs: Mapping[str, tuple[table_runs.TableRun, ...]]) -> AxesFit:
    """Fit sensitivities and angles of each set of runs, and each sensitivity over temperature where
    the temperature varies.

    Raises FitError for a table axis without a run at some temperature.
    """
    if missing := [axis for axis in forms.AXES if not runs.get(axis)]:
        raise FitError(
            f"no log about table axis {missing[0]}",
            hint="three axes need a log each; see [axes] and [logs] files",
        )
    every = [run for axis in forms.AXES for run in runs[axis]]
    known = bool(np.isfinite([run.temp_degc for run in every]).all())
    flags = [flag for run in every for flag in run.flags]
    if not known and len(every) > len(forms.AXES):
        flags.append(over_runs.UNLOGGED)
    sets = tuple(_set_of(group, spec) for group in (_groups(runs) if known else [dict(runs)]))
    for one in sets:
        _require_own_axes(one, spec.gyros)
    temperature = np.array([one.temp_degc for one in sets])
    reference = int(np.argmin(np.abs(temperature - spec.reference_temp_degc))) if known else 0
    over: gyro_triad.TriadOverTemperature | None = None
    bias_over: tuple[TemperaturePolynomial, ...] = ()
    if len(sets) > 1:
        over = gyro_triad.over_temperature([one.triad for one in sets], temperature)
        bias = np.array([one.bias for one in sets]).T
        u_bias = np.array([one.bias_uncertainty for one in sets]).T
        if np.isfinite(bias).all():
            bias_over = tuple(
                scale_factor.over_temperature(values, u, temperature)
                for values, u in zip(bias, u_bias, strict=True)
            )
    flags += _flag_sets(spec, sets)
    return AxesFit(spec.gyros, runs, sets, reference, over, bias_over, tuple(dict.fromkeys(flags)))


def _require_own_axes(one: AxesSet, gyros: Sequence[str]) -> None:
    """Raise FitError where a gyro named x, y or z senses another of these axes most: logs or
    columns are exchanged.
    """
    for gyro, row in zip(gyros, one.triad.misalignment, strict=True):
        most = forms.AXES[int(np.argmax(np.abs(row)))]
        if gyro in forms.AXES and most != gyro:
            raise FitError(
                f"{one.prefix}gyro {gyro} senses table axis {most} most"
                f" ({row[forms.AXES.index(most)]:+.3f})",
                hint=(
                    "logs are exchanged under [axes], or columns; gyros that are not mounted so"
                    " need other names"
                ),
            )


def _groups(
    runs: Mapping[str, tuple[table_runs.TableRun, ...]],
) -> list[dict[str, tuple[table_runs.TableRun, ...]]]:
    """Runs grouped by temperature, coldest first, each group with every axis."""
    pairs = sorted(
        ((run.temp_degc, axis, run) for axis in forms.AXES for run in runs[axis]),
        key=lambda pair: pair[0],
    )
    groups: list[dict[str, tuple[table_runs.TableRun, ...]]] = []
    last = float("-inf")
    for degc, axis, run in pairs:
        if degc - last > ONE_SET_DEGC:
            groups.append({})
        groups[-1][axis] = (*groups[-1].get(axis, ()), run)
        last = degc
    for group in groups:
        if missing := [axis for axis in forms.AXES if axis not in group]:
            there = ", ".join(run.log.file for axis in group for run in group[axis])
            degc = float(np.mean([run.temp_degc for axis in group for run in group[axis]]))
            raise FitError(
                f"no log about table axis {missing[0]} near {degc:.1f} °C, where there are {there}",
                hint=(
                    "each temperature needs a run about each axis; leave the others out:"
                    f" {advise_exclude(there.split(', ')[0])}"
                ),
            )
    return groups


def _set_of(group: Mapping[str, tuple[table_runs.TableRun, ...]], spec: GyroTriadRecipe) -> AxesSet:
    """Set of the triad and biases of a group of runs."""
    means = [_mean([run.scales for run in group[axis]]) for axis in forms.AXES]
    every = tuple(run for axis in forms.AXES for run in group[axis])
    bias, uncertainty = _bias(every, spec)
    stated = [(value, dof) for _, value, dof in spec.known_errors()]
    return AxesSet(
        every,
        float(np.mean([run.temp_degc for run in every])),
        gyro_triad.from_runs(*means, mounting_deg=stated[0] if stated else (0.0, np.inf)),
        bias,
        uncertainty,
    )


def _mean(runs: Sequence[scale_factor.RunScales]) -> scale_factor.RunScales:
    """Mean K of repeated runs with the covariance of one of them, raised to the scatter of the mean
    where that is larger.

    The covariance is not divided by the number of runs: the table's unevenness and a gyro's
    departure from the line are the same in every run.
    """
    K = np.array([run.K for run in runs])
    covariance = np.mean([run.covariance for run in runs], axis=0)
    if len(runs) > 1:
        own = np.sqrt(np.diag(covariance))
        scatter = K.std(axis=0, ddof=1) / np.sqrt(len(runs))
        raised = np.maximum(scatter / np.where(own > 0.0, own, np.inf), 1.0)
        covariance = covariance * np.outer(raised, raised)
    return replace(runs[0], K=K.mean(axis=0), covariance=covariance)


def _bias(runs: Sequence[table_runs.TableRun], spec: GyroTriadRecipe) -> tuple[Array, Array]:
    """Bias [g, 1/s] of runs about all axes without the earth's rate, F0 − K ω, and its standard
    uncertainty.
    """
    vertical = table_runs.vertical_rate_dps(spec)
    if vertical is None:
        return np.full(len(spec.gyros), np.nan), np.full(len(spec.gyros), np.nan)
    lines = [run.scales.gyros for run in runs]
    values = np.array([[line.F0 - line.K * vertical for line in row] for row in lines])
    gradient = np.array([-vertical, 1.0])
    noise = np.array([[gradient @ line.covariance @ gradient for line in row] for row in lines])
    scatter = values.var(axis=0, ddof=1) / len(runs)
    return values.mean(axis=0), np.sqrt(np.maximum(noise.mean(axis=0) / len(runs), scatter))


def _flag_sets(spec: GyroTriadRecipe, sets: Sequence[AxesSet]) -> Iterator[str]:
    """Flags for left-handed input axes, poorly determined scale factors, and biases that are
    inconsistent or unknown.
    """
    for one in sets:
        yield from (f"{one.prefix}{flag}" for flag in one.triad.flags)
    directions = [one.triad.misalignment for one in sets]
    if len(spec.gyros) == len(forms.AXES) and (np.linalg.det(directions) < 0.0).any():
        yield "the input axes make a left-handed system: logs or signs may be exchanged"
    for one in sets:
        shares = one.triad.magnitude_uncertainty / one.triad.magnitude
        for gyro, share in zip(spec.gyros, shares, strict=True):
            if not share < table_runs.UNCERTAIN:
                yield (
                    f"{one.prefix}{gyro}: the scale factor is known to {100.0 * share:.2g} % only:"
                    " hold faster rates, or longer"
                )
    if not spec.errors.component and len(spec.gyros) > 1:
        yield (
            "the errors of mounting are not in u of the angles and unit vectors: state how a"
            ' mounting repeats in [[errors.component]] group = "mounting", effect = "angle"'
        )
    if spec.site.latitude_deg is None:
        yield (
            "the latitude is not known ([site] latitude_deg): the bias stays mixed with the earth's"
            " rate about each table axis, and `apply` is refused"
        )
    for one in sets:
        # a bias that differs between the attitudes depends on acceleration, or the earth's rate is
        # wrong
        largest = float(np.max(one.bias_uncertainty / one.triad.magnitude)) * DPH_PER_DPS
        if largest > 1.0:
            yield (
                f"{one.prefix}the bias is known to {largest:.2g} °/h only: it differs between the"
                " table axes (latitude, table axis, or a bias that depends on acceleration)"
            )
