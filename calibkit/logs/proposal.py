"""Logs of a folder → a commented recipe for them: a shipped recipe with the mapping of these
logs.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

from calibkit import recipe
from calibkit.logs.evidence import Evidence
from calibkit.logs.log_groups import Group, group_logs
from calibkit.logs.recipe_text import Parse, RecipeChoice, note_missing_units, write_recipe


@dataclass(frozen=True, slots=True)
class ProposedText:
    """Text of a recipe, and a note on columns whose unit has to be stated, or ""."""

    text: str
    note: str


_NO_PROCEDURE = (
    "# No procedure was recognised: put canonical names into [logs] names, or map the columns under"
    " [columns], and run init again or choose a shipped recipe."
)
Proposer: TypeAlias = Callable[[Evidence], RecipeChoice | None]
"""Recognises the logs of one instrument."""


def propose(
    folder: Path, parse: Parse, proposers: Sequence[Proposer], skeleton: str, sheet: str = ""
) -> ProposedText:
    """Recipe for the logs of a folder, by the first instrument that recognises them; for logs
    that none recognises a recipe as a skeleton.

    Raises LogFormatError or FrameError where no log can be read.
    """
    groups = group_logs(folder, sheet)
    choices: list[tuple[RecipeChoice, Group]] = []
    for group in groups:
        choice = _choose_recipe(Evidence.of(folder, group, groups, parse), proposers)
        if choice is not None:
            choices.append((choice, group))
    if not choices:
        group = groups[0]
        silent = [column.name for column in group.columns if not (column.stated or column.is_time)]
        words = f" The log states no unit of {', '.join(silent)}." if silent else ""
        choices = [(RecipeChoice(skeleton, {}, (), {}, remark=_NO_PROCEDURE + words), group)]
    # the procedure that more of the logs are for
    choice, group = max(choices, key=lambda pair: (len(pair[1].files), not pair[0].guessed))
    unread_groups = [other for other in groups if other is not group]
    unread_groups = [other for other in unread_groups if not set(other.files) <= set(choice.joined)]
    return ProposedText(
        write_recipe(folder, choice, group, unread_groups, parse), note_missing_units(choice)
    )


def _choose_recipe(evidence: Evidence, proposers: Sequence[Proposer]) -> RecipeChoice | None:
    """Shipped recipe that maps columns of just these names, else that of the first instrument that
    recognises the logs.
    """
    written = {column.name for column in evidence.group.columns}
    for name in recipe.shipped():
        mapped = evidence.parse(recipe.find(name)).columns
        if mapped and {column.source for column in mapped.values()} <= written:
            return RecipeChoice(name, {}, (), {})
    choices = (recognise(evidence) for recognise in proposers)
    recognised = [choice for choice in choices if choice is not None]
    if not recognised:
        return None
    of_other_recipes = (choice for choice in recognised if choice.recipe != recognised[0].recipe)
    second = next((f"{other.recipe} ({other.reason})" for other in of_other_recipes), "none")
    return replace(recognised[0], runner_up=second)
