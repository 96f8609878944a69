"""What results, files and conditions are called where a customer reads of them, in both languages,
beside the keys that profiles and JSON use.
"""

import re

from calibkit.certificate.results import Result
from calibkit.certificate.words import Words, unit_mark, with_unit

_SUBJECTS = (
    (r"gyro_([a-z0-9]+)_(?:dph|lsb)", "gyro {0}", "{0} 陀螺"),
    (r"accel_([a-z0-9]+)_(?:g|lsb)", "accelerometer {0}", "{0} 加速度计"),
    (r"gyro_dph", "gyro", "陀螺"),
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
    "temp_env_degc": Words("chamber air", "箱内气温"),
    "probability_of_deviation_limits": Words("probability of deviation limits", "偏差界限的概率"),
    "temp_rate_degc_min": Words("temperature rate", "温变速率"),
    "gradient_degc": Words("temperature difference", "温差"),
    "gradient_rate_degc_min": Words("rate of the temperature difference", "温差变化率"),
    "table_rate_dps": Words("table rate", "转台角速率"),
}
_MODELS = {
    "pair": Words("pair of gyros", "陀螺对"),
    "triad": Words("triad", "三轴组件"),
    "drift": Words("drift", "漂移"),
    "K_over_temperature": Words("scale factor over temperature", "标度因数随温度"),
    "F0_over_temperature": Words("zero-rate indication over temperature", "零速率示值随温度"),
}
_CRITERIA = {
    "residual over noise": "残差与噪声之比",
    "residual over that of the fit": "残差与拟合残差之比",
    "residual rms": "残差均方根",
    "largest inclination error": "井斜角最大误差",
    "largest toolface error": "工具面角最大误差",
    "largest toolface error times sin(inclination)": "工具面角最大误差乘 sin(井斜角)",
    "largest azimuth error": "方位角最大误差",
    "standard uncertainty of gamma": "γ 的标准不确定度",
    "standard uncertainty of an angle": "角度的标准不确定度",
    "nonlinearity over full scale": "非线性度（满量程）",
    "rate gain off 1 by": "速率增益与 1 之差",
    "drift reduction": "漂移减小倍数",
    "drift reduction on withheld ramps": "保留数据的漂移减小倍数",
    "rms error over its u": "均方根误差与其 u 之比",
    "rms error of K over its u": "标度因数均方根误差与其 u 之比",
    "rms azimuth error over its u": "方位角均方根误差与其 u 之比",
    "turn that azimuths share, over its u": "方位角共同偏转与其 u 之比",
    "drift over its u": "漂移与其 u 之比",
    "azimuth rms": "方位角均方根误差",
    "asymmetry": "不对称度",
    "repeatability": "重复性",
    "temperature sensitivity": "温度灵敏度",
    "scale-factor error": "标度因数误差",
    "rate error": "速率误差",
    "rate across the turned axis": "横轴速率",
    "orthogonality error": "正交误差",
    "largest drift rms after": "补偿后漂移均方根最大值",
    "share of 100 s means within their uncertainty": "100 s 均值在其不确定度内的比例",
    "reduction": "减小倍数",
    "reduction on left-out stretches": "留出段的减小倍数",
    "angle random walk": "角度随机游走",
    "velocity random walk": "速度随机游走",
    "bias instability": "零偏不稳定性",
    "rate random walk": "速率随机游走",
    "acceleration random walk": "加速度随机游走",
    "rate ramp": "速率斜坡",
    "acceleration ramp": "加速度斜坡",
    "quantization": "量化噪声",
}
"""Acceptance limits in Chinese."""
_OF_SOMETHING = (
    (r"error of (\w+) over its u", "{0} 的误差与其 u 之比"),
    (r"unexplained residual, (.+)", "未解释的残差，{0}"),
    (r"bias stability over (\S+) s of (.+)", "{1}：零偏稳定性（{0} s 平均）"),
    (r"([a-z_]+) of (\S+) \(not observable: at most\)", "{1}：{0}（不可观测，上限）"),
    (r"([a-z_]+) of (\S+)", "{1}：{0}"),
)
"""Acceptance limits that name what they are of, and the same in Chinese."""
_FILES = {
    "run.json": Words("recipe, logs and software of the run", "处理记录：配方、数据、软件"),
    "validation.json": Words("as-found and as-left results", "调整前后结果"),
    "profile.toml": Words("laboratory profile", "实验室信息"),
    "dcc.xml": Words("digital calibration certificate", "数字校准证书"),
}


