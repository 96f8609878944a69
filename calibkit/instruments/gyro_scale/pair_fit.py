"""Runs of two gyros about two table axes → N, ε, γ and the angle between the gyros."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from calibkit.errors import FitError
from calibkit.instruments.gyro_scale import forms, table_runs
from calibkit.instruments.gyro_scale.numeric import pair as gyro_pair

OPPOSITE = 20.0
"""Standard uncertainties: two γ that differ by more than this, while their sum is within it, count
as equal and opposite.
"""
ONE_TEMPERATURE_DEGC = 2.0
"""Difference between the two runs' temperatures [°C] above which γ is flagged for the temperature
dependence of K.
"""


@dataclass(frozen=True, slots=True)
class PairFit:
    """Both runs of a pair by their table axis, the ratios and angle of the pair, and flags."""

    runs: Mapping[str, table_runs.TableRun]
    found: gyro_pair.GyroPair
    flags: tuple[str, ...]


def fit_pair(about_a: table_runs.TableRun, about_b: table_runs.TableRun) -> PairFit:
    """Fit N, ε, γ and α to the runs about both table axes; the covariance includes the noise that
    K_A and K_Ba of one run share.
    """
    runs = {"a": about_a, "b": about_b}
    found = gyro_pair.from_runs(about_a.scales, about_b.scales)
    gamma, uncertainty = found.gamma_from_a
    spread = float(np.hypot(uncertainty, found.standard_uncertainty[2]))
    if abs(gamma - found.gamma_indicated) > OPPOSITE * spread > abs(gamma + found.gamma_indicated):
        raise FitError(
            f"gamma is {found.gamma_indicated:.6g} from B about A's axis and {gamma:.6g} from A"
            " about B's: equal and opposite",
            hint=(
                "one gyro, or the table, has opposite signs in the two logs; state the sign in"
                " [columns]"
            ),
        )
    flags = [*about_a.flags, *about_b.flags, *found.flags]
    apart = about_a.temp_degc - about_b.temp_degc
    if abs(apart) > ONE_TEMPERATURE_DEGC:
        flags.append(
            f"the two runs are {abs(apart):.1f} °C apart: gamma carries the change of K_B"
            " between them"
        )
    for gyro, run in runs.items():
        flags += table_runs.flag_uncertain(forms.line_name(gyro, gyro), run.scale(gyro))
    return PairFit(runs, found, tuple(dict.fromkeys(flags)))
