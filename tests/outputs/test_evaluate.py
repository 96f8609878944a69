"""Results of a run at any point: every form, values of `apply` and certificates, units, ranges."""

import csv
import io
from dataclasses import replace

import numpy as np
import pytest

from calibkit import instruments
from calibkit.certificate.content import Layout
from calibkit.instruments.bias import forms
from calibkit.recipe import TypeB
from calibkit.records import store
from calibkit.results import evaluation
from fits.drift_fits import on_levels
from kept import RECIPES, keep, model

T = "temp_case_degc"


def results_of(tmp_path, procedure, stages, *, terms=(), mode=""):
    """Results of a run of a shipped recipe, compensated by `mode`, with models by stage."""
    text = (RECIPES / f"{procedure}.toml").read_text(encoding="utf-8")
    if mode:
        text = text.replace('compensation = "affine"', f'compensation = "{mode}"')
        text = text.replace("cross = true", "cross = false")
    folders = [
        keep(tmp_path / stage, *models, stage=stage, procedure=procedure, recipe=text)
        for stage, models in stages.items()
    ]
    run = store.load(folders[0])
    records = {name: one for folder in folders for name, one in store.load(folder).records.items()}
    return evaluation.RunResults.read(replace(run, records=records), terms)


def one(found, key, **at):
    """Value of a result at a point."""
    (quantity,) = [quantity for quantity in found.quantities if quantity.key == key]
    (value,) = evaluation.evaluate(found, [quantity], [at])
    return value


def fog(tmp_path, thermal, **more):
    """Results of a run that exports a model on levels."""
    return results_of(
        tmp_path, "fog_thermal", {"drift_rate": [forms.write_thermal(thermal, 10.0)]}, **more
    )


LINE = replace(
    model({"K": (1e4, "1/deg", 0.1), "F0": (5.0, "1/s", 0.5)}, name="gyro_x"),
    valid={"table_rate_dps": (-100.0, 100.0)},
)
PLAIN = {
    "gyro-scale/1": ("rate_table", {"gyro_scale": [LINE]}, {"table_rate_dps": 50.0}, 500005.0),
    "gyro-response/1": (
        "rate_table",
        {
            "gyro_scale": [
                LINE,
                replace(
                    model(
                        {"r3": (1e-6, "1/(deg/s)^2", 1e-8)},
                        name="gyro_x.response",
                        form="gyro-response/1",
                        parameters=[("sine", 0.0, "1"), ("order", 3.0, "1")],
                    ),
                    valid={"table_rate_dps": (-100.0, 100.0)},
                ),
            ]
        },
        {"table_rate_dps": 50.0},
        None,
    ),
    "polynomial/1": (
        "bias_temperature",
        {"bias": [model({"p0": (1.0, "deg/h", 0.1), "p1": (0.5, "deg/h/degC", 0.01)},
                        name="gyro_dph", form="polynomial/1")]},
        {T: 22.0},
        12.0,
    ),
    "inclinometer-scale/1": (
        "inclinometer",
        {"inclinometer_scale": [model({"s0": (1.01, "1", 1e-4), "s1": (-1e-5, "1/degC", 1e-7)},
                                      name="x", form="inclinometer-scale/1")]},
        {T: 22.0},
        1.00978,
    ),
}  # fmt: skip


@pytest.mark.parametrize("form", PLAIN)
def test_a_result_of_a_form_is_what_the_form_evaluates(tmp_path, form):
    """Value and type A uncertainty of each form are those of the form itself, at one point."""
    procedure, stages, at, expected = PLAIN[form]
    found = results_of(tmp_path, procedure, stages)
    plain = next(m for models in stages.values() for m in models if m.form == form)
    written = instruments.model_forms(procedure)[form]
    columns = {name: np.array([value]) for name, value in at.items()}
    chosen = [
        one(found, q.key, **at)
        for q in evaluation.choose(found, at, "")
        if q.model in (plain.name, "")
    ]
    value = written.evaluate(plain, columns)[0]
    assert value == pytest.approx(expected if expected is not None else value, rel=1e-12)
    near = min(chosen, key=lambda shown: abs(shown.result.value - value))
    assert near.result.value == pytest.approx(value, rel=1e-12)
    u = written.standard_uncertainty(plain, columns)[0]
    assert near.result.uncertainty.standard_uncertainty == pytest.approx(u, rel=1e-9)


