"""Coefficient files of biases, and the model forms that they hold."""

from calibkit import thermal_forms
from calibkit.forms import POLYNOMIAL

POLYNOMIALS, THERMAL = "bias.json", "thermal.json"
CASE_RANGE = ("case_lowest", "case_highest")
"""Parameters: range of the thermometer in the fitted logs [°C]; what follows it by lags went less
far.
"""
LEVEL = thermal_forms.sum_of_terms("bias-level/1")
"""Bias as the sum of terms of the case temperature and its rate."""
LAGGED = thermal_forms.sum_of_terms("bias-lagged/1")
"""Bias as the sum of terms of temperatures that lag behind the case."""
FORMS = {form.name: form for form in (POLYNOMIAL, LEVEL, LAGGED)}
