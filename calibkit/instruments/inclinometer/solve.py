"""Stations → s(T) of each gyro; then the attitude of every station with s from s(T) or from its
history, its uncertainty, and its errors against a reference.

    u²(ψ) = u² of the readings, s and the latitude (`root_choice`) + (∂ψ/∂δ u(δ))² + type B terms

δ is the turn of a gyro against its accelerometer about the tool axis.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from calibkit.errors import FitError
from calibkit.fit.shared import Shared
from calibkit.fit.unseen import unseen
from calibkit.instruments.inclinometer import published, root_choice, scale_fit
from calibkit.instruments.inclinometer.forms import MOUNTING, ScaleModel
from calibkit.instruments.inclinometer.published import Sensor
from calibkit.instruments.inclinometer.recipe import InclinometerRecipe
from calibkit.instruments.inclinometer.root_choice import (
    BothRoots,
    Combined,
    ScalePrior,
    Solution,
)
from calibkit.instruments.inclinometer.scale_fit import ScaleFit
from calibkit.instruments.inclinometer.stations import Stations
from calibkit.numeric.arrays import Array, Mask
from calibkit.numeric.attitude import wrapped
from calibkit.numeric.dispersion import rms
from calibkit.recipe.shared_errors import state_sizes
from calibkit.recipe.type_b import terms_of
from calibkit.records.coefficients import Criterion, at_most, over_u

TURNED = 5.0
"""Standard uncertainties above which unseen azimuths are turned together; 260 simulated tools had
at most 3.4.
"""
WRONG = "check the gyro's unit in [columns], reference.convention and site.latitude_deg"
"""Advice for a scale factor that no gyro has."""
SHARP = 0.1
"""Relative standard uncertainty of a root below which it counts as measured."""
IMPLAUSIBLE = 0.05
"""Departure of a measured s from its prior that no drift since the calibration explains.
"""
FEW_STATIONS = 3
"""Fewest stations for a majority decision on a log."""
APART_DEG = 5.0
"""Difference between the toolfaces of two pairs [°] that no misalignment of axes explains."""
SMALL_WEIGHT = 0.25
"""Weight of a pair in the azimuth, that of 1.7 times the noise, from which its turn counts in full.
"""


@dataclass(frozen=True, slots=True)
class AngleErrors:
    """Errors [n] [°] against the reference; NaN without reference or result. `before` is the
    azimuth error with s = 1.
    """

    inclination: Array
    toolface: Array
    before: Array
    after: Array
    standard_uncertainty: Array
    """Of the corrected azimuth [n] [°]."""
    noise: Array
    """The same without what the mounting of the sensors adds [n] [°]."""
    stated: Array
    """What the recipe states of the mounting, or of the reference [n] [°]."""
    by_turn: Array
    """Derivative of the azimuth by a turn of the gyros against the accelerometers [n] [°/°]."""

    @property
    def known(self) -> Mask:
        """Mask [n] of the stations with a reference azimuth and a result."""
        return np.isfinite(self.after) & np.isfinite(self.before)

    @property
    def sizes(self) -> dict[str, Array]:
        """Angle → root mean square and largest size [°] of its errors and their number [2, 3], with
        s = 1 and corrected, which does not affect inclination and toolface; NaN without any.
        """
        by_angle = {
            "azimuth": np.where(self.known, [self.before, self.after], np.nan),
            "inclination": np.array([self.inclination] * 2),
            "toolface": np.array([self.toolface] * 2),
        }
        sizes = {}
        for name, stages in by_angle.items():
            finite = [errors[np.isfinite(errors)] for errors in stages]
            largest = [np.fmax.reduce(np.abs(errors), initial=np.nan) for errors in finite]
            counts = [errors.size for errors in finite]
            sizes[name] = np.column_stack([[*map(rms, finite)], largest, counts])
        return sizes

    def turn(self) -> tuple[float, float]:
        """Turn of the gyros against the accelerometers, or of the reference azimuths, that the
        errors of the known stations share, and its standard uncertainty [°].

            β = Σ (s e / u²) / Σ (s² / u²),   u(β)² = 1 / Σ (s² / u²) + (rms v / rms s)²

        e azimuth errors, s their derivatives by a turn, u their noise, v what the recipe states.
        """
        slope, u, with_reference = self.by_turn, self.noise, self.known
        weight = np.where(with_reference, slope / u**2, 0.0)
        power = float(np.nansum(weight * slope))
        shared = rms(self.stated[with_reference]) / rms(slope[with_reference])
        return float(np.nansum(weight * self.after)) / power, float(np.hypot(power**-0.5, shared))

    def judge_uncertainty(self, name: str) -> Criterion:
        """Criterion that azimuth errors of unseen stations are as large as stated; s(T) is common
        to all stations, so that all azimuths may err alike.
        """
        u = self.standard_uncertainty[self.known]
        comparison = unseen(self.after[self.known], u[:, None])
        return over_u(f"{name}: rms azimuth error", comparison.to_object())

    def criteria(self, spec: InclinometerRecipe) -> tuple[Criterion, ...]:
        """Criteria of the recipe's acceptance limits."""
        limits, sizes = spec.acceptance, self.sizes
        tests = [("azimuth rms", sizes["azimuth"][1, 0], limits.max_azimuth_rms_deg)]
        for name in sizes:
            limit = getattr(limits, f"max_{name}_error_deg")
            tests.append((f"largest {name} error", sizes[name][1, 1], limit))
        return tuple(
            at_most(name, float(size), limit, "deg")
            for name, size, limit in tests
            if limit is not None and np.isfinite(size)
        )


