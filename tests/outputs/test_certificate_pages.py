"""Pages of certificates as a customer sees them, in English, Chinese and both: what stands on the
first one, what results are called, where tables break, how the last page ends.
"""

import io
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from calibkit import instruments, recipe
from calibkit.certificate import (
    conformity,
    content,
    judgements,
    names,
    pdf,
    profile,
    run_files,
    sheet,
    tables,
    words,
)
from calibkit.certificate.results import GridTable, ListTable, Result
from calibkit.certificate.words import Words
from calibkit.commands import pipeline
from calibkit.instruments import silent
from calibkit.records.coefficients import at_most
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


@pytest.mark.parametrize("lang", LANGUAGES)
@pytest.mark.parametrize("name", slow_after(2, NAMES))
def test_no_page_is_nearly_empty_and_no_title_ends_one(certificate_of, pages_of, name, lang):
    """Every page has twenty lines at least; the last before the foot is no title of a table or
    chapter.
    """
    certificate, pages = certificate_of(name), pages_of(name, lang)
    shown = sheet.sheet(certificate, lang)
    titles = {squeezed(text) for key, text in shown["words"].items() if not key.startswith("s_")}
    titles |= {squeezed(t["title"]) for b in shown["blocks"] for t in b["tables"] if t["title"]}
    leads = (words.SENTENCES["attached"].of(lang), shown["conformity"]["text"])
    asked = shown["conformity"]["table"] is not None
    titles |= {squeezed(leads[0])} | ({squeezed(leads[1])} if asked else set())
    foot = squeezed(words.SENTENCES["only_item"].of(lang))
    for page in pages:
        lines = [squeezed(line) for line in page.splitlines() if line.strip()]
        body = [line for line in lines if line not in foot]
        assert len(body) >= 20, body
        assert body[-1] not in titles, body[-3:]
        assert not any(lead.endswith(body[-1]) for lead in titles if len(body[-1]) > 8), body[-1]


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
def test_a_signed_certificate_has_no_line_for_a_signature(pages_of, lang):
    """It says where the signature is; one to be signed by hand has the line."""
    for signed, there, absent in ((True, "signed", "draft"), (False, "signature", "signed")):
        pages = pages_of("gyro_pair", lang, signed=signed)
        assert squeezed(words.SENTENCES[there].of(lang)) in squeezed(pages[-1])
        assert squeezed(words.SENTENCES[absent].of(lang)) not in squeezed(pages[-1])


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
def test_degrees_of_angle_stand_without_a_space(certificate_of, name, lang):
    """90.05°, not 90.05 °; degrees Celsius keep theirs."""
    certificate = certificate_of(name)
    shown = sheet.sheet(certificate, lang)

    assert [text for text in texts(shown) if re.search(r"\d [°′″](?![C/])", text)] == []


@pytest.mark.parametrize(
    ("quantity", "name", "english", "chinese"),
    [
        (
            "gyro_scale.nonlinearity_full_scale.GJB 2426A.a_about_a",
            Words("nonlinearity, of full scale"),
            "nonlinearity, of full scale, gyro a about axis a",
            "非线性度（满量程），a 陀螺绕 a 轴",
        ),
        (
            "accel_q.triad.Q1",
            Words("Non-orthogonality"),
            "Non-orthogonality",
            "非正交角",
        ),
        (
            "gyro_orthogonality.angle_deg.x_y",
            Words("angles between the input axes"),
            "angles between the input axes, x to y",
            "输入轴夹角，x 与 y",
        ),
    ],
)
def test_results_have_names_for_people_in_both_languages(quantity, name, english, chinese):
    """The key says of which gyro, axis or pair; the name says what."""
    found = names.name_result(Result(quantity, "f.json", "", name, 1.0, "1"))
    assert (found.en, found.zh) == (english, chinese)


def test_symbols_are_those_of_the_equations():
    """K0 is K₀, s_grad is s_G; the name of a file's coefficient is left to files."""
    assert [names.show_symbol(one) for one in ("K0", "a10", "s_grad", "M_xx")] == [
        "K₀",
        "a₁₀",
        "s_G",
        "M_xx",
    ]


def test_files_and_conditions_have_names_in_both_languages(certificate_of):
    """No attachment and no condition of the computation is left in English in a Chinese page."""
    certificate = certificate_of("inclinometer")
    shown = sheet.sheet(certificate, "zh")
    assert all(re.search(r"[\u4e00-\u9fff]", row[1]) for row in shown["data"]["files"])
    assert all(re.search(r"[\u4e00-\u9fff]", label) for label, _ in shown["conditions"])
    whole = replace(certificate, title=Words("T"))
    assert sheet.sheet(whole, "zh")["title"] == "T"


