"""What `fit` says of a device whose firmware leaves the layout of its type or of the revision
before.
"""

import pytest

from calibkit import instruments, pipeline, recipe
from conftest import ROOT

DATA = ROOT / "datasets" / "fog_thermal"
TYPED = 'type="FOG-98"'


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Return a folder with the lagged model of one device of a type."""
    folder = tmp_path_factory.mktemp("layouts")
    assert said(folder, "FOG-1", "lagged", TYPED) == []
    return folder


def said(runs, serial, model, *overrides, day="2026-11-21"):
    """Flags on the firmware of a fit."""
    source = recipe.find("fog_thermal", (f"drift.model={model}", *overrides))
    outcome = pipeline.fit(source, DATA, serial, runs, day, instruments.silent)
    return [flag for flag in outcome.summary.flags if flag.startswith("firmware:")]


def test_a_refit_of_the_same_form_keeps_its_layout(runs):
    """Nothing is said, and the flag is not in run.json."""
    assert said(runs, "FOG-1", "lagged", TYPED) == []


def test_a_device_that_leaves_the_layout_of_its_type_is_named(runs):
    """With the other device, both forms and what to do; a device of another type is not held
    against it.
    """
    (flag,) = said(runs, "FOG-2", "level", TYPED)
    assert "FOG-1 r00" in flag
    assert "the first of type 'FOG-98' here" in flag
    assert "model form fog-drift-level/1, not fog-drift-lagged/1" in flag
    assert "pin the model in the recipe" in flag
    assert said(runs, "FOG-3", "level") == []
    assert said(runs, "FOG-4", "lagged", TYPED) == []


def test_a_change_of_model_form_is_named(runs):
    """Another model of the same device, whose loader in the field would refuse it."""
    said(runs, "FOG-5", "lagged")
    (flag,) = said(runs, "FOG-5", "bank")
    assert "FOG-5 r001, the revision before" in flag
    assert "model form fog-drift-bank/1, not fog-drift-lagged/1" in flag
