"""What the logs of a campaign do not show, or show to be wrong: flags of runs about one, two or
three axes, and the refusal of what no campaign can be. And criteria of the limits that a recipe
states: on the largest figure of each kind over all gyros and runs of a fit, on the residuals of the
lines over their noise, on the largest error in unseen runs.

A run contradicts the others where it is of another gyro, setting or unit, or has a turned sign or
swapped columns. A gyro that a table turns across its axis indicates the share k/|s| of the rate,
which hardly changes with temperature:

    F = e² / (s² (1 + 1/n)) against F(1, ν)                                                  (1)

e is what the share in one log is off the mean of the n other logs about the axis, s² the scatter
about such means in all logs but that one, of all gyros and axes together, at least that of noise.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations
from typing import Any, Self

import numpy as np

from calibkit.errors import FitError, advise_exclude
from calibkit.fit.value import Value
from calibkit.instruments.gyro_scale import equation, forms, ordering
from calibkit.instruments.gyro_scale.coefficient_files import (
    AxesSet,
    CampaignFit,
    Runs,
    temperature_difference,
)
from calibkit.instruments.gyro_scale.lines import Lines
from calibkit.instruments.gyro_scale.published import IEEE, PPM, ROOM_DEGC, FigureName, Line
from calibkit.instruments.gyro_scale.recipe import (
    AnyRecipe,
    GyroPairRecipe,
    GyroTriadRecipe,
    LineAcceptance,
    RateTableRecipe,
)
from calibkit.instruments.gyro_scale.table_runs import TableRun
from calibkit.numeric import gum, left_out_run
from calibkit.recipe import shared_errors
from calibkit.records.coefficients import Criterion, Figure, at_most
from calibkit.records.frame import Remark

CHANCE = 0.005
"""Probability with which a gyro of a faultless campaign is named, of all its logs together."""
ANOTHER = 1e-3
"""Relative difference from the other runs above which a scale factor is another gyro's or
setting's: what is fitted through both is the scale factor of neither, and is rejected.
"""
CONSISTENT = 4.0
"""Difference of two results, in standard uncertainties, above which they are inconsistent."""
NOISE = 2.0
"""Standard uncertainties of γ within which it may be a limit of it."""
LIMITS = {
    "nonlinearity_full_scale": ("nonlinearity over full scale", "max_nonlinearity_ppm", "ppm"),
    "asymmetry": ("asymmetry", "max_asymmetry_ppm", "ppm"),
    "repeatability": ("repeatability", "max_repeatability_ppm", "ppm"),
    "temperature_sensitivity": (
        "temperature sensitivity",
        "max_temperature_sensitivity_ppm_degc",
        "ppm/degC",
    ),
    "orthogonality_error_deg": ("orthogonality error", "max_orthogonality_error_deg", "deg"),
    "gamma": ("standard uncertainty of gamma", "max_gamma_uncertainty", "1"),
    "angle_deg": ("standard uncertainty of an angle", "max_angle_uncertainty_deg", "deg"),
}
"""Figure of runs (GJB 2426A), or between gyros → name, recipe key and unit of its limit."""
UNSEEN_LIMITS = {
    "scale_factor_error_ppm": ("scale-factor error", "max_scale_factor_error_ppm", "ppm"),
    "nonlinearity_full_scale_ppm": LIMITS["nonlinearity_full_scale"],
    "rate_error_max_ppm_of_full_scale": ("rate error", "max_rate_error_ppm", "ppm"),
    "cross_axis_max_ppm_of_full_scale": (
        "rate across the turned axis",
        "max_cross_axis_ppm",
        "ppm",
    ),
}
"""Error in unseen runs → name, recipe key and unit of its limit."""
UNLOGGED = (
    "temperature is not logged in every run: nothing is fitted over it, all runs count as repeated"
)
WITHIN = (
    "the scale factors hold within these runs: their u leaves out how runs repeat, and no limit on"
    ' them is decided; repeat each run, or state [[errors.component]] group = "run", effect ='
    ' "scale"'
)

MOUNTING = (
    "the error of mounting again is not in u of the angles and unit vectors, and no limit on them"
    ' is decided: state how a mounting repeats in [[errors.component]] group = "mounting", effect ='
    ' "angle"'
)


def _list_holding(*flags: tuple[bool, str]) -> list[str]:
    """Sentences whose test holds. One is a remark where U holds what it says, or where it says what
    U holds within.
    """
    return [sentence for holds, sentence in flags if holds]


def list_undetermined(campaign: CampaignFit) -> list[str]:
    """What the runs of single gyros do not determine, and what it takes."""
    return _list_holding(
        (
            not all(channel.curves for channel in campaign.channels),
            "K and F0 over temperature: log runs at temperatures 5 °C apart or more",
        ),
        (
            any(len(channel.repeated) < 2 for channel in campaign.channels),
            "repeatability: log two runs or more at the reference temperature",
        ),
    )


def of_campaign(spec: AnyRecipe, runs: Runs, campaign: CampaignFit) -> tuple[str, ...]:
    """Flags of a campaign, each once: of its logs, then of what is fitted to them."""
    of_logs = [flag for group in runs.values() for run in group for flag in run.flags]
    bent = {channel.gyro for channel in campaign.channels if channel.response}
    run_lines = campaign.run_lines
    of_lines = [*run_lines.flag_drifts(), *run_lines.flag_uncertain(bent)]
    for gyro, lines, decided in run_lines.in_time:
        name, K = forms.line_name(spec.gyros[gyro]), float(run_lines.K[lines].mean())
        of_lines += ordering.flag(name, decided, K)
    if isinstance(spec, GyroPairRecipe):
        of_fit = _of_pair(spec, runs, campaign)
    elif isinstance(spec, GyroTriadRecipe):
        of_fit = _of_axes(spec, campaign)
    else:
        of_fit = _of_runs(spec, campaign)
    return tuple(dict.fromkeys((*of_logs, *of_lines, *of_fit)))


def _of_runs(spec: RateTableRecipe, campaign: CampaignFit) -> Iterator[str]:
    """Flags of runs about one axis."""
    channels, run_lines = campaign.channels, campaign.run_lines
    cure = 'state [[errors.component]] group = "run"'
    stated_effects = {entry.effect for entry in spec.errors.component}
    unknown = [effect for effect in ("scale", "zero") if effect not in stated_effects]
    runs = channels[0].runs
    for channel in channels:
        name, gyro, repeated = channel.name, channel.gyro, channel.repeated
        K = run_lines.of_runs(runs, gyro)
        yield from of_contradicted_runs(name, repeated, run_lines.of_runs(repeated, gyro))
        # what the runs cannot tell of their repeatability and of the response
        assert channel.mean is not None  # noqa: S101 (as of every gyro of a rate table)
        assert channel.fitted is not None  # noqa: S101
        _, rows, terms = channel.fitted
        few = []
        for c in channel.mean.coefficients:
            dof = channel.mean.dof_of(c)
            interval = f"its interval is ± {gum.coverage_factor(dof):.3g} standard uncertainties"
            text = f"{name}: {c.name} has {dof:.2g} degrees of freedom between {len(runs)} runs"
            few_dof = len(runs) > 1 and dof < shared_errors.FEW_DOF
            few.append((few_dof, Remark(f"{text}, {interval}: add runs, or {cure}")))
        yield from _list_holding(
            (
                len(runs) == 1 and bool(unknown),
                Remark(
                    f"{name}: one run does not show how runs repeat; u of K and F0 holds within"
                    f" this run only: repeat it, or {cure}, effect ="
                    f" {' and '.join(map(repr, unknown))}"
                ),
            ),
            (
                bool(channel.curves) and not terms.order,
                (
                    f"{name}: runs at two temperatures do not show how K changes between them: K is"
                    " the mean of all runs, and its U holds their difference; add runs at a third"
                    " temperature, or leave out those far from the reference"
                ),
            ),
            *few,
            (
                bool(terms.shapes) and not equation.turns_both_ways(rows.rate_dps),
                (
                    f"{name}: every run turns one way and the response is bent: F0, the bias and"
                    " the other direction are not known from these runs; run the table both ways"
                ),
            ),
        )
        if channel.curves:
            yield from of_contradicted_runs(name, runs, K)
        yield from ordering.flag(name, channel.in_time, channel.mean.value("K"))
    temperature = np.array([run.temp_degc for run in runs])
    near_reference = np.abs(temperature - spec.reference_temp_degc) <= ROOM_DEGC
    if len(temperature) > 1 and np.isnan(temperature).any():
        yield UNLOGGED
    elif not near_reference.any() and np.isfinite(temperature).all():
        yield (
            f"no run within {ROOM_DEGC:g} °C of {spec.reference_temp_degc:g} °C: the mean is that"
            f" of all runs, {temperature.min():.1f} to {temperature.max():.1f} °C"
        )


def refuse_opposite(by_noise: Value, from_a: Value) -> None:
    """Raise FitError for two γ that are equal and opposite, by more than mountings can be off."""
    gamma, gamma_a = float(by_noise.value), float(from_a.value)
    # apart by more than this, while their sum is within it: equal and opposite
    limit = 20.0 * float(np.hypot(by_noise.u, from_a.u))
    # two mountings that are each 0.1° off make small γ of opposite sign too
    mounted = 2.0 * float(np.radians(0.1))
    if abs(gamma_a - gamma) > max(limit, mounted) and limit > abs(gamma_a + gamma):
        raise FitError(
            f"gamma is {gamma:.6g} from B about A's axis and {gamma_a:.6g} from A"
            " about B's: equal and opposite",
            hint=(
                "one gyro, or the table, has opposite signs in the two logs; state the sign in"
                " [columns]"
            ),
        )


def of_gamma(indicated: Value, from_a: Value) -> list[str]:
    """Flags of γ by noise alone, at its limits and against that from A about B's axis."""
    gamma, u = float(indicated.value), float(indicated.u)
    excess, difference = abs(gamma) - 1.0, float(from_a.value) - gamma
    expected = max(float(np.hypot(from_a.u, u)), np.finfo(np.float64).tiny)
    return _list_holding(
        (excess > 0.0, f"|gamma| {abs(gamma):.9g} clamped to 1"),
        (
            excess > CONSISTENT * u,
            (
                f"|gamma| exceeds 1 by {excess * 1e6:.0f} ppm, more than noise explains: "
                "gyro B's own table axis is not its input axis, or the runs differ in temperature"
            ),
        ),
        (
            -excess < NOISE * u,
            "|gamma| is within noise of 1: the interval of alpha is one-sided",
        ),
        (abs(gamma) < NOISE * u, "gamma is within noise of 0: its sign does not tell the side"),
        (
            abs(difference) > CONSISTENT * expected,
            (
                f"gamma from A about B's axis differs by {difference:.2g},"
                f" {abs(difference) / expected:.0f} standard uncertainties: a table axis is not the"
                " input axis of its gyro"
            ),
        ),
    )


