"""What an accredited laboratory states: scope, smallest uncertainties, mark, persons, standards;
conditions that the logs measured; what --check says; profiles of every shipped recipe.
"""

import datetime as dt
import json
import math

import pytest

from calibkit import cli, instruments, recipe
from calibkit.certificate import (
    accreditation,
    checklist,
    content,
    dcc,
    dcc_xml,
    profile,
    run_files,
    sheet,
)
from calibkit.errors import RecipeError
from calibkit.records import store
from conftest import REAL, ROOT
from sample_runs import sample_run

ISSUED = dt.date(2026, 11, 21)
PROFILES = ROOT / "reports" / "profiles"
ACCREDITED = (
    'accreditation.body="B"',
    'accreditation.number="N 1"',
    'cmc=[{result="gyro_scale.gyro_x.*K*", unit="ppm", expanded_uncertainty=50.0}]',
)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Run of the rate table's sample logs."""
    return sample_run(tmp_path_factory, "rate_table")


def built(run, *overrides, path=PROFILES / "rate_table.toml"):
    """Certificate of a run after a profile."""
    files = run_files.RunFiles.read(run)
    stated = profile.load(path, overrides)
    return content.build(files, instruments.certificate_layout, *stated, None, ISSUED)


def strings(value):
    """Every text in a JSON value."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list):
        for one in value.values() if isinstance(value, dict) else value:
            yield from strings(one)


def test_no_uncertainty_is_below_what_the_laboratory_is_accredited_for(run):
    """U is the CMC where it would be smaller; the budget says why and adds up; k stays."""
    plain = {r.key: r for r in built(run, *ACCREDITED[:2], "cmc=[]").results}
    raised = {r.key: r for r in built(run, *ACCREDITED).results}
    assert any(accreditation.is_raised(r) for r in raised.values())
    for key, r in raised.items():
        if r.outside_scope or r.uncertainty is None:
            continue
        u, before = r.uncertainty, plain[key].uncertainty
        floor = 50e-6 * abs(r.value)
        assert u.expanded_uncertainty == pytest.approx(max(before.expanded_uncertainty, floor))
        assert u.coverage_factor == before.coverage_factor
        parts = math.hypot(*(c.contribution for c in u.contributions))
        if accreditation.is_raised(r):
            assert parts == pytest.approx(u.standard_uncertainty)
            assert u.coverage_factor * parts == pytest.approx(floor)


def test_results_outside_the_scope_are_marked_wherever_they_stand(run):
    """With a star in every table, and a sentence that says what it means."""
    made = built(run, *ACCREDITED)
    shown = sheet.sheet(made, "en")
    outside = {r.key for r in made.results if r.outside_scope}
    assert outside
    assert "gyro_scale.gyro_x.K" not in outside
    zero = next(row for row in shown["principal"]["rows"] if "zero-rate" in row[0])
    assert zero[1].endswith("*")
    scale = next(row for row in shown["principal"]["rows"] if "scale factor" in row[0])
    assert not scale[1].endswith("*")
    assert "outside the scope" in shown["accreditation"]
    assert any("outside the scope" in text for text in shown["principal"]["notes"])
    unmarked = built(run, 'accreditation={number=""}')
    assert not any(r.outside_scope for r in unmarked.results)
    assert not any("*" in text for text in strings(sheet.sheet(unmarked, "en")["blocks"]))


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ('cmc=[{result="*.F0", unit="m", expanded_uncertainty=1.0}]', "in 'm'"),
        ('accreditation={mark="mark.svg", number=""}', "needs the number"),
        ('standard=[{name="S", expanded_uncertainty=0.1}]', "needs its unit"),
    ],
)
def test_an_accreditation_that_cannot_be_meant_is_refused(run, override, message):
    """A CMC in another unit, a mark without number, a U without unit."""
    with pytest.raises(RecipeError, match=message):
        built(run, override)


STANDARD = """
[[standard]]
name = "Pt100"
certificate = "T-2026-118"
sha256 = "{digest}"
date = 2026-03-02
valid_until = 2027-03-02
range = "−50 °C … 130 °C"
expanded_uncertainty = 0.08
coverage_factor = 2.3
unit = "K"
{keys}
"""


def with_standard(tmp_path, keys=""):
    """Profile whose last standard has these further keys."""
    head, tail = (PROFILES / "rate_table.toml").read_text(encoding="utf-8").split("[calibrated_by]")
    tail = tail.split('[[type_b]]\nname = "case thermometer, calibration"')[0]
    text = STANDARD.format(digest=64 * "a", keys=keys)
    path = tmp_path / "lab.toml"
    path.write_text(f"{head}{text}\n[calibrated_by]{tail}", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "key", ['dcc = "T-2026-118.xml"', 'result = "error"', 'dcc = "absent.xml"\nresult = "error"']
)
def test_the_key_of_a_standards_dcc_is_refused_in_one_line(tmp_path, key):
    """No number is read from an XML file of others: the line says what to state instead."""
    (tmp_path / "T-2026-118.xml").write_text("<a/>")
    with pytest.raises(RecipeError, match=r"lab.toml:\d+: .*is not read") as refused:
        profile.load(with_standard(tmp_path, key))
    assert "\n" not in str(refused.value)
    assert "expanded_uncertainty, unit and coverage_factor" in str(refused.value)
    assert refused.value.exit_code == 2
    bare = tmp_path / "bare.toml"
    bare.write_text(f"[[standard]]\n{key}\n" if "dcc" in key else f'[[standard]]\nname="S"\n{key}')
    with pytest.raises(RecipeError, match="is not read"):
        profile.load(bare)


def test_an_attached_profile_of_0_2_with_the_key_of_a_dcc_makes_the_same_certificate(run, tmp_path):
    """What it was filled with stands in it, with the digest of the file that it was read from."""
    stated, text = profile.load(with_standard(tmp_path, 'quantity = "temp_case_degc"'))
    keys = 'dcc = "T-2026-118.xml"\nresult = "error"\n'
    attached = text.replace('name = "Pt100"\n', f'name = "Pt100"\n{keys}')
    assert attached != text
    found = profile.parse(attached, "profile.toml")
    assert (found.standard[-1].dcc, found.standard[-1].result) == ("T-2026-118.xml", "error")
    files = run_files.RunFiles.read(run)
    before, now = (
        content.build(files, instruments.certificate_layout, one, attached, None, ISSUED)
        for one in (found, stated)
    )
    assert sheet.sheet(before, "en") == sheet.sheet(now, "en")
    assert before.results == now.results


def test_the_uncertainty_of_a_standard_with_its_quantity_is_a_type_b_term(run, tmp_path):
    """As the same term in [[type_b]] would; without a quantity it enters none."""
    key, quantity = "gyro_scale.gyro_x.K_over_temperature.value@60", 'quantity = "temp_case_degc"'
    size = 'unit="K", expanded_uncertainty=0.08, coverage_factor=2.3'
    stated = f'type_b=[{{name="t", quantity="temp_case_degc", {size}}}]'

    def part(certificate):
        u = next(r for r in certificate.results if r.key == key).uncertainty
        return [c for c in u.contributions if c.quantity == "temp_case_degc"]

    (one,) = part(built(run, path=with_standard(tmp_path, quantity)))
    (other,) = part(built(run, stated, path=with_standard(tmp_path)))
    assert one.contribution == pytest.approx(other.contribution, rel=1e-12)
    assert one.name.en == "Pt100, T-2026-118"
    assert part(built(run, path=with_standard(tmp_path))) == []


def test_the_dcc_states_digest_and_validity_of_a_standards_certificate(run, tmp_path):
    """dcc:certificate with SHA-256 and whether it held on the day; schema 3.3.0."""
    pytest.importorskip("lxml")
    made = dcc.render(built(run, path=with_standard(tmp_path)), "en")
    root = dcc_xml.read(made, REAL / "dcc-schema" if REAL.is_dir() else None)
    one = root.findall(".//dcc:measuringEquipment/dcc:certificate", dcc_xml.NAMES)[-1]
    names = ("referralID", "procedure", "value", "inValidityRange")
    texts = [one.findtext(f"dcc:{name}", "", dcc_xml.NAMES) for name in names]
    assert texts == ["T-2026-118", "SHA-256", 64 * "a", "true"]


@pytest.mark.parametrize("name", sorted(recipe.shipped()))
def test_every_shipped_recipe_has_a_profile_that_lacks_nothing(tmp_path_factory, name):
    """But as found and as left, where a sample has logs that were withheld for it."""
    made = built(sample_run(tmp_path_factory, name), path=PROFILES / f"{name}.toml")
    validated = name in {"fog_thermal", "inclinometer"}
    assert [item.key for item in made.missing] == (["adjustment.statement"] if validated else [])
    assert made.unused_terms == ()


def test_check_lists_all_that_is_missing_and_writes_nothing(run, tmp_path, capsys, monkeypatch):
    """Exit code 1 for a DRAFT, 0 where nothing is missing; --out and --check exclude each other."""
    pytest.importorskip("typst")
    monkeypatch.chdir(tmp_path)

    def called(*arguments):
        with pytest.raises(SystemExit) as stopped:
            cli.main(["certify", str(run.folder), *map(str, arguments)])
        return stopped.value.code, capsys.readouterr()

    code, said = called("--check")
    assert code == 1
    assert "a DRAFT" in said.out.splitlines()[0]
    for key in checklist.FIELDS:
        assert key in said.out
    code, said = called("--check", "--profile", PROFILES / "rate_table.toml")
    assert (code, said.out.splitlines()[0].split(": ")[1]) == (
        0,
        "nothing is missing for a certificate",
    )
    assert "outside the scope" in said.out
    code, said = called("--check", "--json")
    assert code == 1
    assert json.loads(said.out)["draft"]
    assert called()[0] == called("--check", "--out", "c.pdf")[0] == 2
    assert list(tmp_path.iterdir()) == []
    assert store.load(run.folder)
