"""Mutated text logs guided by the lines that they reach: `python tests/attacks/guided.py CORPUS
-max_total_time=600`. It needs atheris; the folder CORPUS is made and kept.
"""

import sys
import tempfile
from pathlib import Path

import atheris

ROOT = Path(__file__).resolve().parents[2]
FORMATS = ("a.csv", "b.csv", "c.txt", "d.json", "e.lvm")


def read(path, content):
    """Read a log; raise what is neither calibkit's own refusal nor one line."""
    path.write_bytes(content)
    try:
        registry.read(path, path.name, Logs(files=("*",)), logs.NEEDED)
    except CalibkitError as error:
        if error.exit_code != 3 or "\n" in error.message:
            raise RuntimeError(error.message) from error


def attack(content):
    """Read content as the format that its first byte names."""
    if content:
        read(folder / FORMATS[content[0] % len(FORMATS)], content[1:])


if __name__ == "__main__":
    sys.path[:0] = [str(ROOT), str(ROOT / "tests")]
    with atheris.instrument_imports(include=["calibkit.readers", "calibkit.units"]):
        from attacks import logs
        from calibkit.errors import CalibkitError
        from calibkit.readers import registry
        from calibkit.recipe.logs import Logs
    corpus = Path(sys.argv[1])
    corpus.mkdir(parents=True, exist_ok=True)
    originals = logs.samples()
    for number, name in enumerate(FORMATS):
        (corpus / name).write_bytes(bytes([number]) + originals[name])
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        atheris.Setup([*sys.argv, "-rss_limit_mb=0", "-timeout=20"], attack)
        atheris.Fuzz()