def test_the_uncertainty_is_that_of_the_certificate_type_b_included(tmp_path):
    """At temperatures of the certificate value and U are those that it states, to the last bit."""
    term = TypeB(name="thermometer", quantity=T, unit="degC", half_width=0.5)
    found = fog(tmp_path, on_levels(), terms=[term])
    recipe = instruments.fitted_recipe(found.run.document)
    layout = Layout(instruments.optional("fog_thermal", "blocks"), recipe)
    figures = []
    for block in layout.blocks(replace(found.basis, temperatures=(-20.0, 40.0))):
        figures += [r for r in block.results if r.key.startswith("drift_rate.drift.drift@")]
    assert len(figures) == 2
    for figure in figures:
        value = one(found, "drift_rate.drift.drift", **{T: figure.at[0][1]})
        assert value.result.value == figure.value
        assert value.expanded == figure.uncertainty.expanded_uncertainty
        assert any(part.kind == "B" for part in value.result.uncertainty.contributions)


def test_outside_the_calibrated_range_a_value_has_no_uncertainty(tmp_path):
    """Of a model with lags the coil decides: at a fast ramp it is colder than the case."""
    found = fog(tmp_path, on_levels(lags=(210.0, 120.0)))
    inside = one(found, "drift_rate.drift.drift", **{T: -20.0, "temp_rate_degc_min": 1.0})
    beyond = one(found, "drift_rate.drift.drift", **{T: -20.0, "temp_rate_degc_min": 9.0})
    far = one(found, "drift_rate.drift.drift", **{T: 90.0, "temp_rate_degc_min": 20.0})
    assert inside.expanded is not None
    assert inside.outside == ""
    assert beyond.expanded is None
    assert "the coil is then at -51.5 °C" in beyond.outside
    assert "temp_rate_degc_min 20 is outside -10 … 10" in far.outside
    assert "2 of 3 values are extrapolated" in evaluation.flag_values([inside, beyond, far])[1]


def test_the_command_writes_csv_figure_and_json(tmp_path, calibkit):
    """CSV with every digit, a figure over the range, JSON with flags; nothing is overwritten."""
    text = (RECIPES / "fog_thermal.toml").read_text(encoding="utf-8")
    written = forms.write_thermal(on_levels(), 10.0)
    keep(tmp_path, written, stage="drift_rate", procedure="fog_thermal", recipe=text, serial="F-1")
    call = ("evaluate", "F-1", "--runs", tmp_path, "--range", "temp_case=-45:60:5")
    out = tmp_path / "drift.csv"
    assert calibkit(*call, "--only", "drift", "--out", out).code == 0
    rows = list(csv.DictReader(io.StringIO(out.read_text(encoding="utf-8"))))
    assert len(rows) == 22
    assert rows[0]["expanded_uncertainty"] == ""
    assert "coil is then at -45" in rows[0]["status"]
    assert float(rows[5]["expanded_uncertainty"]) > 0.0
    assert calibkit(*call, "--out", out).code == 4
    for suffix, start in ((".pdf", b"%PDF"), (".png", b"\x89PNG")):
        assert calibkit(*call, "--out", out.with_suffix(suffix)).code == 0
        assert out.with_suffix(suffix).read_bytes().startswith(start)
    document = calibkit(*call, "--only", "drift", "--json").json
    assert document["values"][5]["value"] == float(rows[5]["value"])
    assert any("extrapolated" in flag for flag in document["flags"])
    listing = calibkit("evaluate", "F-1", "--runs", tmp_path)
    assert (listing.code, "drift_rate.drift.drift" in listing.out) == (0, True)
    assert calibkit("evaluate", "F-1", "--runs", tmp_path, "temp_cse=3").code == 2
    assert calibkit("evaluate", "F-1", "--runs", tmp_path, "temp_case=3m").code == 2
    assert calibkit("evaluate", "F-1", "--runs", tmp_path, "temp_rate=3").code == 2
    assert calibkit(*call, "--out", tmp_path / "a.xlsx").code == 2


