"""What results, files and conditions are called where a customer reads of them, in both languages,
beside the keys that profiles and JSON use.
"""

import re

from calibkit.certificate.results import Result
from calibkit.certificate.words import Words, unit_mark, with_unit

_SUBJECTS = (
    (r"gyro_([a-z0-9]+)", "gyro {0}", "{0} 陀螺"),
    (r"accel_([a-z0-9]+)", "{0} axis", "{0} 轴"),
    (r"([a-z0-9]+)_about_([a-z0-9]+)", "gyro {0} about axis {1}", "{0} 陀螺绕 {1} 轴"),
    (r"([xy])", "gyro {0}", "{0} 陀螺"),
)
"""Pattern of a part of a key, and what it is called."""
_WORDS = {
    "K": Words("scale factor", "标度因数"),
    "F0": Words("zero-rate indication", "零速率示值"),
}
"""Letters that stand for a name."""
LONGEST_SYMBOL = 2
"""Characters of a symbol; what is longer is a word."""
_SYMBOLS = {
    "s_rate": "s_r",
    "s_grad": "s_G",
    "s_grad2": "s_GG",
    "s_temp_rate": "s_Tr",
    "s_grad_rate": "s_Ġ",
    "tau_outer": "τ_o",
    "tau_inner": "τ_i",
}
"""Names of coefficients in files, and their symbols in the equations."""
_CONDITIONS = {
    "latitude": Words("latitude", "纬度"),
    "local_gravity": Words("local gravity", "当地重力加速度"),
    "input_axis_elevation": Words("elevation of the input axis", "输入轴仰角"),
    "input_axis_azimuth": Words("azimuth of the input axis", "输入轴方位角"),
    "temp_case_degc": Words("case temperature", "壳温"),
    "temp_rate": Words("temperature rate", "温变速率"),
}
_FILES = {
    "run.json": Words("recipe, logs and software of the run", "处理记录：配方、数据、软件"),
    "validation.json": Words("as-found and as-left results", "调整前后结果"),
    "profile.toml": Words("laboratory profile", "实验室信息"),
    "dcc.xml": Words("digital calibration certificate", "数字校准证书"),
}


def name_condition(name: str) -> Words:
    """A condition of the computation."""
    return _CONDITIONS.get(name, Words(name.replace("_", " ")))


def name_file(name: str) -> Words:
    """What an attached file holds."""
    return _FILES.get(name, Words("coefficients with their covariance", "系数及其协方差"))


def name_subject(key: str) -> Words:
    """Which gyro, axis or pair a key is of; empty where there is but one."""
    parts = key.split(".")
    if parts[-2] == "angle_deg":
        one, _, other = parts[-1].partition("_")
        return Words(f"{one} to {other}", f"{one} 与 {other}")
    for part in parts[1:]:
        for pattern, english, chinese in _SUBJECTS:
            if found := re.fullmatch(pattern, part):
                return Words(english.format(*found.groups()), chinese.format(*found.groups()))
    return Words("")


def name_result(result: Result) -> Words:
    """A result by its name and symbol, the standard that defines it, of what, at which
    conditions.
    """
    symbol = show_symbol(result.symbol)
    name = _WORDS.get(result.name.en, result.name) if result.name.en else Words(symbol)
    is_word = len(symbol) > LONGEST_SYMBOL and symbol.islower() and "_" not in symbol
    if symbol and not is_word and symbol not in name.en.split():
        name += Words(f" {symbol}")
    if result.standard:
        name += Words(f" ({result.standard})")
    subject = name_subject(result.quantity)
    letters = {word for word in subject.en.split() if len(word) == 1}
    if subject.en and not letters <= {*name.en.split()}:
        name += Words(f", {subject.en}", f"，{subject.zh}")
    if result.condition and result.at:
        at = ", ".join(
            with_unit(f"{x:.5g}".replace("-", "−"), unit_mark(u)) for _, x, u in result.at
        )
        name += Words(f", {at}", f"，{at}")
    return name


def show_symbol(symbol: str) -> str:
    """A symbol as equations have it: K0 → K₀, s_grad → s_G."""
    symbol = _SYMBOLS.get(symbol, symbol)
    found = re.fullmatch(r"([A-Za-z])(\d+)", symbol)
    return symbol if found is None else found[1] + found[2].translate(_LOWERED)


_LOWERED = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
