"""How far it is from the command `apply` to the arithmetic: the functions of calibkit on the way,
listed.
"""

import sys
from pathlib import Path

import pytest

import calibkit
from calibkit import pipeline, recipe
from calibkit.cli import cli
from calibkit.instruments import silent

PACKAGE = str(Path(calibkit.__file__).parent)
MOST = 12
"""Functions of calibkit between the command and an array function, at most."""
CHAIN = [
    "cli.logs.apply",
    "pipeline.apply",
    "pipeline.compensate",
    "instruments.bias.fog_thermal.correct",
    "instruments.bias.compensate.compensate_log",
    "instruments.bias.compensate.DriftModel.drift_along",
    "instruments.bias.numeric.bank.evaluate",
]
"""From the command to the drift along a log."""
STOPS = [
    "cli.logs.apply",
    "cli.memory.tune_memory",
    "cli.progress.working",
    "pipeline.apply",
    "pipeline.compensate",
    "pipeline.run_recipe",
    "instruments.find",
    "instruments.fitted_recipe",
    "instruments.bias.fog_thermal.correct",
    "instruments.bias.forms.read_thermal",
    "instruments.bias.compensate.compensate_log",
    "instruments.bias.ramps.block_means",
]
"""What a reader who follows one log from the command on walks through, whether it has returned or
not, before the first array function of the instrument. Files, recipes and records are read, and the
log is checked, by packages of their own, which stand beside this way.
"""


def called(frame):
    """Module and qualified name of a function of calibkit; empty for any other."""
    file = frame.f_code.co_filename
    if not file.startswith(PACKAGE):
        return ""
    module = file[len(PACKAGE) + 1 : -len(".py")].replace("/", ".").removesuffix(".__init__")
    return f"{module}.{frame.f_code.co_qualname}"


def calls(*arguments):
    """Chains of open calls of a command, in the order of their beginning.

    Comprehensions belong to the function that they stand in.
    """
    chains, stack = [], []

    def listen(frame, event, _):
        name = called(frame)
        if not name or "<" in frame.f_code.co_name:
            return
        if event == "call":
            stack.append(name)
            chains.append(tuple(stack))
        elif event == "return" and stack:
            stack.pop()

    cli.main(list(arguments), standalone_mode=False)  # imports are over then
    Path(arguments[-1]).unlink()
    sys.setprofile(listen)
    try:
        cli.main(list(arguments), standalone_mode=False)
    finally:
        sys.setprofile(None)
    start = next(k for k, chain in enumerate(chains) if chain[-1].endswith(".apply"))
    depth = len(chains[start]) - 1
    return [chain[depth:] for chain in chains[start:]]


def is_numeric(name):
    """Whether a function stands in a package that knows arrays alone."""
    return "numeric." in name


@pytest.fixture(scope="module")
def chains(campaign, tmp_path_factory):
    """Return the chains of `apply` of one log of a run with a model on levels."""
    folder = tmp_path_factory.mktemp("runs")
    outcome = pipeline.fit(
        recipe.find("fog_thermal", ("drift.model=lagged",)),
        campaign,
        "F",
        folder,
        "2026-11-21",
        silent,
    )
    log = min(campaign.glob("withheld/*.csv"))
    return calls(
        "apply", str(outcome.run.folder), "--data", str(log), "--out", str(folder / "x.csv")
    )


def test_the_drift_of_a_log_is_a_few_calls_below_the_command(chains):
    """The chain of open calls, listed."""
    found = next(chain for chain in chains if chain[-1] == CHAIN[-1])
    assert list(found) == CHAIN
    assert len(CHAIN) - 2 <= MOST


def test_no_array_function_is_far_below_the_command(chains):
    """Of every call into a numeric package, checks and the writing of the log included."""
    entered = [chain for chain in chains if is_numeric(chain[-1]) and not is_numeric(chain[-2])]
    assert len({chain[-1] for chain in entered}) > 5
    assert max(len(chain) for chain in entered) - 2 <= MOST


def test_few_functions_are_walked_through_before_the_arithmetic(chains):
    """Every function of a module (methods belong to their records) before the first array function
    of the instrument, listed: those that have returned count as well.
    """
    start = next(k for k, c in enumerate(chains) if "bias.numeric" in c[-1])
    walked = dict.fromkeys(
        chain[-1]
        for chain in chains[:start]
        if chain[-1].startswith(("cli.", "pipeline.", "instruments."))
        and not is_numeric(chain[-1])
        and chain[-1].rpartition(".")[0].rpartition(".")[2].islower()
    )
    assert list(walked) == STOPS
    assert len(STOPS) - 1 <= MOST  # beside the command
