"""What the digital calibration certificate of a standard states: its number, date, laboratory, the
largest expanded uncertainty of a quantity, and how long it holds (DCC 2 and 3).
"""

import calendar
import datetime as dt
import hashlib
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from calibkit.certificate import dcc_check, dcc_units
from calibkit.certificate.dcc_xml import DCC, NAMES, SI
from calibkit.errors import OutputError, RecipeError

if TYPE_CHECKING:
    from lxml.etree import _Element

EXPANDED = ("expandedMU", "expandedUnc", "expandedMUXMLList", "expandedUncXMLList")
"""Elements of expanded uncertainties, of one value and of lists, since D-SI 1."""
SIZES = ("valueExpandedMU", "uncertainty", "valueExpandedMUXMLList", "uncertaintyXMLList")
FACTORS = ("coverageFactor", "coverageFactorXMLList")
_PERIOD = re.compile(r"P(?:(\d+)Y)?(?:(\d+)M)?(?:(\d+)D)?")


@dataclass(frozen=True, slots=True)
class _Stated:
    """Expanded uncertainty of a quantity: its name, all that it may be called by, unit, U and its
    k.
    """

    name: str
    names: frozenset[str]
    unit: str
    expanded_uncertainty: float
    coverage_factor: float


def read(path: Path, result: str) -> dict[str, Any]:
    """Keys of a [[standard]] that its DCC fills; `result` names a quantity by its name, id, label
    or refType where the DCC has several units.

    Raises RecipeError for a file that is no DCC, or that states no one expanded uncertainty.
    """
    try:
        content = path.read_bytes()
        root = dcc_check.parse(content)
    except OSError as error:
        raise RecipeError(f"{path}: {error.strerror}", hint="name the standard's DCC") from None
    except OutputError as error:
        raise RecipeError(f"{path}: {error.message}", hint="name the standard's DCC") from None
    if root.tag != f"{{{DCC}}}digitalCalibrationCertificate":
        raise RecipeError(f"{path}: not a digital calibration certificate", hint="name a DCC")
    core = "dcc:administrativeData/dcc:coreData/dcc:"
    dates = (
        root.findtext(f"{core}{name}", "", NAMES) for name in ("issueDate", "endPerformanceDate")
    )
    date = next((dt.date.fromisoformat(one.strip()) for one in dates if one.strip()), None)
    chosen = _choose(list(_uncertainties(root)), result, path)
    item = "dcc:administrativeData/dcc:items/dcc:item"
    found = {
        "sha256": hashlib.sha256(content).hexdigest(),
        "certificate": root.findtext(f"{core}uniqueIdentifier", "", NAMES).strip(),
        "date": date,
        "laboratory": _name(root.find(".//dcc:calibrationLaboratory/dcc:contact", NAMES)),
        "name": _name(root.find(item, NAMES)),
        "serial": root.findtext(
            f"{item}/dcc:identifications/dcc:identification/dcc:value", "", NAMES
        ).strip(),
        "valid_until": _valid_until(root, date),
        "unit": chosen.unit,
        "expanded_uncertainty": chosen.expanded_uncertainty,
        "coverage_factor": chosen.coverage_factor,
    }
    return {key: value for key, value in found.items() if value not in ("", None)}


def _name(element: "_Element | None") -> str:
    """English name of an element, else its first one."""
    if element is None:
        return ""
    contents = element.findall("dcc:name/dcc:content", NAMES)
    english = [one for one in contents if one.get("lang") == "en"]
    return next((one.text or "" for one in (*english, *contents)), "").strip()


def _valid_until(root: "_Element", issued: dt.date | None) -> dt.date | None:
    """Last day of validity that a statement gives as a date or as a period from the issue."""
    for statement in root.iterfind(".//dcc:statements/dcc:statement", NAMES):
        valid = statement.findtext("dcc:valid", "", NAMES).strip() in {"true", "1"}
        date, period = (
            statement.findtext(f"dcc:{n}", "", NAMES).strip() for n in ("date", "period")
        )
        if valid and date:
            return dt.date.fromisoformat(date)
        if issued is not None and period and (found := _PERIOD.fullmatch(period)):
            years, months, days = (int(part or 0) for part in found.groups())
            more, month = divmod(issued.month - 1 + months + 12 * years, 12)
            year = issued.year + more
            day = min(issued.day, calendar.monthrange(year, month + 1)[1])
            return dt.date(year, month + 1, day) + dt.timedelta(days=days)
    return None


def _uncertainties(root: "_Element") -> Iterator[_Stated]:
    """Largest expanded uncertainty of every quantity of the results; the first of a hybrid."""
    for quantity in root.iterfind(".//dcc:results//dcc:quantity", NAMES):
        for real in quantity.iter(f"{{{SI}}}real", f"{{{SI}}}realListXMLList"):
            expanded = next(
                (one for name in EXPANDED for one in real.iter(f"{{{SI}}}{name}")), None
            )
            if expanded is None:
                continue
            sizes, factors = _numbers(expanded, SIZES), _numbers(expanded, FACTORS)
            spelt = {*(_text(real, ("unit", "unitXMLList")).split() or [r"\one"])}
            if not sizes or not factors or len(spelt) > 1:
                continue
            unit, scale = _unit(spelt.pop())
            k = max(range(len(sizes)), key=lambda j: sizes[j])
            factor = factors[k] if len(factors) > k else factors[0]
            yield _Stated(_name(quantity), _names(quantity, real), unit, sizes[k] * scale, factor)
            break


def _unit(spelt: str) -> tuple[str, float]:
    """Unit as calibkit spells it with its factor; one that it does not know as it is."""
    try:
        return dcc_units.spelling_of(spelt)
    except OutputError:
        return spelt, 1.0


def _names(quantity: "_Element", real: "_Element") -> frozenset[str]:
    """What a quantity may be called by: id, refTypes, labels, and names, also of what it is in."""
    found = [_text(real, ("label", "labelXMLList")), *_text(real, ("labelXMLList",)).split()]
    for element in (quantity, *quantity.iterancestors()):
        found += [element.get("id", ""), *element.get("refType", "").split()]
        found += [one.text or "" for one in element.iterfind("dcc:name/dcc:content", NAMES)]
    return frozenset(one.strip() for one in found if one.strip())


def _text(element: "_Element", names: Sequence[str]) -> str:
    """Text of the first of an element's own D-SI elements."""
    return next((t for n in names if (t := element.findtext(f"si:{n}", "", NAMES).strip())), "")


def _numbers(element: "_Element", names: Sequence[str]) -> list[float]:
    """Numbers of the first of an element's own D-SI elements."""
    return [float(item) for item in _text(element, names).split()]


def _choose(stated: Sequence[_Stated], result: str, path: Path) -> _Stated:
    """The largest expanded uncertainty of the quantity that is meant, or RecipeError."""
    named = [one for one in stated if not result or result in one.names]
    found: Mapping[str, list[_Stated]] = {
        unit: [one for one in named if one.unit == unit] for unit in {one.unit for one in named}
    }
    if len(found) == 1:
        return max(named, key=lambda one: one.expanded_uncertainty)
    if not stated:
        raise RecipeError(
            f"{path}: no expanded uncertainty with its coverage factor",
            hint="leave out dcc and state expanded_uncertainty and unit",
        )
    what = f"'{result}' names" if result else "it states"
    listed = "; ".join(sorted(f"{one.name} [{one.unit}]" for one in stated)[:8])
    raise RecipeError(
        f"{path}: {what} uncertainties of {len(found)} units, expected one",
        hint=f"name a quantity with result; there are: {listed}",
    )
