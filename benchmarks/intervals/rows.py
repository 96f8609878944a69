"""Cases, what comes out of a campaign, and how a row of campaigns is judged."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import beta

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

RATIOS = (0.5, 1.0, 3.0)
"""Sizes of a shared error, in dwell noises; 0 is the row without any."""
GROUPS = (5, 7, 9)
COVERED, COVERED_GIVEN = (0.92, 0.999), (0.92, 0.98)
"""Limits of the share that 95 % intervals cover; where the component is given."""
WIDEST, WIDEST_GIVEN = 1.6, 1.15
"""Limits of the mean half-width over the exact one with known components."""
FEW_DOF = 3
"""Degrees of freedom between groups below which intervals may have any width, with a warning."""
CONFIDENCE = 0.99
QUANTILE_99 = 2.5758293035489004
NONE = "none"


@dataclass(frozen=True, order=True)
class Case:
    """One kind of campaign."""

    instrument: str
    procedure: str
    error: str
    ratio: float
    """Size of the error, in dwell noises."""
    groups: int
    given: bool = field(default=False, kw_only=True)
    """Whether the recipe states the component."""
    between: int | None = field(default=None, kw_only=True)
    """Degrees of freedom between the groups, by design; None where the error is not of groups."""

    @property
    def seed(self) -> list[int]:
        """Entropy of the case, the same whichever cases are run beside it."""
        text = f"{self.procedure}|{self.error}|{self.ratio}|{self.groups}|{self.given}"
        return [20261122, *text.encode()]


@dataclass(frozen=True)
class Outcome:
    """One campaign."""

    inside: Mapping[str, Array]
    """Quantity → whether the truth of each of its m members is within the 95 % interval."""
    width: Mapping[str, Array]
    """Quantity → half-widths [m] over the exact ones."""
    warned: bool = False
    """Whether a flag names groups that are too few."""
    refused: str = ""
    """Why there is no fit."""
    rejected: bool = False
    """Whether a criterion failed, though the recipe sets no limits."""


@dataclass
class Row:
    """All campaigns of a case, of one quantity."""

    instrument: str
    procedure: str
    error: str
    ratio: float
    groups: int
    given: bool
    between: int | None
    quantity: str
    campaigns: int
    covered: float
    """Share, over campaigns and members."""
    least: float
    """Share of the member that is covered least."""
    width: float
    width_error: float
    """Standard error of the mean width."""
    warned: float
    """Share of campaigns with a warning of few groups."""
    refused: int
    rejected: int
    reasons: list[str] = field(default_factory=list)

    @property
    def interval(self) -> tuple[float, float]:
        """99 % interval of the covered share (Clopper & Pearson 1934); members of one campaign
        count as one trial.
        """
        n, k = self.campaigns, self.covered * self.campaigns
        tail = (1.0 - CONFIDENCE) / 2.0
        low = float(beta.ppf(tail, k, n - k + 1.0)) if k > 0.0 else 0.0
        high = float(beta.isf(tail, k + 1.0, n - k)) if k < n else 1.0
        return low, high

    @property
    def faults(self) -> list[str]:
        """What the row must show and does not."""
        found = []
        (least, most), widest = (COVERED_GIVEN, WIDEST_GIVEN) if self.given else (COVERED, WIDEST)
        if self.groups == GROUPS[1] and self.ratio <= 1.0:
            found += [name for name in ("refused", "rejected") if getattr(self, name)]
        if not self.campaigns:
            return found
        low, high = self.interval
        few = not self.given and self.between is not None and self.between < FEW_DOF
        if high < least or (low > most and not few):
            found.append("coverage")
        if few:
            found += [] if self.warned == 1.0 else ["no warning"]
        elif self.width - QUANTILE_99 * self.width_error > widest:
            found.append("width")
        return found

    @property
    def label(self) -> str:
        """What the row is of, in words."""
        given = ", given" if self.given else ""
        error = f"{self.error}{given} {self.ratio:g} ×, {self.groups}"
        return f"{self.procedure}: {self.quantity}; {error}"

    @property
    def cell(self) -> str:
        """Coverage with its interval, and width."""
        refused = f", {self.refused} refused" if self.refused else ""
        refused += f", {self.rejected} rejected" if self.rejected else ""
        if not self.campaigns:
            return f"all {self.refused} refused"
        low, high = self.interval
        text = (
            f"{100.0 * self.covered:.1f} % ({100.0 * low:.1f}–{100.0 * high:.1f}),"
            f" {self.width:.2f} ×{refused}"
        )
        return f"**{text}: {', '.join(self.faults)}**" if self.faults else text

    def to_object(self) -> dict[str, object]:
        """Keys and values that JSON can hold."""
        return asdict(self)


def judge(case: Case, outcomes: Sequence[Outcome]) -> list[Row]:
    """One row per quantity."""
    good = [one for one in outcomes if not one.refused]
    refused = [one.refused for one in outcomes if one.refused]
    quantities: Iterable[str] = good[0].inside if good else ("",)
    rows = []
    for name in quantities:
        inside = np.array([one.inside[name] for one in good], dtype=np.float64)
        width = np.array([np.mean(one.width[name]) for one in good])
        rows.append(
            Row(
                **asdict(case),
                quantity=name,
                campaigns=len(good),
                covered=float(inside.mean()) if good else 0.0,
                least=float(inside.mean(axis=0).min()) if good else 0.0,
                width=float(width.mean()) if good else 0.0,
                width_error=float(width.std(ddof=1) / np.sqrt(width.size))
                if len(good) > 1
                else float("inf"),
                warned=float(np.mean([one.warned for one in good])) if good else 0.0,
                refused=len(refused),
                rejected=sum(one.rejected for one in good),
                reasons=sorted(set(refused))[:3],
            )
        )
    return rows
