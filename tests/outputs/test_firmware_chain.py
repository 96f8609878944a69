"""The correction chain of a run against calibkit's own float64 models, in every number format,
within the printed bound.
"""

import json

import numpy as np
import pytest

from calibkit.firmware import bounds, exact, formats, twin
from calibkit.instruments.accelerometer import corrections as triad_correction, firmware
from calibkit.instruments.bias import compensate, forms
from calibkit.instruments.bias.numeric import bank, published as drift
from calibkit.instruments.gyro_scale import forms as gyro_forms
from calibkit.instruments.inclinometer import forms as inclinometer_forms
from conftest import ROOT
from outputs.firmware_log import words
from outputs.firmware_runs import MEMORYLESS, RUNS

# every temperature that a thermometer of 16 bits over ±128 °C can say
TEMPERATURES = np.arange(-(2**15), 2**15) / 256.0
FLOAT64_NOISE = {"drift_dph": 1e-11, "accel_x_g": 1e-14, "gyro_x_dps": 1e-11, "gyro_a_dps": 1e-11}


def within_ranges(chain, rows, seed, *, full=False):
    """Random inputs over the ranges of a chain, temperatures over all that a thermometer says."""
    rng, known = np.random.default_rng(seed), chain.find_ranges(usual=False, full=full).values
    columns = {}
    for entry in chain.structure.inputs:
        low, high = (float(limit) for limit in known[entry.name])
        columns[entry.name] = rng.uniform(low, high, rows)
        if entry.name == "temp_case_degc":
            columns[entry.name] = np.resize(TEMPERATURES, rows)
    return columns


def physical(quantised, columns):
    """Inputs after they were stored in a number format, as float64."""
    stored = words(quantised, columns)
    return stored, {name: word.astype(np.float64) for name, word in stored.items()}


def model_of(name, this):
    """The float64 correction of a chain without memory, from columns of inputs."""
    records, spec = this.run.records, this.spec
    if name in ("affine", "k"):
        correction = triad_correction.find_correction(spec.compensation, records.values())

        def corrected(columns):
            vector = np.column_stack([columns[f"accel_{axis}_g"] for axis in "xyz"])
            found = correction(vector, columns["temp_case_degc"])
            return {f"accel_{axis}_g": found[:, k] for k, axis in enumerate("xyz")}

        return corrected
    if name == "scale":
        file = records[inclinometer_forms.FILE]
        models = {model.name: inclinometer_forms.ScaleModel.read(model) for model in file.models}
        return lambda columns: {
            f"scale_{axis}": model.prior(columns["temp_case_degc"]).s
            for axis, model in models.items()
        }
    if name == "triad":
        (known,) = gyro_forms.read_matrices(spec, records)

        def about_base(columns):
            indications = np.column_stack([columns[f"gyro_{gyro}_lsb"] for gyro in known.gyros])
            rates = known.rates(
                indications, columns.get("temp_case_degc", np.zeros(len(indications)))
            )
            return {f"rate_{axis}_dps": rates[:, a] for a, axis in enumerate("xyz")}

        return about_base
    frozen = {matrix.gyros[0]: matrix for matrix in gyro_forms.read_matrices(spec, records)}

    def rates(columns):
        cold = np.zeros_like(next(iter(columns.values())))
        return {
            f"gyro_{gyro}_dps": one.rates(
                columns[f"gyro_{gyro}_lsb"][:, None], columns.get("temp_case_degc", cold)
            )[:, 0]
            for gyro, one in frozen.items()
        }

    return rates


@pytest.mark.parametrize("full", [False, True], ids=["fitted", "full_scale"])
@pytest.mark.parametrize("number", ["f32", "f64"])
@pytest.mark.parametrize("name", MEMORYLESS)
def test_a_chain_without_memory_is_the_float64_model_within_its_printed_bound(
    name, number, full, runs
):
    """At every temperature of a 16-bit thermometer, clamped at both ends as the model is, and
    random indications of the fitted range or up to ±16 g and ±2000 °/s, which nothing clamps.
    """
    this = runs(name)
    quantised = this.chain.quantise(formats.Format.find(number))
    bound = bounds.find_bounds(this.chain, quantised, full=full)
    inputs = within_ranges(this.chain, TEMPERATURES.size, 1, full=full)
    stored, columns = physical(quantised, inputs)
    found = twin.call(quantised, stored)
    expected = model_of(name, this)(columns)
    usable = found.status != twin.INVALID
    assert usable.mean() > 0.99
    for output, values in expected.items():
        error = np.abs(found.outputs[output].astype(np.float64) - values)[usable].max()
        assert error <= bound[output] + FLOAT64_NOISE.get(output, 1e-11)
        if number == "f32" and output.startswith("accel") and not full:
            assert bound[output] < 1e-6  # g


