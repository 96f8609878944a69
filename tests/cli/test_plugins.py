"""Plugins: log formats that other packages add, and the pages that show how, as they are
written.
"""

import hashlib
import importlib.util
import json
import os
import re
import shutil
import subprocess
import sysconfig
import tomllib
import venv
from dataclasses import asdict
from pathlib import Path

import pytest

from calibkit import instruments, recipe
from calibkit.errors import LogFormatError, UsageError
from calibkit.libraries import plugins
from calibkit.logs import log_files
from calibkit.readers import registry
from calibkit.recipe.logs import Logs
from calibkit.records import coefficients
from conftest import ROOT
from house import pages
from house.pages import validators

FILE = re.compile(r"# ([\w./-]+\.(?:toml|py))\n")
"""First line of a block that is a file."""

READER = '''"""Numbers behind a mark, two per row."""

import hashlib

import numpy as np
import pandas as pd

from calibkit.errors import LogFormatError
from calibkit.readers.table import Table

CALIBKIT_INTERFACE = 2
SIGNATURES = (b"PAIRS1",)


def read(path, file, logs, needed):
    data = path.read_bytes()
    if not data.startswith(SIGNATURES):
        raise LogFormatError(f"{file}: no mark", hint="another format")
    values = np.frombuffer(data[6:], "<f8").reshape(-1, 2)
    frame = pd.DataFrame(values, columns=["time_s", "gyro_dph"])
    return Table(file, hashlib.sha256(data).hexdigest(), frame, units={"gyro_dph": "deg/h"})
'''
PAIRS = b"PAIRS1" + bytes(4 * 8)


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Return a function that installs a package of one module with one reader, for this test."""
    forgotten = (plugins.installed, plugins.usable, plugins._imported, plugins.identify)

    def forget():
        for function in forgotten:
            function.cache_clear()

    def added(name, source, *, version="1.0", module=None, group="readers"):
        module = module or f"{name}_reader"
        site = tmp_path / "site" / f"{name}-{version}-{module}"
        about = site / f"{module}-{version}.dist-info"
        about.mkdir(parents=True)
        (site / f"{module}.py").write_text(source, encoding="utf-8")
        (about / "METADATA").write_text(f"Name: {module}\nVersion: {version}\n", encoding="utf-8")
        (about / "entry_points.txt").write_text(
            f"[calibkit.{group}]\n{name} = {module}\n", encoding="utf-8"
        )
        (about / "RECORD").write_text(
            f"{module}.py,,\n__pycache__/{module}.cpython-311.pyc,,\n"
            f"../../bin/{module},,\n{about.name}/INSTALLER,,\n",
            encoding="utf-8",
        )
        monkeypatch.syspath_prepend(site)
        monkeypatch.delitem(plugins.sys.modules, module, raising=False)
        forget()
        return site

    yield added
    forget()


def read(path, content, **described):
    """Read bytes as a log."""
    (path / "log.dat").write_bytes(content)
    logs = Logs(files=("*",), **described)
    return registry.read(path / "log.dat", "log.dat", logs, {"time_s"})


def test_a_log_in_the_format_of_a_plugin_is_read_and_names_the_plugin(tmp_path, install):
    """The plugin's name, distribution, version and a digest over its own files travel with the
    log to the input of a fit.
    """
    install("pairs", READER, version="2.1")
    table = read(tmp_path, PAIRS, format="pairs")
    digest = hashlib.sha256(READER.encode()).hexdigest()
    stated = hashlib.sha256(f"{digest}  pairs_reader.py\n".encode()).hexdigest()
    plugin = plugins.Plugin("pairs", "pairs_reader", "2.1", stated)
    assert table.plugins == (plugin,)
    text = 'procedure = "fog_thermal"\n[logs]\nfiles = ["*"]\nformat = "pairs"\n'
    spec = instruments.parse_recipe(recipe.Source("r.toml", text))
    log = log_files.read_log(spec, tmp_path / "log.dat", "log.dat", ("time_s", "gyro_dph"))
    assert coefficients.Input.of(log).plugins == (plugin,)
    assert set(asdict(plugin)) == {"name", "distribution", "version", "sha256"}


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("import no_such_module", "cannot be imported: ModuleNotFoundError: No module named"),
        ("CALIBKIT_INTERFACE = 3", "states version 3 of the plugin interface"),
        ("x = 1", "states no version of the plugin interface"),
    ],
)
def test_a_plugin_that_cannot_be_used_is_one_clear_error_where_a_recipe_asks_for_it(
    tmp_path, install, source, found
):
    """Exit code 2, with the names of format and package; no traceback of the package."""
    install("pairs", source, version="3.0")
    with pytest.raises(UsageError, match=found) as refused:
        read(tmp_path, PAIRS, format="pairs")
    assert refused.value.exit_code == 2
    assert str(refused.value).startswith("'pairs' is added by pairs_reader 3.0, which ")
    assert "\n" not in str(refused.value)


def test_whatever_a_reader_raises_is_an_error_of_the_log(tmp_path, install):
    """The message names file, format, package and what was raised."""
    install("pairs", READER)
    with pytest.raises(LogFormatError, match=r"log.dat: not a whole 'pairs' \(pairs_reader 1.0\)"):
        read(tmp_path, PAIRS[:-3], format="pairs")
    with pytest.raises(LogFormatError, match="no mark; another format"):
        read(tmp_path, b"anything", format="pairs")


@pytest.mark.parametrize(
    ("written", "returned"),
    [
        ("    return ", "    return None # "),
        ("hashlib.sha256(data).hexdigest()", '"0" * 64'),
        ("deg/h", "furlong"),
    ],
)
def test_a_reader_that_gives_no_table_of_its_file_is_refused(tmp_path, install, written, returned):
    """Another digest than that of the file would let a copy of a log pass for another log."""
    install("pairs", READER.replace(written, returned))
    with pytest.raises(LogFormatError, match=r"pairs_reader 1\.0"):
        read(tmp_path, PAIRS, format="pairs")


class Environment:
    """A fresh environment that sees calibkit and its libraries, for one package."""

    def __init__(self, folder):
        self.folder = folder
        venv.create(folder / "env", with_pip=False)
        scripts = "Scripts" if os.name == "nt" else "bin"
        self.python = folder / "env" / scripts / "python"
        base = str(folder / "env")
        self.site = Path(sysconfig.get_path("purelib", "venv", vars={"base": base}))
        seen = [str(ROOT), sysconfig.get_path("purelib"), sysconfig.get_path("platlib")]
        (self.site / "seen.pth").write_text("\n".join(dict.fromkeys(seen)) + "\n", encoding="utf-8")

    def run(self, *arguments):
        """Run Python; its outcome."""
        environment = os.environ | {"PYTHONPATH": "", "OPENBLAS_NUM_THREADS": "1"}
        return subprocess.run(
            [str(self.python), *arguments],
            cwd=self.folder,
            env=environment,
            capture_output=True,
            text=True,
            encoding="utf-8",
            check=False,
        )

    def install(self, project):
        """Install a project: by pip where that and the build backend are at hand, else file by
        file.
        """
        if all(importlib.util.find_spec(name) for name in ("pip", "hatchling")):
            offline = ("--no-index", "--no-deps", "--no-build-isolation", "--quiet")
            done = self.run("-m", "pip", "install", *offline, str(project))
            assert done.returncode == 0, done.stderr
            return
        stated = tomllib.loads((project / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        name, version = stated["name"].replace("-", "_"), stated["version"]
        about = self.site / f"{name}-{version}.dist-info"
        about.mkdir()
        modules = [shutil.copy(path, self.site) for path in project.glob("*.py")]
        listed = "".join(f"{Path(path).name},,\n" for path in modules)
        (about / "RECORD").write_text(listed, encoding="utf-8")
        head = f"Metadata-Version: 2.4\nName: {stated['name']}\nVersion: {version}\n"
        (about / "METADATA").write_text(head, encoding="utf-8")
        groups = "".join(
            f"[{group}]\n" + "".join(f"{key} = {value}\n" for key, value in entries.items())
            for group, entries in stated["entry-points"].items()
        )
        (about / "entry_points.txt").write_text(groups, encoding="utf-8")

    def follow(self, page):
        """Run a page: files are written, Python is run, packages installed, commands typed."""
        (self.folder / "datasets").symlink_to(ROOT / "datasets", target_is_directory=True)
        for language, text in pages.BLOCK.findall(page.read_text(encoding="utf-8")):
            if named := FILE.match(text):
                (self.folder / named[1]).parent.mkdir(exist_ok=True)
                (self.folder / named[1]).write_text(text, encoding="utf-8")
            elif language == "python":
                self._succeeds("-c", text)
            else:
                for line in text.splitlines():
                    typed, _, written = line.partition(" > ")
                    command, *arguments = typed.split()
                    if command == "pip":
                        self.install(self.folder / arguments[-1])
                    else:
                        assert command == "calibkit"
                        printed = self._succeeds("-m", "calibkit", *arguments)
                        if written:
                            (self.folder / written).write_text(printed, encoding="utf-8")

    def _succeeds(self, *arguments):
        """Run Python; it ends with exit code 0, and this is what it printed."""
        done = self.run(*arguments)
        assert done.returncode == 0, f"{arguments}\n{done.stdout}\n{done.stderr}"
        return done.stdout


@pytest.mark.slow
def test_the_reader_of_the_page_is_installed_and_reads_logs(tmp_path):
    """Every block of the page in a fresh environment: init, check, fit and apply take logs in the
    format of the package, and run.json states the package.
    """
    environment = Environment(tmp_path)
    environment.follow(ROOT / "docs" / "how_to" / "format_of_my_own.md")
    run = tmp_path / "runs" / "FOG-0001" / "r001"
    document = json.loads((run / "run.json").read_text(encoding="utf-8"))
    validators()["calibkit-run/2"].validate(document)
    (plugin,) = document["plugins"]
    assert (plugin["name"], plugin["distribution"]) == ("sentences", "lab-sentences")
    source = (tmp_path / "lab-sentences" / "lab_sentences.py").read_bytes()
    line = f"{hashlib.sha256(source).hexdigest()}  lab_sentences.py\n"
    assert plugin["sha256"] == hashlib.sha256(line.encode()).hexdigest()
    written = (tmp_path / "compensated.csv").read_text(encoding="utf-8").splitlines()
    # the units that the reader states stand behind the names
    assert written[0] == "time (s),case (degC),chamber (degC),rate (deg/h)"
    proposed = (tmp_path / "proposal.toml").read_text(encoding="utf-8")
    assert 'format = "sentences"' in proposed
    assert 'from = "rate"' in proposed
    log = tmp_path / "lab" / "ramp_heating_05.txt"
    assert len(written) == 1 + len(log.read_text(encoding="utf-8").splitlines())

    log.write_text(log.read_text(encoding="utf-8").replace("$GYRO,100,", "$GYRO,101,"), "utf-8")
    checked = environment.run("-m", "calibkit", "check", "lab.toml", "--data", "lab")
    assert checked.returncode == 3
    assert "ramp_heating_05.txt:101: the checksum is not" in checked.stdout


@pytest.mark.slow
def test_the_instrument_of_the_page_is_installed_and_calibrates(tmp_path):
    """Every block of the page in a fresh environment: the thermometer is right to 10 mK on unseen
    soaks, and run.json states the package.
    """
    environment = Environment(tmp_path)
    environment.follow(ROOT / "docs" / "how_to" / "instrument_of_my_own.md")
    run = tmp_path / "runs" / "T-0001" / "r001"
    document = json.loads((run / "run.json").read_text(encoding="utf-8"))
    validators()["calibkit-run/2"].validate(document)
    (plugin,) = document["plugins"]
    assert (plugin["name"], plugin["distribution"]) == ("case_thermometer", "lab-thermometer")
    validation = json.loads((tmp_path / "validation.json").read_text(encoding="utf-8"))
    errors = [entry["error_degc"] for entry in validation["logs"]]
    assert len(errors) == 3
    assert max(map(abs, errors)) < 0.01
    rows = (tmp_path / "corrected.csv").read_text(encoding="utf-8").splitlines()[1:]
    case, air = (float(field) for field in rows[-1].split(",")[1:3])
    assert case == pytest.approx(air, abs=0.1)

    (tmp_path / "typed.toml").write_text('procedure = "case_thermometre"\n', encoding="utf-8")
    refused = environment.run("-m", "calibkit", "check", "typed.toml", "--data", "lab")
    assert refused.returncode == 2
    assert "did you mean 'case_thermometer'?" in refused.stderr