@dataclass(frozen=True, slots=True)
class SolvedStations:
    """Solutions of n stations by each sensor pair that is read, and combined."""

    stations: Stations
    solutions: Mapping[Sensor, Solution]
    priors: Mapping[Sensor, ScalePrior]
    combined: Combined
    errors: AngleErrors
    c: Array
    """C [n], near zero where s is badly determined (`published.root_label`)."""

    @property
    def refused(self) -> Mask:
        """Mask [n] of the stations without a result."""
        return np.array([bool(reason) for reason in self.combined.status], dtype=np.bool_)

    @np.errstate(divide="ignore", invalid="ignore")
    def require_consistent(self, place: str) -> None:
        """Raise FitError for a log most of whose stations are inconsistent; single inconsistent
        stations are only refused.

        Raises FitError where most stations contradict s(T), or most have pairs that see different
        toolfaces.
        """
        count = len(self.combined.status)
        if count < FEW_STATIONS:
            return
        impossible = np.zeros(count, dtype=np.bool_)
        for axis, pair in self.solutions.items():
            far = np.abs(pair.s_root - self.priors[axis].s) > IMPLAUSIBLE
            impossible |= far & (pair.s_root_uncertainty < SHARP * np.abs(pair.s_root))
            impossible |= np.array([WRONG in reason for reason in pair.status])
        if 2 * int(impossible.sum()) > count:
            raise FitError(
                f"{place}: {int(impossible.sum())} of {count} stations contradict s(T)", hint=WRONG
            )
        if len(self.solutions) == 2:
            x, y = (self.solutions[axis].toolface_deg for axis in ("x", "y"))
            apart_count = int(np.sum(np.abs(wrapped(x - y)) > APART_DEG))
            if 2 * apart_count > count:
                raise FitError(
                    f"{place}: the two sensor pairs see toolfaces more than {APART_DEG:g}° apart at"
                    f" {apart_count} of {count} stations",
                    hint="check the signs of both axes and the direction in which position_deg"
                    " counts",
                )


