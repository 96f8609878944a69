"""Words that users see: phrases that are wrong wherever they stand are in no message, docstring,
help text, page, README or recipe.
"""

import re

from conftest import ROOT

WRONG = {
    r"wild (reading|value)": "outlier",
    r"(a )?reading that is none": "outlier",
    r"limits? (held|hold)\b(?! of)": "limits met",
    r"intervals? (held|hold)\b": "intervals cover",
    r"let go of": "release",
    r"what is told of": "summary",
    r"says of (no|each|the)": "states",
    r"(one|a|two) (row|line|log|page|ramp|number|name|column|sub-folder|folder|panel|record|file)"
    r" an? (unit|device|dwell|position|instant|gyro|coefficient|variable|number|sample|attitude"
    r"|axis|channel|log|quantity|held|station|key|contribution)\b": "one … per …",
    r"\b(row|line|folder|sub-folder|table) (of|per) (a |each )?unit\b": "device",
}
"""Phrase → what to write."""
TEXTS = sorted(
    path
    for folder, pattern in (
        ("calibkit", "*.py"),
        ("calibkit", "*.typ"),
        ("calibkit", "*.js"),
        ("docs", "*.md"),
        (".", "README.md"),
        (".", "CONTRIBUTING.md"),
    )
    for path in (ROOT / folder).glob(f"**/{pattern}" if folder != "." else pattern)
)


def test_no_text_has_a_phrase_that_is_always_wrong():
    """Lines are joined, so that a phrase is found across their ends."""
    found = []
    for path in TEXTS:
        text = " ".join(path.read_text(encoding="utf-8").split())
        for phrase, instead in WRONG.items():
            if match := re.search(phrase, text):
                found.append(f"{path.relative_to(ROOT)}: {match[0]!r}, write {instead!r}")
    assert found == []
