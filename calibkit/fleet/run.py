"""A fleet from start to end: devices found, each fitted once, one table of all."""

import contextlib
import os
from collections import Counter
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from pathlib import Path

from calibkit import instruments, recipe
from calibkit.errors import CalibkitError, FrameError, OutputError, StoppedError, UsageError
from calibkit.fleet import cluster, files, local, table
from calibkit.fleet.device import DeviceTask, Failure, Outcome, Row, fit_device
from calibkit.fleet.table import FleetTable
from calibkit.instruments import Progress
from calibkit.records import atomic, clock, new_files, store


@dataclass(frozen=True, slots=True)
class Fleet:
    """A finished fleet: where its table is, what it holds, and the exit code of its worst
    outcome.
    """

    folder: Path
    table: FleetTable
    before: int
    """Devices whose run was there already."""
    guesses: tuple[str, ...]
    exit_code: int
    recipe: str
    """Its name."""


def run(
    source: recipe.Source,
    data: Path,
    out: Path,
    date: str,
    progress: Progress,
    *,
    jobs: int,
    address: str,
    keep_going: bool,
    dry_run: bool = False,
) -> Fleet:
    """Fit a recipe to every sub-folder of a folder, each under its name as serial, and write the
    table of them all.

    Without a date that of the last row of each device's logs holds. A device with a run of the same
    recipe, logs, date and software is not fitted again. Without
    `keep_going` the first device that cannot be fitted ends the fleet with its error; what was
    finished stays. A dry run fits but writes nothing.
    """
    spec = instruments.parse_recipe(source)
    today = clock.date_or_today(None)
    plan = DeviceTask(source, data.resolve(), out.resolve(), date, dry_run, today)
    serials, refused = _find_devices(plan, data, keep_going=keep_going)
    processes = 1 if address else max(1, min(jobs or os.cpu_count() or 1, len(serials)))
    _make_folder(plan.out, dry_run=dry_run)
    outcomes: list[Outcome] = [*refused]
    try:
        with contextlib.closing(_outcomes(plan, serials, processes, address)) as finished:
            for fitted_outcome, _ in zip(finished, progress(serials, "devices"), strict=True):
                outcome = _require_run_here(fitted_outcome, plan)
                if isinstance(outcome, Failure) and not keep_going:
                    raise _stopping_error(outcome, 0 if dry_run else len(outcomes))
                outcomes.append(outcome)
    except KeyboardInterrupt:
        raise StoppedError(
            f"interrupted after {len(outcomes)} of {len(serials)} devices",
            hint="nothing was written" if dry_run else "their runs stay; run again to go on",
        ) from None
    return _finish(plan, outcomes, spec.title or spec.procedure)


def _finish(plan: DeviceTask, outcomes: Sequence[Outcome], title: str) -> Fleet:
    """Make the table of a fleet and write it."""
    fleet_table = table.build_table(outcomes, plan.data)
    contents = files.make_files(fleet_table, plan, f"{title}: {len(outcomes)} devices")
    rows = [outcome for outcome in outcomes if isinstance(outcome, Row)]
    return Fleet(
        _commit(plan.out, contents, dry_run=plan.dry_run),
        fleet_table,
        sum(row.before for row in rows),
        _guesses(rows),
        _exit_code(outcomes, fleet_table),
        plan.source.name,
    )


def _stopping_error(failure: Failure, finished: int) -> CalibkitError:
    """Error of the device that ends a fleet."""
    error = failure.error()
    stay = f"{finished} devices are finished and stay" if finished else "nothing was written"
    error.hint = "; ".join(
        filter(None, (error.hint, f"{stay}; --keep-going goes on with the others"))
    )
    return error


