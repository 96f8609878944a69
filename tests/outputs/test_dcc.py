"""The digital calibration certificate: schema, units, numbers as in the coefficient files, text of
every kind, the same bytes.
"""

import base64
import datetime as dt
import json
import math
import warnings
from functools import cache, partial
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from calibkit import instruments, recipe, units
from calibkit.certificate import (
    content,
    dcc,
    dcc_results,
    dcc_xml,
    profile,
    run_files,
)
from calibkit.certificate.dcc_units import dsi
from calibkit.certificate.dcc_xml import NAMES
from calibkit.errors import OutputError
from calibkit.records.version import __version__
from conftest import REAL, ROOT, called
from outputs import dcc_structure
from sample_runs import SERIAL, sample_run

pytest.importorskip("lxml")

SCHEMAS = REAL / "dcc-schema"
ISSUED = dt.date(2026, 11, 21)


PROCEDURES = sorted(set(recipe.shipped()) - {"mpu6050_warmup"})


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Return the run of a procedure's sample logs."""
    return cache(partial(sample_run, tmp_path_factory))


def certificate(run, stated=None, text=""):
    """The certificate record of a run, skipped where the procedure has no layout."""
    return content.build(
        run_files.RunFiles.read(run),
        instruments.certificate_layout,
        profile.Profile() if stated is None else stated,
        text,
        None,
        ISSUED,
    )


def sample(name):
    """Profile of a procedure's sample certificate, or an empty one."""
    path = ROOT / "reports" / "profiles" / f"{name}.toml"
    return profile.load(path if path.is_file() else None)[0]


def valid(document):
    """Check a document's structure, and against the schemas where they are."""
    root = dcc_xml.read(document, SCHEMAS if SCHEMAS.is_dir() else None)
    assert list(dcc_structure.find_faults(root)) == []
    return root


def listed(root, label):
    """The list of values whose first label is given."""
    for values in root.iter(f"{{{dcc_xml.SI}}}realListXMLList"):
        if values.findtext("si:labelXMLList", "", NAMES).split()[:1] == [label]:
            return values
    raise AssertionError(label)


def numbers(element, name):
    """Numbers of a D-SI list."""
    return [float(item) for item in element.findtext(f".//si:{name}", "", NAMES).split()]


@pytest.mark.parametrize("name", PROCEDURES)
@pytest.mark.parametrize("lang", ["en", "zh", "both"])
def test_every_procedure_gives_a_valid_certificate(name, lang, run):
    """DCC 3.3.0 of every procedure, with its sample profile and with an empty one, fits structure
    and schema.
    """
    made = run(name)
    for stated in (sample(name), None):
        root = valid(dcc.render(certificate(made, stated), lang))
        assert root.get("schemaVersion") == "3.3.0"
        assert root.findtext(".//dcc:release", "", NAMES) == f"v{__version__}"
        for result in root.iterfind(".//dcc:measurementResult", NAMES):
            assert result.find("dcc:usedMethods/dcc:usedMethod/dcc:name", NAMES) is not None
            assert result.find("dcc:influenceConditions/dcc:influenceCondition", NAMES) is not None


@pytest.mark.parametrize("name", PROCEDURES)
def test_every_unit_of_every_run_has_a_spelling_in_dsi(name, run):
    """No coefficient, figure, condition, parameter or residual of any procedure has a unit that the
    table lacks.
    """
    peer = pytest.importorskip("dsi_unit").DsiUnit
    for record in run(name).records.values():
        stated = [*record.figures, *record.conditions]
        for model in record.models:
            stated += [*model.coefficients, *model.parameters]
            dsi(model.residual_unit)
        for unit in {entry.unit for entry in stated}:
            for gravity in (None, 9.8):
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")  # the peer warns of its own parser
                    assert peer(dsi(unit).with_gravity(gravity).text).valid, unit


