"""The tests themselves: each says in one sentence what it holds."""

import ast
import re
from pathlib import Path

import pytest

MODULES = sorted(Path(__file__).parent.glob("test_*.py"))


@pytest.mark.parametrize("module", MODULES, ids=lambda path: path.stem)
def test_every_test_says_in_one_sentence_what_it_holds(module):
    """A docstring in one piece that ends with a full stop and has no other."""
    tree = ast.parse(module.read_text(encoding="utf-8"))
    tests = [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")
    ]
    said = {test.name: (ast.get_docstring(test) or "").strip() for test in tests}
    assert tests
    assert [
        name
        for name, text in said.items()
        if not text.endswith(".") or re.search(r"\n\n|[a-z0-9)]\. [A-Z]", text)
    ] == []
