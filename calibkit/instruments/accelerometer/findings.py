"""What is wrong, or doubtful, about the dwells of a triad and the fit to them: remarks, flags, and
criteria that fail whatever the recipe accepts.

    F = [Σ n_g (r̄_g - r̄)²/(G - 1)] / [Σ (r - r̄_g)²/(n - G)]      one-way analysis of variance

Of n residuals r in G groups (soaks, attitudes), n_g each: lack of fit where F is beyond chance.
"""

from collections.abc import Mapping

import numpy as np

from calibkit.instruments.accelerometer import published
from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.equation import AXES
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.instruments.accelerometer.shared_errors import (
    SET_UP,
    ZERO,
    number_attitudes,
    number_soaks,
)
from calibkit.instruments.accelerometer.triad import Triad
from calibkit.numeric.arrays import Array, Integers
from calibkit.recipe.shared_errors import warn_of_few_levels
from calibkit.records.coefficients import Criterion, at_most
from calibkit.records.frame import Remark

POOR_Q, POOR_SHARE = np.radians(0.25), 5e-3
"""95 % half-widths that are flagged as too wide: of a Q [rad]; of a relative scale factor, or of a
zero relative to gravity.
"""
ILL_CONDITIONED = 20.0
"""Condition number above which the attitudes determine some combination of parameters poorly; the
six-position tumble has 1.7.
"""
OUTSTANDING = 6.0
"""Error of an attitude or a soak, over the median of all, above which it is flagged; the largest of
50 normal ones is 3 times the median.
"""
CHANCE = 0.001
"""Probability with which any grouping of faultless residuals is called a lack of fit."""
FEW_DOF = 5
"""Degrees of freedom below which the residuals are too few to judge the uncertainty."""


def remark_on_dwells(dwells: DwellSet, spec: AccelerometerRecipe) -> tuple[str, ...]:
    """Remarks on what no fit can tell: the set-up in the fixture, and a drift of the zero where
    temperatures only rise or only fall from soak to soak.
    """
    remarks: list[str] = []
    soak = number_soaks(dwells.temperature, dwells.log)
    level = np.bincount(soak, dwells.temperature) / np.bincount(soak)
    steps = np.sign(np.diff(level))
    if steps.size >= 2 and abs(steps.sum()) == steps.size:
        cure = "return to the first temperature at the end"
        if dwells.log.max() == 0 and np.isfinite(dwells.time).all():
            remark: str = Remark(
                "temperature follows time: U of what follows temperature holds any drift of the"
                f" zero that the dwells of a soak allow; {cure}, or state the drift of the session"
                " in [[errors.component]]"
            )
        else:
            # no remark but a doubt: U leaves the drift out
            remark = (
                "no time_s is logged: a drift of the zero and an effect of temperature cannot be"
                f" told apart; log time_s, and {cure}"
            )
        remarks.append(remark)
    stated_errors = [(entry.group, entry.effect) for entry in spec.errors.component]
    angles = {"inclination_deg", "toolface_deg"} & {entry.quantity for entry in spec.type_b}
    # no dwell tells a set-up from axes that are turned together
    set_up_known = spec.affine.fixture or angles or SET_UP in stated_errors
    if not set_up_known and spec.reference.kind == "attitude":
        group, effect = SET_UP
        remark = (
            "the alignment of the triad in its fixture is not in the uncertainty: state its size"
            f' in [[errors.component]] group = "{group}"'
            f', effect = "{effect}", or in [[type_b]] of inclination_deg and toolface_deg'
        )
        remarks.append(Remark(remark))
    return tuple(remarks)


def flag_fit(triad: Triad, dwells: DwellSet) -> tuple[str, ...]:
    """Flags on suspect dwells and on shared errors: those of too few levels, an attitude that is
    set up wrong the same way every time, a soak whose zero has moved.
    """
    zero_order = max(triad.terms.power[triad.terms.kind == "z"])
    flags = [*triad.flags, *warn_of_few_levels(triad.fit.shared, {ZERO: 1 + zero_order})]
    for k in triad.suspects:
        largest_g = np.abs(triad.residuals[k]).max()
        flags.append(f"triad: suspect dwell {dwells.place[k]}, {largest_g:.3g} g off, left out")
    for shared in triad.fit.shared:
        size = np.linalg.norm(shared.errors, axis=1)
        if shared.error.optional or size.max(initial=0.0) <= OUTSTANDING * np.median(size):
            continue
        worst = int(np.argmax(size))
        rows = np.flatnonzero(shared.error.level == worst) // triad.residuals.shape[1]
        place = f"{dwells.temperature[rows].mean():.3g} °C"
        if shared.error.group == "attitude":
            angles = dwells.inclination[rows[0]], dwells.toolface[rows[0]]
            place = "inclination {:.6g}°, toolface {:.6g}°".format(*angles)
        flags.append(
            f"triad: the {shared.error.name} of {place} is {size[worst]:.2g} {shared.error.unit},"
            f" of most others {np.median(size):.2g} {shared.error.unit}: no outliers, its"
            f" {np.unique(rows).size} dwells are kept in the fit"
        )
    return tuple(flags)