def _of_pair(spec: GyroPairRecipe, runs: Runs, campaign: CampaignFit) -> Iterator[str]:
    """Flags of a pair: γ at its limits, runs at two temperatures, with what N carries of it, scale
    factors that hold within the runs, a mounting error that only the two γ tell, time, and doubtful
    runs.
    """
    run_lines, apart_degc = campaign.run_lines, temperature_difference(runs)
    assert campaign.gammas is not None  # noqa: S101 (as of every pair)
    yield from of_gamma(*campaign.gammas)
    limit = spec.pair.largest_temperature_coefficient_ppm_degc
    stated = spec.pair.temperature_coefficients_ppm_degc is not None
    yield from _list_holding(
        (
            bool(np.isnan(apart_degc)),
            "temperature is not logged: N carries no difference between the runs' temperatures",
        ),
        (
            abs(apart_degc) > 0.2 and not stated,
            Remark(
                f"the two runs are {abs(apart_degc):.1f} °C apart: u of N holds"
                f" {limit * abs(apart_degc) / np.sqrt(3.0):.2g} ppm for scale factors that change"
                f" by up to {limit:g} ppm/°C, gamma that of K_B; run both at one temperature, or"
                " state pair.temperature_coefficients_ppm_degc"
            ),
        ),
        (campaign.within_runs, Remark(f"N: {WITHIN}")),
    )
    assert campaign.pair is not None  # noqa: S101
    mounting = [part for part in campaign.pair.components if part.group == "mounting"]
    if mounting and "angle" not in spec.known_errors():
        dof = campaign.pair.dof_of(campaign.pair.coefficients[2])
        yield Remark(
            f"the two runs show a mounting error of {mounting[0].value:.2g}°, included in gamma and"
            f" alpha (k = {gum.coverage_factor(dof):.3g}): state how well a mounting repeats in"
            ' [[errors.component]] group = "mounting", effect = "angle"'
        )
    for gyro in "ab":
        name = forms.line_name(gyro, gyro)
        K = run_lines.of_runs(runs[gyro], gyro)
        yield from of_contradicted_runs(name, runs[gyro], K)


