"""Pages of certificates as a customer sees them, in English, Chinese and both: what stands on the
first one, what results are called, where tables break, how the last page ends.
"""

import io
import re
from dataclasses import replace
from pathlib import Path

import pytest

from calibkit import instruments, store
from calibkit.certificate import conformity, content, names, pdf, profile, run_files, sheet, words
from calibkit.certificate.results import Result
from calibkit.certificate.words import Words
from conftest import REAL, ROOT
from test_certificate_layouts import ISSUED, fitted
from test_sensitivities import warm_up

pytest.importorskip("typst")
pypdf = pytest.importorskip("pypdf")

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
NAMES = tuple(sorted(path.stem for path in (ROOT / "reports" / "profiles").glob("*.toml")))
"""Every shipped recipe."""
ENGLISH = re.compile(r"[A-Za-z]{3,}(?: [A-Za-z]{3,})+")
"""Words in English one behind the other."""
NAMED = ("IEEE Std", "calibkit verify")
"""What is called so in every language."""
KEY = re.compile(r"\b[a-z]+_[a-z_]+\.(?!json|csv|toml)[a-z]")
"""An internal key: stage.model."""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Certificates of sample runs, their pages as text, by name and language."""
    folder, runs, pages = tmp_path_factory.mktemp("runs"), {}, {}

    def of(name, lang, *, signed=False):
        if name not in runs:
            data = logs_of(name, folder)
            files = run_files.RunFiles.read(store.load(fitted(folder / name, name, data).folder))
            stated = profile.load(ROOT / "reports" / "profiles" / f"{name}.toml")
            runs[name] = content.build(files, instruments.certificate_layout, *stated, None, ISSUED)
        key = name, lang, signed
        if key not in pages:
            fonts = () if lang == "en" else (CHINESE,)
            document = pdf.render(runs[name], lang, fonts, signed=signed)
            reader = pypdf.PdfReader(io.BytesIO(document))
            pages[key] = [page.extract_text() for page in reader.pages]
        return runs[name], pages[key]

    return of


def logs_of(name, folder):
    """Folder with logs of a shipped recipe: samples, a log of the field, or written ones."""
    if name == "mpu6050_warmup":
        if not REAL.is_dir():
            pytest.skip("the logs of the field are not beside the repository")
        return REAL / name
    if (ROOT / "datasets" / name).is_dir():
        return None
    return warm_up(folder / "warm")


def texts(value):
    """Every text in a JSON value."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list | tuple):
        for one in value.values() if isinstance(value, dict) else value:
            yield from texts(one)


def squeezed(text):
    """Text without blanks and places to break."""
    return re.sub(r"[\s\u200b]+", "", text)


@pytest.mark.parametrize("lang", LANGUAGES)
@pytest.mark.parametrize("name", NAMES)
def test_the_first_page_has_the_principal_results_with_u_and_k(made, name, lang):
    """Every one, by its name, with value, U, k and unit; at least one of every sample."""
    certificate, pages = made(name, lang)
    rows = sheet.sheet(certificate, lang)["principal"]["rows"]
    assert rows
    for row in rows:
        assert squeezed("".join(row)) in squeezed(pages[0]), row
        assert row[-2], "k beside each value"


@pytest.mark.parametrize("lang", LANGUAGES)
@pytest.mark.parametrize("name", NAMES)
def test_nothing_is_called_by_an_internal_key_or_in_the_words_of_a_log(made, name, lang):
    """No stage.model.name, no flag of the fit; a count says where its remarks are."""
    certificate, pages = made(name, lang)
    whole = "\n".join(pages)
    assert KEY.findall(whole.replace("\u200b", "")) == []
    for flag in certificate.run.flags:
        assert squeezed(flag) not in squeezed(whole)
    assert str(len(certificate.run.flags)) in whole


