"""The catalogue of Chinese words: it has every sentence that a certificate can state, with the same
values, and none that nothing states.
"""

import ast
import string
from functools import cache

import pytest

from calibkit.certificate.words import Words, catalogue
from conftest import ROOT

COMPOSED = (
    *("largest toolface error", "largest azimuth error", "reduction on left-out stretches"),
    *("rms error over its u", "rms error of K over its u", "rms azimuth error over its u"),
    *("turn that azimuths share, over its u", "drift over its u"),
)
"""Names of limits that instruments put together."""
MODULES = sorted((ROOT / "calibkit").rglob("*.py"))


@cache
def constants(path):
    """Texts in a module, those that f-strings are made of included."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return {
        node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    }


def stated(path):
    """What a module makes words of: the first argument of each call of Words."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return [
        node.args[0]
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id == "Words"
        and path.name != "words.py"
    ]


def values_of(template):
    """Names of the values of a sentence, with how they are printed."""
    return {(name, spec) for _, name, spec, _ in string.Formatter().parse(template) if name}


@pytest.mark.parametrize("path", [path for path in MODULES if stated(path)], ids=lambda p: p.stem)
def test_every_sentence_is_in_the_catalogue(path):
    """Written out where it is stated; a symbol or a user's own text is Words.literal."""
    for text in stated(path):
        assert isinstance(text, ast.Constant), f"{path.name}:{text.lineno}: {ast.unparse(text)}"
        assert text.value in {"", *catalogue()}, f"{path.name}:{text.lineno}: {text.value!r}"


def test_a_sentence_has_the_same_values_in_both_languages():
    """Printed the same way; Chinese may leave one out, which stands in the English alone."""
    for english, chinese in catalogue().items():
        assert chinese
        assert values_of(chinese) <= values_of(english), english


def test_the_catalogue_has_nothing_that_is_never_stated():
    """Each key is written in a module, or is the name of a limit."""
    written = {*COMPOSED}.union(*map(constants, MODULES))
    written |= {word.replace("_", " ") for word in written}
    assert [english for english in catalogue() if english not in written] == []


def test_words_are_put_together_in_each_language():
    """Values that are words are in the language of the sentence, what has no Chinese in English."""
    limit = Words("{owner}: {limit}", owner=Words.literal("S_1"), limit=Words("asymmetry"))
    assert (limit.en, limit.zh) == ("S_1: asymmetry", "S_1：不对称度")
    assert limit.of("both") == "S_1: asymmetry S_1：不对称度"
    assert Words("; ").join([limit, Words.literal("{x}")]).zh == "S_1：不对称度；{x}"
    assert Words("rows|of a log").of("both") == "rows 行"


def test_a_users_own_text_is_no_sentence():
    """It is printed as it is, braces and all, and has no Chinese."""
    own = Words.literal("{gyro}")
    assert (own.en, own.zh) == ("{gyro}", "")
    assert Words.known("{of} something").of("zh") == "{of} something"
