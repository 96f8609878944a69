"""Certificates of every procedure: what each layout states of real run folders, against the
coefficient files themselves.
"""

import math
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest

from calibkit import instruments
from calibkit.certificate import content, profile, run_files, tables
from calibkit.commands import pipeline
from calibkit.errors import RecipeError
from calibkit.instruments import silent
from calibkit.instruments.accelerometer import forms
from calibkit.instruments.bias import forms as fog_forms
from calibkit.instruments.bias.numeric import bank
from calibkit.numeric.thermal.terms import Valid
from conftest import ROOT
from sample_runs import ISSUED, sample_run


def of_type(uncertainty, kind):
    """Standard uncertainty of type A or B alone."""
    return math.hypot(*(c.contribution for c in uncertainty.contributions if c.kind == kind))


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Return the run of a procedure's sample logs."""
    return cache(partial(sample_run, tmp_path_factory))


def certificate(run, name=None, *overrides, validation=None):
    """Certificate of a run after the sample profile, or without one."""
    path = None if name is None else ROOT / "reports" / "profiles" / f"{name}.toml"
    files = run_files.RunFiles.read(run)
    return content.build(
        files, instruments.certificate_layout, *profile.load(path, overrides), validation, ISSUED
    )


def by_key(found):
    """Result by its key."""
    return {result.key: result for result in found.results}


PROCEDURES = ("fog_thermal", "accelerometer", "gyro_pair", "rate_table", "inclinometer")


@pytest.mark.parametrize("name", PROCEDURES)
def test_every_coefficient_of_every_file_is_stated_with_its_value(run, name):
    """Each fitted coefficient of each model of the run is on the certificate, under its key, and
    none is another number.
    """
    found = by_key(certificate(run(name)))
    for file, record in run(name).records.items():
        if file == "denoise.json":
            continue
        for model in record.models:
            for c in model.coefficients:
                if c.value or c.standard_uncertainty:
                    stated = found[f"{record.stage}.{model.name}.{c.name}"]
                    assert (stated.value, stated.unit) == (c.value, c.unit)
                    if c.standard_uncertainty:
                        fit = stated.uncertainty.contributions[0]
                        assert (fit.kind, fit.contribution) == (
                            "A",
                            pytest.approx(c.standard_uncertainty, rel=1e-6),
                        )


@pytest.mark.parametrize("name", PROCEDURES)
def test_keys_are_distinct_and_every_uncertainty_adds_up(run, name):
    """No two results share a key; u_c² is the sum of the contributions, U = k u_c."""
    made = certificate(run(name), name)
    assert len(by_key(made)) == len(made.results)
    for result in made.results:
        if (u := result.uncertainty) is not None:
            assert u.standard_uncertainty == pytest.approx(
                math.hypot(*(of_type(u, kind) for kind in ("A", "B", "CMC"))), rel=1e-12
            )
            assert u.expanded_uncertainty == pytest.approx(
                u.coverage_factor * u.standard_uncertainty, rel=1e-12
            )


SAME = {
    "accelerometer": [
        (f"accel_k.accel_{axis}.{one}", f"accel_k.accel_{axis}.{other}@0")
        for axis in "xyz"
        for one, other in (("K0", "scale"), ("K4", "zero"))
    ]
    + [
        (f"accel_affine.triad.{one}", f"accel_affine.triad.{other}@0")
        for one, other in (("k_x0", "k_x"), ("c_xy", "c_xy"), ("z_z0", "z_z"))
    ],
    "gyro_triad": [
        (f"gyro_scale.{g}_about_{g}.K_over_temperature.{{}}".format(a), b)
        for g in "xyz"
        for a, b in (("p0", f"gyro_scale.{g}_about_{g}.K_over_temperature.value@0"),)
    ],
    "rate_table": [
        ("gyro_scale.gyro_x.K_over_temperature.p0", "gyro_scale.gyro_x.K_over_temperature.value@0")
    ],
}


@pytest.mark.parametrize("name", SAME)
def test_one_quantity_has_one_uncertainty_under_both_its_names(run, name):
    """K0 is the scale factor at 0 °C, K4 the zero there, b0 of a bank the bias at its origin: the
    same value has the same U, also by a type B term that names one of the two.
    """
    term = "" if name != "accelerometer" else 'type_b=[{name="supply", quantity="K0", unit="ppm",'
    more = (term + " half_width=50.0}]",) if term else ()
    for overrides in ((), more) if more else ((),):
        found = by_key(
            certificate(run(name), name, "results.temperatures_degc=[0, 25]", *overrides)
        )
        for one, other in SAME[name]:
            a, b = found[one], found[other]
            assert a.value == pytest.approx(b.value, rel=1e-12)
            assert a.uncertainty.expanded_uncertainty == pytest.approx(
                b.uncertainty.expanded_uncertainty, rel=1e-6
            )


