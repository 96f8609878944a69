"""Reports of `calibkit check` on the logs of a folder: a document for scripts, lines for people."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from calibkit.check.facts import Facts
from calibkit.errors import FitError, FrameError
from calibkit.numeric.constants import SECONDS_PER_HOUR
from calibkit.records.frame import Finding, Severity
from calibkit.report.overview import concise, describe_span
from calibkit.report.screen import MOST, arrange, shorten, wrap
from calibkit.report.table import Cell, Table

WORDS = {"refuse": "REFUSED", "warn": "flagged", "note": "note   "}
"""Severity → the word that begins a line."""
MOST_NAMED = 4
"""Refused logs that the first line names; the rest are counted."""
_MOST_JUDGED = 8
"""Lines of a screen on what the campaign determines."""
ASSUMED = "wanted: U is a prediction of the plan; errors of the bench are assumed, not measured"
MOST_HELD = 12
"""Held conditions that are listed; the rest are counted."""


@dataclass(frozen=True, slots=True)
class HeldCondition:
    """A held condition by time [s] where the log has it, else by row."""

    kind: str
    first: float
    last: float
    level: float
    unit: str
    rows: int
    pinned: bool

    def __str__(self) -> str:
        sign = "+" if self.unit == "°C/min" else ""
        level = f"{self.level:{sign}.4g} {self.unit}"
        return (
            f"{self.kind} {level} from {self.first:g} to"
            f" {self.last:g}{' (pinned)' if self.pinned else ''}"
        )


@dataclass(frozen=True, slots=True)
class LogReport:
    """One log: how it was read, what it holds, what was found. Facts are absent where it could not
    be read.
    """

    file: str
    sha256: str
    reading: tuple[str, ...]
    notes: tuple[str, ...]
    facts: Facts | None
    held: tuple[HeldCondition, ...]
    findings: tuple[Finding, ...]

    @property
    def refused(self) -> bool:
        """Whether a fit refuses the log."""
        return any(finding.refused for finding in self.findings)

    @property
    def flagged(self) -> bool:
        """Whether a fit carries a flag on the log along."""
        return any(finding.flagged for finding in self.findings)

    def lines(self) -> list[str]:
        """Lines about one log: what it holds, then what was found, the worst first."""
        unlisted = len(self.held) - MOST_HELD
        order = list(WORDS)
        ranked = sorted(self.findings, key=lambda finding: order.index(finding.severity))
        lines = [
            *(_describe_facts(self.facts) if self.facts else ()),
            *self.reading,
            *self.notes,
            *map(str, self.held[:MOST_HELD]),
            *([f"… and {unlisted} more {self.held[-1].kind}s"] if unlisted > 0 else ()),
            *(f"{WORDS[finding.severity]} {finding}" for finding in ranked),
        ]
        title = self.file if self.findings else f"{self.file}: ok"
        return [title, *(f"  {line}" for line in lines)]


@dataclass(frozen=True, slots=True)
class Reached:
    """Expanded uncertainty of a result, the largest over where it is used, and what limits it."""

    name: str
    unit: str
    expanded_uncertainty: float
    coverage_factor: float
    where: str
    """Range or point of its inputs; empty where it has none."""
    largest_part: str
    wanted: float | None = None
    """What the plan wanted at most; None for what the fit on trial states."""

    def __str__(self) -> str:
        limit_text = "" if self.wanted is None else f", wanted at most {concise(self.wanted)}"
        where = f"{self.where}; " if self.where else ""
        return (
            f"U of {self.name} {concise(self.expanded_uncertainty)} {self.unit}{limit_text}"
            f" ({where}k = {self.coverage_factor:.3g}; largest part: {self.largest_part})"
        )


@dataclass(frozen=True, slots=True)
class Judgement:
    """What the logs of a campaign determine together, and whether a fit would export it (None
    where that was not tried); the verdict and the exit code that the fit would have.
    """

    determines: tuple[str, ...]
    lacks: tuple[str, ...]
    exports: bool | None
    verdict: str = ""
    exit_code: int = 0
    reached: tuple[Reached, ...] = ()
    """Uncertainty of results by the fit on trial."""
    predicted: tuple[Reached, ...] = ()
    """Uncertainty of the results that a plan wants, as it judges them over its range."""

    @property
    def outcome(self) -> str:
        """What a fit would do, as a sentence; empty where none was tried."""
        if self.exports is None:
            return ""
        outcome = f"be {self.verdict}" if self.exports else f"export no correction: {self.verdict}"
        if self.exit_code:
            outcome = f"export nothing: exit code {self.exit_code}"
        return f"A fit of these logs would {outcome}."

    def lines(self) -> list[str]:
        """The last paragraph of a check."""
        determined = "; ".join(self.determines) or (
            "not tried" if self.exports is None else "nothing"
        )
        return [
            f"This campaign determines: {determined}",
            *(f"  missing: {lack}" for lack in self.lacks),
            *(f"  {result}" for result in self.reached),
            *(f"  {prediction}" for prediction in self.predicted),
            *([f"  {ASSUMED}"] if self.predicted else ()),
        ]


@dataclass(frozen=True, slots=True)
class CheckedCampaign:
    """What a check finds: each log, and what all of them determine."""

    logs: tuple[LogReport, ...]
    judgement: Judgement


def _judge_logs(reports: Sequence[LogReport]) -> str:
    """How many logs of a campaign are ok, and which are refused for what, in a line."""
    refused = []
    for report in reports:
        if report.refused:
            first = next(finding for finding in report.findings if finding.refused)
            refused.append(f"{report.file} ({first.found})")
    ok, noun = len(reports) - len(refused), "log" if len(reports) == 1 else "logs"
    overflow = [f"{len(refused) - MOST_NAMED} more"] if len(refused) > MOST_NAMED else []
    refused_text = "; ".join([*refused[:MOST_NAMED], *overflow])
    count_text = f"{ok} of {len(reports)} {noun} ok"
    return f"{count_text}, {len(refused)} refused: {refused_text}" if refused else count_text


def compose_report(campaign: CheckedCampaign, tail: Sequence[str], width: int = 0) -> list[str]:
    """Lines of a screen of a width: the verdict on the logs, a line per log, what was found with
    one line per cause, what the campaign determines, and the tail. Where all about each log fits,
    or without a width, it is all.
    """
    reports = campaign.logs
    judgement_lines = campaign.judgement.lines()
    verdicts = [*filter(None, (_judge_logs(reports), campaign.judgement.outcome))]
    full = [
        *verdicts,
        *(line for report in reports for line in report.lines()),
        *judgement_lines,
        *tail,
    ]
    if not width or len(full) <= MOST:
        return full
    end = [line for text in judgement_lines for line in wrap(text, width, 2)]
    end = [*shorten(end, _MOST_JUDGED), *tail]
    return arrange(verdicts, [_tabulate_logs(reports)], _causes(reports), end, width)


def _causes(reports: Sequence[LogReport]) -> list[str]:
    """One line per cause that refuses or flags logs, refusals first: the first finding of its kind,
    and how many more logs have it.
    """
    findings_by_cause: dict[tuple[Severity, str, str], list[tuple[str, Finding]]] = {}
    for severity in ("refuse", "warn"):
        for report in reports:
            for finding in report.findings:
                if finding.severity == severity:
                    cause = finding.severity, finding.name, finding.column
                    findings_by_cause.setdefault(cause, []).append((report.file, finding))
    lines = []
    for (severity, _, _), cases in findings_by_cause.items():
        logs = len({file for file, _ in cases})
        count = f"[{logs} logs] " if logs > 1 else ""
        lines.append(f"{WORDS[severity]} {count}{cases[0][1]}")
    return lines


def _tabulate_logs(reports: Sequence[LogReport]) -> Table:
    """A line per log: whether it is ok, its rows and hours, its temperatures, what was held."""
    rows: list[tuple[Cell, ...]] = []
    for report in reports:
        facts = report.facts
        state = "REFUSED" if report.refused else "flagged" if report.flagged else "ok"
        if facts is None:
            rows.append((report.file, state, "", "", "", ""))
            continue
        degc = next((column for column in facts.columns if column.name.endswith("_degc")), None)
        kinds: dict[str, list[HeldCondition]] = {}
        for condition in report.held:
            kinds.setdefault(condition.kind, []).append(condition)
        # the level of the only one of its kind
        held = [
            f"{len(same)} {kind}s"
            if len(same) > 1
            else f"{kind} {same[0].level:.3g} {same[0].unit}"
            for kind, same in kinds.items()
        ]
        rows.append(
            (
                report.file,
                state,
                f"{facts.rows:,}",
                f"{facts.duration_s / SECONDS_PER_HOUR:.2f}" if facts.rate_hz else "",
                "" if degc is None else describe_span(degc.low, degc.high, "").strip(),
                ", ".join(held),
            )
        )
    return Table("", ("log", "", "rows", "hours", "°C", "held"), tuple(rows))


def report_document(campaign: CheckedCampaign) -> dict[str, Any]:
    """JSON document of a check: `ok` where a fit would go on, else the first thing that stops it,
    then each log, and what all of them determine.
    """
    reports, judgement = campaign.logs, campaign.judgement
    logs = []
    for report in reports:
        findings = [asdict(finding) | {"refused": finding.refused} for finding in report.findings]
        for finding in findings:
            del finding["column"]  # its place names it
        entry = {name: value for name, value in asdict(report).items() if name != "file"}
        logs.append({"log": report.file, **entry, "findings": findings})
    content = {"logs": logs, "campaign": asdict(judgement)}
    refused = [finding for report in reports for finding in report.findings if finding.refused]
    if not refused and judgement.exit_code:
        error = {"code": FitError.code, "message": "; ".join(judgement.lacks), "hint": ""}
        return {"ok": False, "error": error, **content}
    if not refused:
        return {"ok": True, **content}
    first, count = refused[0], sum(report.refused for report in reports)
    message = f"{first.place}: {first.said}"
    message += f" ({count} of {len(reports)} logs are refused)" if count > 1 else ""
    error = {"code": FrameError.code, "message": message, "hint": first.advice}
    return {"ok": False, "error": error, **content}


def _describe_facts(facts: Facts) -> list[str]:
    """Lines about what a log holds."""
    lines = [f"{facts.rows:,} rows"]
    if facts.rate_hz:
        lines[0] += f" over {facts.duration_s:,.6g} s at {facts.rate_hz:.4g} Hz"
        if facts.irregularity > 0.01:
            lines[0] += f", intervals vary by {facts.irregularity:.0%}"
        if facts.gaps:
            lines[0] += f", {facts.gaps} gap{'s' if facts.gaps > 1 else ''}"
    for column in facts.columns:
        unit = "" if column.unit == "1" else f" {column.unit}"
        step = f", steps of {column.resolution:.3g}" if column.resolution else ", constant"
        lines.append(f"{column.name}: {column.low:.6g} to {column.high:.6g}{unit}{step}")
    if len(facts.occupancy) > 1:
        shares = ", ".join(f"{part.low:g}: {part.share:.0%}" for part in facts.occupancy)
        lines.append(f"share of the rows from each 10 °C: {shares}")
    return lines
