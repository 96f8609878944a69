"""Errors that observations share, from a recipe's [errors] to a fit and from the fit to a model."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from calibkit.coefficients import Component
from calibkit.errors import RecipeError
from calibkit.fit.shared import Shared
from calibkit.fit.solve import SharedSize
from calibkit.numeric.least_squares import components
from calibkit.numeric.least_squares.components import Effect, Known
from calibkit.recipe.tables import Errors

Units = Mapping[tuple[str, str], str]
"""(group, effect) → unit of its standard deviation."""
FEW_DOF = 3
"""Degrees of freedom between groups below which a warning says how wide intervals become."""


def state_sizes(errors: Errors, shared: Sequence[Shared]) -> list[Shared]:
    """Errors of the groups that a recipe names, with the sizes that it states; one whose size is
    stated is no longer optional.

    Raises RecipeError for a stated size of an error that the logs or the model do not have.
    """
    stated = {(entry.group, entry.effect): entry for entry in errors.component}
    # what earlier runs had, these logs need not have
    if errors.source != "history":
        for group, effect in stated.keys() - {(one.group, one.effect) for one in shared}:
            raise RecipeError(
                f"[[errors.component]] '{effect}' of group '{group}': these logs and this model"
                " have no such error",
                hint=f"there are {', '.join(f'{one.effect} of {one.group}' for one in shared)}",
            )
    named = []
    for one in shared:
        if errors.groups != "auto" and one.group not in errors.groups:
            continue
        entry = stated.get((one.group, one.effect))
        if entry is None:
            named.append(one)
        else:
            size = entry.value_in(one.unit)
            named.append(replace(one, size=size, size_dof=entry.dof, optional=False))
    return named


def components_of(sizes: Sequence[SharedSize]) -> tuple[Component, ...]:
    """Shared errors that the rows show, or that are known, as a coefficient file holds them."""
    return tuple(
        Component(
            size.error.group,
            size.error.effect,
            size.value,
            size.error.unit,
            size.u,
            size.error.levels,
        )
        for size in sizes
        if size.known or size.dof
    )


def state_effects(
    errors: Errors, effects: Sequence[Effect], candidates: Sequence[Effect], unit_of: Units
) -> tuple[tuple[Effect, ...], tuple[Effect, ...]]:
    """Effects of the groups that a recipe names, with what it states of their size, and the
    candidates among them; one whose size is stated is an effect.

    Raises RecipeError for a stated size of an error that the logs or the model do not have.
    """
    stated = {(entry.group, entry.effect): entry for entry in errors.component}
    offered = [(effect.group, effect.effect) for effect in (*effects, *candidates)]
    # what earlier runs had, these logs need not have
    unknown = set() if errors.source == "history" else stated.keys() - set(offered)
    for group, name in unknown:
        raise RecipeError(
            f"[[errors.component]] '{name}' of group '{group}': these logs and this model have no"
            " such error",
            hint=f"there are {', '.join(f'{one} of {other}' for other, one in offered)}",
        )
    surely, perhaps = [], []
    for number, effect in enumerate((*effects, *candidates)):
        if errors.groups != "auto" and effect.group not in errors.groups:
            continue
        entry = stated.get((effect.group, effect.effect))
        if entry is not None:
            value = entry.value_in(unit_of[effect.group, effect.effect])
            surely.append(replace(effect, known=Known(value, entry.dof)))
        elif number < len(effects):
            surely.append(effect)
        else:
            perhaps.append(effect)
    return tuple(surely), tuple(perhaps)


def list_components(found: Sequence[components.Component], unit_of: Units) -> tuple[Component, ...]:
    """Components that the data show, or that are known, as a coefficient file holds them."""
    return tuple(
        Component(
            one.group,
            one.effect,
            one.value,
            unit_of[one.group, one.effect],
            one.standard_uncertainty,
            one.groups,
        )
        for one in found
        if one.known or one.dof
    )


def warn_of_few_levels(
    sizes: Sequence[SharedSize], taken: Mapping[tuple[str, str], int] | None = None
) -> tuple[str, ...]:
    """Flags for errors whose levels are too few to show them. `taken` says by (group, effect) how
    many coefficients each sensor takes from the levels, where several share the variance.
    """
    found = [
        components.Component(
            *(size.error.group, size.error.effect, size.value, size.u),
            *(size.error.levels, size.dof, size.known),
        )
        for size in sizes
        if size.error.levels > 1 or not size.error.optional
    ]
    return warn_of_few_groups(found, taken)


def warn_of_few_groups(
    found: Sequence[components.Component], taken: Mapping[tuple[str, str], int] | None = None
) -> tuple[str, ...]:
    """Flags for errors of groups that are too few to show them. `taken` says by (group, effect) how
    many coefficients each axis takes from the groups, where several axes share the variance.
    """
    cure = "measure more of them, or state the size in [[errors.component]]"
    flags = []
    for one in found:
        own = (taken or {}).get((one.group, one.effect))
        left = one.dof if own is None else min(one.dof, one.groups - own)
        if one.known or left >= FEW_DOF or (one.groups == 1 and one.dof):
            continue
        if one.groups == 1:
            flags.append(
                f"{one.effect} of the {one.group}: one {one.group} cannot show how another differs,"
                f" so the uncertainties leave it out; {cure}"
            )
        elif one.dof == 0:
            flags.append(
                f"{one.effect} of the {one.group}: {one.groups} of them do not tell it from the"
                f" coefficients, so the uncertainties leave it out; {cure}, or lower an order"
            )
        else:
            less = f", less {own} coefficients of an axis," if own else ""
            flags.append(
                f"{one.effect} of the {one.group}: {one.groups} of them{less} leave {left} degrees"
                f" of freedom, so intervals are wide; {cure}, or lower an order"
            )
    return tuple(flags)
