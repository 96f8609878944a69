"""Words in the two languages of a certificate, headings that PDF and DCC share, and how units are
printed.
"""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from calibkit.units import ANGLE_MARKS

if TYPE_CHECKING:
    from collections.abc import Iterable

Lang = Literal["en", "zh", "both"]
CATALOGUE = Path(__file__).with_name("words.zh.toml")


@cache
def catalogue() -> dict[str, str]:
    """English sentence → the same in Chinese, with the same values in braces."""
    return tomllib.loads(CATALOGUE.read_text(encoding="utf-8"))


@dataclass(init=False, unsafe_hash=True)
class Words:
    """Words on a certificate: in English here, in Chinese in the catalogue.

    Values stand in braces as `str.format` has them; a value may be words itself. Behind a `|`
    stands a note for the translator, which tells two uses of the same words apart and is never
    printed.
    """

    english: str
    values: tuple[tuple[str, object], ...]

    def __init__(self, english: str, /, **values: object) -> None:
        self.english, self.values = english, tuple(values.items())

    @classmethod
    def literal(cls, text: str) -> Words:
        """A symbol, a name or a user's own text, which is the same in both languages."""
        return cls("{text}", text=text)

    @classmethod
    def known(cls, text: str) -> Words:
        """A text that is put together elsewhere, in Chinese where the catalogue has it."""
        return cls(text) if text in catalogue() else cls.literal(text)

    @property
    def en(self) -> str:
        """The words in English."""
        values = {k: v.en if isinstance(v, Words) else v for k, v in self.values}
        return self.english.partition("|")[0].format(**values)

    @property
    def zh(self) -> str:
        """The words in Chinese, what has none among them in English; empty where the catalogue
        lacks them.
        """
        values = {k: v.zh or v.en if isinstance(v, Words) else v for k, v in self.values}
        return catalogue().get(self.english, "").format(**values)

    def of(self, lang: Lang) -> str:
        """The words in one language, or one beside the other."""
        english = self.en
        chinese = "" if lang == "en" else self.zh
        if not chinese or chinese == english:
            return english
        return chinese if lang == "zh" else f"{english} {chinese}"

    def fill(self, **values: object) -> Words:
        """The same words with their values."""
        return Words(self.english, **values)

    def __add__(self, other: Words) -> Words:
        return Words("{first}{second}", first=self, second=other)

    def join(self, parts: Iterable[Words]) -> Words:
        """Parts with these words between them; no words for none."""
        joined, *further = [*parts] or [Words("")]
        for part in further:
            joined = joined + self + part
        return joined


HEADINGS = {
    "parties": Words("Laboratory and customer"),
    "item": Words("Item calibrated"),
    "method": Words("Method|heading"),
    "conditions": Words("Conditions"),
    "traceability": Words("Traceability"),
    "results": Words("Results|heading"),
    "as_found": Words("As found and as left"),
    "conformity": Words("Conformity"),
    "budget": Words("Uncertainty budget"),
    "data": Words("Data and digests"),
    "authorisation": Words("Authorisation"),
    "amendment": Words("Amendment"),
    "principal": Words("Principal results"),
    "missing": Words("Missing for a certificate"),
    "remarks": Words("Remarks"),
}
SENTENCES = {
    "draft": Words("DRAFT"),
    "draft_line": Words("DRAFT: not a calibration certificate"),
    "number": Words("Certificate number"),
    "page": Words("Page {n} of {N}", n="{n}", N="{N}"),
    "end": Words("End of certificate"),
    "signature": Words("Signature"),
    "signed": Words(
        "Signed electronically: the signature is in this file; calibkit verify checks it."
    ),
    "only_item": Words(
        "The results relate only to the item calibrated, as it was when it was calibrated."
    ),
    "uncertainty": Words(
        "The expanded uncertainty U is the combined standard uncertainty times the coverage factor"
        " k beside each value, for a coverage probability of about 95 %. It combines the"
        " uncertainty of the fit (type A, from its covariance) with what is known of the equipment"
        " (type B). It holds at the time and under the conditions of the calibration; the item's"
        " long-term stability is not in it."
    ),
    "traceability": Words(
        "The results are traceable through the certificates of the standards below."
    ),
    "reproduction": Words(
        "This certificate may be reproduced only in full, except with the laboratory's written"
        " approval."
    ),
    "principal": Words(
        "All results, with the models and conditions that they hold for, stand on the pages that"
        " follow."
    ),
    "attached": Words(
        "The files below are attached to this PDF. The coefficients in them have all their digits"
        " and their covariance."
    ),
}
AS_FOUND, AS_LEFT = Words("as found"), Words("as left")
CONDITIONS = (
    ("chamber", Words("Chamber set points and holds")),
    ("laboratory_temperature", Words("Laboratory temperature")),
    ("local_gravity", Words("Local gravity")),
    ("latitude", Words("Latitude")),
    ("earth_rate", Words("Earth's rate")),
    ("supply", Words("Supply")),
    ("warm_up", Words("Warm-up")),
)
"""Key of [conditions] in the profile, and what it is called."""

UNIT_MARKS = {
    "": "",
    "1": "",
    "deg": "°",
    "degC": "°C",
    "arcsec": "″",
    "m/s^2": "m/s²",
    "ug": "µg",
    "deg/sqrt(h)": "°/√h",
    "ug/sqrt(Hz)": "µg/√Hz",
    "mg/sqrt(h)": "mg/√h",
    "mg*s": "mg·s",
}
"""Printed form of units, and of parts of compound units, that differ from their spelling in files.
"""
POWERS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")


def character_code(character: str) -> str:
    """A character by its number: [U+8BA1]."""
    return f"[U+{ord(character):04X}]"


def with_unit(number: str, mark: str) -> str:
    """A number with its unit: ° ′ ″ of plane angle stand without a space, nothing for none."""
    return f"{number}{mark}" if mark in ANGLE_MARKS else f"{number} {mark}".strip()


def unit_mark(unit: str) -> str:
    """Unit as it is printed, with one solidus or brackets: 1/deg → 1/°, deg/h/degC^2 → (°/h)/°C²,
    1/s/degC → 1/(s·°C); nothing for a pure number.
    """
    if unit in UNIT_MARKS:
        return UNIT_MARKS[unit]
    first, *factors = map(_mark_factor, re.findall(r"(?:[^/()]|\([^()]*\))+", unit))
    divisors = [mark for mark in factors if mark != "1"]
    if not divisors and first == "1":
        return ""
    if len(divisors) > 1 and first != "1":
        first, divisors = f"({first}/{divisors[0]})", divisors[1:]
    if len(divisors) > 1:
        flat = (mark.strip("()") for mark in sorted(divisors, key=lambda mark: "/" in mark))
        divisors = [f"({'·'.join(flat)})"]
    return "/".join((first, *divisors))


def _mark_factor(factor: str) -> str:
    """One factor of a unit: degC^2 → °C², sqrt(h) → √h, (1)^2 → 1."""
    base, _, power = factor.replace("*", "·").partition("^")
    if base[-1].isdigit() and base != "1":
        base, power = base[:-1], base[-1]
    base = re.sub(r"^\((\w+)\)$", r"\1", re.sub(r"^sqrt\((\w+)\)$", r"√\1", base))
    if base == "1":
        return "1"
    return base.replace("degC", "°C").replace("deg", "°") + power.translate(POWERS)
