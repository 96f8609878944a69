"""Digital calibration certificates of standards: what they fill in a profile, what they add to the
uncertainty, and what is refused.
"""

import datetime as dt
import hashlib

import pytest

from calibkit import instruments
from calibkit.certificate import (
    content,
    dcc,
    dcc_check,
    dcc_xml as xml,
    profile,
    run_files,
)
from calibkit.certificate.dcc_units import spelling_of
from calibkit.errors import OutputError, RecipeError
from conftest import REAL, ROOT
from test_certificate_layouts import fitted

pytest.importorskip("lxml")

ISSUED = dt.date(2026, 11, 21)
PROFILE = ROOT / "reports" / "profiles" / "rate_table.toml"
DOCUMENT = """<?xml version="1.0"?>
<dcc:digitalCalibrationCertificate xmlns:dcc="https://ptb.de/dcc" xmlns:si="https://ptb.de/si"
  schemaVersion="3.3.0">
 <dcc:administrativeData>
  <dcc:coreData><dcc:uniqueIdentifier>T-2026-118</dcc:uniqueIdentifier>
   <dcc:endPerformanceDate>2026-03-01</dcc:endPerformanceDate>
   <dcc:issueDate>2026-03-02</dcc:issueDate></dcc:coreData>
  <dcc:items><dcc:item><dcc:name><dcc:content lang="de">Fühler</dcc:content>
   <dcc:content lang="en">Pt100</dcc:content></dcc:name>
   <dcc:identifications><dcc:identification><dcc:value>T-07</dcc:value></dcc:identification>
   </dcc:identifications></dcc:item></dcc:items>
  <dcc:calibrationLaboratory><dcc:contact><dcc:name><dcc:content>NMI</dcc:content></dcc:name>
  </dcc:contact></dcc:calibrationLaboratory>
  <dcc:statements><dcc:statement>VALID</dcc:statement></dcc:statements>
 </dcc:administrativeData>
 <dcc:measurementResults><dcc:measurementResult><dcc:results>
  <dcc:result id="errors"><dcc:data>RESULTS</dcc:data></dcc:result>
 </dcc:results></dcc:measurementResult></dcc:measurementResults>
</dcc:digitalCalibrationCertificate>"""
LIST = """<dcc:quantity refType="basic_measurementError"><dcc:name><dcc:content>error</dcc:content>
 </dcc:name><si:realListXMLList><si:valueXMLList>0.01 0.02 0.03</si:valueXMLList>
 <si:unitXMLList>\\kelvin</si:unitXMLList><si:measurementUncertaintyUnivariateXMLList>
 <si:expandedMUXMLList><si:valueExpandedMUXMLList>0.04 0.08 0.05</si:valueExpandedMUXMLList>
 <si:coverageFactorXMLList>2.0 2.3 2.0</si:coverageFactorXMLList></si:expandedMUXMLList>
 </si:measurementUncertaintyUnivariateXMLList></si:realListXMLList></dcc:quantity>"""
OLD = """<dcc:quantity><si:real><si:label>error</si:label><si:value>0.01</si:value>
 <si:unit>\\milli\\kelvin</si:unit><si:expandedUnc><si:uncertainty>60</si:uncertainty>
 <si:coverageFactor>2</si:coverageFactor></si:expandedUnc></si:real></dcc:quantity>"""
OTHER = """<dcc:quantity id="r"><dcc:name><dcc:content>resistance</dcc:content></dcc:name>
 <si:real><si:value>100.0</si:value><si:unit>\\ohm</si:unit><si:measurementUncertaintyUnivariate>
 <si:expandedMU><si:valueExpandedMU>0.01</si:valueExpandedMU>
 <si:coverageFactor>2.0</si:coverageFactor></si:expandedMU></si:measurementUncertaintyUnivariate>
 </si:real></dcc:quantity>"""
YEAR = "<dcc:period>P1Y</dcc:period>"
STANDARD = """
[[standard]]
dcc = "T-2026-118.xml"
quantity = "temp_case_degc"
"""


