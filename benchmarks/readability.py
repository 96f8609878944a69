"""How hard is the code to read? Prints size and density of a tree of Python modules.

    python benchmarks/readability.py [--root PATH] [--json]
    python benchmarks/readability.py --sample N [--seed S] [--least 40]

Without options the tree is calibkit/. First a table of the whole tree, then statements and
expressions of each folder, and of the scope of the rebuild: the packages and modules in `SCOPE`.
A statement is every `ast.stmt` (docstrings, imports and bare fields included), an expression every
`ast.expr`. --sample draws N modules of the scope with more than --least statements for somebody
who has not seen them, and prints their names alone.
"""

from __future__ import annotations

import argparse
import ast
import io
import json
import sys
import tokenize
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

CALIBKIT = Path(__file__).resolve().parents[1] / "calibkit"
SCOPE = (
    "instruments",
    "numeric",
    "planning",
    "commands/plans.py",
    "results",
    "records/forms.py",
    "records/left_out.py",
    "records/sensitivities.py",
    "fit",
    "physics",
)
"""Folders and modules, below the root, that hold the equations and what is computed from them."""
HAPPENED = """
    found held made told said asked given shown kept seen taken brought gone done known meant
    wanted needed put got met turned moved named listed called stated offered allowed chosen
    tried judged settled gathered"""
"""Names that say what happened to a value, not what it is."""
WHICH = """
    one ones own others another several some each every both either neither such same rest whole
    what which whose who this that these those it them they thing things something anything
    nothing everything stuff more most many much few less least enough plain mere very"""
"""Names that say which of several values, not what they are."""
WHERE = """
    of into onto within without at about above below beside besides beyond between behind again
    against along apart across among around away here there where when then than thus so also
    too still yet even near nearby off over under through upon together alone alike"""