def test_units_of_logs_have_the_size_that_the_table_of_units_gives_them():
    """Two units of one dimension stand to each other in D-SI as calibkit converts them, rates in
    °/h included.
    """
    size = {r"\second": 1.0, r"\minute": 60.0, r"\hour": 3600.0, r"\day": 86400.0, r"\degree": 1.0}
    size |= {r"\arcminute": 1 / 60, r"\arcsecond": 1 / 3600, r"\radian": 180.0 / math.pi}
    worth = {}
    for spelling, unit in units.TABLE.items():
        if unit.shift or unit.dimension == "temperature":
            continue
        found = dsi(spelling).with_gravity(9.8)
        scale = found.factor * math.prod(
            size.get(name, 1.0) ** float(power) for name, power in found.powers.items()
        )
        worth.setdefault(unit.dimension, []).append(scale / (unit.factor / unit.divisor))
    assert len(worth) > 8
    for dimension, ratios in worth.items():
        np.testing.assert_allclose(ratios, ratios[0], rtol=1e-12, err_msg=dimension)


@pytest.mark.parametrize(
    ("unit", "spelling", "factor"),
    [
        ("deg/h/degC/(degC/min)", r"\degree\hour\tothe{-1}\kelvin\tothe{-2}\minute", 1.0),
        ("degC", r"\degreecelsius", 1.0),
        ("deg/sqrt(h)", r"\degree\hour\tothe{-0.5}", 1.0),
        ("1/degC3", r"\kelvin\tothe{-3}", 1.0),
        ("g/degC^2", r"\kelvin\tothe{-2}\metre\second\tothe{-2}", 9.8),
        ("ppm/degC", r"\kelvin\tothe{-1}", 1e-6),
        ("1", r"\one", 1.0),
    ],
)
def test_compound_units_are_spelt_as_products_of_powers(unit, spelling, factor):
    """Powers with tothe, never per; g becomes m/s² by the local gravity, ppm a number, a degree
    of a difference a kelvin.
    """
    found = dsi(unit).with_gravity(9.8)
    assert found.text == spelling
    assert found.factor == pytest.approx(factor, rel=1e-15)


@pytest.mark.parametrize("unit", ["furlong", "deg//", "m_s", "", "deg)"])
def test_an_unknown_unit_is_refused(unit):
    """A unit without a spelling in D-SI stops the certificate instead of standing there as
    something else.
    """
    with pytest.raises(OutputError, match="D-SI"):
        dsi(unit)


def test_parameters_and_their_covariance_are_those_of_the_coefficient_file(run):
    """Values, covariance and the file itself come out of the DCC as they are in the run, bit for
    bit without a conversion.
    """
    made = run("gyro_pair")
    root = valid(dcc.render(certificate(made), "en"))
    for name, record in made.records.items():
        for model in record.models:
            values = listed(root, f"{record.stage}.{model.name}.{model.coefficients[0].name}")
            assert numbers(values, "valueXMLList") == [c.value for c in model.coefficients]
            entries = values.iterfind(".//si:covarianceXMLList/si:valueXMLList", NAMES)
            square = np.reshape([float(e.text) for e in entries], np.shape(model.covariance))
            # one triangle: the other may differ by rounding
            lower = np.tril(model.covariance)
            np.testing.assert_array_equal(square, lower + np.tril(lower, -1).T)
        file = next(
            e
            for e in root.iter(f"{{{dcc_xml.DCC}}}byteData")
            if e.findtext("dcc:fileName", "", NAMES) == name
        )
        assert (
            base64.b64decode(file.findtext("dcc:dataBase64", "", NAMES))
            == (made.folder / name).read_bytes()
        )