@pytest.fixture
def lab(tmp_path):
    """Profile with a standard, as a function of its DCC's results, validity and further keys."""

    def write(results=LIST, validity=YEAR, keys=""):
        text = DOCUMENT.replace("RESULTS", results).replace("VALID", validity)
        (tmp_path / "T-2026-118.xml").write_text(text, encoding="utf-8")
        whole = PROFILE.read_text(encoding="utf-8")
        head, tail = whole.split("[calibrated_by]")
        tail = tail.split('[[type_b]]\nname = "case thermometer, calibration"')[0]
        path = tmp_path / "lab.toml"
        path.write_text(f"{head}{STANDARD}{keys}\n[calibrated_by]{tail}", encoding="utf-8")
        return path

    return write


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Run of the rate table's sample logs."""
    return fitted(tmp_path_factory.mktemp("runs"), "rate_table")


def built(run, path, *overrides):
    """Certificate of a run after a profile."""
    files = run_files.RunFiles.read(run)
    stated = profile.load(path, overrides)
    return content.build(files, instruments.certificate_layout, *stated, None, ISSUED)


def test_a_standard_is_filled_from_its_dcc(lab, tmp_path):
    """Number, digest, date, laboratory, name, serial, validity, the largest U with its own k."""
    one = profile.load(lab())[0].standard[-1]
    assert (one.certificate, one.date, one.laboratory) == ("T-2026-118", dt.date(2026, 3, 2), "NMI")
    assert (one.name, one.serial, one.valid_until) == ("Pt100", "T-07", dt.date(2027, 3, 2))
    assert (one.expanded_uncertainty, one.coverage_factor, one.unit) == (0.08, 2.3, "K")
    content = (tmp_path / "T-2026-118.xml").read_bytes()
    assert one.sha256 == hashlib.sha256(content).hexdigest()
    old = profile.load(lab(OLD))[0].standard[-1]
    assert (old.expanded_uncertainty, old.coverage_factor, old.unit) == (0.06, 2.0, "K")
    own = profile.load(lab(keys='name = "Thermometer 7"'))[0].standard[-1]
    assert own.name == "Thermometer 7"


@pytest.mark.parametrize(
    ("validity", "until"),
    [
        (YEAR, dt.date(2027, 3, 2)),
        ("<dcc:period>P6M10D</dcc:period>", dt.date(2026, 9, 12)),
        ("<dcc:valid>true</dcc:valid><dcc:date>2027-01-31</dcc:date>", dt.date(2027, 1, 31)),
        ("<dcc:valid>false</dcc:valid><dcc:date>2027-01-31</dcc:date>", None),
        ("<dcc:norm>none</dcc:norm>", None),
    ],
)
def test_validity_is_a_date_or_a_period_that_a_statement_gives(lab, validity, until):
    """What states none leaves it to the profile."""
    assert profile.load(lab(validity=validity))[0].standard[-1].valid_until == until


def test_its_uncertainty_enters_results_as_a_type_b_term(lab, run):
    """As the same term in [[type_b]] would; without a quantity it enters none."""
    made = built(run, lab())
    size = 'unit="K", expanded_uncertainty=0.08, coverage_factor=2.3'
    stated = f'type_b=[{{name="t", quantity="temp_case_degc", {size}}}]'
    slope = "gyro_scale.gyro_x.K_over_temperature.value@60"
    same = built(run, lab(), stated, 'standard=[{name="S"}]')

    def part(certificate):
        u = next(r for r in certificate.results if r.key == slope).uncertainty
        return [c for c in u.contributions if c.quantity == "temp_case_degc"]

    (one,), (other,) = part(made), part(same)
    assert one.contribution == pytest.approx(other.contribution, rel=1e-12)
    assert one.name.en == "Pt100, T-2026-118"
    assert part(built(run, lab(), 'standard=[{dcc="T-2026-118.xml"}]')) == []


def test_an_expired_standard_is_named(lab, run):
    """Valid until a day before the work: a DRAFT that says until when."""
    text = "<dcc:valid>true</dcc:valid><dcc:date>2026-11-01</dcc:date>"
    (item,) = (i for i in built(run, lab(validity=text)).missing if i.key == "standard.valid_until")
    assert item.what.en == "the standard 'Pt100' was valid until 2026-11-01"