def triad_stages():
    """K of three axes and Q of a triad, with coefficients and uncertainties of a real size."""
    rng = np.random.default_rng(5)
    sizes = [1.0, 1e-4, 1e-7, 1e-10, 1e-2, 1e-5, 1e-8, 1e-11, 0.0, 0.0]
    named = zip((f"K{k}" for k in range(10)), sizes, strict=True)
    values = {
        name: (size * (1.0 if name == "K0" else rng.normal()), "1", 1e-3 * size)
        for name, size in named
    }
    axes = [model(values, name=f"accel_{axis}", form="accel-k/1") for axis in "xyz"]
    angles = {f"Q{k}": (1e-3 * k, "rad", 1e-5) for k in (1, 2, 3)}
    q = model(angles, name="triad", form="accel-q/1", parameters=[("temperature", 25.0, "degC")])
    return {"accel_k": axes, "accel_q": [q]}


def test_corrected_components_have_the_uncertainty_of_all_coefficients(tmp_path):
    """K: u of a component is the root of the squares of its changes, coefficient by
    coefficient, each moved by its own u through the correction that `apply` uses.
    """
    from calibkit.instruments.accelerometer.corrections import find_correction

    found = results_of(tmp_path, "accelerometer", triad_stages(), mode="k")
    at = {T: 27.0, "accel_x_g": 0.5, "accel_y_g": -0.6, "accel_z_g": 0.7}
    G, t = np.array([[0.5, -0.6, 0.7]]), np.array([27.0])
    correction = find_correction("k", found.run.records.values())
    for axis, letter in enumerate("xyz"):
        value = one(found, f"accel_k.corrected_{letter}", **at)
        assert value.result.value == pytest.approx(correction(G, t)[0, axis], rel=1e-12)
        variance = 0.0
        models = correction.models
        for m, plain in enumerate(models):
            for j, c in enumerate(plain.coefficients):
                moved = replace(c, value=c.value + c.standard_uncertainty)
                entries = (*plain.coefficients[:j], moved, *plain.coefficients[j + 1 :])
                other = (*models[:m], replace(plain, coefficients=entries), *models[m + 1 :])
                off = replace(correction, models=other)(G, t)[0, axis]
                variance += (off - value.result.value) ** 2
        u = value.result.uncertainty.standard_uncertainty
        assert u == pytest.approx(np.sqrt(variance), rel=1e-4)


def test_a_triad_of_gyros_and_a_pair_are_evaluated(tmp_path):
    """F = S Ω + B of each gyro, and the coefficients of a pair as they are."""
    pair = model(
        {"N": (1.0, "1", 1e-6), "epsilon": (1e-3, "1", 1e-6), "gamma": (1e-3, "1", 1e-6),
         "alpha_deg": (89.94, "deg", 1e-4)},
        name="pair",
        form="gyro-orthogonality/1",
    )  # fmt: skip
    lines = [replace(LINE, name=f"{a}_about_{b}") for a in "ab" for b in "ab"]
    found = results_of(tmp_path, "gyro_pair", {"gyro_scale": lines, "gyro_orthogonality": [pair]})
    angle = one(found, "gyro_orthogonality.pair.alpha_deg")
    assert (angle.result.value, angle.expanded) == (89.94, pytest.approx(2.0 * 1e-4, rel=0.1))
    values = {f"S_{g}{a}": (1e4 * (g == a) + 3.0, "1/deg", 0.1) for g in "xyz" for a in "xyz"}
    values |= {f"B_{g}": (7.0, "1/s", 0.5) for g in "xyz"}
    triad = replace(
        model(values, name="triad", form="gyro-triad/1"),
        valid={"table_rate_dps": (-100.0, 100.0), T: (20.0, 30.0)},
    )
    found = results_of(
        tmp_path / "triad", "gyro_triad", {"gyro_scale": [LINE], "gyro_orthogonality": [triad]}
    )
    rates = {"rate_x_dps": 1.0, "rate_y_dps": 2.0, "rate_z_dps": 150.0}
    value = one(found, "gyro_orthogonality.triad.F_y", **rates)
    assert value.result.value == pytest.approx(3.0 + 20006.0 + 450.0 + 7.0)
    assert "rate_z_dps 150 is outside -100 … 100 deg/s" in value.outside