def require_own_axes(sets: Sequence[AxesSet], gyros: Sequence[str]) -> None:
    """Raise FitError where a gyro named x, y or z senses another of these axes most: logs or
    columns are exchanged.
    """
    for axes_set in sets:
        for gyro in gyros:
            row = axes_set.misalignment(gyro)
            axis = forms.AXES[int(np.argmax(np.abs(row)))]
            if gyro in forms.AXES and axis != gyro:
                raise FitError(
                    f"{_place(axes_set)}gyro {gyro} senses table axis {axis} most"
                    f" ({row[forms.AXES.index(axis)]:+.3f})",
                    hint=(
                        "logs are exchanged under [axes], or columns; gyros that are not mounted so"
                        " need other names"
                    ),
                )


def _place(axes_set: AxesSet) -> str:
    """Beginning of the flags of a set."""
    return f"{axes_set.temp_degc:.0f} °C: " if np.isfinite(axes_set.temp_degc) else ""


def of_directions(figures: Mapping[str, Figure], gyros: Sequence[str]) -> Iterator[str]:
    """Flags of input axes by their figures: parallel ones, and such that leave a direction out."""
    for g, h in combinations(gyros, 2):
        angle = figures[f"angle_deg.{g}_{h}"]
        # from 0° and 180° its first-order uncertainty tells nothing
        if min(angle.value, 180.0 - angle.value) < 4.0 * angle.standard_uncertainty:
            yield f"gyros {g} and {h} are collinear within noise"
    unit = [[figures[f"misalignment.{gyro}{a}"].value for a in forms.AXES] for gyro in gyros]
    if np.linalg.matrix_rank(unit, tol=1e-6) < len(forms.AXES):
        yield "the gyros do not span three axes: the compensation leaves rates out"