@pytest.mark.parametrize(
    ("results", "keys", "message"),
    [
        (LIST + OTHER, "", "uncertainties of 2 units"),
        (LIST + OTHER, 'result = "length"', "'length' names uncertainties of 0 units"),
        ("<dcc:text/>", "", "no expanded uncertainty"),
        (LIST, 'certificate = "T-2025-001"', "certificate = T-2025-001, T-2026-118.xml states"),
        (LIST, 'sha256 = "' + 64 * "0" + '"', "sha256"),
        (OTHER, "", "'ohm' is not of the kind of 'degC'"),
    ],
)
def test_a_dcc_that_does_not_say_one_thing_is_refused(lab, results, keys, message):
    """Several units and no choice, none, a contradiction, another file, another dimension; with
    file and line of the profile.
    """
    with pytest.raises(RecipeError, match=rf"lab.toml:\d+: .*{message}"):
        profile.load(lab(results, keys=keys))


@pytest.mark.parametrize(("name", "value"), [("error", 0.08), ("basic_measurementError", 0.08)])
def test_a_quantity_is_chosen_by_name_or_type(lab, name, value):
    """By id and label too."""
    one = profile.load(lab(LIST + OTHER, keys=f'result = "{name}"'))[0].standard[-1]
    assert one.expanded_uncertainty == value


def test_a_file_that_is_no_dcc_is_refused_with_its_place(lab, tmp_path):
    """Absent, not XML, other XML; an entity is not expanded."""
    path = lab()
    for text in ("no XML", "<a/>", None):
        if text is None:
            (tmp_path / "T-2026-118.xml").unlink()
        else:
            (tmp_path / "T-2026-118.xml").write_text(text)
        with pytest.raises(RecipeError, match=r"lab.toml:\d+: .*T-2026-118.xml"):
            profile.load(path)


def test_the_attached_profile_needs_the_file_no_more(lab, run, tmp_path):
    """What it stated stands in it; the certificate made from it alone is the same."""
    found, text = profile.load(lab())
    (tmp_path / "T-2026-118.xml").unlink()
    again = profile.parse(text, "profile.toml")
    assert again == found
    files = run_files.RunFiles.read(run)
    both = [
        content.build(files, instruments.certificate_layout, one, text, None, ISSUED)
        for one in (found, again)
    ]
    assert both[0] == both[1]


def test_the_dcc_states_digest_and_validity_of_the_standards_certificate(lab, run):
    """dcc:certificate with SHA-256 and whether it held on the day; schema 3.3.0."""
    root = dcc_check.check(
        dcc.render(built(run, lab()), "en"), REAL / "dcc-schema" if REAL.is_dir() else None
    )
    one = root.findall(".//dcc:measuringEquipment/dcc:certificate", xml.NAMES)[-1]
    assert one.findtext("dcc:referralID", "", xml.NAMES) == "T-2026-118"
    assert one.findtext("dcc:procedure", "", xml.NAMES) == "SHA-256"
    assert len(one.findtext("dcc:value", "", xml.NAMES)) == 64
    assert one.findtext("dcc:inValidityRange", "", xml.NAMES) == "true"


def test_certificates_of_calibkit_are_read_too(run, lab, tmp_path):
    """Its own DCC fills a standard: the scale factor by its key."""
    key = "gyro_scale.gyro_x.K"
    made = built(run, PROFILE)
    path = lab(keys=f'result = "{key}"').with_name("lab.toml")
    path.write_text(path.read_text().replace('quantity = "temp_case_degc"\n', ""))
    (tmp_path / "T-2026-118.xml").write_bytes(dcc.render(made, "en"))
    one = profile.load(path)[0].standard[-1]
    expected = next(r for r in made.results if r.key == key).uncertainty
    assert one.expanded_uncertainty == pytest.approx(expected.expanded_uncertainty)
    assert (one.unit, one.certificate) == ("1/deg", "SAMPLE-2026-004")


@pytest.mark.parametrize(
    ("text", "unit", "scale"),
    [
        (r"\degreecelsius", "degC", 1.0),
        (r"\milli\kelvin", "K", 1e-3),
        (r"\degree\second\tothe{-1}", "deg/s", 1.0),
        (r"\metre\second\tothe{-2}", "m/s^2", 1.0),
        (r"\degree\tothe{-1}", "1/deg", 1.0),
        (r"\one", "1", 1.0),
    ],
)
def test_units_of_dsi_are_spelt_as_in_recipes(text, unit, scale):
    """With the size of their prefix."""
    assert spelling_of(text) == (unit, scale)


@pytest.mark.parametrize("text", [r"\furlong", "kelvin", "", r"\kelvin x"])
def test_a_unit_that_the_table_lacks_is_refused(text):
    """It is never taken as another one."""
    with pytest.raises(OutputError, match="not known"):
        spelling_of(text)
