"""The documentation: every tutorial runs as it is written, file formats have schemas that hold, pages build without a warning."""

import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys

import pytest

from conftest import ROOT

TUTORIALS = sorted((ROOT / "docs" / "tutorials").glob("*.md"))
SCHEMAS = ROOT / "docs" / "schemas"


def blocks(page):
    """Code blocks of a page in order: language and text."""
    return re.findall(r"^```(sh|python)\n(.*?)^```$", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def typed(folder):
    """Return a function that runs a tutorial's block in a folder with the sample logs, as a reader would."""
    (folder / "bin").mkdir()
    command = folder / "bin" / "calibkit"
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m calibkit "$@"\n', encoding="utf-8")
    command.chmod(0o755)
    (folder / "datasets").symlink_to(ROOT / "datasets")
    environment = os.environ | {
        "PATH": f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "OPENBLAS_NUM_THREADS": "1",
    }

    def run(language, text):
        arguments = ["bash", "-euc", text] if language == "sh" else [sys.executable, "-c", text]
        done = subprocess.run(arguments, cwd=folder, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{text}\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}"
        return done

    return run


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash on this machine")
@pytest.mark.parametrize("page", TUTORIALS, ids=lambda page: page.stem)
def test_a_tutorial_runs_as_it_is_written(page, tmp_path):
    """Every block of the page, in order, in an empty folder beside the sample logs: all end with exit code 0."""
    if "calibkit certify" in page.read_text(encoding="utf-8") and importlib.util.find_spec("typst") is None:
        pytest.skip("typst is not installed")
    run = typed(tmp_path)
    for language, text in blocks(page):
        run(language, text)


def test_every_procedure_has_a_tutorial():
    """Nine pages, and each shipped procedure is fitted on one of them."""
    from calibkit.procedures import NAMES

    text = "".join(page.read_text(encoding="utf-8") for page in TUTORIALS)
    assert [name for name in NAMES if f"calibkit fit {name} " not in text] == []


@pytest.mark.parametrize("procedure", ["gyro_pair", "rate_table", "inclinometer"])
def test_what_calibkit_writes_is_of_its_schema(tmp_path, calibkit, procedure):
    """run.json, every coefficient file and a validation hold against the published JSON Schemas."""
    jsonschema = pytest.importorskip("jsonschema")
    data = ROOT / "datasets" / procedure
    assert calibkit("fit", procedure, "--data", data, "--serial", "S", "--out", tmp_path / "runs").code == 0
    paths = sorted((tmp_path / "runs" / "S" / "r001").glob("*.json"))
    if (data / "withheld").is_dir():
        paths.append(tmp_path / "v.json")
        arguments = ("--runs", tmp_path / "runs", "--data", data / "withheld", "--out", paths[-1])
        assert calibkit("validate", "S", *arguments).code == 0
    for path in paths:
        document = json.loads(path.read_text(encoding="utf-8"))
        name = document["format"].replace("/", "-")
        schema = json.loads((SCHEMAS / f"{name}.schema.json").read_text(encoding="utf-8"))
        jsonschema.Draft202012Validator.check_schema(schema)
        jsonschema.Draft202012Validator(schema).validate(document)


def test_a_schema_refuses_a_coefficient_without_its_unit():
    """The golden file passes; the same without one unit does not."""
    jsonschema = pytest.importorskip("jsonschema")
    schema = json.loads((SCHEMAS / "calibkit-coefficients-1.schema.json").read_text(encoding="utf-8"))
    golden = json.loads((ROOT / "tests" / "golden" / "coefficients-1.json").read_text(encoding="utf-8"))
    golden |= {"recipe_sha256": "0" * 64, "inputs": []}  # its own are shortened
    validator = jsonschema.Draft202012Validator(schema)
    validator.validate(golden)
    del golden["models"][0]["coefficients"][0]["unit"]
    assert not validator.is_valid(golden)


def test_the_pages_build_without_a_warning(tmp_path):
    """Sphinx with warnings as errors."""
    for module in ("sphinx", "myst_parser", "furo", "numpydoc"):
        if importlib.util.find_spec(module) is None:
            pytest.skip(f"{module} is not installed: pip install 'calibkit[docs]'")
    arguments = ["-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", str(ROOT / "docs"), str(tmp_path)]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, *arguments], env=environment, cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-4000:]
    assert "Glossary" in (tmp_path / "glossary.html").read_text(encoding="utf-8")