def _find_devices(
    plan: DeviceTask, data: Path, *, keep_going: bool
) -> tuple[list[str], list[Failure]]:
    """Serials in order, and the sub-folders whose names are no serials; hidden ones are passed
    over.
    """
    if not data.is_dir():
        raise UsageError(
            f"--data {data}: no such folder",
            hint="name the folder that holds one sub-folder per device",
        )
    if plan.data in (plan.out, *plan.out.parents):
        raise UsageError(
            f"--out {plan.out.name} lies in --data: it would be taken for a device",
            hint="keep them apart",
        )
    try:
        folders = [path.name for path in data.iterdir() if path.is_dir()]
    except OSError as error:
        raise FrameError(
            f"{data}: cannot be read: {error.strerror}", hint="check --data and its disk"
        ) from None
    names = sorted(name for name in folders if not name.startswith("."))
    if not names:
        raise FrameError(
            f"{data}: holds no sub-folder, so no device",
            hint="a device is a sub-folder named by its serial",
        )
    serials, refused = [], []
    for name in names:
        try:
            serials.append(store.check_serial(name))
        except UsageError as error:
            if not keep_going:
                raise
            refused.append(Failure.of(name, error))
    return serials, refused


def _make_folder(out: Path, *, dry_run: bool) -> None:
    """Create the folder of the runs, or see whether it could be."""
    if dry_run:
        existing_folder = next(path for path in (out, *out.parents) if os.path.lexists(path))
        if not (existing_folder.is_dir() and os.access(existing_folder, os.W_OK)):
            raise OutputError(
                f"{out}: cannot be written: {existing_folder} cannot be written into",
                hint="give another --out",
            )
        return
    with new_files.output_errors(out, "give another --out"):
        atomic.make_folder(out)


def _outcomes(
    plan: DeviceTask, serials: Sequence[str], processes: int, address: str
) -> Generator[Outcome]:
    """Outcome of every device, as it is finished."""
    if address:
        return cluster.fit_devices(plan, serials, address)
    if processes == 1:
        return (fit_device(plan, serial) for serial in serials)
    return local.fit_devices(fit_device, plan, serials, processes)


def _require_run_here(outcome: Outcome, plan: DeviceTask) -> Outcome:
    """The outcome, or a failure where the run that a worker wrote is not in the folder that this
    process sees.
    """
    if plan.dry_run or isinstance(outcome, Failure):
        return outcome
    if not (plan.out / outcome.serial / outcome.run / new_files.RUN_FILE).is_file():
        error = OutputError(
            f"a worker wrote {outcome.run}, which is not in --out here",
            hint="--out must be the same folder under the same path on every worker",
        )
        return Failure.of(outcome.serial, error)
    return outcome


def _commit(out: Path, contents: dict[str, bytes], *, dry_run: bool) -> Path:
    """Folder of the fleet's table: the one that holds these very bytes already, or the next
    revision.
    """
    saved = None
    while saved is None:
        numbers = store.revisions(out / store.FLEETS)
        for number in reversed(numbers):
            folder = out / store.FLEETS / f"r{number:03d}"
            if contents == {
                path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()
            }:
                return folder
        number = max(numbers, default=0) + 1
        saved = store.save(out, store.FLEETS, number, contents, dry_run=dry_run)
    return saved


def _guesses(rows: Sequence[Row]) -> tuple[str, ...]:
    """What was guessed of how logs are written, one line per guess."""
    counts = Counter(guess for row in rows for guess in row.guesses)
    return tuple(
        f"{count} units: {guess}; pin it in the recipe" for guess, count in sorted(counts.items())
    )


def _exit_code(outcomes: Sequence[Outcome], fleet_table: FleetTable) -> int:
    """The worst of all devices: 0 accepted, 1 a limit failed, else the highest code of a device
    that has no run of its own.
    """
    codes = [outcome.exit_code for outcome in outcomes if isinstance(outcome, Failure)]
    codes += [
        FrameError.exit_code for entry in fleet_table.entries if entry.verdict == table.COPIED
    ]
    codes += [1 for entry in fleet_table.entries if entry.verdict == "rejected"]
    return max(codes, default=0)
