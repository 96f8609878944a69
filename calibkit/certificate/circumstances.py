"""What surrounds the results of a certificate: conditions, standards, accreditation, persons."""

from collections.abc import Iterable
from typing import Any

from calibkit.certificate import names, tables
from calibkit.certificate.content import Certificate
from calibkit.certificate.profile import Profile, Standard
from calibkit.certificate.words import CONDITIONS, SENTENCES, Lang, Words, unit_mark, with_unit
from calibkit.records.left_out import Cause, Kind, LeftOut

Rows = list[list[str]]


def in_words(rows: Iterable[tuple[Words, str]], lang: Lang) -> Rows:
    """Rows of a label and a text."""
    return [[label.of(lang), text] for label, text in rows]


def list_given(*rows: tuple[Words, str]) -> list[tuple[Words, str]]:
    """The rows that have a text."""
    return [(label, text) for label, text in rows if text.strip()]


def lay_out_conditions(certificate: Certificate, lang: Lang) -> Rows:
    """Conditions that the profile states, those that the logs measured, and those that the
    coefficient files hold.
    """
    lab_conditions, run = certificate.profile.conditions, certificate.run
    rows = [(words, getattr(lab_conditions, key)) for key, words in CONDITIONS]
    rows += list_given(*((Words(""), text) for text in lab_conditions.others))
    for column, *ends in run.measured:
        label = Words("Measured in the logs: ", "数据中实测：") + names.name_condition(column)
        low, high = (f"{end:.1f} °C".replace("-", "−") for end in ends)
        rows.append((label, f"{low} … {high}"))
    for condition in run.conditions:
        label = Words("In the computation: ", "计算中采用：") + names.name_condition(condition.name)
        unit = unit_mark(condition.unit)
        text = with_unit(tables.format_plain(condition.value, 8), unit)
        if condition.standard_uncertainty > 0.0:
            words = Words("standard uncertainty", "标准不确定度").of(lang)
            u = with_unit(tables.format_plain(condition.standard_uncertainty, 2), unit)
            text += f" ({words} {u})"
        rows.append((label, text))
    return in_words(rows, lang)


_COUNTED: dict[Kind, Words] = {
    "rows": Words("rows", "行"),
    "samples": Words("samples", "个采样"),
    "positions": Words("positions", "个位置"),
    "stations": Words("stations", "个测站"),
}
_CAUSES: dict[Cause, Words] = {
    "excluded": Words("excluded for the reason that is stated", "按所述原因剔除"),
    "incomplete": Words(
        "excluded because a value that is needed is missing", "因缺少所需数值而剔除"
    ),
    "missing": Words("not in the log", "缺失"),
    "outlier": Words(
        "excluded because they differ from the others by far more than noise", "因明显离群而剔除"
    ),
    "unsolved": Words("excluded because their readings give no result", "因读数无解而剔除"),
}


def describe_left_out(fact: LeftOut) -> Words:
    """What a fit did not use, in a customer's words."""
    counted, cause = _COUNTED[fact.what], _CAUSES[fact.cause]
    were = "was" if fact.count == 1 else "were"
    place = names.name_channel(fact.where) if fact.what == "stations" else Words(fact.where)
    of_place, place_zh = (f" of {place.en}", f"{place.zh or place.en} ") if fact.where else ("", "")
    return Words(
        f"{fact.count} of {fact.of} {counted.en}{of_place} {were} {cause.en}.",
        f"{place_zh}{fact.of} {counted.zh}中有 {fact.count} {counted.zh}{cause.zh}。",
    )


def describe_remarks(count: int, file: str) -> Words:
    """How many remarks of an evaluation there are, and where; empty for none."""
    if not count:
        return Words("")
    return Words(
        f"Remarks of the evaluation for the laboratory: {count}, in {file}.",
        f"数据处理备注 {count} 条，供实验室使用，见 {file}。",
    )


def lay_out_traceability(profile: Profile, lang: Lang) -> dict[str, Any]:
    """Standards with their certificates, ranges and expanded uncertainties."""
    heads = [
        Words("Standard", "标准器"),
        Words("Serial", "编号"),
        Words("Range", "测量范围"),
        Words("U"),
        Words("Certificate", "证书编号"),
        Words("Date", "日期"),
        Words("Laboratory", "校准机构"),
    ]
    valid_until = Words(" (valid until ", "（有效期至 ").of(lang)
    close = Words(")", "）").of(lang)
    rows = []
    for s in profile.standard:
        until = f"{valid_until}{s.valid_until}{close}" if s.valid_until else ""
        date = f"{s.date or ''}{until}"
        rows.append([s.name, s.serial, s.range, _uncertainty(s), s.certificate, date, s.laboratory])
    table = tables.text_table(heads, "lllllll", rows, lang)
    return table | {"text": profile.certificate.traceability or SENTENCES["traceability"].of(lang)}


def _uncertainty(standard: Standard) -> str:
    """Expanded uncertainty of a standard with its coverage factor; empty where none is stated."""
    U = standard.expanded_uncertainty
    if U is None:
        return ""
    number = with_unit(tables.format_exact(U), unit_mark(standard.unit))
    return f"{number} (k = {standard.coverage_factor:g})"


def describe_accreditation(certificate: Certificate) -> Words:
    """By whom the laboratory is accredited; empty where it is not."""
    accreditation = certificate.profile.accreditation
    if not accreditation.number.strip():
        return Words("")
    return Words(
        f"Accredited by {accreditation.body}, {accreditation.number}.",
        f"获 {accreditation.body} 认可，{accreditation.number}。",
    )


def lay_out_accreditation(certificate: Certificate, lang: Lang) -> str:
    """By whom the laboratory is accredited, and whether results are not in the scope."""
    words = describe_accreditation(certificate)
    if any(result.outside_scope for result in certificate.results):
        words += Words(" ", "") + tables.OUTSIDE
    return words.of(lang)


def list_signatories(certificate: Certificate, lang: Lang) -> list[Rows]:
    """Who calibrated, checked and authorised it, as what; the last with the date of issue."""
    profile = certificate.profile
    first_signatories = [
        in_words([(label, person.name), *list_given((Words("Role", "职务"), person.role))], lang)
        for label, person in (
            (Words("Calibrated by", "校准"), profile.calibrated_by),
            (Words("Checked by", "核验"), profile.checked_by),
        )
        if person.name.strip()
    ]
    authorised = profile.authorised_by
    last = [
        (Words("Authorised by", "批准"), authorised.name),
        (Words("Role", "职务"), authorised.role),
        (Words("Date of issue", "签发日期"), str(certificate.issued)),
    ]
    return [*first_signatories, in_words(last, lang)]
