"""Command line: parse, call, print, exit status; nothing else. Heavy libraries are imported inside
the commands.
"""

import os
import sys
from collections.abc import Sequence
from typing import NoReturn

import click

from calibkit.cli import fleets, logs, outputs, plans, records, results
from calibkit.cli.console import prepare_streams
from calibkit.cli.ending import run_to_exit_code
from calibkit.cli.options import CommandGroup
from calibkit.records.version import __version__


@click.group(
    cls=CommandGroup,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)
@click.version_option(__version__, prog_name="calibkit", message="%(prog)s %(version)s")
def cli() -> None:
    """From laboratory logs to versioned coefficient files of gyros, accelerometers and
    inclinometers.

    \b
    calibkit fit fog_thermal --data logs --serial FOG-0001
    calibkit apply FOG-0001 --data field.csv --out compensated.csv

    Exit codes: 0 accepted or no verdict, 1 an acceptance limit failed, 2 usage or recipe, 3 data
    unreadable or unusable, 4 output or verification,
    5 not checked, 70 internal error, 130 interrupted.
    """


for subcommand in (
    logs.fit,
    logs.check,
    logs.init,
    logs.apply,
    logs.validate,
    outputs.certify,
    outputs.sign,
    fleets.fleet,
    outputs.export,
    results.evaluate,
    results.compare,
    outputs.report,
    results.open_page,
    records.verify,
    records.show,
    records.history,
    plans.plan,
    logs.simulate,
):
    cli.add_command(subcommand)


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command line and exit with the contract's codes."""
    # libraries loaded later start no threads that calibkit.libraries.threads must stop
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    argv = list(sys.argv[1:] if arguments is None else arguments)
    prepare_streams()
    sys.exit(
        run_to_exit_code(
            lambda: cli.main(argv, prog_name="calibkit", standalone_mode=False),
            as_json="--json" in argv,
        )
    )
