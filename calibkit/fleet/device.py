"""One device of a fleet: its run of an earlier call, a new fit, or the reason why it has none."""

import contextlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calibkit import instruments, recipe
from calibkit.check import copies
from calibkit.commands import pipeline
from calibkit.errors import CalibkitError, CoefficientError, TakenError
from calibkit.fleet import keys
from calibkit.fleet.keys import KeyFigure
from calibkit.logs import log_files
from calibkit.readers import parts
from calibkit.records import store
from calibkit.records.version import SOFTWARE


@dataclass(frozen=True, slots=True)
class DeviceTask:
    """What is done for every device: which recipe, where their folders are, where runs go, from
    when coefficients hold.
    """

    source: recipe.Source
    data: Path
    out: Path
    date: str
    """Date from which coefficients hold; "" where that of the logs' last row does."""
    dry_run: bool = False
    """Whether all is done but nothing written."""
    today: str = ""
    """Date from which coefficients of logs without dates hold."""

    def date_of(self, dates: Iterable[str]) -> str:
        """Date from which coefficients hold, by the last dates of logs or runs."""
        return self.date or max(dates, default="") or self.today


@dataclass(frozen=True, slots=True)
class Row:
    """A device and its run; of one without a run in the table its error."""

    serial: str
    run: str
    """rNNN."""
    run_sha256: str
    """Digest that run.json states of itself."""
    verdict: str
    """accepted, rejected or no verdict; in the table also failed or copied logs."""
    figures: tuple[KeyFigure, ...]
    inputs: tuple[Mapping[str, Any], ...]
    """Each log as run.json lists it: name, digest, fingerprint of its values."""
    guesses: tuple[str, ...]
    flags: int
    """Number of flags in the run."""
    before: bool
    """Whether the run was there already."""
    effective_from: str = ""
    """Date from which its coefficients hold; empty where it has none."""
    error: str = ""
    """Why the device has no run of its own."""

    @property
    def logs(self) -> tuple[str, ...]:
        """Names of the logs that the run was fitted to."""
        return tuple(entry["name"] for entry in self.inputs)


@dataclass(frozen=True, slots=True)
class Failure:
    """A device that has no run, and why."""

    serial: str
    code: str
    exit_code: int
    message: str
    hint: str

    @classmethod
    def of(cls, serial: str, error: Exception) -> "Failure":
        """Failure that an error is; what calibkit did not expect is internal."""
        if isinstance(error, CalibkitError):
            return cls(serial, error.code, error.exit_code, error.message, error.hint)
        return cls(
            serial, "internal", 70, f"internal error: {type(error).__name__}: {error}", "report it"
        )

    @classmethod
    def lost(cls, serial: str) -> "Failure":
        """Failure of a device whose fit no process survived."""
        return cls(
            serial,
            "internal",
            70,
            "every process that took this device up died",
            "killed, out of memory, or a crash: fit this device alone to see",
        )

    def error(self) -> CalibkitError:
        """The error again."""
        error = CalibkitError(f"{self.serial}: {self.message}", hint=self.hint)
        error.code, error.exit_code = self.code, self.exit_code
        return error


Outcome = Row | Failure


def fit_device(plan: DeviceTask, serial: str) -> Outcome:
    """Outcome of one device; never raises, so that one device's bad data do not stop the others."""
    try:
        return _finished(plan, serial)
    except Exception as error:  # noqa: BLE001 (whatever it is, it is this device's failure)
        return Failure.of(serial, error)


def _finished(plan: DeviceTask, serial: str) -> Row:
    """Row of a device: of the run that is there, or of the one that is fitted now.

    Where two processes fit it at once, as when a worker was believed dead, the second takes the run
    of the first.
    """
    spec = instruments.parse_recipe(plan.source)
    while True:
        expected = store.next_number(plan.out, serial)
        run = _already(plan, serial, spec)
        if run is not None:
            return _row(run, spec, before=True)
        with contextlib.suppress(TakenError):
            outcome = pipeline.fit(
                plan.source,
                plan.data / serial,
                serial,
                plan.out,
                plan.date or None,
                instruments.silent,
                dry_run=plan.dry_run,
                today=plan.today,
                expected=expected,
            )
            return _row(outcome.run, spec, before=False)


def _already(plan: DeviceTask, serial: str, spec: recipe.Recipe) -> store.StoredRun | None:
    """Newest run of a device by this software with this recipe, date and logs, whole and with right
    digests, or None.
    """
    candidates = []
    for number in reversed(store.revisions(plan.out / serial)):
        # what cannot be trusted is never used again, and never touched
        with contextlib.suppress(CoefficientError):
            run = store.load_revision(plan.out, serial, number)
            document = run.document
            dated = plan.date_of(entry.get("last_date", "") for entry in document["inputs"])
            terms = document["software"], document["recipe"]["sha256"], document["effective_from"]
            if terms == (SOFTWARE, plan.source.sha256, dated):
                candidates.append(run)
    if not candidates:
        return None
    logs = {
        file: parts.digest_log(plan.data / serial / file, file, split=spec.logs.split)
        for file in log_files.find_logs(spec, plan.data / serial)
    }
    second_loggers = _second_loggers(plan.data / serial, spec)
    for run in candidates:
        inputs = run.document["inputs"]
        joined = {entry.get("second_logger_sha256") for entry in inputs} - {None}
        if (
            {entry["name"]: entry["sha256"] for entry in inputs} == logs
            and joined <= second_loggers
            and bool(joined) == (spec.chamber is not None)
        ):
            return run
    return None


def _second_loggers(folder: Path, spec: recipe.Recipe) -> set[str]:
    """Digests of the files of the second logger, where the recipe has one."""
    if spec.chamber is None:
        return set()
    return {
        parts.digest_log(path, path.name, split=False)
        for pattern in spec.chamber.files
        for path in folder.glob(pattern.replace("{log}", "*"))
        if path.is_file()
    }


def _row(run: store.StoredRun, spec: recipe.Recipe, *, before: bool) -> Row:
    """What the fleet's table states of a run."""
    document = run.document
    patterns = instruments.optional(spec.procedure, "KEY_FIGURES") or (".+",)
    return Row(
        serial=document["serial"],
        run=f"r{document['revision']:03d}",
        run_sha256=document["sha256"],
        verdict=document["verdict"],
        figures=keys.select_key_figures(run, patterns, spec.reference_temp_degc),
        inputs=tuple(
            {
                key: entry[key]
                for key in ("name", "sha256", copies.FINGERPRINT, copies.SAMPLE)
                if key in entry
            }
            for entry in document["inputs"]
        ),
        guesses=tuple(
            dict.fromkeys(
                guess for entry in document["inputs"] for guess in entry.get("guesses", ())
            )
        ),
        flags=len(document["flags"]),
        before=before,
        effective_from=document["effective_from"],
    )
