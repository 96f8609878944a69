"""Bias results on a certificate: coefficients of each channel, and its bias over the abscissa."""

from calibkit.certificate.blocks import lay_out_models
from calibkit.certificate.results import Block, Equation
from calibkit.certificate.stated import Stated
from calibkit.certificate.words import Words
from calibkit.forms import POLYNOMIAL
from calibkit.instruments.bias import forms, quantities

EQUATIONS = (
    Equation(
        POLYNOMIAL.name,
        r"p(T) = \sum_k p_k T^k",
        Words("T the abscissa named in the tables.", "T 为表中所示自变量。"),
    ),
    Equation(
        forms.LEVEL.name,
        r"y = b_0 + b_1 T + b_2 T^2 + b_3 T^3 + s_r \dot T + s_{Tr} T \dot T",
        Words(
            "y indication at rest, T temperature [°C], Ṫ its rate [°C/min]. What is taken off is y"
            " less its value at rest at the reference temperature.",
            "y 为静态示值，T 为温度 [°C]，Ṫ 为其速率 [°C/min]。补偿量为 y 减去参考温度稳态时的值。",
        ),
    ),
    Equation(
        forms.LAGGED.name,
        r"y = b_0 + b_1 T + b_2 T^2 + b_3 T^3 + s_r \dot T + s_G G + s_{Tr} T \dot T, "
        r"\quad \tau_o \dot T = T_s - T, \quad \tau_i \dot T_i = T - T_i, \quad G = T - T_i",
        Words(
            "y indication at rest, T a temperature that follows the thermometer T_s with the lag"
            " τₒ, G its excess over one that follows it with τᵢ. What is taken off is y less its"
            " value at rest at the reference temperature.",
            "y 为静态示值，T 以时间常数 τₒ 跟随温度计读数 T_s，G 为 T 与以 τᵢ 跟随其的温度之差。"
            "补偿量为 y 减去参考温度稳态时的值。",
        ),
    ),
)


def blocks(basis: Stated) -> tuple[Block, ...]:
    """Block of bias.json or thermal.json."""
    title, laid_out = Words("Bias over temperature", "零偏随温度"), []
    for record in basis.records.values():
        used = {model.form for model in record.models}
        equations = [equation for equation in EQUATIONS if equation.form in used]
        biases = [quantities.bias(record.stage, model) for model in record.models]
        laid_out.append(lay_out_models(basis, record, title, equations, biases))
    return tuple(laid_out)
