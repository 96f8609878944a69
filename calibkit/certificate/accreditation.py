"""What a laboratory is accredited for: which results are in its scope, and the smallest expanded
uncertainty (CMC) that it may state of them (ILAC P14).
"""

from __future__ import annotations

import fnmatch
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from calibkit import units
from calibkit.certificate.results import Contribution, Result
from calibkit.certificate.words import Words
from calibkit.errors import RecipeError
from calibkit.recipe.type_b import RELATIVE

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from calibkit.certificate.profile import Capability

FLOOR = Words("smallest uncertainty of the accreditation (CMC)")
"""Name of the contribution that raises U to the CMC."""


@dataclass(frozen=True, slots=True)
class Scope:
    """Capabilities of a laboratory, and whether it is accredited; without them nothing is raised
    and nothing marked.
    """

    capabilities: tuple[Capability, ...] = ()
    accredited: bool = False

    def raise_to_floor(self, result: Result) -> Result:
        """The result with U no smaller than its CMC, marked where it is outside the scope;
        RecipeError for a CMC in another unit.
        """
        floors = list(_floors(self.capabilities, result))
        if not floors:
            return replace(result, outside_scope=self.accredited)
        u, floor = result.uncertainty, max(floors)
        if u is None or u.expanded_uncertainty >= floor:
            return result
        u_floor = floor / u.coverage_factor
        missing = math.sqrt(u_floor**2 - u.standard_uncertainty**2)
        added = Contribution(FLOOR, "CMC", "", missing, "", "normal", math.inf)
        raised = replace(
            u,
            contributions=(*u.contributions, added),
            standard_uncertainty=u_floor,
            expanded_uncertainty=floor,
        )
        return replace(result, uncertainty=raised)


def is_raised(result: Result) -> bool:
    """Whether U of a result is the CMC, which is larger than what was found."""
    uncertainty = result.uncertainty
    return uncertainty is not None and any(part.kind == "CMC" for part in uncertainty.contributions)


def _floors(capabilities: Sequence[Capability], result: Result) -> Iterator[float]:
    """Smallest expanded uncertainties of a result, in its unit."""
    for number, capability in enumerate(capabilities):
        if not fnmatch.fnmatchcase(result.key, capability.result):
            continue
        unit = units.ALIASES.get(capability.unit, capability.unit)
        if unit in RELATIVE and result.unit != unit:
            yield capability.expanded_uncertainty * RELATIVE[unit] * abs(result.value)
        elif unit == result.unit:
            yield capability.expanded_uncertainty
        else:
            raise RecipeError(
                f"[[cmc]] '{capability.result}' is in '{capability.unit}',"
                f" {result.key} in '{result.unit}'",
                hint="state it in the unit of the result, in ppm or in %",
                at=("cmc", number, "unit"),
            )
