"""Words in the two languages of a certificate, headings that PDF and DCC share, and how units are
printed.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from calibkit.units import ANGLE_MARKS

Lang = Literal["en", "zh", "both"]


@dataclass(frozen=True, slots=True)
class Words:
    """The same words in English and in Chinese; symbols and names that are the same in both are
    given once.
    """

    en: str
    zh: str = ""

    def of(self, lang: Lang) -> str:
        """The words in one language, or one beside the other."""
        if lang == "en" or not self.zh or self.zh == self.en:
            return self.en
        return self.zh if lang == "zh" else f"{self.en} {self.zh}"

    def __add__(self, other: Words) -> Words:
        return Words(self.en + other.en, (self.zh or self.en) + (other.zh or other.en))


HEADINGS = {
    "parties": Words("Laboratory and customer", "实验室与客户"),
    "item": Words("Item calibrated", "被校件"),
    "method": Words("Method", "校准方法"),
    "conditions": Words("Conditions", "校准条件"),
    "traceability": Words("Traceability", "溯源性"),
    "results": Words("Results", "校准结果"),
    "as_found": Words("As found and as left", "调整前与调整后"),
    "conformity": Words("Conformity", "符合性声明"),
    "budget": Words("Uncertainty budget", "不确定度评定"),
    "data": Words("Data and digests", "数据与摘要"),
    "authorisation": Words("Authorisation", "批准"),
    "amendment": Words("Amendment", "修改说明"),
    "principal": Words("Principal results", "主要结果"),
    "missing": Words("Missing for a certificate", "尚缺内容"),
    "remarks": Words("Remarks", "备注"),
}
SENTENCES = {
    "draft": Words("DRAFT", "草稿"),
    "draft_line": Words("DRAFT: not a calibration certificate", "草稿：非正式校准证书"),
    "number": Words("Certificate number", "证书编号"),
    "page": Words("Page {n} of {N}", "第 {n} 页，共 {N} 页"),
    "end": Words("End of certificate", "证书结束"),
    "signature": Words("Signature", "签名"),
    "signed": Words(
        "Signed electronically: the signature is in this file; calibkit verify checks it.",
        "电子签名：签名含于本文件中，可用 calibkit verify 核验。",
    ),
    "only_item": Words(
        "The results relate only to the item calibrated, as it was when it was calibrated.",
        "结果仅与被校件及其校准时的状态有关。",
    ),
    "uncertainty": Words(
        "The expanded uncertainty U is the combined standard uncertainty times the coverage factor"
        " k beside each value, for a coverage probability of about 95 %. It combines the"
        " uncertainty of the fit (type A, from its covariance) with what is known of the equipment"
        " (type B). It holds at the time and under the conditions of the calibration; the item's"
        " long-term stability is not in it.",
        "扩展不确定度 U 为合成标准不确定度乘以各值旁所列包含因子 k，包含概率约 95 %。"
        "其中包括拟合不确定度（A 类，来自协方差）"
        "与设备不确定度（B 类），仅对校准时的时间与条件有效，不含被校件的长期稳定性。",
    ),
    "traceability": Words(
        "The results are traceable through the certificates of the standards below.",
        "量值通过下列标准器的证书溯源。",
    ),
    "reproduction": Words(
        "This certificate may be reproduced only in full, except with the laboratory's written"
        " approval.",
        "未经实验室书面批准，不得部分复制本证书。",
    ),
    "principal": Words(
        "All results, with the models and conditions that they hold for, stand on the pages that"
        " follow.",
        "全部结果及其模型与适用条件见后续各页。",
    ),
    "attached": Words(
        "The files below are attached to this PDF. The coefficients in them have all their digits"
        " and their covariance.",
        "以下文件附于本 PDF 中，其中的系数含全部有效数字及协方差。",
    ),
}
AS_FOUND, AS_LEFT = Words("as found", "调整前"), Words("as left", "调整后")
CONDITIONS = (
    ("chamber", Words("Chamber set points and holds", "温箱设定点与保温")),
    ("laboratory_temperature", Words("Laboratory temperature", "实验室温度")),
    ("local_gravity", Words("Local gravity", "当地重力加速度")),
    ("latitude", Words("Latitude", "纬度")),
    ("earth_rate", Words("Earth's rate", "地球自转")),
    ("supply", Words("Supply", "供电")),
    ("warm_up", Words("Warm-up", "预热")),
)
"""Key of [conditions] in the profile, and what it is called."""

UNIT_MARKS = {
    "": "",
    "1": "",
    "deg": "°",
    "degC": "°C",
    "arcsec": "″",
    "m/s^2": "m/s²",
    "ug": "µg",
    "deg/sqrt(h)": "°/√h",
    "ug/sqrt(Hz)": "µg/√Hz",
    "mg/sqrt(h)": "mg/√h",
    "mg*s": "mg·s",
}
"""Printed form of units, and of parts of compound units, that differ from their spelling in files.
"""
POWERS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")


def character_code(character: str) -> str:
    """A character by its number: [U+8BA1]."""
    return f"[U+{ord(character):04X}]"


def with_unit(number: str, mark: str) -> str:
    """A number with its unit: ° ′ ″ of plane angle stand without a space, nothing for none."""
    return f"{number}{mark}" if mark in ANGLE_MARKS else f"{number} {mark}".strip()


def unit_mark(unit: str) -> str:
    """Unit as it is printed, with one solidus or brackets: 1/deg → 1/°, deg/h/degC^2 → (°/h)/°C²,
    1/s/degC → 1/(s·°C); nothing for a pure number.
    """
    if unit in UNIT_MARKS:
        return UNIT_MARKS[unit]
    first, *factors = map(_mark_factor, re.findall(r"(?:[^/()]|\([^()]*\))+", unit))
    divisors = [mark for mark in factors if mark != "1"]
    if not divisors and first == "1":
        return ""
    if len(divisors) > 1 and first != "1":
        first, divisors = f"({first}/{divisors[0]})", divisors[1:]
    if len(divisors) > 1:
        flat = (mark.strip("()") for mark in sorted(divisors, key=lambda mark: "/" in mark))
        divisors = [f"({'·'.join(flat)})"]
    return "/".join((first, *divisors))


def _mark_factor(factor: str) -> str:
    """One factor of a unit: degC^2 → °C², sqrt(h) → √h, (1)^2 → 1."""
    base, _, power = factor.replace("*", "·").partition("^")
    if base[-1].isdigit() and base != "1":
        base, power = base[:-1], base[-1]
    base = re.sub(r"^\((\w+)\)$", r"\1", re.sub(r"^sqrt\((\w+)\)$", r"√\1", base))
    if base == "1":
        return "1"
    return base.replace("degC", "°C").replace("deg", "°") + power.translate(POWERS)
