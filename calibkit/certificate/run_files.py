"""The files that a certificate is made from, those of a run and its validation, and what they
state.
"""

import hashlib
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from calibkit.certificate.words import Words
from calibkit.errors import CoefficientError, UsageError
from calibkit.numeric import gum
from calibkit.records import left_out, run_document, sealed, store
from calibkit.records.coefficients import Condition, Criterion, Input, Record
from calibkit.records.left_out import LeftOut
from calibkit.records.new_files import RUN_FILE
from calibkit.records.run_document import VALIDATION_FORMAT, Verdict
from calibkit.records.store import StoredRun
from calibkit.report.run import stated_criteria


@dataclass(frozen=True, slots=True)
class RunFiles:
    """The files of a run, from its folder or from a certificate: run.json, the coefficient files,
    and the bytes of both.
    """

    document: Mapping[str, Any]
    records: Mapping[str, Record]
    contents: Mapping[str, bytes]

    @property
    def name(self) -> str:
        """SERIAL@rNNN."""
        return f"{self.document['serial']}@r{self.document['revision']:03d}"

    def facts(self) -> "RunFacts":
        """What run.json and the coefficient files state of a run."""
        document = self.document
        conditions = {c.name: c for record in self.records.values() for c in record.conditions}
        return RunFacts(
            name=self.name,
            serial=document["serial"],
            procedure=document["procedure"],
            sha256=document["sha256"],
            software=document["software"],
            effective_from=document["effective_from"],
            recipe=document["recipe"]["name"],
            recipe_sha256=document["recipe"]["sha256"],
            inputs=_stated_inputs(document["inputs"]),
            measured=_measured(document["inputs"]),
            excluded=tuple((_range(e), e["reason"], e["person"]) for e in document["excluded"]),
            criteria=stated_criteria(document),
            flags=tuple(document["flags"]),
            left_out=left_out.loads(document.get("left_out", ()), RUN_FILE),
            conditions=tuple(conditions.values()),
            verdict=document["verdict"],
        )

    @classmethod
    def read(cls, run: StoredRun) -> Self:
        """The files of a run folder."""
        contents = {name: store.read_bytes(run.folder / name) for name in (*run.records, RUN_FILE)}
        return cls(run.document, run.records, contents)

    @classmethod
    def parse(cls, contents: Mapping[str, bytes]) -> Self:
        """The run whose files are among these; CoefficientError for the first that is missing,
        damaged, or of another run.
        """
        if RUN_FILE not in contents:
            raise CoefficientError(f"{RUN_FILE} is not attached")
        document = run_document.loads(store.decode(contents[RUN_FILE], RUN_FILE), RUN_FILE)
        records = {}
        for entry in document["files"]:
            name = entry["name"]
            if name in contents:
                text = store.decode(contents[name], name)
                records[name] = store.own_record(document, name, text, name)
                if hashlib.sha256(contents[name]).hexdigest() != entry["sha256"]:
                    raise CoefficientError(
                        f"{name}: the attached file is not the one that run.json lists"
                    )
            elif name.endswith(".json"):
                raise CoefficientError(f"{name} is not attached")
        return cls(document, records, contents)


@dataclass(frozen=True, slots=True)
class RunFacts:
    """What run.json states."""

    name: str
    serial: str
    procedure: str
    sha256: str
    software: str
    effective_from: str
    recipe: str
    recipe_sha256: str
    inputs: tuple[Input, ...]
    measured: tuple[tuple[str, float, float], ...]
    """Column, lowest and highest reading of the thermometers in all logs."""
    excluded: tuple[tuple[str, str, str], ...]
    """What was left out, why, by whom."""
    criteria: tuple[Criterion, ...]
    flags: tuple[str, ...]
    left_out: tuple[LeftOut, ...]
    conditions: tuple[Condition, ...]
    verdict: Verdict
    """On the run's acceptance limits."""

    @property
    def content_digest(self) -> Words:
        """The run with the digest of its content, which is not that of its file, and where it is
        found.
        """
        return Words(
            "Run {name}, digest of its content (field sha256 of run.json; the SHA-256 of the file"
            " is another): {sha256}",
            name=self.name,
            sha256=self.sha256,
        )


def _range(entry: Mapping[str, Any]) -> str:
    """A log that was left out, or which part of it: a range of time [s], rows or lines."""
    ends = [
        f"{word} {entry[key]:.12g} s"
        for word, key in (("from", "from_s"), ("to", "to_s"))
        if entry.get(key) is not None
    ]
    parts = [
        f"{key} {', '.join(map(str, entry[key]))}"
        for key in ("rows", "lines", "positions", "stations")
        if entry.get(key)
    ]
    return " ".join((entry["log"], *ends, *parts))


def _stated_inputs(entries: Iterable[Mapping[str, Any]]) -> tuple[Input, ...]:
    """Logs that a file lists."""
    return tuple(Input(entry["name"], entry["sha256"], entry["rows"]) for entry in entries)


def _measured(entries: Iterable[Mapping[str, Any]]) -> tuple[tuple[str, float, float], ...]:
    """Lowest and highest reading of the thermometers in all logs; none in runs of before."""
    readings: dict[str, list[float]] = {}
    for entry in entries:
        for column, ends in entry.get("measured", {}).items():
            readings.setdefault(column, []).extend(ends)
    return tuple((column, min(ends), max(ends)) for column, ends in readings.items())