def flag_lengths(triad: Triad, dwells: DwellSet) -> tuple[str, ...]:
    """Flags of a fit to the length of gravity: poorly determined parameters, poorly spread
    attitudes and unchecked dwells.
    """
    t, terms, fit = float(triad.mapped(triad.reference_degc)), triad.terms, triad.fit
    width = fit.of(lambda p: terms.at_temperature(p, t)).expanded
    flags: list[str] = []
    if fit.dof < FEW_DOF:
        flags.append(
            f"{len(triad.residuals)} dwells for {len(terms.names)} parameters leave {fit.dof}"
            " degrees of freedom: the residuals cannot vouch for these numbers"
        )
    # scale factors, zeros and angles as lengths at the attitudes see them: the fit's own columns
    # have the prior of the angles, and depend on the size of the zeros
    down = terms.corrected(fit.parameters, dwells.indication, triad.mapped(dwells.temperature))
    design = np.column_stack([down**2, down, down * np.roll(down, 1, axis=1)])
    condition = float(np.linalg.cond(design / np.linalg.norm(design, axis=0)))
    if condition > ILL_CONDITIONED:
        flags.append(
            f"ill-conditioned: condition number {condition:.3g}, six faces have 1.7; add other"
            " attitudes"
        )
    names = [*(f"{kind}_{axis}" for kind in "kz" for axis in AXES), *published.Q_NAMES]
    for name, w in zip(names, width, strict=True):
        if name in published.Q_NAMES and w > POOR_Q:
            flags.append(f"{name} is known to ±{np.degrees(w):.2g}° only (95 %)")
        elif name not in published.Q_NAMES and w > POOR_SHARE:
            reference = "itself" if name[0] == "k" else "gravity"
            flags.append(f"{name} is known to ±{100.0 * w:.2g} % of {reference} only (95 %)")
    # change of a fitted residual by its own reference: near 1, no other dwell checks it
    unchecked = np.flatnonzero(np.sum(fit.jacobian.T * fit.gain, axis=0) > 0.99)
    if unchecked.size:
        flags.append(
            f"no other dwell checks dwell {', '.join(map(str, unchecked))} (leverage above 0.99)"
        )
    return tuple(f"magnitude: {flag}" for flag in flags)


def judge_unexplained(triad: Triad, dwells: DwellSet) -> tuple[Criterion, ...]:
    """Failed criteria for residuals that differ from soak to soak or from attitude to attitude by
    more than U of a corrected component, with shared errors taken out, whatever limits the recipe
    sets.
    """
    from scipy.special import stdtrit

    fit, terms, per_dwell = triad.fit, triad.terms, triad.residuals.shape[1]
    gravity = dwells.reference
    if per_dwell == 1:
        t = triad.mapped(dwells.temperature)
        gravity = terms.corrected(fit.parameters, dwells.indication, t)
    soak = number_soaks(dwells.temperature, dwells.log)
    groups = {
        "soak": soak,
        "attitude": number_attitudes(gravity),
        "quarter of the soaks": np.minimum(4 * soak // (soak.max() + 1), 3),
    }
    labels = {}
    for name, level in groups.items():
        component_level = per_dwell * level[:, None] + np.arange(per_dwell)
        labels[name] = np.where(fit.used, component_level.ravel(), -1)
    variance = np.sum((fit.jacobian @ fit.covariance) * fit.jacobian, axis=1)
    k = float(stdtrit(float(np.median(fit.dof_along(np.eye(len(terms.names))))), 0.975))
    expanded = k * float(np.sqrt(np.mean(variance)))
    failed = []
    for grouping, label, size in find_lack_of_fit(-fit.noise_residual, labels):
        if abs(size) > expanded:
            group, component = divmod(label, per_dwell)
            direction = f"along {AXES[component]}" if per_dwell == 3 else "of the length"
            name = f"unexplained residual, {grouping} {1 + group}, {direction}"
            failed.append(at_most(name, abs(size), expanded, "g"))
    return tuple(failed)


def find_lack_of_fit(
    residuals: Array, groupings: Mapping[str, Integers]
) -> list[tuple[str, int, float]]:
    """Groupings of residuals [n] whose means differ, the most significant first, each with the
    label and the mean [unit of the residuals] of its group with the largest mean.

    An F test against the scatter within groups, with Holm's correction for several tests (1979).
    `groupings` are labels [n] by name, −1 for a row that belongs to no group. Residuals of a fit
    differ less than errors do, so that the test is on the safe side.
    """
    from scipy.special import fdtrc

    tested = []
    for name, labels in groupings.items():
        rows = labels >= 0
        label, level, count = np.unique(labels[rows], return_inverse=True, return_counts=True)
        spare = int(rows.sum()) - count.size
        if count.size < 2 or spare < 1:
            continue
        values = residuals[rows]
        mean = np.bincount(level, values) / count
        variance_within = float(np.sum((values - mean[level]) ** 2)) / spare
        variance_between = float(np.sum(count * (mean - values.mean()) ** 2)) / (count.size - 1)
        if variance_within > 0.0:
            chance = float(fdtrc(count.size - 1, spare, variance_between / variance_within))
        else:
            chance = 1.0 if variance_between == 0.0 else 0.0
        # the group of the largest mean beyond what its noise explains
        worst = int(np.argmax(np.abs(mean) * np.sqrt(count)))
        tested.append((chance, (name, int(label[worst]), float(mean[worst]))))
    tested.sort(key=lambda of_grouping: of_grouping[0])
    significant = []
    for number, (chance, lack_of_fit) in enumerate(tested):
        if chance * (len(tested) - number) > CHANCE:
            break
        significant.append(lack_of_fit)
    return significant