def test_the_temperature_sensitivity_has_a_thermometer_term(run):
    """A thermometer that is off by its u at one end of the runs and by −u at the other turns the
    slope by 2u over their span.
    """
    found = by_key(certificate(run("rate_table"), "rate_table"))
    one = found["gyro_scale.temperature_sensitivity.GJB 2426A.gyro_x"]
    u = math.hypot(0.03, 0.15 / math.sqrt(3.0))
    assert of_type(one.uncertainty, "B") == pytest.approx(one.value * 2.0 * u / 100.0, rel=0.03)


@pytest.mark.parametrize("name", [*PROCEDURES, "gyro_triad", "gyro_noise"])
def test_principal_results_without_type_b_make_a_draft_unless_a_reason_is_stated(run, name):
    """No [[type_b]]: DRAFT that names a result; a reason in [type_b_none] stands for it."""
    keys = [
        item.key
        for item in certificate(run(name), name, "type_b=[]", "type_b_none.reason=").missing
    ]
    assert "type_b" in keys
    made = certificate(run(name), name, "type_b=[]", "type_b_none.reason=a check of the software")
    assert "type_b" not in [item.key for item in made.missing]
    assert "a check of the software" in made.without_type_b.en
    assert any(result.principal for result in made.results)


def test_scale_and_zero_of_an_accelerometer_are_what_the_k_factor_gives(run):
    """G' of G = 0 is minus the zero offset, of G = 1 on one axis the scale less the zero: the
    form as the judge.
    """
    record = run("accelerometer").records["accel_k.json"]
    found = by_key(certificate(run("accelerometer"), "accelerometer"))
    for t in (-20.0, 25.0, 125.0):
        cold = forms.inputs(np.zeros((1, 3)), np.array([t]))
        zero = [forms.K.evaluate(model, cold)[0] for model in record.models]
        along = forms.inputs(np.eye(3), np.full(3, t))
        ones = np.column_stack([forms.K.evaluate(model, along) for model in record.models])
        for k, axis in enumerate("xyz"):
            assert found[f"accel_k.accel_{axis}.zero@{t:g}"].value == pytest.approx(
                -zero[k], rel=1e-12
            )
            assert found[f"accel_k.accel_{axis}.scale@{t:g}"].value == pytest.approx(
                ones[k, k] - zero[k], rel=1e-12
            )


def test_drift_on_a_ramp_is_what_the_model_gives_on_a_log_of_such_a_ramp(run):
    """Simulate a case that climbs at 5 °C/min: once the lags are over, the model's drift is the
    certificate's, to 1e-6 °/h.
    """
    made = run("fog_thermal")
    found = by_key(certificate(made, "fog_thermal"))
    (model,) = made.records["drift_rate.json"].models
    wide = replace(fog_forms.read_thermal(model), valid=Valid(*[(-1e5, 1e5)] * 4))
    rate = 5.0
    time = np.arange(0.0, 42_000.0, 5.0)
    case = 35.0 + rate * (time - time[-1]) / 60.0  # long before, so that the start is forgotten
    drift = bank.evaluate(wide, time, case, case, 25.0).drift
    for t in (0.0, 15.0, 25.0):
        key = f"drift_rate.drift.drift_+5@{t:g}"
        assert np.interp(t, case, drift) == pytest.approx(found[key].value, abs=1e-5)


def test_drift_at_rest_has_the_uncertainty_that_the_run_states(run):
    """The certificate and run.json say the same of the drift at each temperature, but at 25 °C it
    is the reference.
    """
    made = run("fog_thermal")
    stated = {
        e["temp_case_degc"]: e for e in made.document["uncertainty"] if e["where"] == "at rest"
    }
    assert len(stated) > 3
    listed = ",".join(map(repr, stated))
    found = by_key(certificate(made, None, f"results.temperatures_degc=[{listed}]"))
    for t, entry in stated.items():
        drift = found[f"drift_rate.drift.drift@{t:g}"]
        assert drift.value == pytest.approx(entry["value"], abs=1e-12)
        assert drift.by_definition == (t == 25.0)
        if not drift.by_definition:
            assert drift.uncertainty.expanded_uncertainty == pytest.approx(
                entry["expanded_uncertainty"], rel=1e-9
            )


def test_what_is_zero_by_definition_is_printed_as_the_reference_and_not_judged(run):
    """No U at 25 °C, no statement by a *, and naming it is an error with the line of the
    specification.
    """
    made = certificate(run("fog_thermal"), "fog_thermal")
    drift = by_key(made)["drift_rate.drift.drift@25"]
    assert tables.format_result(drift) == ("0", "ref.")
    assert drift.uncertainty is None
    judged = {s.result.key for s in made.statements}
    assert "drift_rate.drift.drift@40" in judged
    assert drift.key not in judged
    with pytest.raises(RecipeError, match="0 by definition"):
        certificate(
            run("fog_thermal"),
            "fog_thermal",
            'specification=[{result="drift_rate.drift.drift@25",unit="deg/h",upper=1.0}]',
        )