def name_condition(name: str) -> Words:
    """A condition of the computation."""
    return _CONDITIONS.get(name) or name_channel(name)


def name_channel(column: str) -> Words:
    """A sensor or channel by its column or letter; one that is not known without its unit."""
    subject = _find_subject(column)
    if subject is not None:
        return subject
    return Words(re.sub(r"_(lsb|dph|dps|g|mg|v|mv)$", "", column).replace("_", " "))


def name_model(name: str) -> Words:
    """A model of a coefficient file: of which sensor, over what, of which log."""
    head, _, qualifier = name.partition(".")
    words = _MODELS.get(head) or name_channel(head)
    if not qualifier:
        return words + Words("")  # with Chinese, be it the same word
    return words + Words(", ", "，") + _MODELS.get(qualifier, Words(qualifier))


def name_criterion(name: str) -> Words:
    """An acceptance limit by its name, with the channel or log that it is of."""
    owner, colon, criterion = name.rpartition(": ")
    for english, chinese in _OF_SOMETHING:
        if match := re.fullmatch(english, criterion) or re.fullmatch(english, name):
            term = _CRITERIA.get(match[1].replace("_", " "), match[1])
            return Words(name.replace("_", " "), chinese.format(term, *match.groups()[1:]))
    chinese = _CRITERIA.get(criterion, "")
    subject = name_channel(owner.replace("gyro ", "")) if colon else Words("")
    if not subject.zh and colon:
        subject = Words(owner, owner)
    english = f"{subject.en}: {criterion}" if colon else criterion
    return Words(english, f"{subject.zh}：{chinese}" if colon and chinese else chinese)


def name_file(name: str) -> Words:
    """What an attached file holds."""
    return _FILES.get(name, Words("coefficients with their covariance", "系数及其协方差"))


def name_subject(key: str) -> Words:
    """Which gyro, axis or pair a key is of; empty where there is but one."""
    parts = key.split(".")
    if parts[-2] == "angle_deg":
        first_axis, _, second_axis = parts[-1].partition("_")
        return Words(f"{first_axis} to {second_axis}", f"{first_axis} 与 {second_axis}")
    for part in parts[1:]:
        subject = _find_subject(part)
        if subject is not None:
            return subject
    return name_channel(parts[1]) if parts[1].endswith("_lsb") else Words("")


def _find_subject(part: str) -> Words | None:
    """Gyro, axis or channel that a part of a key names."""
    for pattern, english, chinese in _SUBJECTS:
        if match := re.fullmatch(pattern, part):
            return Words(english.format(*match.groups()), chinese.format(*match.groups()))
    return None


def name_result(result: Result) -> Words:
    """A result by its name and symbol, the standard that defines it, of what, at which
    conditions.
    """
    symbol = show_symbol(result.symbol)
    name = _WORDS.get(result.name.en, result.name) if result.name.en else Words(symbol)
    name_words = {*name.en.split()}
    is_word = len(symbol) > LONGEST_SYMBOL and symbol.islower() and "_" not in symbol
    if symbol and not is_word and symbol not in name.en.split():
        name += Words(f" {symbol}")
    if result.standard:
        name += Words(f" ({result.standard})")
    subject = name_subject(result.quantity)
    letters = {word for word in subject.en.split() if len(word) == 1}
    if subject.en and not letters <= name_words:
        name += Words(f", {subject.en}", f"，{subject.zh or subject.en}")
    if result.at:
        conditions = ", ".join(
            with_unit(f"{x:.5g}".replace("-", "−"), unit_mark(u)) for _, x, u in result.at
        )
        name += Words(f", {conditions}", f"，{conditions}")
    return name


def show_symbol(symbol: str) -> str:
    """A symbol as equations have it: K0 → K₀, s_grad → s_G."""
    symbol = _SYMBOLS.get(symbol, symbol)
    match = re.fullmatch(r"([A-Za-z])(\d+)", symbol)
    return symbol if match is None else match[1] + match[2].translate(_LOWERED)


_LOWERED = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
