"""The notebooks of the documentation run as they are, from the first cell to the last."""

import json

import numpy as np
import pytest

from conftest import ROOT


def follow(path, folder, monkeypatch, start="."):
    """Names that the cells of a notebook leave, run in a folder beside the sample logs, or in one
    below it.
    """
    monkeypatch.setenv("MPLBACKEND", "agg")
    (folder / start).mkdir(parents=True, exist_ok=True)
    monkeypatch.chdir(folder / start)
    (folder / "datasets").symlink_to(ROOT / "datasets", target_is_directory=True)
    names = {"__name__": "__main__"}
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), path.name, "exec"), names)  # noqa: S102 (the notebook's own code)
    return names


@pytest.mark.parametrize("start", [".", "docs/notebooks"])
def test_an_own_model_beside_calibkit_s(tmp_path, monkeypatch, start):
    """On ramps left out the cubic of temperature leaves several times what calibkit leaves, and
    what it leaves depends on the direction; nothing is written, wherever the kernel starts.
    """
    names = follow(ROOT / "docs" / "notebooks" / "own_model.ipynb", tmp_path, monkeypatch, start)
    rms = names["rms"]
    for log in names["left_out"]:
        assert rms[log, "calibkit"] < 0.7 * rms[log, "cubic of T"] < 0.2 * rms[log, "raw"]
    directions = names["directions"]
    assert np.ptp(directions["own"]) > 0.05
    assert np.ptp(directions["residual_dph"]) < 1e-9
    assert {path.name for path in tmp_path.rglob("*")} <= {"datasets", "docs", "notebooks"}
