"""A certificate as PDF/A-3b: typst typesets the sheet, which it reads as JSON; the files are
attached.
"""

import datetime as dt
import json
import re
import shutil
import tempfile
import unicodedata
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from calibkit.certificate import plots
from calibkit.certificate.content import Certificate
from calibkit.certificate.sheet import sheet
from calibkit.certificate.words import Lang, character_code
from calibkit.errors import OutputError, RecipeError, UsageError
from calibkit.libraries import extras

TEMPLATE = Path(__file__).with_name("certificate.typ")
LONGEST_WORD = 36
"""Characters without a space, behind which a line may break."""
JOINERS = "\u00ad\u200b\u200c\u200d\u200e\u200f\u2060"
"""Invisible characters that text may contain: hyphenation, joiners, and marks of direction that
reorder nothing.
"""
MOST_UNSHOWN = 20
"""Characters that a message lists."""
_UNSHOWN = re.compile(r'the text `"(.*?)"` could not be displayed', re.DOTALL)
_ESCAPE = re.compile(r"\\u\{([0-9a-f]+)\}")


SPACINGS = (1.0, 0.92, 0.84, 0.76, 1.1, 1.2, 1.3)
"""Spacings of lines that are tried until the last page is not nearly empty."""
LEAST_FILLED_MM = 125.0
"""Height of the end mark on a last page that is filled well enough [mm]."""


def load_typst() -> Any:  # noqa: ANN401 (an optional library)
    """The library that typesets, or OutputError that says how to install it."""
    return extras.load_library("typst", "pdf", "certificates need typst")


def render(
    certificate: Certificate,
    lang: Lang,
    fonts: Sequence[Path] = (),
    *,
    signed: bool = False,
    mark: bytes = b"",
) -> bytes:
    """PDF/A-3b bytes of a certificate, to be signed electronically or by hand, with the mark of an
    accreditation (SVG or PNG); the same for the same input.

    Raises UsageError for Chinese without a font and for characters that no font has, RecipeError
    for a file that is no font or a mark that is no image, OutputError without typst.
    """
    if lang != "en" and not fonts:
        raise UsageError(
            f"--lang {lang} needs a font with Chinese",
            hint='name one in the profile: [certificate] fonts = ["…"]',
        )
    data = clean_sheet(sheet(certificate, lang, signed=signed)) | {"mark": list(mark)}
    data["attachments"] = [
        {
            "name": attached.name,
            "text": attached.content.decode("utf-8"),
            "type": attached.media_type,
            "relationship": attached.relationship,
            "description": attached.description,
        }
        for attached in certificate.attachments
    ]
    for laid_out, block in zip(data["blocks"], certificate.blocks, strict=True):
        size_mm = plots.ALONE_MM if len(laid_out["figures"]) == 1 else plots.BESIDE_MM
        for words, figure in zip(laid_out["figures"], block.figures, strict=True):
            words |= {"svg": plots.draw(figure, size_mm), "width": size_mm[0]}
    typst = load_typst()
    try:
        scratch = tempfile.TemporaryDirectory(prefix="calibkit-")
    except OSError as error:
        raise OutputError(
            f"{tempfile.gettempdir()}: cannot be written: {error.strerror}",
            hint="make room there, or name another folder in TMPDIR",
        ) from None
    with scratch as folder:
        data["families"] = _families(fonts, Path(folder))
        inputs = {"sheet": json.dumps(data, ensure_ascii=False)}  # never as source
        font_options = {"font_paths": [folder] if fonts else [], "ignore_system_fonts": True}
        try:
            document: bytes = typst.compile(
                str(TEMPLATE),
                pdf_standards=["a-3b"],
                timestamp=dt.datetime.combine(certificate.issued, dt.time(), dt.UTC),
                sys_inputs=inputs | {"spacing": _choose_spacing(typst, inputs, font_options)},
                **font_options,
            )
        except typst.TypstError as error:
            raise _refusal(error) from error
        except RuntimeError as error:  # of a query, which sees the same faults first
            if not mark:
                raise
            reason = re.sub(r"^failed to compile document: |, searched at [^)]*", "", str(error))
            raise RecipeError(
                f"accreditation.mark: {reason}",
                hint="give a PNG, or a whole SVG without linked images",
            ) from None
    return document if document.endswith(b"\n") else document + b"\n"


def _choose_spacing(typst: Any, inputs: dict[str, str], font_options: dict[str, Any]) -> str:  # noqa: ANN401 (an optional library)
    """First spacing of lines with which the last page is not nearly empty, else the usual one."""
    for spacing in map(str, SPACINGS):
        sys_inputs = inputs | {"spacing": spacing}
        end = typst.query(
            str(TEMPLATE), "<end>", field="value", one=True, sys_inputs=sys_inputs, **font_options
        )
        place = json.loads(end)
        if place["page"] == 1 or place["y"] >= LEAST_FILLED_MM:
            return spacing
    return str(SPACINGS[0])


def _refusal(error: Any) -> Exception:  # noqa: ANN401 (a class of an optional library)
    """What is wrong where typst refuses: UsageError for characters that no font has, else
    OutputError.
    """
    texts = _UNSHOWN.findall(error.diagnostic)
    unshown = {_ESCAPE.sub(lambda m: chr(int(m.group(1), 16)), text) for text in texts}
    characters = "".join(sorted(set("".join(unshown))))
    if not characters:
        return OutputError(f"typst: {error.message}", hint="this is a bug")
    return UsageError(
        f"no font has {characters[:MOST_UNSHOWN]!r}",
        hint='name a font that has it: [certificate] fonts = ["…"] of the profile',
    )


def _families(fonts: Sequence[Path], folder: Path) -> list[str]:
    """Families of the named font files, copied into an empty folder, so that no other font is
    ever used.
    """
    if not fonts:
        return []
    for k, font in enumerate(fonts):
        try:
            shutil.copyfile(font, folder / f"{k:03d}{font.suffix}")
        except OSError as error:
            raise RecipeError(
                f"certificate.fonts: {font}: {error.strerror}", hint="name a font file"
            ) from None
    import typst

    font_book = typst.Fonts(
        include_system_fonts=False, include_embedded_fonts=False, font_paths=[str(folder)]
    )
    families = sorted({font.family for font in font_book.fonts()})
    if not families:
        font_names = ", ".join(str(font) for font in fonts)
        raise RecipeError(
            f"certificate.fonts: no font in {font_names}", hint="name .ttf, .otf or .ttc files"
        )
    return families


def clean_sheet(document: dict[str, Any]) -> dict[str, Any]:
    """The sheet without control characters and overrides of direction; long words with places to
    break.
    """

    def clean(value: Any) -> Any:  # noqa: ANN401 (walks a JSON value)
        if isinstance(value, str):
            text = "".join(map(make_visible, value))
            return re.sub(rf"\S{{{LONGEST_WORD}}}(?=\S)", lambda m: m.group() + "\u200b", text)
        if isinstance(value, list):
            return [clean(item) for item in value]
        if isinstance(value, dict):
            return {key: clean(item) for key, item in value.items()}
        return value

    def make_visible(character: str) -> str:
        visible = (
            character in "\n\t"
            or character in JOINERS
            or unicodedata.category(character) not in {"Cc", "Cf", "Cs", "Co", "Cn"}
        )
        return character if visible else character_code(character)

    cleaned: dict[str, Any] = clean(document)
    return cleaned
