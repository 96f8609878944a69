"""The shape of the package: what imports what, names without content, who knows procedures."""

import ast
import re
import sys
import tomllib
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

from calibkit import instruments

ROOT = Path(__file__).resolve().parents[2]
WORDS_WITHOUT_CONTENT = {"base", "common", "helper", "helpers", "manager", "misc", "util", "utils"}


@cache
def modules():
    """Name of each module of the package → its syntax tree."""
    found = {}
    for path in sorted((ROOT / "calibkit").rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        found[name] = ast.parse(path.read_text(encoding="utf-8"))
    return found


def outside_instruments():
    """Modules that know no instrument, with their syntax trees."""
    return {
        name: tree
        for name, tree in modules().items()
        if not name.startswith("calibkit.instruments")
    }


def imports(name, tree):
    """Modules that one module imports anywhere, in its functions and for annotations too.

    An import from another package runs that package's own module as well.
    """
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0
            full = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= {one if one in modules() else node.module for one in full}
    parents = {
        parent
        for one in found
        for parent in (one[: dot.start()] for dot in re.finditer(r"\.", one))
        if not f"{name}.".startswith(f"{parent}.")
    }
    return ((found | parents) & modules().keys()) - {name}


def circles(graph):
    """Circles of a graph, each as the names on it; the first edge of each is cut to find the
    next.
    """
    found, graph = [], {name: set(edges) for name, edges in graph.items()}
    while True:
        try:
            TopologicalSorter(graph).prepare()
        except CycleError as error:
            *around, first = error.args[1]
            found.append(around)
            graph[around[1]].remove(first)
        else:
            return found


def test_circles_of_a_graph_are_found():
    """A circle of two and one of three that share a node, beside a branch that is in none."""
    graph = {"a": {"b"}, "b": {"a", "c", "e"}, "c": {"d"}, "d": {"b"}, "e": set()}
    assert sorted(map(sorted, circles(graph))) == [["a", "b"], ["b", "c", "d"]]


def test_modules_and_functions_have_names_that_say_something():
    """No module is a place for anything, and no function merely gets or computes."""
    functions = {
        f"{name}.{node.name}"
        for name, tree in modules().items()
        for node in ast.walk(tree)
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))
    }
    assert not {name for name in modules() if name.rpartition(".")[2] in WORDS_WITHOUT_CONTENT}
    assert not {name for name in functions if re.search(r"\._*(get|compute)_\w+$", name)}


def test_procedures_are_known_to_instruments_alone():
    """No other module holds a procedure's name as a value: none compares it, none lists it."""
    named = {
        f"{module}: {node.value}"
        for module, tree in outside_instruments().items()
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and node.value in instruments.SHIPPED
    }
    assert named == set()


def test_packages_of_instruments_are_imported_by_the_registry_alone():
    """Other modules import `calibkit.instruments` and ask it; they name no recipe class."""
    inside = {
        (module, one)
        for module, tree in outside_instruments().items()
        for one in imports(module, tree)
        if one.startswith("calibkit.instruments.")
    }
    assert inside == set()


def test_no_module_imports_itself_on_a_way_round():
    """In functions and for annotations neither: every import points one way."""
    assert circles({name: imports(name, tree) for name, tree in modules().items()}) == []


def test_a_plain_install_imports_every_module():
    """Libraries of extras are imported where they are used, or for annotations."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    needed = {re.match(r"[\w-]+", one)[0].lower() for one in project["dependencies"]}
    known = {*needed, "pywt", "pydantic_core", "calibkit", *sys.stdlib_module_names}
    imported = {
        f"{module}: {name}"
        for module, tree in modules().items()
        if module != "calibkit.native.build"  # the build backend runs it
        for node in tree.body
        for name in (
            [alias.name for alias in node.names]
            if isinstance(node, ast.Import)
            else [node.module]
            if isinstance(node, ast.ImportFrom)
            else []
        )
        if name.split(".")[0] not in known
    }
    assert imported == set()
