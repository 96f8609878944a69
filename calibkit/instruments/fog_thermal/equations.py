"""Equations of the thermal drift as a certificate prints them."""

from calibkit.certificate.results import Equation
from calibkit.certificate.words import Words
from calibkit.instruments.fog_thermal import forms

PER_RAMP = Equation(
    forms.PER_RAMP.name,
    r"\omega_k - \omega_{k-1} = a_0 + a_1 G_{k-1} + a_2 G_{k-1}^2",
    Words(
        "ω indicated rate [°/h] of the k-th interval, G case less chamber temperature [K].",
        "ω 为第 k 个区间的示值角速率 [°/h]，G 为壳温与箱温之差 [K]。",
    ),
)
OVER_RATES = Equation(
    forms.OVER_RATES.name,
    r"a_j(r) = \sum_m c_{jm} r^m",
    Words("r temperature rate of the chamber air [°C/min].", "r 为箱内空气温变速率 [°C/min]。"),
)
LEVEL_WHERE = Words(
    "T case temperature [°C], Ṫ its rate [°C/min], G case less chamber temperature [K], Ġ its rate"
    " [K/min]. D, which is taken off, is ω less its value at rest at the reference temperature T₀:"
    " bias and earth's rate stay.",
    "T 为壳温 [°C]，Ṫ 为其速率 [°C/min]，G 为壳温与箱温之差 [K]，Ġ 为其速率 [K/min]。"
    "补偿量 D 为 ω 减去参考温度 T₀ 稳态时的值：零偏与地球自转分量保留在输出中。",
)
LAGGED_WHERE = Words(
    "T temperature of the coil's outside [°C], which follows the case with the lag τₒ; G its excess"
    " over the inside [K], which follows it with τᵢ. D, which is taken off, is ω less its value at"
    " rest at the reference temperature T₀: bias and earth's rate stay.",
    "T 为光纤环外层温度（以时间常数 τₒ 跟随壳温），G 为环内外层温差（内层以 τᵢ 跟随外层）。"
    "补偿量 D 为 ω 减去参考温度 T₀ 稳态时的值：零偏与地球自转分量保留在输出中。",
)
LATEX = (
    r"D = \omega - \omega(T_0), \quad \omega = b_0 + b_1 T + b_2 T^2 + b_3 T^3 "
    r"+ s_r \dot T + s_G G + s_{GG} G^2 + s_{Tr} T \dot T + s_{\dot G} \dot G"
)
LEVEL = Equation(forms.LEVEL.name, LATEX, LEVEL_WHERE)
LAGGED = Equation(
    forms.LAGGED.name,
    rf"{LATEX}, \quad \tau_o \dot T_o = T_s - T_o, \quad \tau_i \dot T_i = T_o - T_i",
    LAGGED_WHERE,
)
BANK = Equation(
    forms.BANK.name,
    r"D = \omega - \omega(T_0), \quad \omega = b_0 + \sum_j (a_j + b_j z) \rho_j "
    r"+ \sum_k s_k z^k + g(T) + \sum_m h_m d_m + \sum_m w_m e^{-t/\theta_m}, "
    r"\quad \rho_j = (u - x_j)/\tau_j, \quad \tau_j \dot x_j = u - x_j",
    Words(
        "u case temperature, ρⱼ its rate behind the lag τⱼ [°C/min]; T follows u with the lags"
        " tau_fast and tau_static, z = (T − 25 °C)/50 °C; g a table over T, dₘ a play operator of"
        " T, t the time since switch-on, each where the model has it. D, which is taken off, is ω"
        " less its value at rest at the reference temperature T₀: bias and earth's rate stay.",
        "u 为壳温，ρⱼ 为经时间常数 τⱼ 滞后的温变速率 [°C/min]；T 以 tau_fast、tau_static 跟随 u，"
        "z = (T − 25 °C)/50 °C；g 为 T 的表，dₘ 为 T 的滞回算子，t 为通电后的时间（模型含有时）。"
        "补偿量 D 为 ω 减去参考温度 T₀ 稳态时的值：零偏与地球自转分量保留在输出中。",
    ),
)
EXPORTED = (OVER_RATES, LEVEL, LAGGED, BANK)