"""Names that say where a value is in a sentence."""
NAMES_WITHOUT_CONTENT = frozenset(f"{HAPPENED} {WHICH} {WHERE}".split())
"""Names that tell a reader neither what a value is nor its unit."""
COMPREHENSIONS = (ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


@dataclass(frozen=True)
class Module:
    """One module: its path below the root, its syntax tree, and its lines."""

    path: Path
    nodes: tuple[ast.AST, ...]
    lines: tuple[str, ...]
    comments: int
    """Number of comments, those behind code included."""

    @classmethod
    def read(cls, root: Path, path: Path) -> Module:
        """Parse a file."""
        text = path.read_text(encoding="utf-8")
        tokens = tokenize.generate_tokens(io.StringIO(text).readline)
        return cls(
            path.relative_to(root),
            tuple(ast.walk(ast.parse(text))),
            tuple(text.splitlines()),
            sum(token.type == tokenize.COMMENT for token in tokens),
        )

    def count(self, kind: type[ast.AST] | tuple[type[ast.AST], ...]) -> int:
        """Number of nodes of a kind."""
        return sum(isinstance(node, kind) for node in self.nodes)

    def count_docstring_lines(self) -> int:
        """Lines of strings that stand as statements: of modules, classes, functions, fields."""
        return sum(
            (node.end_lineno or 0) - node.lineno + 1
            for node in self.nodes
            if isinstance(node, ast.Expr)
            and isinstance(node.value, ast.Constant)
            and isinstance(node.value.value, str)
        )

    def bound_names(self) -> Iterator[str]:
        """Names that the module gives to its variables and parameters, each as often as it does."""
        for node in self.nodes:
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                yield node.id
            elif isinstance(node, ast.arg):
                yield node.arg


@dataclass(frozen=True)
class Size:
    """Size of some modules."""

    statements: int
    expressions: int

    @classmethod
    def sum(cls, modules: Iterable[Module]) -> Size:
        """Size of modules together."""
        modules = tuple(modules)
        return cls(
            sum(module.count(ast.stmt) for module in modules),
            sum(module.count(ast.expr) for module in modules),
        )


def read_tree(root: Path) -> list[Module]:
    """Every module below a root, by its path."""
    return [Module.read(root, path) for path in sorted(root.rglob("*.py"))]


def room(module: Module) -> str:
    """The entry of the scope that holds a module; else its folder or itself, directly below the
    root.
    """
    path = module.path.as_posix()
    holders = [name for name in SCOPE if path == name or path.startswith(f"{name}/")]
    return holders[0] if holders else module.path.parts[0]


def in_scope(module: Module) -> bool:
    """Whether a module belongs to the scope of the rebuild."""
    return room(module) in SCOPE


def measure(modules: Sequence[Module]) -> dict[str, float]:
    """Row of the table → number, of a whole tree."""
    size = Size.sum(modules)
    nodes = [node for module in modules for node in module.nodes]
    functions = [
        (node.end_lineno or 0) - node.lineno + 1 for node in nodes if isinstance(node, FUNCTIONS)
    ]
    widths = [len(line) for module in modules for line in module.lines if line]
    total = sum(len(module.lines) for module in modules)
    docstring_lines = sum(module.count_docstring_lines() for module in modules)
    comments = sum(module.comments for module in modules)
    names = Counter(name for module in modules for name in module.bound_names())
    empty = sum(names[name] for name in NAMES_WITHOUT_CONTENT)
    comprehensions = sum(module.count(COMPREHENSIONS) for module in modules)
    classes = Counter(node.name for node in nodes if isinstance(node, ast.ClassDef))
    return {
        "lines": total,
        "statements": size.statements,
        "expressions": size.expressions,
        "lines of a function, median": float(np.median(functions)),
        "lines of a function, p95": float(np.percentile(functions, 95)),
        "lines of a function, max": max(functions),
        "line, p95": float(np.percentile(widths, 95)),
        "comment lines %": 100.0 * comments / total,
        "docstring lines %": 100.0 * docstring_lines / total,
        "nodes of expression a statement": size.expressions / size.statements,
        "comprehensions in 1,000 statements": 1000.0 * comprehensions / size.statements,
        "names without content %": 100.0 * empty / names.total(),
        "class names that stand in two places": sum(count > 1 for count in classes.values()),
    }


def measure_folders(modules: Sequence[Module]) -> dict[str, Size]:
    """Folder or module directly below the root → its size; those of the scope and their sum too,
    marked so.
    """
    sizes = {}
    for name in dict.fromkeys(map(room, modules)):
        mark = "scope: " if name in SCOPE else ""
        sizes[mark + name] = Size.sum(m for m in modules if room(m) == name)
    sizes = dict(sorted(sizes.items(), key=lambda item: not item[0].startswith("scope: ")))
    return sizes | {"scope": Size.sum(filter(in_scope, modules)), "all": Size.sum(modules)}


def draw_sample(modules: Sequence[Module], count: int, seed: int, least: int) -> list[str]:
    """Paths of modules of the scope with more than some statements, drawn without replacement."""
    large = [m.path.as_posix() for m in modules if in_scope(m) and m.count(ast.stmt) > least]
    drawn = np.random.default_rng(seed).choice(large, min(count, len(large)), replace=False)
    return sorted(drawn.tolist())


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure a tree, or draw modules of it, and print that."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--root", type=Path, default=CALIBKIT, help="folder of the tree")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--sample", type=int, help="draw so many modules instead")
    parser.add_argument("--seed", type=int, default=0, help="of the draw")
    parser.add_argument("--least", type=int, default=40, help="drawn modules have more statements")
    options = parser.parse_args(arguments)
    modules = read_tree(options.root)
    if options.sample is not None:
        print("\n".join(draw_sample(modules, options.sample, options.seed, options.least)))
        return 0
    rows, folders = measure(modules), measure_folders(modules)
    if options.json:
        sizes = {name: asdict(size) for name, size in folders.items()}
        print(json.dumps({"table": rows, "folders": sizes}, indent=2))
        return 0
    for name, number in rows.items():
        print(f"{name:40} {number:12,.{0 if float(number).is_integer() else 1}f}")
    print(f"\n{'':40} {'statements':>12} {'expressions':>12}")
    for name, size in folders.items():
        print(f"{name:40} {size.statements:12,} {size.expressions:12,}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