@dataclass(frozen=True, slots=True)
class BeforeAfter:
    """One quantity of one log, as found and as left, in one unit; descriptors, unless an
    uncertainty is stated.
    """

    log: str
    quantity: Words
    as_found: float | None
    as_left: float | None
    unit: str
    left_u: float | None = None
    """Expanded uncertainty (about 95 %) of the as-left result where the validation states one."""
    left_k: float | None = None
    """Its coverage factor."""


@dataclass(frozen=True, slots=True)
class AsFoundAsLeft:
    """The rows, the logs that they come from, the limits of the recipe, the text of the file."""

    rows: tuple[BeforeAfter, ...]
    check_points: tuple[BeforeAfter, ...]
    logs: tuple[Input, ...]
    criteria: tuple[Criterion, ...]
    flags: tuple[str, ...]
    text: str

    @staticmethod
    def load(path: Path, run: RunFiles) -> "AsFoundAsLeft":
        """Read a validation of a run; CoefficientError for another run's, UsageError where there is
        no such file.
        """
        try:
            content = path.read_bytes()
        except OSError as error:
            raise UsageError(
                f"--validation {path}: {error.strerror}", hint="write one with calibkit validate"
            ) from None
        return AsFoundAsLeft.parse(content, str(path), run)

    @classmethod
    def parse(cls, content: bytes, name: str, run: RunFiles) -> Self:
        """Validation of a run from the bytes of its file; CoefficientError for another file, or
        another run's.
        """
        text = store.decode(content, name)
        document = sealed.unseal(text, name, VALIDATION_FORMAT)
        if document["run_sha256"] != run.document["sha256"]:
            raise CoefficientError(
                f"{name}: a validation of {document['serial']} r{document['revision']:03d}, not of"
                f" {run.name} as it is here",
                hint=f"run calibkit validate {run.name}",
            )
        logs = document["logs"]
        return cls(
            (*(row for entry in logs for row in _rows(entry)), *_pair(document)),
            tuple(row for entry in logs for row in _stations(entry)),
            _stated_inputs(logs),
            stated_criteria(document),
            tuple(document["flags"]),
            text,
        )


ANGLES = (
    ("residual_rms_g", Words("residual rms"), "g"),
    ("inclination_rms_deg", Words("inclination error, rms"), "deg"),
    ("inclination_max_deg", Words("inclination error, largest"), "deg"),
    ("toolface_rms_deg", Words("toolface error, rms"), "deg"),
    ("toolface_max_deg", Words("toolface error, largest"), "deg"),
    ("azimuth_rms_deg", Words("azimuth error, rms"), "deg"),
    ("azimuth_max_deg", Words("azimuth error, largest"), "deg"),
)


def _rows(entry: Mapping[str, Any]) -> Iterator[BeforeAfter]:
    """Figures of one log, whatever the procedure."""
    log = str(entry["name"])
    if "drift_rms_before" in entry:
        quantity = Words("drift rms, 100 s means")
        yield BeforeAfter(
            log, quantity, entry["drift_rms_before"], entry["drift_rms_after"], "deg/h"
        )
        yield BeforeAfter(log, Words("rate gain"), 1.0, entry["rate_gain"], "1")
    for gyro in entry.get("gyros", ()):
        before, after, name = gyro["before"], gyro["after"], gyro["gyro"]
        factor = gum.coverage_factor(max(gyro.get("scale_factor_error_dof", math.inf), 1.0))
        u = factor * gyro["scale_factor_error_standard_uncertainty_ppm"]
        errors = before["scale_factor_error_ppm"], after["scale_factor_error_ppm"]
        quantity = Words("gyro {name}: scale-factor error", name=name)
        yield BeforeAfter(log, quantity, *errors, "ppm", u, factor)
        rates = before["rate_error_rms_dps"], after["rate_error_rms_dps"]
        yield BeforeAfter(log, Words("gyro {name}: rate error rms", name=name), *rates, "deg/s")
    for channel in entry.get("channels", ()):
        quantity = Words("{channel}: standard deviation", channel=channel["name"])
        yield BeforeAfter(log, quantity, channel["before"], channel["after"], channel["unit"])
    if not isinstance(entry.get("before"), dict):
        return
    before, after = entry["before"], entry["after"]
    span = after.get("toolface_inclination_range_deg")
    for key, words, unit in ANGLES:
        if key in before or key in after:
            quantity = words
            if span and key.startswith("toolface"):
                quantity += Words(", inclination {low:g}° to {high:g}°", low=span[0], high=span[1])
            yield BeforeAfter(log, quantity, before.get(key), after.get(key), unit)


def _stations(entry: Mapping[str, Any]) -> Iterator[BeforeAfter]:
    """Azimuth error of every station with its expanded uncertainty."""
    for station in entry.get("stations", ()):
        if station.get("refused") or station.get("azimuth_error_after_deg") is None:
            continue
        u = station.get("azimuth_standard_uncertainty_deg")
        quantity = Words("station {station}: azimuth error", station=station["station"])
        before, after = station.get("azimuth_error_before_deg"), station["azimuth_error_after_deg"]
        expanded = () if u is None else (2.0 * u, 2.0)
        yield BeforeAfter(str(entry["name"]), quantity, before, after, "deg", *expanded)


def _pair(document: Mapping[str, Any]) -> Iterator[BeforeAfter]:
    """Differences of N, ε, γ, α found on other runs from those of the coefficients."""
    for entry in document.get("pair", ()):
        quantity = Words("{result}: difference of the new runs", result=entry["name"])
        factor = gum.coverage_factor(max(entry.get("dof", math.inf), 1.0))
        u = factor * entry["standard_uncertainty"]
        yield BeforeAfter("", quantity, None, entry["difference"], entry["unit"], u, factor)