def _of_axes(spec: GyroTriadRecipe, campaign: CampaignFit) -> Iterator[str]:
    """Flags of runs about three axes: runs that contradict the others, time; left-handed input
    axes, and biases that are inconsistent or unknown.
    """
    sets, run_lines = campaign.sets, campaign.run_lines
    logged = np.isfinite([run.temp_degc for run in run_lines.runs]).all()
    if not logged and len(run_lines.runs) > len(forms.AXES):
        yield UNLOGGED
    # in the order of the lines, by the temperature of their sets
    axis_of = run_lines.axis_of[:: len(spec.gyros)]
    for gyro, axis in zip(spec.gyros, np.abs(run_lines.sensitivity()).argmax(axis=1), strict=True):
        axis_runs = [run_lines.runs[k] for k in np.flatnonzero(axis_of == axis)]
        name = forms.line_name(gyro, forms.AXES[axis])
        yield from of_contradicted_runs(name, axis_runs, run_lines.of_runs(axis_runs, gyro))
    yield from of_contradicted_shares(run_lines, spec.gyros)
    for axes_set in sets:
        for flag in of_directions(axes_set.figures, spec.gyros):
            yield f"{_place(axes_set)}{flag}"
    directions = [[axes_set.misalignment(gyro) for gyro in spec.gyros] for axes_set in sets]
    three = len(spec.gyros) == len(forms.AXES)
    yield from _list_holding(
        (
            three and bool(np.any(np.linalg.det(directions) < 0.0)),
            "the input axes make a left-handed system: logs or signs may be exchanged",
        )
    )
    yield from _list_holding(
        (
            "orthogonality error" in undecided_limits(spec, within_runs=False),
            Remark(MOUNTING),
        ),
        (
            spec.site.latitude_deg is None,
            (
                "set [site] latitude_deg to separate the bias from the earth's rate; without it"
                " `apply` is refused"
            ),
        ),
    )
    for axes_set in sets:
        # a bias that differs between the attitudes depends on acceleration, or the earth's rate is
        # wrong
        biases = [figure for name, figure in axes_set.figures.items() if name.startswith("bias.")]
        largest = max((bias.standard_uncertainty for bias in biases), default=0.0)
        if largest > 1.0:
            yield (
                f"{_place(axes_set)}the bias is known to {largest:.2g} °/h only: it differs between"
                " the table axes (latitude, table axis, or a bias that depends on acceleration)"
            )
    if campaign.within_runs:
        yield Remark(WITHIN)