def fit_scale(
    stations: Stations, spec: InclinometerRecipe
) -> tuple[dict[Sensor, ScaleFit], SolvedStations]:
    """Fit s(T) of each gyro to all stations, and solve every station with the s(T) fitted to all
    the others.

    Raises FitError where a gyro has no usable root of s, or an s that only a wrong unit, sign or
    latitude explains.
    """
    roots, fits = _estimate_roots(stations, spec), {}
    for axis in spec.axes:
        # 1. Stations that no working gyro can have produced are left out.
        first = _solve_in_sequence(roots[axis], stations, spec)
        low, high, usable = spec.scale.smallest, spec.scale.largest, first.weight > 0.0
        if not usable.any():
            positive = first.s_root[np.isfinite(first.s_root) & (first.s_root > 0.0)]
            strange = bool(positive.size) and not low <= float(np.median(positive)) <= high
            raise FitError(
                f"gyro_{axis}_dph: none of {usable.size} stations gives a usable s, expected one or"
                f" more; station {stations.names[0]}:"
                f" {first.status[0] or '; '.join(first.flags[0])}",
                hint=WRONG
                if strange
                else "add stations of other inclinations and azimuths, or see [limits]",
            )
        median = float(np.median(first.s_root[usable]))
        if not low <= median <= high:
            raise FitError(
                f"gyro_{axis}_dph: s is {median:.4g} (median of {int(usable.sum())} stations),"
                f" expected {low:g} to {high:g}",
                hint=WRONG,
            )
        roots[axis] = _refuse_contradictions(roots[axis], first, spec)
        first = _solve_in_sequence(roots[axis], stations, spec)

        # 2. s(T) of the roots that are left, with the errors that stations share: the turn of the
        # gyro, unless the recipe leaves it out, and the scale of a log.
        by_turn, _ = root_choice.mounting_slopes(
            stations.components[axis], first.root_slopes[:, :4]
        )
        tool, loading = np.zeros(by_turn.size, dtype=np.int64), np.radians(by_turn[:, None])
        candidates = [
            Shared(group=MOUNTING, effect="gyro turn", level=tool, loading=loading, unit="deg")
        ]
        if stations.log.max() > 0:
            candidates.append(scale_fit.scale_of_logs(stations.log))
        shared = {error.group: error for error in state_sizes(spec.errors, candidates)}
        fits[axis] = scale_fit.fit_over_temperature(
            first,
            stations.temperature,
            order=None if spec.scale.order == "auto" else spec.scale.order,
            turn=shared.get(MOUNTING),
            log=shared.get("log"),
            noise=stations.noise[axis],
            history=spec.history,
        )

    # 3. Every station by the s(T) of all the others.
    turns_deg = {axis: scale.model.turn_deg for axis, scale in fits.items()}
    left_out = {axis: scale.left_out for axis, scale in fits.items()}
    solved = _solve_stations(stations, roots, left_out, spec, turns_deg)
    solved.require_consistent("the stations")
    return fits, solved


def seek_north(
    stations: Stations, models: Mapping[Sensor, ScaleModel], spec: InclinometerRecipe
) -> SolvedStations:
    """Solve every station with the s(T) of a calibration, times the relative departure from it that
    the stations before show (step D).

    A station whose s no gyro has is refused, and does not shift the others.
    """
    turns_deg = {axis: models[axis].turn_deg for axis in spec.axes}
    roots = _estimate_roots(stations, spec)
    while True:
        priors = {}
        for axis, estimates in roots.items():
            base = models[axis].prior(stations.temperature)
            # the uncertainty of the measured departure combines those of s(T) and of the root
            s, u_base = base.s[:, None], base.standard_uncertainty[:, None]
            relative = replace(
                estimates,
                s=estimates.s / s,
                uncertainty=np.hypot(estimates.uncertainty, u_base) / s,
            )
            departure = root_choice.history_prior(relative, stations.elapsed, spec.departure)
            u = np.hypot(base.standard_uncertainty, base.s * departure.standard_uncertainty)
            priors[axis] = ScalePrior(base.s * departure.s, u)
        solved = _solve_stations(stations, roots, priors, spec, turns_deg)
        refused = [pair.status for pair in roots.values()]
        for axis, solution in solved.solutions.items():
            roots[axis] = _refuse_contradictions(roots[axis], solution, spec)
        if refused == [pair.status for pair in roots.values()]:
            return solved


def _solve_in_sequence(roots: BothRoots, stations: Stations, spec: InclinometerRecipe) -> Solution:
    """Solve the stations of one sensor pair in order, with the history of s as prior."""
    prior = root_choice.history_prior(roots, stations.elapsed, spec.history)
    return root_choice.solve(roots, prior, spec.site.latitude_uncertainty_deg)


def _estimate_roots(stations: Stations, spec: InclinometerRecipe) -> dict[Sensor, BothRoots]:
    """Both roots of s of the stations of each sensor pair."""
    heading_deg = stations.reference[:, 2] if spec.root.choice == "heading" else None
    return {
        axis: root_choice.estimate_roots(
            stations.components[axis],
            spec.site.latitude_deg,
            heading_deg=heading_deg,
            refused=stations.status[axis],
            limits=spec.limits,
        )
        for axis in spec.axes
    }


