"""Files that cannot be trusted: damaged, truncated, forged, from the future, from the past, or
reaching out of their folder.
"""

import hashlib
import json
import random
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from calibkit.errors import CoefficientError, LogFormatError
from calibkit.readers import hdf5
from calibkit.recipe.logs import Logs
from calibkit.records import coefficients, run_document, sealed, store
from conftest import ROOT

GOLDEN = ROOT / "tests" / "golden"
RUN = GOLDEN / "0.2" / "inclinometer" / "G-1" / "r001"


@pytest.fixture
def golden(tmp_path):
    """Return a copy of a run folder that calibkit 0.2 wrote."""
    return Path(shutil.copytree(RUN, tmp_path / "G-1" / "r001"))


def test_there_is_a_golden_file_of_every_format():
    """No format that a module names is without a file that has to keep loading; those of firmware
    are told by its sources.
    """
    named = {
        found
        for path in (ROOT / "calibkit").rglob("*.py")
        for found in re.findall(r'"(calibkit-[a-z]+/\d+)"', path.read_text(encoding="utf-8"))
    }
    documents = [json.loads(path.read_text(encoding="utf-8")) for path in GOLDEN.rglob("*.json")]
    # numbers that tests compare are of no format
    kept = {document["format"] for document in documents if "format" in document}
    assert named >= {
        coefficients.FORMAT,
        run_document.FORMAT,
        store.FLEET_FORMAT,
        run_document.VALIDATION_FORMAT,
    }
    assert named - kept == {"calibkit-firmware/1"}


EXPORTS = sorted(path for path in GOLDEN.glob("exports-*/**/*") if path.is_file())
FLEETS = sorted(GOLDEN.glob("fleet-*"))


@pytest.mark.parametrize("path", [*EXPORTS, *FLEETS], ids=lambda path: path.name)
def test_an_export_and_a_fleet_of_every_format_still_verify(calibkit, path):
    """Sources, loader, blobs, records, table and manifest as each version wrote them: digests hold,
    vectors come out.
    """
    outcome = calibkit("verify", path)
    assert (outcome.code, outcome.err) == (0, "")
    assert (len(EXPORTS), len(FLEETS)) == (5, 1)


def test_a_run_of_the_second_format_is_read(calibkit):
    """Effective degrees of freedom, components and a run without a verdict."""
    run = store.load(GOLDEN / "run-2" / "RT-2" / "r001")
    assert (run.document["verdict"], run.document["accepted"]) == ("no verdict", None)
    (found,) = run.records["gyro_scale.json"].models
    assert [one.effective_dof for one in found.coefficients] == [3.25, None]
    assert [one.name for one in found.components] == ["run-to-run scale"]
    assert calibkit("verify", run.folder, GOLDEN / "run-2" / "validation.json").code == 0


def test_a_plan_of_the_first_format_still_gives_logs(tmp_path, calibkit):
    """A campaign is simulated by a plan that was kept, action for action of its schedule."""
    outcome = calibkit("simulate", plan=GOLDEN / "plan-1", seed="1", out=tmp_path / "logs")
    assert outcome.code == 0, outcome.err
    assert len(list((tmp_path / "logs").glob("*.csv"))) == 5


@pytest.mark.parametrize(("verdict", "accepted"), [("accepted", None), ("fine", True), ("", None)])
def test_a_verdict_that_contradicts_itself_is_refused(golden, verdict, accepted):
    """`verdict` has three values, and `accepted` beside it is the one that belongs to it."""
    reseal(golden, verdict=verdict, accepted=accepted)
    with pytest.raises(CoefficientError, match="not a run document: verdict"):
        store.load(golden)


@pytest.mark.parametrize(
    "name", ["run.json", "inclinometer_scale.json", "report.html", "report.txt"]
)
def test_every_damage_to_a_file_of_a_run_is_refused_by_name(golden, name):
    """60 damages a file, bytes changed, cut off, put in, doubled or emptied: the run is refused and
    the file is named.
    """
    path, generator = golden / name, random.Random(name)  # noqa: S311 (a fixed seed, not a secret)
    whole = path.read_bytes()
    for _ in range(60):
        at = generator.randrange(len(whole))
        damaged = generator.choice(
            [
                whole[:at],
                whole[:at] + bytes([whole[at] ^ (1 << generator.randrange(8))]) + whole[at + 1 :],
                whole[:at] + generator.randbytes(3) + whole[at:],
                whole + whole,
                b"",
            ]
        )
        path.write_bytes(damaged)
        if name == "run.json" and same_document(damaged, whole):
            continue  # a changed blank between two keys is no change of the document
        with pytest.raises(CoefficientError, match=name):
            store.load(golden)


def same_document(a, b):
    """Whether two texts are the same JSON document."""
    try:
        return json.loads(a) == json.loads(b)
    except ValueError:
        return False