PACES = (
    (5, 0.0),
    (8, 5.0),
    (6, 0.0),
    (15, -5.0),
    (10, 0.0),
    (9, 9.0),
    (5, 0.0),
    (12, -6.0),
    (6, 0.0),
)
"""Minutes and chamber rate [°C/min] of one thermal history."""


def history(interval=10.0):
    """Case and air temperatures of a thermal history with ramps and rests; noise of a real
    thermometer.
    """
    pace = np.concatenate(
        [np.full(round(minutes * 60.0 / interval), rate) for minutes, rate in PACES]
    )
    time = np.arange(pace.size) * interval
    air = 15.0 + np.cumsum(pace) * interval / 60.0
    case = np.empty_like(air)
    case[0] = air[0]
    for k in range(1, air.size):
        case[k] = case[k - 1] + (air[k] - case[k - 1]) * interval / 300.0
    return time, case + np.random.default_rng(5).normal(0.0, 0.003, time.size), air


def along(quantised, columns):
    """Drift [n, °/h] of the twin, update by update."""
    heard = words(quantised, columns)
    state, found = twin.reset(quantised, 1), []
    for k in range(len(next(iter(heard.values())))):
        result = twin.call(
            quantised, {name: column[k : k + 1] for name, column in heard.items()}, state
        )
        state = result.state
        found.append(float(result.outputs["drift_dph"][0]))
    return np.array(found)


@pytest.mark.parametrize("number", ["f32", "f64"])
@pytest.mark.parametrize("name", ["lagged", "level", "bank", "grown"])
def test_a_drift_model_with_memory_follows_the_float64_model_within_its_printed_bound(
    name, number, runs
):
    """Over an hour of ramps and rests: filter states, rates over windows, clamping and the start
    included.
    """
    this = runs(name)
    quantised = this.chain.quantise(formats.Format.find(number))
    bound = bounds.find_bounds(this.chain, quantised)["drift_dph"]
    time, case, air = history()
    inputs = {
        e.name: case if e.name == "temp_case_degc" else air for e in this.chain.structure.inputs
    }
    _, stored = physical(quantised, inputs)
    model = forms.read_thermal(this.record("drift_rate.json").model("drift"))
    heard = stored.get("temp_env_degc", air)
    expected = bank.evaluate(
        model, time, stored["temp_case_degc"], heard, this.spec.reference_temp_degc
    )
    error = np.abs(along(quantised, inputs) - expected.drift).max()
    assert np.abs(expected.drift).max() > 0.4  # °/h: there is something to get wrong
    assert error <= bound + FLOAT64_NOISE["drift_dph"]
    if number == "f32":
        assert bound < 1e-4  # °/h


@pytest.mark.parametrize("number", ["f32", "f64"])
def test_the_recursive_gradient_form_sums_the_float64_increments(number, runs):
    """Each update adds no more than the printed bound of one update to the error of the sum."""
    this = runs("gradient")
    quantised = this.chain.quantise(formats.Format.find(number))
    bound = bounds.find_bounds(this.chain, quantised)["drift_dph"]
    time, case, air = history()
    rate = np.gradient(air, time / 60.0)
    inputs = {"temp_case_degc": case, "temp_env_degc": air, "temp_env_rate_degc_min": rate}
    _, stored = physical(quantised, inputs)
    gradient = stored["temp_case_degc"] - stored["temp_env_degc"]
    blocks = drift.DriftBlocks(
        time,
        stored["temp_case_degc"],
        gradient,
        np.zeros_like(time),
        stored["temp_env_rate_degc_min"],
    )
    model = compensate.DriftModel.read(this.run.records, this.spec)
    expected = np.cumsum(model.drift_along(blocks).delta)
    error = np.abs(along(quantised, inputs) - expected)
    assert np.abs(expected).max() > 0.2  # °/h
    assert (error <= bound * np.arange(1, time.size + 1) + FLOAT64_NOISE["drift_dph"]).all()
    assert number != "f32" or bound < 1e-4  # °/h