def test_every_result_of_the_pdf_stands_in_the_dcc_with_its_uncertainty(run):
    """Each key of the certificate has its value, and U with k where it has one."""
    made = certificate(run("rate_table"))
    root = valid(dcc.render(made, "en"))
    found = {}
    for real in root.iter(f"{{{dcc_xml.SI}}}real"):
        if key := real.findtext("si:label", "", NAMES):
            found[dcc_results.spell_label(key)] = (
                numbers(real, "value")[0],
                numbers(real, "valueExpandedMU"),
                numbers(real, "coverageFactor"),
            )
    for values in root.iter(f"{{{dcc_xml.SI}}}realListXMLList"):
        U, k = numbers(values, "valueExpandedMUXMLList"), numbers(values, "coverageFactorXMLList")
        for j, key in enumerate(values.findtext("si:labelXMLList", "", NAMES).split() if U else ()):
            found[key] = (numbers(values, "valueXMLList")[j], [U[j]], [k[j]])
    assert len(made.results) > 50
    for result in made.results:
        value, U, k = found[dcc_results.spell_label(result.key)]
        factor = dsi(result.unit).factor
        assert value == pytest.approx(result.value * factor, rel=1e-15)
        if result.uncertainty is not None and result.interval is None:
            assert len(U) == 1
            assert U[0] == pytest.approx(
                result.uncertainty.expanded_uncertainty * factor, rel=1e-15
            )
            assert k[0] == pytest.approx(result.uncertainty.coverage_factor, abs=1e-11)


def test_accelerations_are_in_si_where_the_local_gravity_is_known_and_ratios_where_not(run):
    """z_x0 is in m/s² with the profile's gravity; without one it stays a ratio, and the certificate
    says so.
    """
    made = run("accelerometer")
    bias = made.records["accel_affine.json"].models[0].value("z_x0")
    conditions = profile._LabConditions(local_gravity_mps2=9.7967)
    known = valid(dcc.render(certificate(made, profile.Profile(conditions=conditions)), "en"))
    unknown = valid(dcc.render(certificate(made), "en"))
    for root, factor, unit in (
        (known, 9.7967, r"\metre\second\tothe{-2}"),
        (unknown, 1.0, r"\one"),
    ):
        real = next(
            e
            for e in root.iter(f"{{{dcc_xml.SI}}}real")
            if e.findtext("si:label", "", NAMES).endswith("triad.z_x0")
        )
        assert real.findtext("si:unit", "", NAMES) == unit
        assert numbers(real, "value")[0] == pytest.approx(bias * factor, rel=1e-14)
    assert "ratios to the local gravity" in "".join(unknown.itertext())
    assert "ratios to the local gravity" not in "".join(known.itertext())
    assert unknown.find(".//dcc:nonSIUnit", NAMES).text == "g"


@pytest.mark.parametrize("dof", [5, 40, 100000])
@pytest.mark.parametrize("n", [1, 2, 7])
def test_the_region_of_all_parameters_holds_the_truth_as_often_as_it_says(n, dof):
    """The ellipsoid's factor squared over n is the 95 % quantile of F: against scipy.stats, and by
    drawing where dof is large.
    """
    model = SimpleNamespace(coefficients=range(n), dof_of=lambda _: dof)
    factor = dcc_results.region_factor(model)
    assert factor == pytest.approx(math.sqrt(n * stats.f.ppf(0.95, n, dof)), rel=1e-9)
    if dof == 100000:
        drawn = np.random.default_rng(n).normal(size=(20000, n))
        assert np.mean(np.linalg.norm(drawn, axis=1) <= factor) == pytest.approx(0.95, abs=0.006)


