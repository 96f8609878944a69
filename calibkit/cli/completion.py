"""What a shell offers for a RECIPE, a RUN or a SERIAL that is being typed."""

import os
from pathlib import Path

import click
from click.shell_completion import CompletionItem

Items = list[CompletionItem]


def complete_recipe(ctx: click.Context, param: click.Parameter, incomplete: str) -> Items:  # noqa: ARG001 (click's signature)
    """Shipped recipes and files."""
    package = Path(__file__).resolve().parents[1]
    folders = (package / "recipes", package.parent / "recipes")
    names = sorted({path.stem for folder in folders for path in folder.glob("*.toml")})
    items = [CompletionItem(name) for name in names if name.startswith(incomplete)]
    return [*items, CompletionItem(incomplete, type="file")]


def complete_run(ctx: click.Context, param: click.Parameter, incomplete: str) -> Items:  # noqa: ARG001 (click's signature)
    """Serials under --runs, behind an @ their revisions, and folders."""
    root = Path(ctx.params.get("runs") or "runs")
    serial, at_sign, _ = incomplete.partition("@")
    names = [f"{serial}@{name}" for name in _folders(root / serial)] if at_sign else _folders(root)
    items = [CompletionItem(name) for name in names if name.startswith(incomplete)]
    return items if at_sign else [*items, CompletionItem(incomplete, type="dir")]


def _folders(root: Path) -> list[str]:
    """Names of the folders in a folder that begin with a letter or a digit."""
    try:
        return sorted(
            entry.name for entry in os.scandir(root) if entry.is_dir() and entry.name[0].isalnum()
        )
    except OSError:
        return []
