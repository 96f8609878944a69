"""Campaigns with a fault and the same without it: how often U covers the truth, and how often a
flag names the cause.
"""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import numpy as np

from intervals.physics import accelerometer, bias, campaigns, gyro, inclinometer
from intervals.rows import Case

if TYPE_CHECKING:
    from collections.abc import Sequence

    from intervals.physics.campaigns import Fault, Fitted

FAULTS = {
    f"{fault.procedure}, {fault.label}": fault
    for fault in (*accelerometer.FAULTS, *gyro.FAULTS, *inclinometer.FAULTS, *bias.FAULTS)
}
COVERED, COVERED_OR_NAMED = 0.88, 0.95
"""Least shares: of truths within U where nothing names the cause, and of either."""
FALSE_ALARMS = 0.01
"""Largest share of campaigns without the fault in which anything is flagged that the design of the
campaign does not earn.
"""


@dataclass(frozen=True)
class Outcome:
    """A campaign with its fault and without it."""

    fault: Fitted
    sound: Fitted


@dataclass(frozen=True)
class FaultRow:
    """One quantity of all campaigns of a fault, or of the same campaigns without it."""

    procedure: str
    fault: str
    present: bool
    quantity: str
    campaigns: int
    covered: float
    """Share of truths within U, over campaigns that give results and members."""
    flagged: float
    """Share of campaigns in which a flag or a refusal names the cause, but not without the fault;
    without the fault, of campaigns with any flag that their design does not earn.
    """
    noted: float
    """Share of campaigns in which a remark alone names the cause, whether or not it does without
    the fault.
    """
    covered_or_named: float
    """Share of truths within U, or in a campaign in which a flag or a remark names the cause."""
    expanded: float
    """Mean U."""
    error: float
    """Root mean square error."""
    refused: int
    rejected: int

    @property
    def faults(self) -> list[str]:
        """What the row must show and does not."""
        if not self.present:
            return ["false alarms"] * (self.flagged > FALSE_ALARMS) + ["rejected"] * bool(
                self.rejected + self.refused
            )
        named = self.flagged + self.noted
        unnamed = (self.covered_or_named - named) / max(1.0 - named, 1e-9)
        failed = ["covered or named"] * (self.covered_or_named < COVERED_OR_NAMED)
        return failed + ["covered"] * (named < 1.0 and unnamed < COVERED)

    @property
    def label(self) -> str:
        """What a row is of, in words."""
        present = "" if self.present else "without "
        return f"{self.procedure}: {present}{self.fault}: {self.quantity}"

    @property
    def cell(self) -> str:
        """Shares, mean U and rms error."""
        shares = (
            f"covered {100.0 * self.covered:.0f} %, flagged {100.0 * self.flagged:.0f} %"
            f" (noted {100.0 * self.noted:.0f} %), either {100.0 * self.covered_or_named:.0f} %"
        )
        text = f"{shares}, U {self.expanded:.3g}, rms error {self.error:.3g}"
        text += f", {self.refused} of {self.campaigns} refused" if self.refused else ""
        text += f", {self.rejected} rejected" if self.rejected else ""
        return f"**{text}: {', '.join(self.faults)}**" if self.faults else text

    def to_object(self) -> dict[str, object]:
        """Keys and values that JSON can hold."""
        return asdict(self)


def list_cases() -> list[Case]:
    """A case per fault; it stands for the same campaigns without the fault too."""
    return [
        Case("physics.rows", fault.procedure, label, fault.size, 0)
        for label, fault in FAULTS.items()
    ]


def simulate(case: Case, number: int) -> Outcome:
    """Simulate and fit one campaign with its fault and without it."""
    fault = FAULTS[case.error]
    seed = [*f"{fault.procedure}|{fault.name}".encode(), number]
    campaign, sound = (
        fault.campaign(np.random.default_rng(seed), size) for size in (fault.size, fault.sound)
    )
    return Outcome(campaigns.fit(campaign), campaigns.fit(sound))


def names_cause(fault: Fault, texts: Sequence[str]) -> bool:
    """Whether one of some flags names the cause."""
    return any(re.search(fault.causes, text) for text in texts)


def judge(case: Case, outcomes: Sequence[Outcome]) -> list[FaultRow]:
    """Rows of a fault, and of the same campaigns without it."""
    fault = FAULTS[case.error]
    alarms = np.array([names_cause(fault, outcome.sound.flags) for outcome in outcomes])
    flagged = np.array([names_cause(fault, outcome.fault.flags) for outcome in outcomes]) & ~alarms
    noted = np.array([names_cause(fault, outcome.fault.notes) for outcome in outcomes])
    noted &= ~flagged & ~alarms
    unearned = alarms | np.array(
        [
            any(not re.search(fault.by_design, text) for text in outcome.sound.flags)
            for outcome in outcomes
        ]
    )
    remarked = np.array([names_cause(fault, outcome.sound.notes) for outcome in outcomes]) & ~alarms
    return [
        *_judge(fault, [outcome.fault for outcome in outcomes], flagged, noted, present=True),
        *_judge(fault, [outcome.sound for outcome in outcomes], unearned, remarked, present=False),
    ]


def _judge(
    fault: Fault,
    fits: Sequence[Fitted],
    flagged: np.ndarray,
    noted: np.ndarray,
    *,
    present: bool,
) -> list[FaultRow]:
    """A row per quantity of campaigns that are flagged [n] or only noted [n]."""
    rows = []
    quantities = dict.fromkeys(name for fitted in fits for name in fitted.error)
    for quantity in quantities or ("",):
        # A refused campaign covers nothing; a result that is not stated covers nothing either.
        inside = np.zeros(len(fits))
        errors, widths = [], []
        for k, fitted in enumerate(fits):
            if quantity in fitted.error:
                error, half_width = fitted.error[quantity], fitted.half_width[quantity]
                inside[k] = float(np.mean(np.abs(error) <= half_width))
                errors.append(error)
                widths.append(half_width)
        results = np.array([quantity in fitted.error for fitted in fits])
        rows.append(
            FaultRow(
                fault.procedure,
                fault.label,
                present,
                quantity,
                len(fits),
                float(inside[results].mean()) if results.any() else 0.0,
                float(flagged.mean()),
                float(noted.mean()),
                float(np.maximum(inside, flagged | noted).mean()),
                _mean(widths),
                float(np.sqrt(_mean([error**2 for error in errors]))),
                sum(fitted.refused for fitted in fits),
                sum(fitted.rejected for fitted in fits),
            )
        )
    return rows


def _mean(values: Sequence[np.ndarray]) -> float:
    """Mean of all that are stated; 0 where none is."""
    finite = np.concatenate([*values, np.empty(0)])
    finite = finite[np.isfinite(finite)]
    return float(finite.mean()) if finite.size else 0.0
