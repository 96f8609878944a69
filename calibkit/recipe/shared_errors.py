"""Errors that observations share, from a recipe's [errors] to a fit and from the fit to a model."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from calibkit.errors import RecipeError
from calibkit.fit.shared import Shared
from calibkit.fit.solve import SharedSize
from calibkit.recipe.tables import Errors

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


def warn_of_few_levels(
    sizes: Sequence[SharedSize], taken: Mapping[tuple[str, str], int] | None = None
) -> tuple[str, ...]:
    """Flags for errors whose levels are too few to show them. `taken` says by (group, effect) how
    many coefficients each sensor takes from the levels, where several share the variance.
    """
    cure = "measure more of them, or state the size in [[errors.component]]"
    flags = []
    for size in sizes:
        error, group, levels = size.error, size.error.group, size.error.levels
        if levels == 1 and error.optional:
            continue
        own = (taken or {}).get((error.group, error.effect))
        left = size.dof if own is None else min(size.dof, levels - own)
        if size.known or left >= FEW_DOF or (levels == 1 and size.dof):
            continue
        if levels == 1:
            flags.append(
                f"{error.effect} of the {group}: one {group} cannot show how another differs,"
                f" so the uncertainties leave it out; {cure}"
            )
        elif size.dof == 0:
            flags.append(
                f"{error.effect} of the {group}: {levels} of them do not tell it from the"
                f" coefficients, so the uncertainties leave it out; {cure}, or lower an order"
            )
        else:
            less = f", less {own} coefficients of an axis," if own else ""
            flags.append(
                f"{error.effect} of the {group}: {levels} of them{less} leave {left} degrees"
                f" of freedom, so intervals are wide; {cure}, or lower an order"
            )
    return tuple(flags)
