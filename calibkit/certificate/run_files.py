"""The files of a run that a certificate is made from, and what they state."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from calibkit.certificate.words import Words
from calibkit.coefficients import Condition, Criterion, Input, Record
from calibkit.new_files import RUN_FILE
from calibkit.report.run import stated_criteria
from calibkit.store import Run


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
    excluded: tuple[tuple[str, str, str], ...]
    """What was left out, why, by whom."""
    criteria: tuple[Criterion, ...]
    flags: tuple[str, ...]
    conditions: tuple[Condition, ...]
    accepted: bool
    """Whether the run met its acceptance limits."""

    @property
    def content_digest(self) -> Words:
        """The run with the digest of its content, which is not that of its file, and where it is
        found.
        """
        return Words(
            f"Run {self.name}, digest of its content (field sha256 of run.json; the SHA-256 of the"
            " file is another): ",
            f"处理记录 {self.name}，内容摘要（run.json 的 sha256 字段，并非文件的 SHA-256）：",
        ) + Words(self.sha256)


def read_run(run: Run) -> RunFiles:
    """The files of a run folder."""
    contents = {name: (run.folder / name).read_bytes() for name in (*run.records, RUN_FILE)}
    return RunFiles(run.document, run.records, contents)


def run_facts(run: RunFiles) -> RunFacts:
    """What run.json and the coefficient files state of a run."""
    document = run.document
    conditions = {c.name: c for record in run.records.values() for c in record.conditions}
    return RunFacts(
        name=run.name,
        serial=document["serial"],
        procedure=document["procedure"],
        sha256=document["sha256"],
        software=document["software"],
        effective_from=document["effective_from"],
        recipe=document["recipe"]["name"],
        recipe_sha256=document["recipe"]["sha256"],
        inputs=stated_inputs(document["inputs"]),
        excluded=tuple((_range(e), e["reason"], e["person"]) for e in document["excluded"]),
        criteria=stated_criteria(document),
        flags=tuple(document["flags"]),
        conditions=tuple(conditions.values()),
        accepted=document["accepted"],
    )


def _range(entry: Mapping[str, Any]) -> str:
    """A log, or the range of it, that was left out."""
    ends = [
        f"{word} {entry[key]:g} s"
        for word, key in (("from", "from_s"), ("to", "to_s"))
        if entry.get(key) is not None
    ]
    return " ".join((entry["log"], *ends))


def stated_inputs(entries: Iterable[Mapping[str, Any]]) -> tuple[Input, ...]:
    """Logs that a file lists."""
    return tuple(Input(entry["name"], entry["sha256"], entry["rows"]) for entry in entries)