def test_the_bound_of_a_plain_polynomial_is_within_the_classical_formula(runs):
    """E ≤ 2⁻²⁴ (S (1 + 2n) + 3 D) of single precision is never exceeded by what is printed, and not
    undercut tenfold.
    """
    chain = runs("scale").chain
    name = chain.structure.steps[1].terms[0].table
    c = [abs(float(x)) for x in chain.tables[name]]
    classical = 2.0**-24 * (
        sum(c) * (1 + 2 * (len(c) - 1)) + 3 * sum(k * x for k, x in enumerate(c))
    )
    printed = bounds.find_bounds(chain, chain.quantise(formats.Format.find("f32")))[
        chain.structure.outputs[0].name
    ]
    assert classical / 10 < printed <= classical * 1.02


@pytest.mark.parametrize("name", RUNS)
def test_the_printed_bounds_are_those_of_the_error_analysis_as_it_was_proven(name, runs):
    """Single precision, fitted range and full scale, to two digits: a rounding that is no longer
    counted would print a smaller one.
    """
    proven = json.loads((ROOT / "tests/golden/firmware_bounds.json").read_text(encoding="utf-8"))
    chain = runs(name).chain
    quantised = chain.quantise(formats.Format.find("f32"))
    fitted, full = (bounds.find_bounds(chain, quantised, full=full) for full in (False, True))
    found = {output: [fitted[output], full[output]] for output in fitted}
    assert found == {output: pytest.approx(pair, rel=0.06) for output, pair in proven[name].items()}


@pytest.mark.parametrize("name", RUNS)
def test_statuses_say_what_was_clamped_and_what_is_no_number(name, runs):
    """A NaN gives INVALID and no number (or the last drift), a temperature far outside its flag,
    the middle nothing.
    """
    this = runs(name)
    quantised = this.chain.quantise(formats.Format.find("f32"))
    known = this.chain.find_ranges(usual=False).values
    middle = {
        e.name: np.full(3, sum(map(float, known[e.name])) / 2) for e in this.chain.structure.inputs
    }
    first = this.chain.structure.inputs[0].name
    middle[first] = np.array([middle[first][0], np.nan, 1e9 + middle[first][0]])
    state = twin.reset(quantised, 3) if this.chain.structure.interval_s else None
    result = twin.call(quantised, words(quantised, middle), state)
    still = {flag: 1 << k for k, flag in enumerate(this.chain.structure.flags)}
    assert result.status[0] & ~(still.get("HELD", 0) | still.get("STARTING", 0)) == 0
    assert result.status[1] == twin.INVALID
    beyond = [still.get(flag, 0) for flag in ("TEMP_CLAMPED", "RATE_CLAMPED", "RATE_BEYOND")]
    assert result.status[2] & sum(beyond)
    for output in this.chain.structure.outputs:
        value = result.outputs[output.name][1]
        assert np.isnan(value) if state is None else value == 0.0


@pytest.mark.parametrize("name", ["affine", "k"])
def test_a_sensor_of_specific_force_is_corrected_in_its_own_sign(name, runs):
    """Bias and second order turn their sign with the convention: f(V) of one is −f(−V) of the
    other.
    """
    this = runs(name)
    reference = this.spec.reference.model_copy(update={"convention": "specific_force"})
    spec = this.spec.model_copy(update={"reference": reference})
    turned = firmware.chain(spec, this.run.records)
    columns = within_ranges(this.chain, 500, 4)
    opposite = {column: -v if column.startswith("accel") else v for column, v in columns.items()}
    expected = twin.call(this.chain.quantise(formats.Format.find("f64")), columns).outputs
    found = twin.call(turned.quantise(formats.Format.find("f64")), opposite).outputs
    for output, values in expected.items():
        np.testing.assert_allclose(found[output], -values, rtol=0.0, atol=1e-15)


def test_exact_arithmetic_does_not_hang_on_a_mathematics_library():
    """Exp and sqrt to sixty digits against published digits; a map of a polynomial is the
    polynomial.
    """
    assert f"{float(exact.exp(exact.Fraction(-1))):.17g}" == "0.36787944117144233"
    assert str(
        exact.sqrt(exact.Fraction(2)).numerator
        * 10**50
        // exact.sqrt(exact.Fraction(2)).denominator
    ).startswith("14142135623730950488016887242096980785696718753769"[:49])
    raw = (exact.Fraction(3), exact.Fraction(-2), exact.Fraction(1, 7))
    u = exact.mapped(raw, exact.Fraction(20), exact.Fraction(60))
    assert exact.value(u, exact.Fraction(1, 3)) == exact.value(raw, exact.Fraction(40))