@pytest.mark.parametrize("lang", LANGUAGES)
@pytest.mark.parametrize("name", NAMES)
def test_a_unit_has_one_solidus_and_every_u_has_its_unit(certificate_of, name, lang):
    """(°/h)/°C and not °/h/°C; U beside a column of units or with the unit in its head."""
    certificate = certificate_of(name)
    shown = sheet.sheet(certificate, lang)
    for text in texts([tables_of(shown), shown["budgets"]]):
        assert not re.search(r"[^\s/()\[\]]/[^\s/()\[\]]+/", text), text
    unit = {tables.UNIT.of(lang), tables.UNIT_OF_BOTH.of(lang), judgements.LIMITS.of(lang)}
    for table in tables_of(shown):
        for head in table["heads"]:
            assert head != "U" or unit & {*table["heads"]}, table["heads"]
        assert not any(head.startswith("U [") and head.endswith("[]") for head in table["heads"])


@pytest.mark.parametrize("lang", LANGUAGES)
@pytest.mark.parametrize("name", slow_after(2, NAMES))
def test_symbols_have_subscripts_as_in_the_equations(certificate_of, pages_of, name, lang):
    """S with a small xx, and nowhere S_xx, but in names of the customer's own files."""
    certificate, pages = certificate_of(name), pages_of(name, lang)
    own = " ".join(texts(certificate.profile.model_dump()))
    own += " ".join(log.name for log in certificate.run.inputs)
    found = re.findall(r"\b[A-Za-zα-ω]_[A-Za-z0-9]+\b", "\n".join(pages))
    assert [symbol for symbol in found if symbol not in own] == []


@pytest.mark.parametrize("lang", LANGUAGES)
@pytest.mark.parametrize("name", slow_after(2, NAMES))
def test_a_certificate_does_not_contradict_the_conditions_that_it_states(
    certificate_of, pages_of, name, lang
):
    """Every profile states the latitude: nothing on the pages says that it is not known."""
    certificate, pages = certificate_of(name), pages_of(name, lang)
    whole = squeezed("".join(pages))
    assert certificate.profile.conditions.latitude
    assert squeezed(certificate.profile.conditions.latitude) in whole
    for word in ("not known", "unknown", "未知", "latitude_deg"):
        assert squeezed(word) not in whole


@pytest.mark.parametrize("name", NAMES)
def test_no_two_rows_columns_or_lists_of_a_block_are_called_alike(certificate_of, name):
    """A column says of which gyro, log and temperature it is; a list which model it holds."""
    certificate = certificate_of(name)
    for block in certificate.blocks:
        listed = [table.title.en for table in block.tables if isinstance(table, ListTable)]
        assert len(listed) == len({*listed})
        for table in block.tables:
            if isinstance(table, GridTable):
                labels = [one if isinstance(one, str) else one.en for one in table.labels]
                assert len(labels) == len({*labels}), labels
                heads = [head.en for head in table.heads]
                assert len(heads) == len({*heads}), heads


@pytest.mark.parametrize("name", VALIDATED)
def test_results_as_left_have_k_and_limits_of_the_evaluation_few_digits(certificate_of, name):
    """A column k beside U; 0.837 against 3.29, not 3.290526731491895."""
    certificate = certificate_of(name)
    shown = sheet.sheet(certificate, "en")["as_found"]
    for table in shown["tables"]:
        if "U" in table["heads"]:
            column = table["heads"].index("k")
            assert all(row[column] for row in table["rows"] if row[column - 1])
    own = [note for note in shown["notes"] if note.startswith("Limit of the evaluation")]
    assert own
    for note in own:
        assert max(len(number) for number in re.findall(r"[\d.]+", note)) <= 7, note


@pytest.mark.parametrize(
    "name",
    [
        "asymmetry",
        "azimuth rms",
        "stations.csv: turn that azimuths share, over its u",
        "pair: error of gamma over its u",
        "angle_random_walk of static",
        "rate_ramp of static (not observable: at most)",
        "bias stability over 10 s of static",
        "gyro x: residual over noise",
        "share of 100 s means within their uncertainty",
    ],
)
def test_acceptance_limits_have_chinese_names(name):
    """One word or many, of a channel, log or record."""
    assert re.search(r"[\u4e00-\u9fff]", names.name_criterion(name).zh)


def test_a_rejected_run_is_called_one_in_chinese(certificate_of):
    """The limits that failed have their Chinese names."""
    certificate = certificate_of("gyro_pair")
    failed = at_most("asymmetry", 2.0, 1.0, "ppm")
    run = replace(certificate.run, criteria=(failed,), verdict="rejected")
    assert replace(certificate, run=run).rejection.zh == "本次处理未满足接受限：不对称度"
