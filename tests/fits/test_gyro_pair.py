"""N, ε, γ and α of two gyros: the worked examples, the shared covariance, |γ| near one."""

import json

import numpy as np
import pandas as pd
import pytest

from calibkit.certificate.fit_tables import UNNAMED
from calibkit.certificate.stated import Stated
from calibkit.certificate.uncertainty import TypeBTerms
from calibkit.errors import FitError
from calibkit.fit.value import Value
from calibkit.instruments.gyro_scale import (
    certificate,
    coefficient_files,
    fit,
    flags,
    published,
    simulate as simulated,
    table_runs,
)
from calibkit.instruments.gyro_scale.recipe import GyroPairRecipe
from calibkit.recipe.type_b import TypeB
from calibkit.records.frame import Log
from conftest import AUTHORITIES, slow_after
from fits.known_fit import known_fit

CASES = json.loads((AUTHORITIES / "gyro_orthogonality.json").read_text(encoding="utf-8"))["cases"]


UNKNOWN = Value(np.array(0.0), np.array(1.0), np.array(1.0))
"""A second γ that tells nothing."""


def find(K_A, K_B, K_Ba, covariance):
    """Ratios of scale factors with a covariance."""
    return published.find_ratios(known_fit([K_A, K_B, K_Ba], covariance))


def u_of(found):
    """Standard uncertainties of N, ε, γ, α."""
    return np.sqrt(np.diag(found.covariance))


def flags_of(found, second=UNKNOWN):
    """Flags of a pair whose γ are known by noise alone."""
    return list(flags.of_gamma(found.indicated, second))


def case_pair(case):
    """Ratios of a worked example with independent scale factors."""
    covariance = np.diag([case["u_K_A"] ** 2, case["u_K_B"] ** 2, case["u_K_Ba"] ** 2])
    return find(case["K_A"], case["K_B"], case["K_Ba"], covariance)


def test_the_covariance_is_that_of_drawn_scale_factors():
    """With K_A and K_Ba correlated 0.7, covariances of N, ε, γ, α agree with 200,000 draws to 2 %
    of the uncertainties.
    """
    K_A, K_B, K_Ba = 10000.0, 9900.0, 7000.0
    u = np.array([2.0, 1.5, 1.0])
    covariance = np.outer(u, u) * np.array([[1.0, 0.0, 0.7], [0.0, 1.0, 0.0], [0.7, 0.0, 1.0]])
    found = find(K_A, K_B, K_Ba, covariance)
    a, b, ba = np.random.default_rng(1).multivariate_normal([K_A, K_B, K_Ba], covariance, 200_000).T
    drawn = np.cov(np.vstack((b / a, ba / a, ba / b, np.degrees(np.arccos(ba / b)))))
    size = u_of(found)
    assert np.abs((found.covariance - drawn) / np.outer(size, size)).max() < 0.02
    # K_B is shared: N and γ are anticorrelated, which adding variances would lose
    assert found.covariance[0, 2] < 0.0


def test_noise_beyond_one_is_clamped_and_flagged():
    """γ of 1.00002 ± 2e-5 is clamped: α 0°, interval from 0° to about half a degree, flagged, no
    NaN.
    """
    found = find(10000.0, 10000.0, 10000.2, np.diag([0.0, 0.14, 0.14]) ** 2)
    assert found.results[2:] == (1.0, 0.0)
    assert found.indicated.value == pytest.approx(1.00002)
    low, high = found.alpha_interval_deg
    assert low == 0.0
    assert 0.2 < high < 0.6
    assert np.isfinite(found.covariance).all()
    assert any("clamped" in flag for flag in flags_of(found))
    assert any("one-sided" in flag for flag in flags_of(found))


def test_scale_factors_that_cannot_give_ratios_are_refused():
    """A zero or a NaN is refused."""
    for K_A, K_B, K_Ba in ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, np.nan)):
        with pytest.raises(FitError, match="cannot give ratios"):
            find(K_A, K_B, K_Ba, np.eye(3))