def _refuse_contradictions(
    roots: BothRoots, solution: Solution, spec: InclinometerRecipe
) -> BothRoots:
    """Roots without those of stations whose readings no working gyro can have produced.

    The true s is always a root. Noise may merge it with the other (a clamped discriminant), not
    make it disappear.
    """
    low, high = spec.scale.smallest, spec.scale.largest
    s, u = solution.s_root, solution.s_root_uncertainty
    # a root with a relative uncertainty below 10 % is a measurement, even if its weight against the
    # prior is small
    clamped = np.array([root_choice.CLAMPED in flags for flags in solution.flags])
    measured = (u < SHARP * np.abs(s)) | (solution.weight > 0.0) | clamped
    judged = np.array([not reason for reason in solution.status])
    contradictions = root_choice.tell(
        (judged & (solution.root == 0), f"no positive root of s: {WRONG}"),
        (
            judged & (solution.root != 0) & measured & ~((low <= s) & (s <= high)),
            f"s is {{s:.4g}}, expected {low:g} to {high:g}: {WRONG}",
        ),
        s=s,
    )
    reasons = zip(roots.status, contradictions, strict=True)
    status = tuple(text or "".join(contradiction) for text, contradiction in reasons)
    return replace(roots, status=status)


@np.errstate(divide="ignore", invalid="ignore")
def _solve_stations(
    stations: Stations,
    roots: Mapping[Sensor, BothRoots],
    priors: Mapping[Sensor, ScalePrior],
    spec: InclinometerRecipe,
    turns_deg: Mapping[Sensor, float],
) -> SolvedStations:
    """Solve every station with its priors, and combine both pairs where both are read; the azimuth
    is as uncertain as how the sensors are mounted makes it.

    Raises FitError for a station whose predicted s is not positive.
    """
    for axis, prior in priors.items():
        for k in np.flatnonzero(~(prior.s > 0.0))[:1].tolist():
            raise FitError(
                f"gyro_{axis}_dph: s(T) predicts s = {prior.s[k]:.3g} for station"
                f" {stations.names[k]} at {stations.temperature[k]:.4g} °C, expected a positive"
                " number",
                hint="lower [scale] order, or add stations near this temperature",
            )
    u_latitude_deg = spec.site.latitude_uncertainty_deg
    solutions = {
        axis: root_choice.solve(pair, priors[axis], u_latitude_deg) for axis, pair in roots.items()
    }
    combined = root_choice.combine(solutions)

    # How sensors and positions are mounted: an unknown turn of the gyros, of which the larger of
    # two counts, in full, but by the weight of its pair where that is small (a noisy gyro does not
    # tell its turn, nor carry the azimuth); and what [[type_b]] and [[errors.component]] state.
    by_turn, by_index = np.stack([pair.by_mounting for pair in solutions.values()], axis=1)
    weight = combined.azimuth_weight
    counted = np.where(weight < SMALL_WEIGHT, weight, 1.0) * np.abs(by_turn)
    sizes_deg = np.array([[turns_deg[axis]] for axis in solutions])
    with_positions, of_azimuth = (
        sum((part.sensitivity * part.standard_uncertainty) ** 2 for part in terms)
        for terms in (
            terms_of(spec.type_b, "azimuth_deg", 0.0, {"position_deg": (0.0, 1.0)}),
            terms_of(spec.type_b, "azimuth_deg", 0.0),
        )
    )
    without_turn = of_azimuth + np.fmax.reduce(np.abs(by_index)) ** 2 * (
        with_positions - of_azimuth
    )
    of_mounting = [entry for entry in spec.errors.component if entry.group == MOUNTING]
    stated_deg = max((entry.value_in("deg") for entry in of_mounting), default=0.0)
    covariance = combined.covariance.copy()
    covariance[:, 2, 2] += without_turn + np.fmax.reduce(sizes_deg * counted) ** 2
    inclination_deg, toolface_deg, azimuth_deg = stations.reference.T
    solved = np.array([not reason for reason in combined.status])
    errors = AngleErrors(
        inclination=np.where(solved, combined.inclination_deg - inclination_deg, np.nan),
        toolface=wrapped(combined.toolface_deg - toolface_deg),
        before=wrapped(combined.uncorrected_deg - azimuth_deg),
        after=wrapped(combined.azimuth_deg - azimuth_deg),
        standard_uncertainty=np.sqrt(covariance[:, 2, 2]),
        noise=combined.standard_uncertainty[:, 2],
        stated=np.sqrt(without_turn + (stated_deg * np.fmax.reduce(counted)) ** 2),
        by_turn=np.fmax.reduce(by_turn),
    )
    theta, psi = np.radians([combined.inclination_deg, combined.azimuth_deg])
    c = published.root_label(theta, psi, spec.site.latitude_deg)
    with_mounting = replace(combined, covariance=covariance)
    return SolvedStations(stations, solutions, priors, with_mounting, errors, c)
