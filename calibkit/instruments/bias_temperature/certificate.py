"""Bias results: each channel's bias as a polynomial of its abscissa."""

from calibkit.certificate.blocks import lay_out_models
from calibkit.certificate.results import Block, Equation
from calibkit.certificate.stated import Stated
from calibkit.certificate.words import Words
from calibkit.forms import POLYNOMIAL
from calibkit.instruments.bias_temperature import quantities

CURVE = Equation(
    POLYNOMIAL.name,
    r"p(T) = \sum_k p_k T^k",
    Words("T the abscissa named in the tables.", "T 为表中所示自变量。"),
)


def blocks(stated: Stated) -> tuple[Block, ...]:
    """Block of bias.json."""
    record = stated.records.get("bias.json")
    if record is None:
        return ()
    biases = [quantities.bias(record.stage, model) for model in record.models]
    title = Words("Bias over temperature", "零偏随温度")
    return (lay_out_models(stated, record, title, (CURVE,), biases),)
