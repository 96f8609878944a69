"""Recipes: strict, typed, every fault at once with its line."""

import tomllib

import pytest
from pydantic import ValidationError

from calibkit import instruments, recipe
from calibkit.errors import RecipeError, UsageError
from calibkit.recipe import Recipe
from calibkit.recipe.loader import _key_lines

GOOD = 'procedure = "fog_thermal"\n[logs]\nfiles = ["*.csv"]\n'


def faults(text, *overrides):
    """Lines of the error that a recipe's text raises."""
    with pytest.raises(RecipeError) as refused:
        instruments.parse_recipe(recipe.Source("r.toml", text, overrides))
    return str(refused.value).splitlines()


@pytest.mark.parametrize("name", sorted(recipe.shipped()))
def test_every_shipped_recipe_parses(name):
    """A recipe that comes with calibkit is found by name and has no fault."""
    assert instruments.parse_recipe(recipe.find(name)).procedure


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        (
            "[drift]\nordr = 2",
            "r.toml:5: unknown key 'drift.ordr' = 2, allowed: model, interval_s, estimate, order",
        ),
        ("[drift]\nordr = 2", "did you mean 'order'?"),
        (
            "[drift]\norder = 'two'",
            "r.toml:5: drift.order: found 'two', expected a whole number or 'auto'",
        ),
        ("[drift]\ninterval_s = 0", "r.toml:5: drift.interval_s: found 0, expected greater than 0"),
        (
            "[denoise]\nrule = 'sotf'",
            "expected 'soft', 'hard', 'garrote' or 'firm'; did you mean 'soft'?",
        ),
        ("titel = 1", "r.toml:4: unknown key 'logs.titel'"),
        (
            "[columns.gyro_dph]\nfrom = 'G'\nunit = 'deg/hh'",
            "r.toml:6: columns.gyro_dph.unit: unknown unit 'deg/hh'",
        ),
        ("[columns.gyro_dph]\nfrom = 'G'\nscale = 0", "a scale of 0 erases the column"),
        ("[[exclude]]\nlog = 'a'\nreason = 'x'", "r.toml:4: missing key 'exclude.0.person'"),
        (
            "[[exclude]]\nlog='a'\nreason='x'\nperson='p'\nfrom_s=5.0\nto_s=4.0",
            "to_s = 4 is not after from_s = 5",
        ),
        ("[errors]\ngroups = 'auto'", "r.toml:4: errors: this procedure estimates no errors"),
        (
            "[[errors.component]]\ngroup = 'soak'\neffect = 'zero'\nvalue = 1e-5\nunit = 'g'",
            "r.toml:4: missing key 'errors.component.0.dof'",
        ),
    ],
)
def test_a_fault_is_named_with_line_value_and_what_is_allowed(line, fault):
    """Unknown, missing and ill-typed keys are errors with file, line, value, allowed set and the
    closest name.
    """
    assert any(fault in found for found in faults(GOOD + line + "\n"))


def test_a_pattern_may_not_leave_the_data_folder():
    """A recipe cannot read files outside of --data."""
    for pattern in ("../*.csv", "/etc/*", "C:/x.csv", "a/../../b.csv"):
        assert (
            "leaves the data folder"
            in faults(f'procedure = "fog_thermal"\nlogs.files = ["{pattern}"]')[0]
        )


def test_an_override_replaces_a_key_and_is_blamed_for_its_faults():
    """--set changes a key, a text needs no quotes, and a fault names the override."""
    spec = instruments.parse_recipe(
        recipe.Source(
            "r.toml", GOOD, ("drift.order=2", "denoise.wavelet=haar", "site.latitude_deg=58")
        )
    )
    assert (spec.drift.order, spec.denoise.wavelet, spec.site.latitude_deg) == (2, "haar", 58.0)
    assert faults(GOOD, "drift.ordr=2")[0].startswith("--set drift.ordr=2: unknown key")
    with pytest.raises(UsageError, match=r"expected table\.key=value"):
        instruments.parse_recipe(recipe.Source("r.toml", GOOD, ("drift.order",)))
    with pytest.raises(UsageError, match="'files' is not a table"):
        instruments.parse_recipe(recipe.Source("r.toml", GOOD, ("logs.files.x=1",)))


def test_an_unknown_recipe_is_answered_with_the_shipped_ones(tmp_path):
    """A recipe that is neither file nor name lists what there is; one that is not text says so."""
    with pytest.raises(UsageError, match="did you mean 'fog_thermal'"):
        recipe.find("fog_termal")
    bad = tmp_path / "b.toml"
    bad.write_bytes(b"\xff\xfa")
    with pytest.raises(RecipeError, match="UTF-8"):
        recipe.find(str(bad))


def test_line_numbers_follow_tables_arrays_and_dotted_keys():
    """Every way of writing a key in TOML is located."""
    text = 'a.b = 1\n["quoted key"]\nx = 1\n[[t]]\ny = 1\n[[t]]\ny = 2\n'
    tomllib.loads(text)
    lines = _key_lines(text)
    assert lines[("a", "b")] == "1"
    assert lines[("quoted key", "x")] == "3"
    assert lines[("t", 0, "y")] == "5"
    assert lines[("t", 1, "y")] == "7"


class _Sharing(Recipe):
    """A procedure that estimates errors shared by soaks."""

    error_groups = ("soak", "attitude")
    procedure: str = "x"


def sharing(errors):
    """The [errors] of such a recipe."""
    tables = tomllib.loads(f'[logs]\nfiles = ["*"]\n{errors}')
    return _Sharing.model_validate(tables).errors


def test_shared_errors_are_stated_by_group():
    """Groups are tried by name, and a component is known with its degrees of freedom."""
    found = sharing(
        '[errors]\ngroups = ["soak"]\nfrom = "none"\n[[errors.component]]\ngroup = "soak"\n'
        'effect = "zero"\nvalue = 15e-6\nunit = "g"\ndof = 12\n'
    )
    assert (found.groups, found.source) == (("soak",), "none")
    (known,) = found.component
    assert (known.group, known.effect, known.value, known.unit, known.dof) == (
        "soak",
        "zero",
        15e-6,
        "g",
        12.0,
    )
    assert sharing("").groups == "auto"


COMPONENT = '[[errors.component]]\ngroup="{}"\neffect="zero"\nvalue=1e-5\nunit="g"\ndof=3\n'


@pytest.mark.parametrize(
    ("errors", "words"),
    [
        ('[errors]\ngroups = ["soka"]', "group 'soka', expected soak or attitude"),
        (COMPONENT.format("run"), "group 'run', expected soak or attitude"),
        (COMPONENT.format("soak") * 2, "the component 'zero' of group 'soak' is stated twice"),
        ('[errors]\nfrom = "history"', "needs type"),
    ],
)
def test_a_group_that_the_procedure_does_not_know_is_refused(errors, words):
    """A misspelt group, a component stated twice, and a history of no type."""
    with pytest.raises(ValidationError, match=words):
        sharing(errors)
