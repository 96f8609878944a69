"""What results, files and conditions are called where a customer reads of them, in both languages,
beside the keys that profiles and JSON use.
"""

import re

from calibkit.certificate.results import Result
from calibkit.certificate.words import Words
from calibkit.units import unit_mark, with_unit

_SUBJECTS = (
    (r"gyro_(?P<letter>[a-z0-9]+)_(?:dph|lsb)", Words("gyro {letter}")),
    (r"accel_(?P<letter>[a-z0-9]+)_(?:g|lsb)", Words("accelerometer {letter}")),
    (r"gyro_dph", Words("gyro")),
    (r"gyro_(?P<letter>[a-z0-9]+)", Words("gyro {letter}")),
    (r"accel_(?P<letter>[a-z0-9]+)", Words("{letter} axis")),
    (r"(?P<letter>[a-z0-9]+)_about_(?P<axis>[a-z0-9]+)", Words("gyro {letter} about axis {axis}")),
    (r"(?P<letter>[xy])", Words("gyro {letter}")),
)
"""Pattern of a part of a key, and what it is called."""
_WORDS = {
    "K": Words("scale factor"),
    "F0": Words("zero-rate indication"),
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
    "latitude": Words("latitude"),
    "local_gravity": Words("local gravity"),
    "input_axis_elevation": Words("elevation of the input axis"),
    "input_axis_azimuth": Words("azimuth of the input axis"),
    "temp_case_degc": Words("case temperature"),
    "temp_env_degc": Words("chamber air"),
    "probability_of_deviation_limits": Words("probability of deviation limits"),
    "temp_rate_degc_min": Words("temperature rate"),
    "gradient_degc": Words("temperature difference"),
    "gradient_rate_degc_min": Words("rate of the temperature difference"),
    "table_rate_dps": Words("table rate"),
}
_MODELS = {
    "pair": Words("pair of gyros"),
    "triad": Words("triad"),
    "drift": Words("drift"),
    "K_over_temperature": Words("scale factor over temperature"),
    "F0_over_temperature": Words("zero-rate indication over temperature"),
}
_CRITERIA = (
    (r"error of (?P<of>\w+) over its u", Words("{name}|error of {of} over its u")),
    (r"unexplained residual, (?P<of>.+)", Words("{name}|unexplained residual, {of}")),
    (
        r"bias stability over (?P<time>\S+) s of (?P<record>.+)",
        Words("{name}|bias stability over {time} s of {record}"),
    ),
    (
        r"(?P<of>[a-z_]+) of (?P<record>\S+) \(not observable: at most\)",
        Words("{name}|{of} of {record} (not observable: at most)"),
    ),
    (r"(?P<of>[a-z_]+) of (?P<record>\S+)", Words("{name}|{of} of {record}")),
)
"""Acceptance limits that name what they are of."""
_FILES = {
    "run.json": Words("recipe, logs and software of the run"),
    "validation.json": Words("as-found and as-left results"),
    "profile.toml": Words("laboratory profile"),
    "dcc.xml": Words("digital calibration certificate"),
}


def name_condition(name: str) -> Words:
    """A condition of the computation."""
    return _CONDITIONS.get(name) or name_channel(name)


def name_channel(column: str) -> Words:
    """A sensor or channel by its column or letter; one that is not known without its unit."""
    subject = _find_subject(column)
    if subject is not None:
        return subject
    return Words.literal(re.sub(r"_(lsb|dph|dps|g|mg|v|mv)$", "", column).replace("_", " "))


def name_model(name: str) -> Words:
    """A model of a coefficient file: of which sensor, over what, of which log."""
    head, _, qualifier = name.partition(".")
    words = _MODELS.get(head) or name_channel(head)
    if not qualifier:
        return words + Words("")  # with Chinese, be it the same word
    return words + Words(", ") + _MODELS.get(qualifier, Words.literal(qualifier))


def name_criterion(name: str) -> Words:
    """An acceptance limit by its name, with the channel or log that it is of."""
    owner, colon, criterion = name.rpartition(": ")
    for pattern, words in _CRITERIA:
        if match := re.fullmatch(pattern, criterion) or re.fullmatch(pattern, name):
            parts: dict[str, Words | str] = match.groupdict()
            if "of" in parts:
                parts["of"] = Words.known(match["of"].replace("_", " "))
            return words.fill(name=name.replace("_", " "), **parts)
    limit = Words.known(criterion)
    if not colon:
        return limit
    channel = name_channel(owner.replace("gyro ", ""))
    return Words("{owner}: {limit}", owner=channel if channel.zh else owner, limit=limit)


def name_file(name: str) -> Words:
    """What an attached file holds."""
    return _FILES.get(name, Words("coefficients with their covariance"))


def name_subject(key: str) -> Words:
    """Which gyro, axis or pair a key is of; empty where there is but one."""
    parts = key.split(".")
    if parts[-2] == "angle_deg":
        first_axis, _, second_axis = parts[-1].partition("_")
        return Words(
            "{first_axis} to {second_axis}", first_axis=first_axis, second_axis=second_axis
        )
    for part in parts[1:]:
        subject = _find_subject(part)
        if subject is not None:
            return subject
    return name_channel(parts[1]) if parts[1].endswith("_lsb") else Words("")


def _find_subject(part: str) -> Words | None:
    """Gyro, axis or channel that a part of a key names."""
    for pattern, words in _SUBJECTS:
        if match := re.fullmatch(pattern, part):
            return words.fill(**match.groupdict())
    return None


def name_result(result: Result) -> Words:
    """A result by its name and symbol, the standard that defines it, of what, at which
    conditions.
    """
    symbol = show_symbol(result.symbol)
    name = _WORDS.get(result.name.en, result.name) if result.name.en else Words.literal(symbol)
    name_words = {*name.en.split()}
    is_word = len(symbol) > LONGEST_SYMBOL and symbol.islower() and "_" not in symbol
    if symbol and not is_word and symbol not in name.en.split():
        name += Words.literal(f" {symbol}")
    if result.standard:
        name += Words.literal(f" ({result.standard})")
    subject = name_subject(result.quantity)
    letters = {word for word in subject.en.split() if len(word) == 1}
    if subject.en and not letters <= name_words:
        name += Words(", {subject}", subject=subject)
    if result.at:
        conditions = ", ".join(
            with_unit(f"{x:.5g}".replace("-", "−"), unit_mark(u)) for _, x, u in result.at
        )
        name += Words(", {conditions}", conditions=conditions)
    return name


def show_symbol(symbol: str) -> str:
    """A symbol as equations have it: K0 → K₀, s_grad → s_G."""
    symbol = _SYMBOLS.get(symbol, symbol)
    match = re.fullmatch(r"([A-Za-z])(\d+)", symbol)
    return symbol if match is None else match[1] + match[2].translate(_LOWERED)


_LOWERED = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
