"""The coefficient file: same bytes, a digest that notices everything, and old files that keep
loading.
"""

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import pytest

from calibkit.errors import CoefficientError
from calibkit.records import coefficients, sealed
from calibkit.records.coefficients import (
    Coefficient,
    Component,
    Condition,
    Figure,
    Input,
    Model,
    Parameter,
    Record,
)

GOLDEN = Path(__file__).parents[1] / "golden"

RECORD = Record(
    stage="accel_k",
    serial="Q-7",
    revision=3,
    supersedes="",
    effective_from="2026-11-21",
    software="calibkit 0.1.0",
    recipe_sha256="00",
    inputs=(Input("positions.csv", "ab", 378),),
    conditions=(Condition("latitude", 34.2, "deg", 0.001),),
    models=(
        Model(
            "accel_x",
            "accel-k/1",
            (Coefficient("K0", 1.0042, "1", 2e-7), Coefficient("K1", -8.1e-05, "1/K", 1e-9)),
            ((4e-14, 0.0), (0.0, 1e-18)),
            368,
            2.1e-5,
            "g",
            {"temp_case_degc": (-20.3, 125.4)},
            (Parameter("middle", 52.5, "degC"),),
        ),
    ),
    figures=(Figure("gamma", 0.7, "1", 1e-5),),
    flags=("温度 flagged",),
)


def test_a_record_survives_its_file():
    """What is written reads back as the same record."""
    assert coefficients.loads(RECORD.dumps(), "x") == RECORD


SHARED = Component("soak", "zero", 1.4e-5, "g", 5e-6, 7)
SHARING = replace(
    RECORD,
    models=(
        replace(
            RECORD.models[0],
            coefficients=(
                Coefficient("K0", 1.0042, "1", 2e-7, 3.4),
                RECORD.models[0].coefficients[1],
            ),
            components=(SHARED,),
        ),
    ),
    figures=(Figure("gamma", 0.7, "1", 1e-5, 2.5),),
)


def test_degrees_of_freedom_and_shared_errors_survive_the_file():
    """Effective degrees of freedom and components read back; a coefficient without its own has
    those of the model.
    """
    assert coefficients.loads(SHARING.dumps(), "x") == SHARING
    (model,) = SHARING.models
    assert [model.dof_of(one) for one in model.coefficients] == [3.4, 368.0]
    assert model.components[0].name == "soak-to-soak zero"


@pytest.mark.parametrize("dof", ["0", "-1", '"3"'])
def test_degrees_of_freedom_are_a_number_above_zero(dof):
    """Text, zero and less are refused, also where the digest is made to fit."""
    document = json.loads(SHARING.dumps())
    document["models"][0]["coefficients"][0]["effective_dof"] = json.loads(dof)
    with pytest.raises(CoefficientError, match="not a coefficient record"):
        coefficients.loads(sealed.seal(document), "x")


def test_the_digest_is_that_of_the_canonical_json():
    """The digest is SHA-256 over RFC 8785, spelt out here without the library for a small
    document.
    """
    found = json.loads(sealed.seal({"format": "calibkit-coefficients/1", "b": 1.0, "a": "°"}))
    canonical = '{"a":"°","b":1,"format":"calibkit-coefficients/1"}'
    assert found["sha256"] == hashlib.sha256(canonical.encode()).hexdigest()


def test_the_same_record_gives_the_same_bytes():
    """Two records that are equal give equal bytes."""
    assert replace(RECORD).dumps() == RECORD.dumps()


def test_any_changed_value_is_noticed():
    """A digit changed anywhere makes the file refuse to load."""
    text = RECORD.dumps()
    for old, new in (
        ("1.0042", "1.0043"),
        ('"revision": 3', '"revision": 4'),
        ("2e-07", "2e-08"),
        ("Q-7", "Q-8"),
    ):
        assert old in text
        with pytest.raises(CoefficientError, match="digest"):
            coefficients.loads(text.replace(old, new), "x")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not a whole JSON document"),
        ("[]", "no 'format' key"),
        ('{"format": "calibkit-coefficients/9"}', "or a newer one"),
        ('{"format": "calibkit-coefficients/1"}', "expected one of calibkit-coefficients/2"),
        ('{"format": "calibkit-coefficients/2", "a": 1, "a": 2}', "a key stands twice"),
        (RECORD.dumps()[:-40], "not a whole JSON document"),
    ],
)
def test_a_file_that_is_not_one_is_refused_by_name(text, message):
    """Truncated, foreign and future files are refused with the reason."""
    with pytest.raises(CoefficientError, match=f"x.json: .*|{message}") as refused:
        coefficients.loads(text, "x.json")
    assert message in str(refused.value)


def test_a_sealed_file_of_another_shape_is_refused():
    """A right digest over a wrong shape is not a record."""
    with pytest.raises(CoefficientError, match="not a coefficient record"):
        coefficients.loads(
            sealed.seal({"format": "calibkit-coefficients/2", "stage": "x"}), "x.json"
        )


def test_a_number_that_is_not_finite_is_never_written():
    """A NaN coefficient stops the writing, not the reading."""
    coefficient = Coefficient("K0", float("nan"), "1", 0.0)
    broken = replace(RECORD.models[0], coefficients=(coefficient,), covariance=())
    with pytest.raises(CoefficientError, match="K0 is nan"):
        replace(RECORD, models=(broken,)).dumps()


@pytest.mark.parametrize(
    "path", sorted(GOLDEN.glob("coefficients-*.json")), ids=lambda path: path.name
)
def test_every_released_format_keeps_loading(path):
    """One file of every format that was ever released loads with its digest right."""
    assert (
        coefficients.loads(path.read_text(encoding="utf-8"), path.name).format
        == coefficients.FORMAT
    )


@pytest.mark.parametrize("stage", ["../evil", "a/b", "C:evil", "", "Drift", "con.txt"])
def test_a_stage_is_named_as_a_file_of_its_run_can_be(stage):
    """Nothing that an instrument calls a stage is written outside its run's folder."""
    identity = coefficients.Identity("S-1", 1, "2026-11-21", "calibkit 0", "00", ())
    with pytest.raises(CoefficientError, match="not the name of a coefficient file"):
        coefficients.StageResult(stage).as_record(identity, "")
