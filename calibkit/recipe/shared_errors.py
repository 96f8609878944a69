"""Errors that observations share, from a recipe's [errors] to a fit and from the fit to a model."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from calibkit.errors import RecipeError
from calibkit.fit.shared import Shared
from calibkit.fit.solve import SharedSize
from calibkit.recipe.tables import Errors
from calibkit.records.frame import Remark

FEW_DOF = 3
"""Degrees of freedom between groups below which a warning says how wide intervals become."""


def state_sizes(errors: Errors, shared: Sequence[Shared]) -> list[Shared]:
    """Errors of the groups that a recipe names, with the sizes that it states; one whose size is
    stated is no longer optional.

    Raises RecipeError for a stated size of an error that the logs or the model do not have.
    """
    entries = {(entry.group, entry.effect): entry for entry in errors.component}
    # what earlier runs had, these logs need not have
    if errors.source != "history":
        for group, effect in entries.keys() - {(error.group, error.effect) for error in shared}:
            raise RecipeError(
                f"[[errors.component]] '{effect}' of group '{group}': these logs and this model"
                " have no such error",
                hint="there are "
                + ", ".join(f"{error.effect} of {error.group}" for error in shared),
            )
    selected = []
    for error in shared:
        if errors.groups != "auto" and error.group not in errors.groups:
            continue
        entry = entries.get((error.group, error.effect))
        if entry is None:
            selected.append(error)
        else:
            size = entry.value_in(error.unit)
            selected.append(replace(error, size=size, size_dof=entry.dof, optional=False))
    return selected


def warn_of_few_levels(
    sizes: Sequence[SharedSize], coefficient_counts: Mapping[tuple[str, str], int] | None = None
) -> tuple[str, ...]:
    """Flags for errors whose levels are too few to show them; a remark where U holds it.
    `coefficient_counts` says by (group, effect) how many coefficients each sensor takes from the
    levels, where several share the variance.
    """
    cure = "measure more of them, or state the size in [[errors.component]]"
    flags = []
    for size in sizes:
        error, group, levels = size.error, size.error.group, size.error.levels
        if levels == 1 and error.optional:
            continue
        coefficient_count = (coefficient_counts or {}).get((error.group, error.effect))
        dof = size.dof if coefficient_count is None else min(size.dof, levels - coefficient_count)
        if size.known or dof >= FEW_DOF or (levels == 1 and size.dof):
            continue
        if levels == 1:
            flags.append(
                f"{error.effect} of the {group}: with only one {group}, how it repeats is unknown"
                f" and not in U; {cure}"
            )
        elif size.dof == 0:
            flags.append(
                f"{error.effect} of the {group}: {levels} of them do not tell it from the"
                f" coefficients, so the uncertainties leave it out; {cure}, or lower an order"
            )
        else:
            less_text = (
                f", less {coefficient_count} coefficients of an axis," if coefficient_count else ""
            )
            wide = (
                f"{error.effect} of the {group}: {levels} of them{less_text} leave {dof} degrees"
                f" of freedom, so intervals are wide; {cure}, or lower an order"
            )
            flags.append(Remark(wide))
    return tuple(flags)
