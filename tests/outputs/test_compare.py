"""Is a device still good? Answers by limits and by U alone, other model forms, shared equipment,
and how often an unchanged device is called changed.
"""

import json
from dataclasses import replace

import numpy as np
import pytest

from calibkit import units
from calibkit.errors import RecipeError, UsageError
from calibkit.instruments.bias import forms
from calibkit.numeric.thermal.terms import TERMS
from calibkit.recipe import TypeB
from calibkit.records import store
from calibkit.results import comparison, key_values, still_good
from calibkit.results.evaluation import RunResults
from fits.drift_fits import RATES, on_levels
from kept import LIMITED, RECIPES, keep, rate_table


def kept_run(tmp_path, *models, procedure="rate_table", stage="gyro_scale", limit="", **more):
    """Run of a shipped recipe, with a limit on the change of the scale factor."""
    text = (RECIPES / f"{procedure}.toml").read_text(encoding="utf-8")
    text = text.replace("[acceptance]", limit) if limit else text
    folder = keep(tmp_path, *models, procedure=procedure, stage=stage, recipe=text, **more)
    return store.load(folder)


def fog(tmp_path, thermal, **more):
    """Run that exports a model on levels, each term of which is known to 0.01 deg/h at the ends of
    its range, and each lag to 1 s.
    """
    reach = np.array([1.0, 60.0, 60.0**2, 60.0**3, 10.0, 30.0, 900.0, 600.0, 5.0])
    u = np.concatenate([0.01 / reach, np.ones(len(thermal.lags))])
    u[: len(TERMS)][[name not in thermal.terms for name in TERMS]] = 0.0
    thermal = replace(thermal, covariance=np.diag(u**2))
    written = forms.write_thermal(thermal, 10.0)
    return kept_run(tmp_path, written, procedure="fog_thermal", stage="drift_rate", **more)


@pytest.mark.parametrize(
    ("ppm", "u_ppm", "answer"),
    [(5.0, 5.0, "yes"), (100.0, 5.0, "no"), (25.0, 5.0, "cannot tell"), (0.0, 40.0, "cannot tell")],
)
def test_the_answer_by_a_limit_of_the_recipe(tmp_path, ppm, u_ppm, answer):
    """Within the limit by U: yes; beyond it by U: no; else nobody can tell."""
    old = kept_run(tmp_path, rate_table(1e4, 1e-2 * u_ppm), limit=LIMITED)
    new = kept_run(tmp_path, rate_table(1e4 * (1 + 1e-6 * ppm), 1e-2 * u_ppm), limit=LIMITED)
    found = comparison.compare(old, new)
    (one,) = found.compared
    assert found.answer == answer
    assert one.limit.change == pytest.approx(0.3, rel=1e-3)
    u = np.hypot(1e-2 * u_ppm, 1e-2 * u_ppm)
    assert one.worst.u == pytest.approx(u, rel=1e-9)
    said = still_good.sentence(found)
    assert said.startswith(still_good.SENTENCES[answer])
    assert "limit 30 ppm (acceptance.max_scale_factor_error_ppm)" in said


@pytest.mark.parametrize(("ppm", "answer"), [(5.0, "yes"), (50.0, "no")])
def test_without_a_limit_u_alone_decides_and_the_sentence_says_so(tmp_path, ppm, answer):
    """A change of 5 ppm with U of 14 ppm is none that could be seen."""
    old = kept_run(tmp_path, rate_table(1e4))
    new = kept_run(tmp_path, rate_table(1e4 * (1 + 1e-6 * ppm)))
    found = comparison.compare(old, new)
    assert found.answer == answer
    assert "you set no limit" in still_good.sentence(found)
    assert still_good.document(found)["still_good"] is (answer == "yes")


def test_a_limit_of_the_command_has_a_unit_or_is_a_share(tmp_path):
    """Ppm of the value, or the unit itself; a unit of another kind and an unknown result are
    refused.
    """
    old, new = kept_run(tmp_path, rate_table(1e4)), kept_run(tmp_path, rate_table(1e4 + 0.1))
    for text, expected in (("K_x<=20 ppm", 0.2), ("K_x <= 0.3", 0.3), ("K_x<=0.5 1/deg", 0.5)):
        found = comparison.compare(old, new, limits=units.parse_limits([text], "--limit"))
        assert found.compared[0].limit.change == pytest.approx(expected, rel=1e-4)
    with pytest.raises(RecipeError, match="not of the kind"):
        comparison.compare(old, new, limits=units.parse_limits(["K_x<=1 degC"], "--limit"))
    with pytest.raises(UsageError, match="did you mean"):
        comparison.compare(old, new, limits=units.parse_limits(["K_y<=1"], "--limit"))
    for wrong in ("K_x", "K_x<=-1", "K_x<=x", "K_x<=0"):
        with pytest.raises(UsageError):
            units.parse_limits([wrong], "--limit")


