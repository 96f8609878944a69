"""Plugins: log formats that other packages add."""

import hashlib
import logging
from dataclasses import asdict
from importlib.metadata import EntryPoint

import pytest

from calibkit import coefficients, plugins, recipe
from calibkit.errors import LogFormatError, RecipeError, UsageError
from calibkit.ingest import logs as ingest
from calibkit.readers import registry
from calibkit.recipe.logs import Logs

READER = '''"""Numbers behind a mark, two per row."""

import hashlib

import numpy as np
import pandas as pd

from calibkit.errors import LogFormatError
from calibkit.readers.table import Table

CALIBKIT_INTERFACE = 1
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

    def added(name, source, *, version="1.0", module=None):
        module = module or f"{name}_reader"
        site = tmp_path / "site" / f"{name}-{version}-{module}"
        about = site / f"{module}-{version}.dist-info"
        about.mkdir(parents=True)
        (site / f"{module}.py").write_text(source, encoding="utf-8")
        (about / "METADATA").write_text(f"Name: {module}\nVersion: {version}\n", encoding="utf-8")
        (about / "entry_points.txt").write_text(
            f"[calibkit.readers]\n{name} = {module}\n", encoding="utf-8"
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
    spec = recipe.parse(recipe.Source("r.toml", text))
    log = ingest.read_log(spec, tmp_path / "log.dat", "log.dat", ("time_s", "gyro_dph"))
    assert coefficients.Input.of(log).plugins == (plugin,)
    assert set(asdict(plugin)) == {"name", "distribution", "version", "sha256"}


def test_the_digest_of_an_editable_installation_is_over_its_sources(tmp_path, install, monkeypatch):
    """A record that does not list the module: another source is another digest."""
    digests = []
    for comment in ("", "# changed\n"):
        site = install("pairs", READER + comment, version=f"1.{len(digests)}")
        record = next(site.glob("*.dist-info")) / "RECORD"
        record.write_text("__editable__.pairs_reader.pth,,\n", encoding="utf-8")
        (site / "__editable__.pairs_reader.pth").write_text("/somewhere", encoding="utf-8")
        plugins.installed.cache_clear()
        digests.append(read(tmp_path, PAIRS, format="pairs").plugins[0].sha256)
        monkeypatch.delitem(plugins.sys.modules, "pairs_reader")
    assert digests[0] != digests[1]


def test_an_unknown_format_is_refused_with_the_closest_name_plugins_included(install):
    """As before for calibkit's own; the formats of plugins stand among those that are allowed."""
    install("pairs", "raise RuntimeError('imported')")
    text = 'procedure = "fog_thermal"\n[logs]\nfiles = ["*"]\nformat = '
    with pytest.raises(RecipeError, match=r"r.toml:4: .*'binary' or 'pairs'; did you mean 'pairs'"):
        recipe.parse(recipe.Source("r.toml", text + '"pair"'))
    with pytest.raises(RecipeError, match=r"found 'cvs', expected 'auto', .* did you mean 'csv'"):
        recipe.parse(recipe.Source("r.toml", text + '"cvs"'))
    assert recipe.parse(recipe.Source("r.toml", text + '"pairs"')).logs.format == "pairs"


def test_no_plugin_is_looked_for_where_a_recipe_names_a_format_of_calibkit(monkeypatch):
    """To look for entry points takes longer than to read a small log."""
    monkeypatch.setattr(plugins, "installed", None)
    for name in ("auto", "csv", "hdf5"):
        assert Logs(files=("*",), format=name).format == name


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("import no_such_module", "cannot be imported: ModuleNotFoundError: No module named"),
        ("CALIBKIT_INTERFACE = 2", "states version 2 of the plugin interface"),
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


def test_a_plugin_that_cannot_be_used_is_skipped_with_a_warning_where_none_asks(
    tmp_path, install, caplog
):
    """The log is recognised by another plugin; the broken one is named once."""
    install("broken", "1 / 0")
    install("pairs", READER)
    with caplog.at_level(logging.WARNING, logger="calibkit"):
        for _ in range(2):
            table = read(tmp_path, PAIRS)
            assert table.reading == ("format = 'pairs' (guessed)",)
    (warning,) = (record.getMessage() for record in caplog.records)
    assert warning == (
        "'broken' of broken_reader 1.0 is skipped: the package cannot be imported:"
        " ZeroDivisionError: division by zero"
    )


def test_what_calibkit_reads_by_itself_no_plugin_takes(tmp_path, install):
    """A plugin whose mark every text begins with, or whose name is that of a shipped format,
    changes nothing.
    """
    install("csv", READER.replace("PAIRS1", "time"))
    install("pairs", READER.replace("PAIRS1", "time"))
    for content in (b"time_s,gyro_dph\n0,1\n1,2\n", b"time_s;gyro_dph\n0,5;1\n1,5;2\n"):
        assert read(tmp_path, content).plugins == ()
    assert read(tmp_path, b"time_s,gyro_dph\n0,1\n", format="csv").plugins == ()


def test_a_log_that_nothing_recognises_is_refused_as_without_plugins(tmp_path, install):
    """The message is that of calibkit's own readers."""
    with pytest.raises(LogFormatError) as alone:
        read(tmp_path, b"\0\1\2\3")
    install("pairs", READER)
    with pytest.raises(LogFormatError) as together:
        read(tmp_path, b"\0\1\2\3")
    assert str(alone.value) == str(together.value)


def test_whatever_a_reader_raises_is_an_error_of_the_log(tmp_path, install):
    """The message names file, format, package and what was raised."""
    install("pairs", READER)
    with pytest.raises(LogFormatError, match=r"log.dat: not a whole 'pairs' \(pairs_reader 1.0\)"):
        read(tmp_path, PAIRS[:-3], format="pairs")
    with pytest.raises(LogFormatError, match="no mark; another format"):
        read(tmp_path, b"anything", format="pairs")


@pytest.mark.parametrize("returned", ["None", 'Table(file, "0" * 64, frame)'])
def test_a_reader_that_gives_no_table_of_its_file_is_refused(tmp_path, install, returned):
    """A wrong digest in a record would let a log vouch for itself."""
    source, _, _ = READER.rpartition("    return ")
    install("pairs", f"{source}    return {returned}\n")
    with pytest.raises(LogFormatError, match="gave no table with the digest of this file"):
        read(tmp_path, PAIRS, format="pairs")


def test_two_packages_that_add_one_name_are_refused(tmp_path, install):
    """Which of them would read the log is not for calibkit to choose."""
    install("pairs", READER, module="one_reader")
    install("pairs", READER, module="other_reader")
    with pytest.raises(UsageError, match="two plugins are called 'pairs'"):
        read(tmp_path, PAIRS, format="pairs")


def test_a_part_of_calibkit_itself_is_loaded_unchecked():
    """An entry point without a distribution is one of calibkit's own."""
    entry = EntryPoint("csv", "calibkit.readers.delimited", plugins.READERS)
    assert plugins.load(entry).__name__ == "calibkit.readers.delimited"
