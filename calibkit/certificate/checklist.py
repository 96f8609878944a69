"""What a calibration certificate must state (ISO/IEC 17025:2017, 7.8.2 and 7.8.4), and which of
that is missing.
"""

import datetime as dt
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from calibkit.certificate.profile import Profile
from calibkit.certificate.results import Result
from calibkit.certificate.words import Words, character_code

# where it is stated → what it is called
FIELDS: dict[str, Words] = {
    "certificate.number": Words("certificate number", "证书编号"),
    "laboratory.name": Words("laboratory name", "实验室名称"),
    "laboratory.address": Words("laboratory address", "实验室地址"),
    "laboratory.place_of_work": Words("place of work", "校准地点"),
    "customer.name": Words("customer", "客户名称"),
    "customer.address": Words("customer address", "客户地址"),
    "item.type": Words("item", "被校件名称"),
    "item.maker": Words("maker", "制造商"),
    "item.model": Words("model", "型号"),
    "item.condition": Words("condition of the item", "被校件状态"),
    "dates.performed": Words("date of calibration", "校准日期"),
    "method.name": Words("method", "校准方法"),
    "method.revision": Words("revision of the method", "方法版本"),
    "method.deviations": Words("deviations from the method", "对方法的偏离"),
    "method.external_providers": Words("parts from external providers", "外部提供的部分"),
    "conditions.chamber": Words("chamber set points and holds", "温箱设定点与保温"),
    "conditions.laboratory_temperature": Words("laboratory temperature", "实验室温度"),
    "conditions.local_gravity": Words("local gravity", "当地重力加速度"),
    "conditions.latitude": Words("latitude", "纬度"),
    "conditions.earth_rate": Words("handling of the earth's rate", "地球自转处理"),
    "conditions.supply": Words("supply", "供电"),
    "conditions.warm_up": Words("warm-up", "预热"),
    "authorised_by.name": Words("authorised by", "批准人"),
    "authorised_by.role": Words("role", "职务"),
}


STATED_OF_STANDARDS = {
    "range": Words("range", "测量范围"),
    "expanded_uncertainty": Words("expanded uncertainty", "扩展不确定度"),
}
"""Keys of a standard that an accredited laboratory states."""
MOST_LISTED = 4
"""Results that one missing item names."""
FONTS = "certificate.fonts"
"""Key of what is missing where no font has a character."""


@dataclass(frozen=True, slots=True)
class Missing:
    """One item that the certificate lacks: the key that would state it, and what it is."""

    key: str
    description: Words


NO_SENSITIVITIES = Missing(
    "sensitivities",
    Words(
        "run.json knows no sensitivities to errors of the inputs: fit again with this calibkit",
        "run.json 无输入误差的灵敏度：请用本版本 calibkit 重新拟合",
    ),
)
"""What is missing of a run that was fitted before sensitivities were computed."""


def list_missing(
    profile: Profile,
    results: Sequence[Result],
    issued: dt.date,
    *,
    validated: bool,
    shifted: bool = True,
) -> tuple[Missing, ...]:
    """Every item that keeps a certificate a DRAFT; `shifted` is whether the run knows what errors
    of the inputs do to its results.
    """
    return (
        *_fields(profile),
        *_traceability(profile),
        *_influences(profile, results),
        *_accreditation(profile, results),
        *(() if shifted else (NO_SENSITIVITIES,)),
        *_consistency(profile, issued, validated=validated),
    )


def fits_alone(results: Iterable[Result]) -> list[Result]:
    """Principal results whose uncertainty is that of the fit alone: no type B contribution."""
    return [
        result
        for result in results
        if result.principal
        and not result.by_definition
        and (
            result.uncertainty is None
            or all(part.kind != "B" for part in result.uncertainty.contributions)
        )
    ]