def test_a_specification_of_a_profile_limits_the_value_over_the_whole_range(tmp_path):
    """Drift of 0.25 deg/h at the ends is within 0.7 and beyond 0.1; a specification at one
    temperature is not judged, and a flag says so.
    """
    from calibkit.certificate.profile import Profile

    def stated(result, limit):
        entry = {"result": result, "unit": "deg/h", "lower": -limit, "upper": limit, "name": "d"}
        return Profile.model_validate({"specification": [entry]})

    runs = [fog(tmp_path, on_levels()) for _ in range(2)]
    for limit, answer in ((9.0, "yes"), (0.1, "no")):
        found = comparison.compare(*runs, profile=stated("drift_rate.drift.drift@*", limit))
        assert (found.answer, found.compared[0].limit.key) == (answer, "specification d")
        assert "(specification d)" in still_good.sentence(found)
    found = comparison.compare(*runs, profile=stated("drift_rate.drift.drift@40", 0.1))
    assert found.answer == "yes"
    assert any("'d' is not judged" in flag for flag in found.flags)


def test_another_model_form_is_compared_by_its_result(tmp_path):
    """A level and a lagged model with the same drift at rest: still good, at rest alone, though no
    coefficient can be compared.
    """
    level, lagged = on_levels("level"), on_levels()
    same = replace(level, coefficients=lagged.coefficients)
    found = comparison.compare(fog(tmp_path, lagged), fog(tmp_path, same))
    (one,) = found.compared
    assert found.answer == "yes"
    assert max(abs(change.difference) for change in one.changes) < 1e-12
    assert {change.point["temp_rate_degc_min"] for change in one.changes} == {0.0}
    assert any("another model form" in flag for flag in found.flags)
    other = replace(same, coefficients=same.coefficients * np.r_[1.0, 1.5, np.ones(7)])
    assert comparison.compare(found.before, fog(tmp_path, other)).answer == "no"


def test_what_cannot_be_compared_is_not_called_good(tmp_path):
    """No common range, another result, an unknown range, the same logs: nobody can tell."""
    warm, cold = rate_table(1e4), rate_table(1e4, low=-40.0, high=-20.0)
    unlogged = replace(warm, valid={"table_rate_dps": (-100.0, 100.0)})
    levels = fog(tmp_path, on_levels(), serial="F")
    rates = kept_run(
        tmp_path,
        forms.write_rates(RATES, 10.0),
        procedure="fog_thermal",
        stage="drift_rate",
        serial="F",
    )
    assert comparison.compare(levels, rates).answer == "cannot tell"
    for other, reason in ((cold, "nothing in common"), (unlogged, "is not known")):
        found = comparison.compare(kept_run(tmp_path, warm), kept_run(tmp_path, other))
        assert found.answer == "cannot tell"
        assert reason in still_good.sentence(found)
    runs = [kept_run(tmp_path / "same", warm, logs=("a", "b")) for _ in range(2)]
    found = comparison.compare(*runs)
    assert (found.answer, still_good.EXIT_CODES[found.answer]) == ("cannot tell", 3)
    assert "use the same logs" in still_good.sentence(found)


def test_type_b_of_the_same_equipment_cancels_where_the_command_says_so(tmp_path):
    """Two thermometers: both count; one thermometer: what it does to both results counts once, by
    the difference.
    """
    runs = [kept_run(tmp_path, rate_table(1e4, 1e-3)) for _ in range(2)]
    stated = (TypeB(name="table", quantity="K_x", unit="ppm", half_width=50.0),)
    then, now = (RunResults.read(run, stated) for run in runs)
    results = []
    for run in (then, now):
        (quantity,) = [one for one in run.quantities if one.compared]
        results.append(run.state(quantity, quantity.complete({"temp_case_degc": 25.0})))
    apart = list(comparison.combine_both(*results, same_equipment=False))
    alike = list(comparison.combine_both(*results, same_equipment=True))

    def size(parts):
        return np.sqrt(sum((p.sensitivity * p.standard_uncertainty) ** 2 for p in parts))

    u_table = 1e4 * 50e-6 / np.sqrt(3.0)
    assert size(apart) == pytest.approx(np.sqrt(2.0 * u_table**2 + 2.0 * 1e-6), rel=1e-6)
    assert size(alike) == pytest.approx(np.sqrt(2.0 * 1e-6), rel=1e-6)


def test_an_unchanged_device_is_called_changed_as_rarely_as_stated(tmp_path):
    """Coefficients of a model drawn twice from their covariance, 4000 times: the largest of all
    changes at rest and on ramps exceeds its limit in 4.6 % of them; 2 u at each point by itself is
    exceeded in far more.
    """
    run = fog(tmp_path, replace(on_levels("level"), model_error=0.0))
    (one,) = comparison.compare(run, run).compared
    points = [one.quantity.point(entry.point) for entry in one.changes]
    weights = np.array([point.parts[0][1] for point in points])
    (plain,) = run.records["drift_rate.json"].models
    u = np.array([entry.u for entry in one.changes])
    size = np.sqrt(2.0 * np.diag(np.array(plain.covariance)))
    moved = np.random.default_rng(11).standard_normal((4000, 9)) * size
    largest = np.abs(moved @ weights.T / u).max(axis=1)
    assert np.mean(largest > one.factor) == pytest.approx(0.0455, abs=0.012)
    assert np.mean(largest > 2.0) > 0.09