@pytest.mark.parametrize("alpha_deg", slow_after(2, [0.0, 0.2, 0.5, 0.8, 1.5, 3.0, 179.6]))
def test_the_interval_of_alpha_covers_the_truth_also_near_one(alpha_deg):
    """Noise of 2e-5 in γ, 400 draws: 95 % intervals of α cover in at least 93 % of them, all along
    the approach to 0°.
    """
    rng = np.random.default_rng(int(alpha_deg * 10))
    u = 10000.0 * np.array([1.4e-5, 1.4e-5, 1.4e-5])
    true = np.array([10000.0, 10000.0, 10000.0 * np.cos(np.radians(alpha_deg))])
    covered = []
    for _ in range(400):
        found = find(*(true + u * rng.normal(size=3)), np.diag(u**2))
        low, high = found.alpha_interval_deg
        covered.append(low <= alpha_deg + 1e-12 and alpha_deg - 1e-12 <= high)
    assert np.mean(covered) > 0.93


def test_the_second_gamma_agrees_or_is_flagged():
    """γ from A about B's axis of the same cosine passes; one that is 1e-3 off is named, and tells a
    mounting error with one degree of freedom, or more where it is known.
    """
    u = np.array(2.4e-5)
    found = case_pair(CASES[2])
    same, off = (
        Value(np.array(CASES[2]["gamma"] + apart), u, np.array(30.0)) for apart in (0.0, 1e-3)
    )
    assert flags_of(found, same) == []
    assert "differs by 0.001" in flags_of(found, off)[-1]
    sine = np.sin(np.radians(found.results[3]))
    assert fit.find_mounting(found.indicated, off, None) == (pytest.approx(1e-3 / sine), 1.0)
    tilt, dof = fit.find_mounting(found.indicated, off, (0.01, 9.0))
    assert dof == 10.0
    noise = u**2 + float(found.indicated.u) ** 2
    square = (9.0 * np.radians(0.01) ** 2 + 0.5 * (1e-6 - noise) / sine**2) / 10.0
    assert tilt == pytest.approx(np.sqrt(square))


SPEC = GyroPairRecipe(procedure="gyro_pair", logs={"files": ["*.csv"]})


def run_of(log, name):
    """Run of both gyros in one simulated log."""
    frame = pd.DataFrame(log)
    return table_runs.fit_run(SPEC, Log(name, f"{name}.csv", name, len(frame), frame))


def test_the_interval_of_an_angle_near_zero_holds_what_the_laboratory_states():
    """Parallel gyros whose angle a type B term leaves 0.5° open: the certificate's interval begins
    at 0° and ends half a degree above α at least.
    """
    logs = simulated.pair(5, alpha_deg=0.1, ideal=True)
    runs = {axis: (run_of(logs.logs[f"table_axis_{axis}.csv"], axis),) for axis in "ab"}
    stages = coefficient_files.list_results(fit.fit_campaign(SPEC, runs), SPEC)
    records = {stage.file: stage.as_record(UNNAMED, "") for stage in stages}
    term = TypeB(name="axes", quantity="alpha_deg", unit="deg", standard_uncertainty=0.5)
    _, block = certificate.blocks(Stated(records, TypeBTerms((term,)), (), 25.0))
    (alpha,) = (one for one in block.tables[0].results if one.name.en == "angle between the axes")
    low, high = alpha.interval
    assert low == 0.0
    assert high > alpha.value + 0.5


def pair_of(gamma, gamma_from_a):
    """Runs about both axes of gyros whose two γ are given, rows that are means over held rates."""
    spec = SPEC.model_copy(update={"plateaus": SPEC.plateaus.model_copy(update={"one_row": True})})
    rates = np.array([*range(10, 101, 10), *range(-100, 0, 10)], dtype=float)
    rng, runs = np.random.default_rng(3), {}
    for axis, shares in (("a", (1.0, gamma)), ("b", (gamma_from_a, 1.0))):
        columns = {"table_rate_dps": rates, "temp_case_degc": np.full(rates.size, 25.0)}
        for gyro, share in zip("ab", shares, strict=True):
            columns[f"gyro_{gyro}_lsb"] = 1e4 * share * rates + rng.normal(0.0, 0.5, rates.size)
        log = Log(axis, f"{axis}.csv", axis, rates.size, pd.DataFrame(columns))
        runs[axis] = (table_runs.fit_run(spec, log),)
    return fit.fit_campaign(spec, runs).pair


def test_a_pair_at_a_right_angle_is_no_turned_sign():
    """γ of 1e-5 and −1e-5 is what mountings that are 0.001° off make of 0, and stays; 5e-3 and
    −5e-3 is a turned sign.
    """
    assert abs(pair_of(1e-5, -1e-5).value("gamma")) < 2e-5
    with pytest.raises(FitError, match="equal and opposite"):
        pair_of(5e-3, -5e-3)