def test_a_statement_of_conformity_names_result_rule_and_verdict(run):
    """Verdicts that the schema knows stand in its own words; one that is not possible is only
    said.
    """
    limits = {"name": "angle", "unit": "deg"}
    result = "gyro_orthogonality.pair.alpha_deg"
    stated = profile.Profile(
        specification=(
            profile.Specification(result=result, lower=0.0, upper=180.0, **limits),
            profile.Specification(result=result, lower=0.0, upper=1.0, **limits),
            profile.Specification(result=result, lower=0.0, upper=1e-9, **limits),
        )
    )
    root = valid(dcc.render(certificate(run("gyro_pair"), stated), "en"))
    found = [
        s
        for s in root.iterfind(".//dcc:statement", NAMES)
        if s.find("dcc:reference", NAMES) is not None
    ]
    assert [s.findtext("dcc:conformity", "", NAMES) for s in found] == ["pass", "fail", ""]
    assert "no statement possible" in "".join(found[2].itertext())


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<dcc:performanceLocation>laboratory<", "<dcc:performanceLocation> <", "Location"),
        ("<si:coverageFactor>", "<si:coverageFactor>0.9 ", "coverageFactor '0.9'"),
        ("<si:value>", "<si:value>,", "value ',"),
        (r"<si:unit>\one", "<si:unit>ppm", "unit 'ppm'"),
        ("<si:unitXMLList>", r"<si:unitXMLList>\one ", "is not as long"),
        ("<dcc:dataBase64>", "<dcc:dataBase64>*", "base 64"),
    ],
)
def test_a_broken_structure_is_found_without_the_schema(old, new, words, run):
    """Each rule of the structural check, seen to fail."""
    text = dcc.render(certificate(run("gyro_pair")), "en").decode()
    assert old in text
    faults = dcc_structure.find_faults(dcc_xml.read(text.replace(old, new, 1).encode()))
    assert words in "; ".join(faults)


def test_certify_writes_the_dcc_beside_the_pdf_and_inside_it(run, tmp_path):
    """certificate.xml is the dcc.xml of the PDF, whose digest is printed; neither is
    overwritten.
    """
    pytest.importorskip("typst")
    pikepdf = pytest.importorskip("pikepdf")
    out, stated = tmp_path / "certificate.pdf", ROOT / "reports" / "profiles" / "gyro_pair.toml"
    arguments = ("certify", run("gyro_pair").folder, "--profile", stated, "--date", "2026-11-21")
    schemas = ("--schema-dir", SCHEMAS) if SCHEMAS.is_dir() else ()
    assert called(*arguments, "--out", out, *schemas) == 0
    document = (tmp_path / "certificate.xml").read_bytes()
    with pikepdf.open(out) as pdf:
        attached = pdf.attachments["dcc.xml"]
        assert attached.get_file().read_bytes() == document
        assert attached.obj["/AFRelationship"] == "/Alternative"
    assert called(*arguments, "--out", out.with_name("certificate.PDF")) == 4
    assert called(*arguments, "--out", tmp_path / "other.pdf", "--schema-dir", tmp_path) == 2
    assert not (tmp_path / "other.pdf").exists()
    attached = base64.b64decode(document.split(b"<dcc:dataBase64>")[1].split(b"<")[0])
    assert json.loads(attached)["serial"] == SERIAL


def test_limits_and_conditions_are_quantities(run):
    """Tolerance and acceptance limits with their types, in D-SI; the range of the thermometer."""
    made = certificate(run("rate_table"), sample("rate_table"))
    root = valid(dcc.render(made, "en"))
    listed = root.findall(".//dcc:statement[@refType='basic_conformity']", NAMES)
    for statement, one in zip(made.statements, listed, strict=True):
        factor = dsi(statement.result.unit).factor
        for kind, pair in (
            ("toleranceLimit", (statement.specification.lower, statement.specification.upper)),
            ("acceptanceLimit", statement.acceptance),
        ):
            for end, value in zip(("minimum", "maximum"), pair, strict=True):
                path = f"dcc:data/dcc:quantity[@refType='math_{end} calibkit_{kind}']"
                found = one.find(path, NAMES)
                assert (found is None) == (value is None)
                if found is not None:
                    assert numbers(found, "value")[0] == pytest.approx(value * factor)
    ((_, low, high),) = made.run.measured
    for end, value in (("minimum", low), ("maximum", high)):
        path = f".//dcc:influenceCondition//*[@refType='math_{end}']"
        assert numbers(root.find(path, NAMES), "value") == [value]
