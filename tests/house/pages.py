"""Running a page of the documentation as its reader would: every block in order, in an empty folder
beside the sample logs.
"""

from __future__ import annotations

import contextlib
import json
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from conftest import ROOT

BLOCK = re.compile(r"^```(sh|python|toml|c)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
NAMED = re.compile(r"(?:#|//) (\S+\.(?:toml|c))\n")
"""First line of a block that is a file."""


def follow(page, folder, calibkit, monkeypatch):
    """Run a page: commands of calibkit in this process, other commands by a shell, Python, and
    files written down.
    """
    monkeypatch.chdir(folder)
    (folder / "datasets").symlink_to(ROOT / "datasets", target_is_directory=True)
    for language, text in BLOCK.findall(page.read_text(encoding="utf-8")):
        if language == "python":
            with contextlib.redirect_stdout(None):
                exec(compile(text, str(page), "exec"), {"__name__": "__main__"})  # noqa: S102 (the page's own code)
        elif language == "sh":
            for line in filter(None, text.splitlines()):
                typed(line, calibkit)
        elif named := NAMED.match(text):
            Path(named[1]).write_text(text, encoding="utf-8")


def typed(line, calibkit):
    """Run one line of a page; it ends with 0, or with what `# exit N` behind it says."""
    line, _, expected = line.partition("    # exit ")
    if line.startswith("calibkit "):
        command, _, redirected = line.partition(" > ")
        done = calibkit(*shlex.split(command)[1:])
        if redirected:
            Path(redirected).write_text(done.out, encoding="utf-8")
        code, said = done.code, done.err
    elif shutil.which(line.split()[0]) is None:
        return
    else:
        done = subprocess.run(["bash", "-euc", line], capture_output=True, text=True, check=False)
        code, said = done.returncode, done.stderr
    assert code == int(expected or 0), f"{line}\n{said}"


def validators():
    """Validator of each format that has a schema."""
    jsonschema = pytest.importorskip("jsonschema")
    schemas = [
        json.loads(path.read_text(encoding="utf-8")) for path in sorted(SCHEMAS.glob("*.json"))
    ]
    for schema in schemas:
        jsonschema.Draft202012Validator.check_schema(schema)
    return {schema["title"]: jsonschema.Draft202012Validator(schema) for schema in schemas}


SCHEMAS = ROOT / "docs" / "schemas"
