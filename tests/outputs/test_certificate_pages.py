"""Pages of certificates as a customer sees them, in English, Chinese and both: what stands on the
first one, what results are called, where tables break, how the last page ends.
"""

import io
import re
from functools import cache
from pathlib import Path

import pytest

from calibkit import instruments, recipe
from calibkit.certificate import (
    conformity,
    content,
    names,
    pdf,
    profile,
    run_files,
    sheet,
    tables,
)
from calibkit.commands import pipeline
from calibkit.instruments import silent
from conftest import ROOT, slow_after
from sample_runs import ISSUED, sample_run

pytest.importorskip("typst")
pypdf = pytest.importorskip("pypdf")

pytestmark = pytest.mark.drawn
CHINESE = Path("/usr/share/fonts/truetype/wqy/wqy-zenhei.ttc")
LANGUAGES = [
    "en",
    *(
        pytest.param(
            lang,
            marks=pytest.mark.skipif(
                not CHINESE.is_file(), reason="the WenQuanYi Zen Hei font is not installed"
            ),
        )
        for lang in ("zh", "both")
    ),
]
VALIDATED = ("fog_thermal", "inclinometer")
"""Those whose sample certificate has as-found and as-left results."""
NAMES = sorted(recipe.shipped(), key=lambda name: (name not in ("fog_thermal", "gyro_pair"), name))
"""Every shipped recipe; pages of the first two are drawn in the default run."""
ENGLISH = re.compile(r"[A-Za-z]{3,}(?: [A-Za-z]{3,})+")
"""Words in English one behind the other."""
NAMED = ("IEEE Std", "calibkit verify")
"""What is called so in every language."""
KEY = re.compile(r"\b[a-z]+_[a-z_]+\.(?!json|csv|toml)[a-z]")
"""An internal key: stage.model."""


@pytest.fixture(scope="module")
def certificate_of(tmp_path_factory):
    """Certificate of a sample run."""

    @cache
    def of(name):
        run = sample_run(tmp_path_factory, name)
        files = run_files.RunFiles.read(run)
        stated = profile.load(ROOT / "reports" / "profiles" / f"{name}.toml")
        validation = None
        if name in VALIDATED:
            out = tmp_path_factory.mktemp("validated") / f"{name}.json"
            pipeline.validate(run, ROOT / "datasets" / name / "withheld", out, silent)
            validation = run_files.AsFoundAsLeft.load(out, files)
        return content.build(files, instruments.certificate_layout, *stated, validation, ISSUED)

    return of


@pytest.fixture(scope="module")
def pages_of(certificate_of):
    """Texts of the pages of a sample certificate in a language."""

    @cache
    def of(name, lang, *, signed=False):
        fonts = () if lang == "en" else (CHINESE,)
        document = pdf.render(certificate_of(name), lang, fonts, signed=signed)
        return [page.extract_text() for page in pypdf.PdfReader(io.BytesIO(document)).pages]

    return of


def texts(value):
    """Every text in a JSON value."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list | tuple):
        for one in value.values() if isinstance(value, dict) else value:
            yield from texts(one)


def squeezed(text):
    """Text without blanks, places to break, and the underscores that stand for subscripts."""
    return re.sub(r"[\s\u200b_]+", "", text)


def tables_of(shown):
    """Every table of a sheet but that of standards and those of digests."""
    every = [shown["principal"], *shown["as_found"]["tables"], shown["conformity"]["table"]]
    every += [table for block in shown["blocks"] for table in block["tables"]]
    return [table for table in every if table is not None]


@pytest.mark.parametrize("lang", LANGUAGES)
@pytest.mark.parametrize("name", slow_after(2, NAMES))
def test_the_first_page_has_the_principal_results_with_u_and_k(
    certificate_of, pages_of, name, lang
):
    """Every one, by its name, with value, U, k and unit; at least one of every sample."""
    certificate, pages = certificate_of(name), pages_of(name, lang)
    rows = sheet.sheet(certificate, lang)["principal"]["rows"]
    assert rows
    for row in rows:
        assert squeezed("".join(row)) in squeezed(pages[0]), row
        assert row[-2], "k beside each value"


@pytest.mark.parametrize("lang", LANGUAGES)
@pytest.mark.parametrize("name", slow_after(2, NAMES))
def test_nothing_is_called_by_an_internal_key_or_in_the_words_of_a_log(
    certificate_of, pages_of, name, lang
):
    """No stage.model.name, no flag of the fit; a count says where its remarks are."""
    certificate, pages = certificate_of(name), pages_of(name, lang)
    whole = "\n".join(pages)
    assert KEY.findall(whole.replace("\u200b", "")) == []
    for flag in certificate.run.flags:
        assert squeezed(flag) not in squeezed(whole)
    assert str(len(certificate.run.flags)) in whole


@pytest.mark.parametrize("name", NAMES)
def test_every_result_that_is_named_has_a_name_of_its_own(certificate_of, name):
    """No two principal results and no two statements of conformity are called alike."""
    certificate = certificate_of(name)
    shown = [names.name_result(r).en for r in certificate.results if r.principal]
    assert len(shown) == len({*shown})
    judged = [names.name_result(s.result).en for s in certificate.statements]
    assert len(judged) == len({*judged})


@pytest.mark.parametrize("name", NAMES)
def test_a_chinese_certificate_has_no_english_but_what_was_stated(certificate_of, name):
    """Names of standards and commands, and columns of a laboratory's own, are left."""
    certificate = certificate_of(name)
    own = " ".join(texts(certificate.profile.model_dump()))
    own += " angular rate magnetometer die temperature"  # columns of the recipe itself
    found = {m for text in texts(sheet.sheet(certificate, "zh")) for m in ENGLISH.findall(text)}
    left = {m for m in found if m not in own and not m.startswith(NAMED)}
    assert left == set()


@pytest.mark.parametrize("lang", LANGUAGES)
def test_conformity_has_limit_value_u_k_decision_and_risk(certificate_of, lang):
    """A column each, and the risk of every rule that was used under the table."""
    certificate = certificate_of("gyro_pair")
    shown = sheet.sheet(certificate, lang)["conformity"]
    assert len(shown["table"]["heads"]) == 9
    for statement, row in zip(certificate.statements, shown["table"]["rows"], strict=True):
        assert row[0] == names.name_result(statement.result).of(lang)
        assert row[-1].startswith(conformity.VERDICTS[statement.verdict].of(lang))
    for rule in {s.rule for s in certificate.statements}:
        assert any(
            conformity.RISKS[rule].of("en" if lang == "en" else "zh") in r for r in shown["rules"]
        )


@pytest.mark.parametrize("lang", LANGUAGES)
@pytest.mark.parametrize("name", NAMES)
def test_a_unit_has_one_solidus_and_every_u_has_its_unit(certificate_of, name, lang):
    """(°/h)/°C and not °/h/°C; U beside a column of units or with the unit in its head."""
    certificate = certificate_of(name)
    shown = sheet.sheet(certificate, lang)
    for text in texts([tables_of(shown), shown["budgets"]]):
        assert not re.search(r"[^\s/()\[\]]/[^\s/()\[\]]+/", text), text
    unit = {tables.UNIT.of(lang), tables.UNIT_OF_BOTH.of(lang), sheet.LIMITS.of(lang)}
    for table in tables_of(shown):
        for head in table["heads"]:
            assert head != "U" or unit & {*table["heads"]}, table["heads"]
        assert not any(head.startswith("U [") and head.endswith("[]") for head in table["heads"])
