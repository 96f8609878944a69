"""The page on how the code is laid out: its picture is drawn from the code, its paths are there."""

import re

from conftest import ROOT, load_script

PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
PATHS = sorted(set(re.findall(r"`((?:calibkit|tests|recipes|datasets|docs)/[\w./<>]*)`", PAGE)))


def test_the_drawn_house_is_the_one_that_is_checked():
    """Layers and purposes in the picture are those of pyproject.toml and of the docstrings."""
    drawing = load_script(ROOT / "docs" / "draw_house.py")
    assert drawing.OUT.read_text(encoding="utf-8") == drawing.house()


def test_the_paths_that_the_page_names_are_there():
    """A path with <instrument> is there for at least one instrument."""
    found = {path: any(ROOT.glob(path.replace("<instrument>", "*").rstrip("/"))) for path in PATHS}
    assert found
    assert [path for path, is_there in found.items() if not is_there] == []