@pytest.mark.parametrize("lang", LANGUAGES)
@pytest.mark.parametrize("name", NAMES)
def test_no_page_is_nearly_empty_and_no_title_ends_one(made, name, lang):
    """Every page has twenty lines at least; the last before the foot is no title of a table or
    chapter.
    """
    certificate, pages = made(name, lang)
    shown = sheet.sheet(certificate, lang)
    titles = {squeezed(text) for key, text in shown["words"].items() if not key.startswith("s_")}
    titles |= {squeezed(t["title"]) for b in shown["blocks"] for t in b["tables"] if t["title"]}
    foot = squeezed(words.SENTENCES["only_item"].of(lang))
    for page in pages:
        lines = [squeezed(line) for line in page.splitlines() if line.strip()]
        body = [line for line in lines if line not in foot]
        assert len(body) >= 20, body
        assert body[-1] not in titles, body[-3:]


@pytest.mark.parametrize("name", NAMES)
def test_every_result_that_is_named_has_a_name_of_its_own(made, name):
    """No two principal results and no two statements of conformity are called alike."""
    certificate, _ = made(name, "en")
    shown = [names.name_result(r).en for r in certificate.results if r.principal]
    assert len(shown) == len({*shown})
    judged = [names.name_result(s.result).en for s in certificate.statements]
    assert len(judged) == len({*judged})


@pytest.mark.parametrize("name", NAMES)
def test_a_chinese_certificate_has_no_english_but_what_was_stated(made, name):
    """Names of standards and commands, and columns of a laboratory's own, are left."""
    certificate, _ = made(name, "en")
    own = " ".join(texts(certificate.profile.model_dump()))
    own += " angular rate magnetometer die temperature"  # columns of the recipe itself
    found = {m for text in texts(sheet.sheet(certificate, "zh")) for m in ENGLISH.findall(text)}
    left = {m for m in found if m not in own and not m.startswith(NAMED)}
    assert left == set()


@pytest.mark.parametrize("lang", LANGUAGES)
def test_a_signed_certificate_has_no_line_for_a_signature(made, lang):
    """It says where the signature is; one to be signed by hand has the line."""
    for signed, there, absent in ((True, "signed", "draft"), (False, "signature", "signed")):
        _, pages = made("gyro_pair", lang, signed=signed)
        assert squeezed(words.SENTENCES[there].of(lang)) in squeezed(pages[-1])
        assert squeezed(words.SENTENCES[absent].of(lang)) not in squeezed(pages[-1])


@pytest.mark.parametrize("lang", LANGUAGES)
def test_conformity_has_limit_value_u_k_decision_and_risk(made, lang):
    """A column each, and the risk of every rule that was used under the table."""
    certificate, _ = made("gyro_pair", lang)
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
def test_degrees_of_angle_stand_without_a_space(made, name, lang):
    """90.05°, not 90.05 °; degrees Celsius keep theirs."""
    certificate, _ = made(name, lang)
    shown = sheet.sheet(certificate, lang)

    assert [text for text in texts(shown) if re.search(r"\d [°′″](?![C/])", text)] == []


@pytest.mark.parametrize(
    ("quantity", "name", "english", "chinese"),
    [
        (
            "gyro_scale.nonlinearity_full_scale.GJB 2426A.a_about_a",
            Words("nonlinearity, of full scale", "非线性度（满量程）"),
            "nonlinearity, of full scale, gyro a about axis a",
            "非线性度（满量程），a 陀螺绕 a 轴",
        ),
        (
            "accel_q.triad.Q1",
            Words("Non-orthogonality", "非正交角"),
            "Non-orthogonality",
            "非正交角",
        ),
        (
            "gyro_orthogonality.angle_deg.x_y",
            Words("angle", "夹角"),
            "angle, x to y",
            "夹角，x 与 y",
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


def test_files_and_conditions_have_names_in_both_languages(made):
    """No attachment and no condition of the computation is left in English in a Chinese page."""
    certificate, _ = made("inclinometer", "en")
    shown = sheet.sheet(certificate, "zh")
    assert all(re.search(r"[\u4e00-\u9fff]", row[1]) for row in shown["data"]["files"])
    assert all(re.search(r"[\u4e00-\u9fff]", label) for label, _ in shown["conditions"])
    whole = replace(certificate, title=Words("T"))
    assert sheet.sheet(whole, "zh")["title"] == "T"
