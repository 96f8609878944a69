"""`calibkit init` on logs that nobody wrote for it: the right procedure, and a recipe that `check`
accepts after what only a person can know.
"""

import tomllib

import pytest

from calibkit import recipe
from calibkit.commands import inspection
from calibkit.errors import CalibkitError
from logs import stranger_logs

RIGHT, ACCEPTED, MOST_EDITS = 17, 15, 2
GRAVITY = (("# state: gravity_mps2 = 9.8 ", "gravity_mps2 = 9.7966 "),)
EDITS = {
    "static IMU swept over a chamber's range in one HDF5 file": GRAVITY,
    "flight controller's export, a topic a file, microseconds": GRAVITY,
    "six logs of an IMU, one a face": GRAVITY,
    "one session of six positions and turns of 360° by hand": (
        ("# rate_hz = …", "rate_hz = 51.2"),
        *GRAVITY,
    ),
}
"""What a person knows of a kind: words of the recipe, and what stands there instead."""


@pytest.fixture(scope="module")
def proposed(tmp_path_factory):
    """Return name → folder and proposed text of every kind."""
    found = {}
    for number, name in enumerate(stranger_logs.KINDS):
        folder = tmp_path_factory.mktemp(f"kind{number}")
        for file, content in stranger_logs.files(name).items():
            (folder / file).write_bytes(content)
        found[name] = folder, inspection.init(folder).text
    return found


def test_the_procedure_of_strange_logs_is_recognised(proposed):
    """Of all 17 kinds, each with its reason."""
    right = [
        name
        for name, (_, text) in proposed.items()
        if tomllib.loads(text)["procedure"] in stranger_logs.KINDS[name].right
        and "# Procedure: " in text
        and "Runner-up: " in text
    ]
    assert len(right) == RIGHT, set(proposed) - set(right)


def accepts(folder, text):
    """Whether check accepts a recipe."""
    try:
        campaign = inspection.check(recipe.Source("r.toml", text), folder)
    except CalibkitError:
        return False
    return campaign.judgement.exit_code == 0


@pytest.mark.slow
def test_check_accepts_the_recipes_after_two_edits(proposed):
    """Of 15 kinds, every edit of a line that the recipe asks about; in the other two six faces
    alone determine no nine parameters.
    """
    accepted = []
    for name, (folder, text) in proposed.items():
        edited, edits = text, EDITS.get(name, ())
        assert len(edits) <= MOST_EDITS
        for before, after in edits:
            assert before in edited, name
            edited = edited.replace(before, after, 1)
        if accepts(folder, edited):
            accepted.append(name)
    assert len(accepted) == ACCEPTED, set(proposed) - set(accepted)
