"""Plugins: log formats and instruments of other distributions, found by their entry points and
imported only when one is asked for.

A distribution states in its pyproject.toml the name and the module of what it adds,

    [project.entry-points."calibkit.readers"]
    mylab = "mylab_reader"

and the module states the version of the interface that it was written for:
`CALIBKIT_INTERFACE = 2`.
"""

import functools
import hashlib
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

from calibkit.errors import UsageError

READERS, INSTRUMENTS = "calibkit.readers", "calibkit.instruments"
"""Groups of entry points."""
INTERFACES = {READERS: (1, 2), INSTRUMENTS: (2,)}
"""Versions of the interface between calibkit and its plugins: in the first, instruments were
records.
"""


@dataclass(frozen=True, slots=True)
class Plugin:
    """What run.json states of a plugin: its name, and name, version and digest of its
    distribution.
    """

    name: str
    distribution: str
    version: str
    sha256: str


@functools.cache
def installed(group: str) -> Mapping[str, EntryPoint]:
    """Name → entry point of every installed plugin of a group; none of them is imported.

    Raises UsageError where two distributions add the same name.
    """
    from importlib.metadata import entry_points

    plugins: dict[str, EntryPoint] = {}
    for entry in entry_points(group=group):
        other = plugins.setdefault(entry.name, entry)
        if other != entry:
            raise UsageError(
                f"two plugins are called '{entry.name}': {_title(other)} and {_title(entry)}",
                hint="uninstall one of them",
            )
    return dict(sorted(plugins.items()))


def load(entry: EntryPoint) -> Any:  # noqa: ANN401 (what an entry point names can be anything)
    """Import what an entry point names; raises UsageError for a plugin that cannot be imported or
    was written for another version of the interface.

    An entry point without a distribution is one of calibkit's own, and not checked.
    """
    loaded, fault = _imported(entry)
    if fault:
        raise UsageError(
            f"'{entry.name}' is added by {_title(entry)}, which {fault}",
            hint="update or repair that package, or uninstall it",
        )
    return loaded


@functools.cache
def usable(group: str) -> Mapping[str, Any]:
    """Name → imported plugin of a group; a warning names each that cannot be used."""
    import logging

    plugins = {}
    for name, entry in installed(group).items():
        loaded, fault = _imported(entry)
        if fault:
            logging.getLogger("calibkit").warning(
                "'%s' of %s is skipped: the package %s", name, _title(entry), fault
            )
        else:
            plugins[name] = loaded
    return plugins


@functools.cache
def _imported(entry: EntryPoint) -> tuple[Any, str]:
    """What an entry point names, and what is wrong with it, "" for nothing."""
    if entry.dist is None:
        return entry.load(), ""
    try:
        loaded = entry.load()
    except (Exception, SystemExit) as error:  # noqa: BLE001 (the code of others raises anything)
        return None, f"cannot be imported: {type(error).__name__}: {' '.join(str(error).split())}"
    version = getattr(sys.modules[entry.module], "CALIBKIT_INTERFACE", None)
    expected = INTERFACES[entry.group]
    if version not in expected:
        version_text = "no version" if version is None else f"version {version}"
        return (
            None,
            (
                f"states {version_text} of the plugin interface (CALIBKIT_INTERFACE), expected"
                f" {' or '.join(map(str, expected))}"
            ),
        )
    return loaded, ""


def _title(entry: EntryPoint) -> str:
    """Distribution and version that an entry point belongs to."""
    return f"{entry.dist.name} {entry.dist.version}" if entry.dist else "calibkit"


@functools.cache
def identify(entry: EntryPoint) -> Plugin:
    """What run.json states of an imported plugin.

    The digest is the SHA-256 of one line `<SHA-256>  <path>` per file, in order of the paths: the
    files that the distribution installed, without bytecode and without what an installer adds; of
    an installation that does not list the plugin's module (an editable one), the module's sources.
    """
    assert entry.dist is not None  # noqa: S101 (calibkit's own are no plugins)
    digest = hashlib.sha256()
    for name, path in sorted(_files(entry).items()):
        digest.update(f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {name}\n".encode())
    return Plugin(entry.name, entry.dist.name, entry.dist.version, digest.hexdigest())


def _files(entry: EntryPoint) -> dict[str, Path]:
    """Name → path of the files that a plugin's digest is taken over."""
    assert entry.dist is not None  # noqa: S101 (as in `identify`)
    installed_files = {
        file.as_posix(): Path(str(file.locate()))
        for file in entry.dist.files or ()
        if not file.parts[0].endswith((".dist-info", ".egg-info", ".."))
    }
    files = {name: path for name, path in installed_files.items() if path.suffix != ".pyc"}
    module = sys.modules[entry.module]
    source = Path(str(module.__file__)).resolve()
    if source in {path.resolve() for path in files.values()}:
        return files
    sources = source.parent.rglob("*.py") if module.__package__ else [source]
    return {path.relative_to(source.parent).as_posix(): path for path in sources}