def test_each_scale_factor_stands_with_the_temperature_that_it_was_found_at(run):
    """A line at −40 °C is no line at 25 °C: the row names the case temperature, the result carries
    it as a condition.
    """
    record = run("rate_table").records["gyro_scale.json"]
    made = certificate(run("rate_table"), "rate_table")
    labels = made.blocks[0].tables[0].labels
    assert labels[1].en == "gyro x, at_-40 (−39.9 °C)"
    assert labels[0].en == "gyro x, all 6 runs, weighted (25.1 °C)"
    assert labels[-1].en == "gyro x, room_3 (25.1 °C)"
    (parameter,) = record.model("gyro_x.at_-40").parameters
    assert by_key(made)["gyro_scale.gyro_x.at_-40.K"].at == (
        ("temp_case_degc", parameter.value, "degC"),
    )


def test_a_scale_factor_at_a_temperature_has_the_thermometer_in_its_uncertainty(run):
    """K of the runs near 25 °C is stated for the temperature that was read there: what the
    thermometer may be off by enters as in K over temperature.
    """
    found = by_key(certificate(run("rate_table"), "rate_table"))
    line, curve = (
        {c.name.en: c.contribution for c in found[key].uncertainty.contributions}
        for key in ("gyro_scale.gyro_x.K", "gyro_scale.gyro_x.K_over_temperature.value@25")
    )
    for name in ("case thermometer, calibration", "case thermometer, gradient to the sensor"):
        assert line[name] == pytest.approx(curve[name], rel=0.02)


def test_type_b_of_a_rate_table_scales_k_and_leaves_the_pair_alone(run):
    """1.7 ppm and 0.5 ppm/√3 of K, whatever the table was; N, γ and α do not see the table's
    rate.
    """
    found = by_key(certificate(run("gyro_pair"), "gyro_pair"))
    K = found["gyro_scale.a_about_a.K"]
    assert of_type(K.uncertainty, "B") == pytest.approx(
        K.value * 1e-6 * math.hypot(1.7, 0.5 / math.sqrt(3.0)), rel=1e-9
    )
    (rate,) = [c for c in K.uncertainty.contributions if c.quantity == "table_rate_dps"]
    assert (rate.standard_uncertainty, rate.unit) == (pytest.approx(1.7), "ppm")
    assert rate.contribution == pytest.approx(1.7e-6 * K.value)
    ieee = found["gyro_scale.scale_factor.IEEE Std 952.a_about_a"]
    assert of_type(ieee.uncertainty, "B") / ieee.value == pytest.approx(
        of_type(K.uncertainty, "B") / K.value, rel=1e-9
    )
    assert of_type(found["gyro_orthogonality.pair.N"].uncertainty, "B") == 0.0
    assert of_type(found["gyro_orthogonality.pair.alpha_deg"].uncertainty, "B") == pytest.approx(
        3.0 / 3600.0 / math.sqrt(3.0)
    )


def test_as_found_and_as_left_come_from_logs_that_were_not_fitted(run, tmp_path):
    """The withheld ramps of the sample gyro, before and after, with the rate gain; the file is
    attached.
    """
    made = run("fog_thermal")
    out = tmp_path / "validation.json"
    document, _ = pipeline.validate(
        made, ROOT / "datasets" / "fog_thermal" / "withheld", out, silent
    )
    validation = run_files.AsFoundAsLeft.load(out, run_files.RunFiles.read(made))
    rows = {(row.log, row.quantity.en): (row.as_found, row.as_left) for row in validation.rows}
    entry = document["logs"][0]
    assert rows[entry["name"], "drift rms, 100 s means"] == (
        entry["drift_rms_before"],
        entry["drift_rms_after"],
    )
    assert not {log.name for log in validation.logs} & {
        entry["name"] for entry in made.document["inputs"]
    }
    made = certificate(made, "fog_thermal", validation=validation)
    assert made.missing == ()
    assert {a.name: a for a in made.attachments}["validation.json"].content == out.read_bytes()


def test_the_orders_of_s_over_temperature_are_averaged_and_their_spread_is_type_a(run):
    """One polynomial of the highest order for each gyro, and no contribution of a choice."""
    found = by_key(certificate(run("inclinometer"), "inclinometer"))
    for gyro in "xy":
        model = run("inclinometer").records["inclinometer_scale.json"].model(gyro)
        assert [c.name for c in model.coefficients] == ["s0", "s1", "s2", "s3"]
        uncertainty = found[f"inclinometer_scale.{gyro}.s@25"].uncertainty
        powers = 25.0 ** np.arange(4)
        assert uncertainty.contributions[0].contribution == pytest.approx(
            np.sqrt(powers @ np.array(model.covariance) @ powers), rel=1e-9
        )
        assert not any("choice" in c.name.en for c in uncertainty.contributions)


@pytest.mark.parametrize("name", ["accelerometer", "gyro_pair", "inclinometer", "rate_table"])
def test_the_report_of_a_fit_states_the_principal_results_as_the_certificate_does(run, name):
    """Value and U of the same digits, from the same quantities: type A with the recipe's type B."""
    text = (run(name).folder / "report.txt").read_text(encoding="utf-8")
    principal = [result for result in certificate(run(name)).results if result.principal]
    assert principal
    for result in principal:
        value, U = tables.format_result(result)
        assert f"{value} ± {U}" in text or f"{value} {U}" in text