def _influences(profile: Profile, results: Sequence[Result]) -> Iterator[Missing]:
    """Principal results without a type B contribution, unless the profile states why."""
    if profile.type_b_none.reason.strip():
        return
    kinds = dict.fromkeys(result.quantity for result in fits_alone(results))
    if kinds:
        names = ", ".join(list(kinds)[:MOST_LISTED])
        unlisted_count = len(kinds) - MOST_LISTED
        names += f" and {unlisted_count} more" if unlisted_count > 0 else ""
        description = Words(
            f"type B contribution ([[type_b]]), or type_b_none.reason, of {names}",
            f"B 类分量（[[type_b]]）或 type_b_none.reason：{names}",
        )
        yield Missing("type_b", description)


def _accreditation(profile: Profile, results: Sequence[Result]) -> Iterator[Missing]:
    """What an accredited laboratory states besides: who accredited it, a result in its scope, range
    and U of each standard.
    """
    if not profile.accreditation.number.strip():
        return
    if not profile.accreditation.body.strip():
        yield Missing("accreditation.body", Words("accreditation body", "认可机构"))
    if all(result.outside_scope for result in results):
        description = Words(
            "a result in the scope of the accreditation ([[cmc]])", "认可范围内的结果（[[cmc]]）"
        )
        yield Missing("cmc", description)
    for standard in profile.standard:
        for name, words in STATED_OF_STANDARDS.items():
            if not getattr(standard, name):
                description = words + Words(
                    f" of the standard '{standard.name}'", f"：标准器“{standard.name}”"
                )
                yield Missing(f"standard.{name}", description)


def missing_glyphs(characters: Iterable[str]) -> Missing:
    """What is missing where no font has these characters."""
    codes = " ".join(map(character_code, characters))
    return Missing(
        FONTS, Words(f"characters that no font has: {codes}", f"字体中没有的字符：{codes}")
    )


def _fields(profile: Profile) -> Iterator[Missing]:
    """Plain fields that are empty."""
    for key, description in FIELDS.items():
        table, _, name = key.partition(".")
        value = getattr(getattr(profile, table), name)
        if value is None or not str(value).strip():
            yield Missing(key, description)


def _traceability(profile: Profile) -> Iterator[Missing]:
    """Standards, each with certificate, date and laboratory, and valid when they were used."""
    if not profile.standard:
        yield Missing("standard", Words("traceability: reference standards", "溯源性：标准器"))
    used = profile.dates.performed_until or profile.dates.performed
    for standard in profile.standard:
        for name in ("certificate", "date", "laboratory"):
            if not getattr(standard, name):
                description = Words(
                    f"{name} of the standard '{standard.name}'", f"标准器“{standard.name}”的 {name}"
                )
                yield Missing(f"standard.{name}", description)
        if standard.valid_until is not None and used is not None and standard.valid_until < used:
            description = Words(
                f"the standard '{standard.name}' was valid until {standard.valid_until}",
                f"标准器“{standard.name}”有效期至 {standard.valid_until}",
            )
            yield Missing("standard.valid_until", description)
        if standard.date is not None and used is not None and standard.date > used:
            description = Words(
                f"the standard '{standard.name}' was calibrated on {standard.date}, after the work",
                f"标准器“{standard.name}”的校准日期 {standard.date} 晚于本次工作",
            )
            yield Missing("standard.date", description)


def _consistency(profile: Profile, issued: dt.date, *, validated: bool) -> Iterator[Missing]:
    """A certificate is not issued before the work is done; an amendment states what it changes; as
    found and as left are stated, or why they are not.
    """
    performed = profile.dates.performed_until or profile.dates.performed
    if performed is not None and performed > issued:
        description = Words(
            f"the work of {performed} is later than the date of issue {issued}",
            f"校准日期 {performed} 晚于签发日期 {issued}",
        )
        yield Missing("dates.performed", description)
    if profile.certificate.amends and not any(
        change.strip() for change in profile.certificate.changes
    ):
        yield Missing("certificate.changes", Words("what the amendment changes", "修改内容"))
    if not validated and not profile.adjustment.statement.strip():
        description = Words(
            "as-found and as-left results (--validation), or adjustment.statement",
            "调整前后结果（--validation）或 adjustment.statement",
        )
        yield Missing("adjustment.statement", description)