def test_a_rejected_run_is_not_still_good(tmp_path):
    """A limit of the recipe that the newer run failed: no, whatever moved."""
    old, new = kept_run(tmp_path, rate_table(1e4)), kept_run(tmp_path, rate_table(1e4))
    failed = {"name": "asymmetry", "value": 9.0, "limit": 5.0, "unit": "ppm", "passed": False}
    document = {**new.document, "verdict": "rejected", "acceptance": [failed]}
    found = comparison.compare(old, replace(new, document=document))
    assert found.answer == "no"
    assert "itself failed its limits: asymmetry" in still_good.sentence(found)
    own = {**document, "acceptance": [{**failed, "set_by": "calibkit"}]}
    assert comparison.compare(old, replace(new, document=own)).answer == "cannot tell"


def test_the_command_exits_by_its_answer_and_draws(tmp_path, calibkit):
    """0 yes, 1 no, 3 cannot tell; at most 25 lines with the answer in the first three."""
    for K in (1e4, 1e4 + 0.01, 1.01e4):
        kept_run(tmp_path, rate_table(K), limit=LIMITED)
    call = ("compare", "S-1@r001", "--runs", tmp_path)
    figure = tmp_path / "then_and_now.pdf"
    good = calibkit(*call, "S-1@r002", "--out", figure)
    assert good.code == 0
    assert figure.read_bytes().startswith(b"%PDF")
    assert "Still good" in good.out.splitlines()[0]
    assert len(good.out.splitlines()) <= 25
    assert calibkit(*call, "S-1@r003").code == 1
    assert calibkit(*call, "S-1@r002", "--limit", "K_x<=1 ppm").code == 3
    document = calibkit(*call, "S-1@r003", "--json").json
    assert (document["answer"], document["still_good"]) == ("no", False)
    assert document["results"][0]["largest"]["change"] == pytest.approx(100.0)
    assert calibkit(*call, "S-9").code == 2
    assert calibkit(*call, "S-1@r002", "--out", tmp_path / "a.xlsx").code == 2
    assert calibkit(*call, "S-1@r002", "--out", figure).code == 4


def test_the_command_lists_what_changed(tmp_path, calibkit):
    """What moved is a row with its step in u, a changed line of the recipe another; JSON has every
    number, and null where a run has none.
    """
    kept_run(tmp_path, rate_table(1e4), limit=LIMITED)
    later = rate_table(1.01e4)
    extra = replace(later.coefficients[1], name="L")
    covariance = np.diag([c.standard_uncertainty**2 for c in (*later.coefficients, extra)])
    whole = tuple(map(tuple, covariance.tolist()))
    more = replace(later, coefficients=(*later.coefficients, extra), covariance=whole)
    kept_run(tmp_path, more, limit="[acceptance]\nmax_scale_factor_error_ppm = 40.0")
    call = ("compare", "S-1@r001", "S-1@r002", "--runs", tmp_path)
    shown = calibkit(*call, "--details").out
    assert "1 of 2 coefficients by more than 2 u" in " ".join(shown.split())
    assert "max_scale_factor_error_ppm = 40.0" in " ".join(shown.split())
    assert "+100, +1.41e+03 u" in " ".join(shown.split())
    document = json.loads(calibkit(*call, "--json").out, parse_constant=pytest.fail)
    moved, still, appeared = document["changed"]["numbers"]
    assert (moved["name"], moved["verdict"]) == ("K", "moved")
    assert (still["name"], still["verdict"]) == ("F0", "held")
    assert (appeared["before"], appeared["after"], appeared["verdict"]) == (None, 5.0, "appeared")
    assert (document["before"]["name"], document["after"]["name"]) == ("S-1@r001", "S-1@r002")


# key values over the years


def years(tmp_path, ppm_a_year, scatter_ppm, count=6, limit=LIMITED):
    """Runs of a gyro whose scale factor drifts, one a year."""
    rng = np.random.default_rng(3)
    return [
        kept_run(
            tmp_path,
            rate_table(1e4 * (1 + 1e-6 * (ppm_a_year * k + scatter_ppm * rng.normal())), 0.02),
            date=f"{2018 + k}-06-01",
            limit=limit,
        )
        for k in range(count)
    ]


def test_the_limit_is_reached_between_two_dates(tmp_path):
    """8 ppm a year reach 30 ppm after 3.75 years; U of the slope makes it an interval that holds
    the truth.
    """
    (one,), flags = key_values.follow(years(tmp_path, 8.0, 2.0))
    assert flags == ()
    found = one.reach
    truth = key_values._year(one.values[-1][0]) + 30.0 / 8.0
    assert found.earliest < found.expected < found.latest
    assert found.earliest < truth < found.latest
    assert found.expected == pytest.approx(truth, abs=0.6)
    assert one.forecast.startswith("about 20")