@pytest.mark.parametrize(
    "format_", ["calibkit-run/1", "calibkit-run/9", "calibkit-coefficients/2", "somebody-else/1"]
)
def test_a_run_of_a_future_or_foreign_format_is_refused_by_name(golden, format_):
    """A well sealed run.json of a format that this calibkit does not know is refused with the
    formats that it does know.
    """
    reseal(golden, format=format_)
    with pytest.raises(
        CoefficientError, match=rf"run\.json: format '{format_}', expected one of calibkit-run/2"
    ):
        store.load(golden)


def reseal(folder, **changes):
    """Change keys of a run.json and give it a digest that fits: what a forger without a key can
    do.
    """
    document = json.loads((folder / "run.json").read_text(encoding="utf-8")) | changes
    document["files"] = [
        (
            {
                **entry,
                "sha256": (
                    hashlib.sha256((folder / Path(entry["name"]).name).read_bytes()).hexdigest()
                ),
            }
            if (folder / Path(entry["name"]).name).is_file()
            else entry
        )
        for entry in document["files"]
    ]
    (folder / "run.json").write_text(sealed.seal(document), encoding="utf-8")


def forge(path, change):
    """Change a coefficient file and give it a digest that fits."""
    document = json.loads(path.read_text(encoding="utf-8"))
    change(document)
    path.write_text(sealed.seal(document), encoding="utf-8")


C_TEXT = "*/ int stolen(void) { return 1; } /*"


@pytest.mark.parametrize(
    "text", [C_TEXT, 'X"; int x; char *y="', "X\\", "X\n#error", "", "X?\u003f/"]
)
@pytest.mark.parametrize("command", ["show", "export", "verify"])
def test_a_sealed_run_whose_serial_no_fit_takes_is_refused(
    golden, text, command, tmp_path, calibkit
):
    """Digests made to fit or not, it reaches no file: one line and exit code 4."""
    forge(golden / "inclinometer_scale.json", lambda document: document.update(serial=text))
    reseal(golden, serial=text)
    asked = {"export": ("--target", "c", "--prefix", "cal", "--out", tmp_path / "c")}
    outcome = calibkit(command, golden, *asked.get(command, ()))
    assert (outcome.code, outcome.err.count("\n")) == (4, 1), outcome
    assert "serial" in outcome.err + outcome.out
    assert not (tmp_path / "c").exists()
    alone = calibkit("verify", golden / "inclinometer_scale.json")
    assert (alone.code, alone.err.count("\n")) == (4, 1), alone


@pytest.mark.parametrize(
    "form", [f"inclinometer-scale/1{C_TEXT}", C_TEXT, "inclinometer-scale", "accel-k/1", "k/1"]
)
def test_a_sealed_run_of_an_unknown_model_form_is_not_exported(golden, form, tmp_path, calibkit):
    """Also one of another procedure: the coefficients would be taken for something else."""
    forge(
        golden / "inclinometer_scale.json", lambda document: document["models"][0].update(form=form)
    )
    reseal(golden)
    out = ("--prefix", "cal", "--out", tmp_path / "c")
    outcome = calibkit("export", golden, "--target", "c", *out)
    assert (outcome.code, outcome.err.count("\n")) == (4, 1), outcome
    assert "form" in outcome.err
    assert not (tmp_path / "c").exists()


@pytest.mark.parametrize("inputs", [[None], [1], ["x"], [[]], [{}]])
def test_a_sealed_run_whose_inputs_are_no_tables_is_refused(golden, inputs, calibkit):
    """`show` ends with exit code 4 and says what is not a table, or what it lacks."""
    reseal(golden, inputs=inputs)
    outcome = calibkit("show", golden)
    assert (outcome.code, outcome.err.count("\n")) == (4, 1), outcome
    assert "inputs.0" in outcome.err


@pytest.mark.parametrize(
    "name",
    [
        "../other.json",
        "/etc/passwd",
        "..",
        "a\\b.json",
        "C:x.json",
        "",
        "x\n.json",
    ],
)
def test_a_run_that_lists_a_file_outside_its_folder_is_refused(golden, name):
    """run.json cannot make calibkit read a file elsewhere, however the path is written."""
    document = json.loads((golden / "run.json").read_text(encoding="utf-8"))
    reseal(golden, files=[*document["files"], {"name": name, "sha256": "0" * 64}])
    with pytest.raises(CoefficientError, match="leaves the folder"):
        store.load(golden)


JUNK = (None, True, -1, 1e300, "x", [], {}, [1], {"a": 1}, "../..")


def mutate(node, generator):
    """A copy of a JSON document with one value replaced, removed or doubled somewhere."""
    copy = json.loads(json.dumps(node))
    place = copy
    while True:
        keys = list(place) if isinstance(place, dict) else list(range(len(place)))
        key = generator.choice(keys)
        if isinstance(place[key], (dict, list)) and place[key] and generator.random() < 0.75:
            place = place[key]
            continue
        if generator.random() < 0.3:
            del place[key]
        else:
            place[key] = generator.choice(JUNK)
        return copy