class Contradiction(str):
    """A flag on a run whose scale factor the others contradict."""

    __slots__ = ("relative_difference",)

    relative_difference: float
    """Magnitude of the difference, over the scale factor."""

    @classmethod
    def of(cls, difference: float, text: str) -> Self:
        """The flag of a relative difference."""
        flag = cls(text)
        flag.relative_difference = abs(difference)
        return flag


def judge_contradictions(flags: Iterable[str]) -> tuple[Criterion, ...]:
    """Criterion that no run contradicts the others as another gyro or setting would; none where
    none is flagged.
    """
    differences = [flag.relative_difference for flag in flags if isinstance(flag, Contradiction)]
    if not differences:
        return ()
    criterion_name = "K of a run off what the other runs let expect"
    largest_ppm = PPM * max(differences)
    return (at_most(criterion_name, largest_ppm, PPM * ANOTHER, "ppm", "calibkit"),)


def of_contradicted_runs(name: str, runs: Sequence[TableRun], K_of_runs: Value) -> Iterator[str]:
    """Flags on runs of a gyro about one axis whose K [r] the others contradict; FitError where that
    is because their thermometer was in °F.
    """
    temp_degc = np.array([run.temp_degc for run in runs])
    files, K, u = [run.log.file for run in runs], K_of_runs.value, K_of_runs.u
    # within 10 °C runs count as repeated
    if len(runs) == 1 or not np.ptp(temp_degc) > 10.0:
        differences = np.abs(K / np.median(K) - 1.0)
        if differences.max() > ANOTHER:
            off_ppm = f"{PPM * differences.max():.0f} ppm off"
            text = f"K of {files[int(np.argmax(differences))]} is {off_ppm} the other runs"
            if len(runs) == 2:
                # two runs are equally far from their middle: neither is the wrong one by itself
                text = f"K of {files[0]} and of {files[1]} are each {off_ppm} their middle"
            yield Contradiction.of(differences.max(), f"{name}: {text}: another gyro or setting?")
        return
    in_degf = left_out_run.find_degf(temp_degc, K, u)
    if in_degf.any():
        numbers = np.flatnonzero(in_degf).tolist()
        named_runs = ", ".join(f"{files[k]} ({temp_degc[k]:.1f})" for k in numbers)
        raise FitError(
            f"{name}: K over temperature is one curve only if these runs are in °F, not °C:"
            f" {named_runs}",
            hint=(
                f"write the unit into the headers of these logs, {forms.TEMPERATURE} (degF), or"
                " leave them out"
            ),
        )
    contradicting = tuple(left_out_run.find(temp_degc, K, u))
    size = float(np.median(np.abs(K)))
    # of several that may each explain the others, the one that is least off
    smallest_difference = (
        min((abs(departure) for _, departure, _ in contradicting), default=0.0) / size
    )
    for run, departure, certain in contradicting:
        off_ppm = f"{PPM * departure / size:+.3g} ppm"
        run_label = f"{files[run]} at {temp_degc[run]:.1f} °C"
        why = (
            f"K of {run_label} is {off_ppm} off what the other runs let expect: see its thermometer"
            f" and what else was different, or leave it out: {advise_exclude(files[run])}"
            if certain
            else f"either K of {run_label} is {off_ppm} off, or K over temperature bends that much,"
            " which no other run shows: repeat a run at that temperature"
        )
        yield Contradiction.of(smallest_difference, f"{name}: {why}")


