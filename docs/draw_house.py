"""Draw the house of calibkit from the layers that import-linter checks.

python docs/draw_house.py
"""

from __future__ import annotations

import ast
import tomllib
from html import escape
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "docs" / "static" / "house.svg"
WIDTH, ROW, GAP, LEFT = 940, 46, 12, 20
INK, LINE, FILL, LIT = "#1b1b1e", "#6b7280", "#f5f7fa", "#dbe7f3"
LEFT_OUT = {"__main__"}


def layers() -> list[list[str]]:
    """Names of modules side by side, from the top layer down."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = settings["tool"]["importlinter"]["contracts"]
    stated = next(contract["layers"] for contract in contracts if contract["type"] == "layers")
    return [row.split(" | ") for row in stated if row not in LEFT_OUT]


def purpose(module: str) -> str:
    """First sentence of a module's docstring."""
    path = ROOT / "calibkit" / module
    path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    text = " ".join((ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").split())
    return text.partition(". ")[0].removesuffix(".")


def instruments() -> list[str]:
    """Packages of instruments."""
    folder = ROOT / "calibkit" / "instruments"
    return sorted(path.parent.name for path in folder.glob("*/recipe.py"))


def box(x: float, y: float, width: float, name: str, note: str, fill: str = FILL) -> str:
    """A room with its name and what it is for, in as many lines as it takes."""
    words, lines = note.split(), [""]
    most = int(width / 5.4)
    for word in words:
        if len(lines[-1]) + len(word) >= most:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    if len(lines) > 2:
        lines = [lines[0], f"{lines[1][: most - 2]} …"]
    texts = "".join(
        f'<text x="{x + 8:.0f}" y="{y + 28 + 11 * k:.0f}" font-size="9" fill="{LINE}">'
        f"{escape(line)}</text>"
        for k, line in enumerate(lines)
    )
    return (
        f'<rect x="{x:.0f}" y="{y:.0f}" width="{width:.0f}" height="{ROW}" rx="4" fill="{fill}"'
        f' stroke="{LINE}"/><text x="{x + 8:.0f}" y="{y + 15:.0f}" font-size="12"'
        f' font-weight="bold" fill="{INK}">{escape(name)}</text>{texts}'
    )


def row(names: list[str], y: float, prefix: str = "", fill: str = FILL) -> str:
    """One layer."""
    width = (WIDTH - 2 * LEFT - GAP * (len(names) - 1)) / len(names)
    return "".join(
        box(LEFT + k * (width + GAP), y, width, name, purpose(prefix + name), fill)
        for k, name in enumerate(names)
    )


def house() -> str:
    """The picture as SVG."""
    parts, y = [], 16.0
    for names in layers():
        parts.append(row(names, y))
        y += ROW + GAP
        if names == ["instruments"]:
            parts.append(row(instruments(), y - GAP / 2, "instruments/", LIT))
            y += ROW + GAP / 2
    body = "\n".join(parts)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {y + 4:.0f}" role="img"'
        ' aria-label="Layers of calibkit: imports point down" font-family="sans-serif">'
        f'\n<rect width="100%" height="100%" fill="#ffffff"/>\n{body}\n</svg>\n'
    )


if __name__ == "__main__":
    OUT.write_text(house(), encoding="utf-8", newline="\n")
