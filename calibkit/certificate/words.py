"""Words on a certificate in two languages, and headings and sentences that PDF and DCC share."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Literal

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


def character_code(character: str) -> str:
    """A character by its number: [U+8BA1]."""
    return f"[U+{ord(character):04X}]"