def of_contradicted_shares(table: Lines, gyros: Sequence[str]) -> Iterator[str]:
    """Flags on logs of a triad in which gyros that lie across the axis indicate another share of
    the rate than in the other logs about it.
    """
    from scipy.special import stdtrit

    count = len(gyros)
    about, sets = table.axis_of[::count], table.set_of[::count]
    own_axis = np.argmax(np.abs(table.sensitivity()), axis=1)
    # [runs, g], |s| at the temperature of each run
    of_sets = [table.sensitivity(table.set_of == number) for number in np.unique(sets)]
    size = np.linalg.norm(of_sets, axis=2)[sets]
    K_of_runs, u_K = table.K.reshape(-1, count), table.u_K.reshape(-1, count)
    share, noise = K_of_runs / size, u_K / size
    across = own_axis != about[:, None]
    tests = int(np.count_nonzero(across))
    for log, run in enumerate(table.runs):
        others = np.arange(about.size) != log
        peers, lying = others & (about == about[log]), across[log]
        # a log is compared with two others or more
        if not lying.any() or np.count_nonzero(peers) < 2:
            continue
        square, dof = 0.0, 0
        for axis in np.unique(about[others]):
            off_mean = share[np.ix_(others & (about == axis), own_axis != axis)]
            off_mean = off_mean - off_mean.mean(axis=0)
            square += float(np.sum(off_mean**2))
            dof += off_mean.size - off_mean.shape[1]
        variance = max(square / dof, float(np.mean(noise[others][across[others]] ** 2)))
        # the largest |e| of (1) by chance in so many tests
        t = float(stdtrit(dof, 1.0 - CHANCE / (2.0 * tests)))
        spread = t * np.sqrt(variance * (1.0 + 1.0 / np.count_nonzero(peers)))
        K, of_log = K_of_runs[log, lying], size[log, lying]
        expected, limit = share[peers][:, lying].mean(axis=0) * of_log, spread * of_log
        names = [gyros[g] for g in np.flatnonzero(lying).tolist()]
        place = f"{run.log.file}: about {forms.AXES[about[log]]}"
        contradicting = np.flatnonzero(np.abs(K - expected) > limit)
        relative = np.abs(K / expected - 1.0)
        if contradicting.size > 1 and np.all(
            np.abs(K[contradicting][::-1] - expected[contradicting]) <= limit[contradicting]
        ):
            swapped_names = " and ".join(names[k] for k in contradicting.tolist())
            text = (
                f"{place} gyros {swapped_names} are swapped, as the other logs about the axis tell"
            )
            yield Contradiction.of(relative[contradicting].max(), text)
            continue
        for k in contradicting.tolist():
            values = f"K is {K[k]:+.4g} 1/deg, {expected[k]:+.4g} in the other logs"
            if abs(-K[k] - expected[k]) <= limit[k]:
                text = f"{place} the sign of gyro {names[k]} is turned: its {values}"
                yield Contradiction.of(relative[k], text)
                continue
            text = (
                f"{place} either gyro {names[k]} contradicts the other logs, or its axis turns that"
                f" much with temperature: its {values}; repeat the log"
            )
            yield Contradiction.of((K[k] - expected[k]) / of_log[k], text)


