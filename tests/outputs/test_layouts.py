"""What `fit` says of a device whose firmware leaves the layout of its type or of the revision
before.
"""

from dataclasses import replace

import numpy as np
import pytest

from calibkit import instruments, recipe
from calibkit.commands import pipeline
from calibkit.firmware import blob, formats
from calibkit.instruments.bias import forms
from calibkit.instruments.bias.forms import FILE
from calibkit.instruments.bias.numeric import bank_fit
from conftest import ROOT
from outputs.firmware_runs import cached

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


def fewer_lags(record):
    """Record of a lagged model without an inner lag, whose terms of the gradient are 0."""
    model = forms.read_thermal(record.models[0])
    coefficients = model.coefficients.copy()
    coefficients[[5, 6, 8]] = 0.0
    smaller = replace(
        model,
        coefficients=coefficients,
        lags=model.lags[:1],
        covariance=model.covariance[:-1, :-1],
    )
    return replace(record, models=(forms.write_thermal(smaller, 10.0),))


def more_parts(record):
    """Record of a bank with play operators."""
    bank = forms.read_thermal(record.models[0])
    coefficients = np.concatenate([bank.coefficients, [0.02, -0.01, 0.03]])
    bigger = replace(
        bank,
        bank=replace(bank.bank, widths=bank_fit.WIDTHS_DEGC),
        coefficients=coefficients,
        covariance=1e-8 * np.eye(coefficients.size + len(bank.static_lag)),
    )
    return replace(record, models=(forms.write_thermal(bigger, 10.0),))


def test_runs_of_another_procedure_have_a_loader_of_their_own(runs):
    """The accelerometer of a device is not compared with its gyro."""
    source = recipe.find("accelerometer")
    data = ROOT / "datasets" / "accelerometer"
    outcome = pipeline.fit(source, data, "FOG-1", runs, "2026-11-22", instruments.silent)
    assert outcome.run.document["revision"] > 1
    assert not [flag for flag in outcome.summary.flags if flag.startswith("firmware:")]


@pytest.mark.parametrize(("name", "change"), [("lagged", fewer_lags), ("bank", more_parts)])
def test_all_devices_of_one_form_share_a_loader(name, change, tmp_path_factory):
    """A lagged model that needs no inner lag, and a bank with a hysteresis, are laid out as those
    of other devices: what one has not stands there with 0.
    """
    this = cached(name, tmp_path_factory)
    other = instruments.optional("fog_thermal", "chain")(
        this.spec, {FILE: change(this.record(FILE))}
    )
    number = formats.Format.find("f32")
    one, two = (blob.shape(c.quantise(number)) for c in (this.chain, other))
    assert one == two