@pytest.mark.parametrize("name", ["run.json", "inclinometer_scale.json"])
def test_a_document_of_another_shape_is_one_message_and_never_an_internal_error(
    golden, name, calibkit
):
    """100 documents with a value of another type or a key missing, every digest right: read, or
    refused in one line.
    """
    generator = random.Random(5)  # noqa: S311 (a fixed seed, not a secret)
    whole = json.loads((golden / name).read_text(encoding="utf-8"))
    run_document = (golden / "run.json").read_bytes()
    for _ in range(100):
        document = mutate(whole, generator)
        if not isinstance(document.get("format"), str):
            continue
        (golden / "run.json").write_bytes(run_document)
        (golden / name).write_text(sealed.seal(document), encoding="utf-8")
        if name != "run.json":
            reseal(golden)
        for command in (
            ("show", golden),
            ("show", golden, "--csv"),
            ("history", "G-1", "--runs", golden.parent.parent),
        ):
            outcome = calibkit(*command)
            assert outcome.code in {0, 2, 4}, (document, outcome.err)
        assert calibkit("verify", golden / name).code in {0, 4}


@pytest.mark.parametrize(
    "text",
    [
        "[" * 100_000,
        '{"format": "calibkit-coefficients/2", "sha256": "", "x": ' + "[" * 900 + "]" * 900 + "}",
        '{"format": "calibkit-coefficients/2", "sha256": "", "x": NaN}',
        '{"format": "calibkit-coefficients/2", "sha256": "", "x": 123456789012345678901234567890}',
        '{"format": "calibkit-coefficients/2", "sha256": "", "x": "\\ud800"}',
    ],
)
def test_hostile_json_is_refused(text):
    """Nesting without end, numbers that JSON lacks, half a surrogate pair: refused by name, not a
    crash.
    """
    with pytest.raises(CoefficientError, match=r"x\.json|not a JSON document"):
        coefficients.loads(text, "x.json")


@pytest.mark.parametrize(
    "change",
    [
        lambda document: document["models"][0]["coefficients"][0].update(value="1.0"),
        lambda document: document["models"][0]["coefficients"][0].update(standard_uncertainty=None),
        lambda document: document["models"][0].update(covariance=[[1.0]]),
        lambda document: document["models"][0]["valid"].update(temp_case_degc=[0.0, "60"]),
        lambda document: document.update(surplus=1),
    ],
)
def test_a_coefficient_record_holds_numbers_where_numbers_belong(golden, change):
    """A text for a number, a covariance of another size, a key that the format lacks: refused
    whatever the digest says.
    """
    path = golden / "inclinometer_scale.json"
    forge(path, change)
    with pytest.raises(CoefficientError, match="not a coefficient record"):
        coefficients.loads(path.read_text(encoding="utf-8"), path.name)


@pytest.mark.parametrize("kind", ["external", "virtual", "unwritten", "half written"])
def test_a_log_whose_values_are_not_in_it_is_refused(tmp_path, kind):
    """HDF5 can point at values in other files, and reads what was never written as zeros: neither
    becomes a measurement.
    """
    h5py = pytest.importorskip("h5py")
    values = 20.0 + np.arange(300.0)
    values.tofile(tmp_path / "elsewhere.bin")
    with h5py.File(tmp_path / "elsewhere.h5", "w") as made:
        made["x"] = values
    with h5py.File(tmp_path / "log.h5", "w") as made:
        made["time_s"] = np.arange(300.0)
        if kind == "external":
            made.create_dataset(
                "gyro_dph", (300,), "<f8", external=[(str(tmp_path / "elsewhere.bin"), 0, 2400)]
            )
        elif kind == "virtual":
            layout = h5py.VirtualLayout((300,), "<f8")
            layout[:] = h5py.VirtualSource(str(tmp_path / "elsewhere.h5"), "x", (300,))
            made.create_virtual_dataset("gyro_dph", layout)
        elif kind == "unwritten":
            made.create_dataset("gyro_dph", (300,), "<f8")
        else:
            made.create_dataset("gyro_dph", (300,), "<f8", chunks=(100,))[:150] = values[:150]
    log = tmp_path / "log.h5"
    message = "was not written to its end" if "written" in kind else "lie in other files"
    with pytest.raises(LogFormatError, match=message):
        hdf5.read(log, log.name, Logs(files=("*.h5",)), ("time_s", "gyro_dph"))
    with h5py.File(log, "a") as made:
        del made["gyro_dph"]
        made["gyro_dph"] = values
    assert (
        hdf5.read(log, log.name, Logs(files=("*.h5",)), ("time_s", "gyro_dph"))
        .frame["gyro_dph"]
        .tolist()
        == values.tolist()
    )