def judge_figures(figures: Sequence[Figure], limits: LineAcceptance) -> tuple[Criterion, ...]:
    """Criteria on the largest figure of each kind, of γ and angles on their standard uncertainties;
    raises FitError where a limit is stated but no run gives the figure.
    """
    values_of: dict[str, list[float]] = {}
    for figure in figures:
        kind, standard, _ = FigureName.of(figure.name)
        if standard != IEEE:
            limited_u = kind in ("gamma", "angle_deg")
            value = figure.standard_uncertainty if limited_u else abs(figure.value)
            values_of.setdefault(kind, []).append(value)
    for kind, (_, key, _) in LIMITS.items():
        if getattr(limits, key, None) is not None and kind not in values_of:
            raise FitError(
                f"acceptance.{key} = {getattr(limits, key):g}: these logs cannot show that figure",
                hint="add the runs that it needs, or take the limit out of the recipe",
            )
    return _judge(limits, LIMITS, values_of)


def undecided_limits(spec: AnyRecipe, *, within_runs: bool) -> dict[str, str]:
    """Criterion → why a result within its limit accepts nothing, as its U leaves something out that
    no log shows: how scale factors repeat, or in a triad the mounting, where no component states
    it. One beyond its limit rejects.
    """
    undecided: dict[str, str] = {}
    if within_runs:
        undecided |= dict.fromkeys(("scale-factor error", "rate error"), WITHIN)
    if isinstance(spec, GyroTriadRecipe) and "angle" not in spec.known_errors():
        angles = ("orthogonality error", "standard uncertainty of an angle")
        undecided |= dict.fromkeys((*angles, "rate across the turned axis"), MOUNTING)
    return undecided


def judge_noise(lines: Iterable[Line], limits: LineAcceptance) -> tuple[Criterion, ...]:
    """Criterion on the residuals of the lines of runs over the noise of their held rates, the
    largest of all gyros, where the recipe limits it and noise was measured.
    """
    ratios = np.array([line.residual_over_noise for line in lines])
    limit = ("residual over noise", "max_residual_over_noise", "1")
    return _judge(limits, {"noise": limit}, {"noise": ratios[np.isfinite(ratios)].tolist()})


def judge_unseen(
    errors: Sequence[Mapping[str, Any]], limits: LineAcceptance
) -> tuple[Criterion, ...]:
    """Criteria on the largest error of each kind in unseen runs."""
    values_of = {
        kind: [abs(error[kind]) for error in errors if kind in error] for kind in UNSEEN_LIMITS
    }
    return _judge(limits, UNSEEN_LIMITS, values_of)


def _judge(
    limits: LineAcceptance,
    names: Mapping[str, tuple[str, str, str]],
    values_of: Mapping[str, Sequence[float]],
) -> tuple[Criterion, ...]:
    """Criteria that the largest values do not exceed their limits; a limit that the recipe does not
    state is left out.
    """
    criteria = []
    for kind, (name, key, unit) in names.items():
        values, limit = values_of.get(kind), getattr(limits, key, None)
        if values and limit is not None:
            criteria.append(at_most(name, max(values), limit, unit))
    return tuple(criteria)
