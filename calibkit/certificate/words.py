"""Words in the two languages of a certificate, and how units are printed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Lang = Literal["en", "zh", "both"]


@dataclass(frozen=True, slots=True)
class Words:
    """The same words in English and in Chinese; symbols and names that are alike in both are given
    once.
    """

    en: str
    zh: str = ""

    def of(self, lang: Lang) -> str:
        """The words in one language, or one beside the other."""
        if lang == "en" or not self.zh or self.zh == self.en:
            return self.en
        return self.zh if lang == "zh" else f"{self.en} {self.zh}"

    def __add__(self, other: Words) -> Words:
        return Words(self.en + other.en, (self.zh or self.en) + (other.zh or other.en))


UNIT_MARKS = {
    "1": "",
    "deg": "°",
    "degC": "°C",
    "arcsec": "″",
    "m/s^2": "m/s²",
    "ug": "µg",
    "deg/sqrt(h)": "°/√h",
}
"""Printed form of units, and of parts of compound units, that differ from their spelling in files.
"""
POWERS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")


def unit_mark(unit: str) -> str:
    """Unit as it is printed: 1/deg → 1/°, deg/h/degC^2 → °/h/°C², nothing for a pure number."""
    if unit in UNIT_MARKS:
        return UNIT_MARKS[unit]
    marked = unit
    for spelling in ("degC", "deg"):
        marked = marked.replace(spelling, UNIT_MARKS[spelling])
    head, *powers = marked.replace("°C2", "°C^2").replace("°C3", "°C^3").split("^")
    for power in powers:
        digits = power[: len(power) - len(power.lstrip("0123456789"))]
        head += digits.translate(POWERS) + power[len(digits) :]
    return head
