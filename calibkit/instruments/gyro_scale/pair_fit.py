"""Runs of two gyros about two table axes → N, ε, γ and the angle between the gyros."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from calibkit.errors import FitError
from calibkit.instruments.gyro_scale import forms, table_runs
from calibkit.instruments.gyro_scale.numeric import gjb_figures, pair as gyro_pair
from calibkit.instruments.gyro_scale.recipe import GyroPairRecipe
from calibkit.numeric import gum

OPPOSITE = 20.0
"""Standard uncertainties: two γ that differ by more than this, while their sum is within it, count
as equal and opposite.
"""
FLAGGED_DEGC = 0.2
"""Difference between the two runs' temperatures [°C] from which it is flagged."""


@dataclass(frozen=True, slots=True)
class PairFit:
    """Both runs of a pair by their table axis, the ratios and angle of the pair, and flags."""

    runs: Mapping[str, table_runs.TableRun]
    found: gyro_pair.GyroPair
    flags: tuple[str, ...]


def fit_pair(
    about_a: table_runs.TableRun, about_b: table_runs.TableRun, spec: GyroPairRecipe
) -> PairFit:
    """Fit N, ε, γ and α to the runs about both table axes; the covariance includes the noise that
    K_A and K_Ba of one run share, the difference between the runs' temperatures, and the mounting.
    """
    runs = {"a": about_a, "b": about_b}
    apart = about_b.temp_degc - about_a.temp_degc
    stated = [(value, dof) for _, value, dof in spec.known_errors()]
    found = gyro_pair.from_runs(
        about_a.scales,
        about_b.scales,
        one_temperature=_one_temperature(apart, spec) if np.isfinite(apart) else None,
        mounting_deg=stated[0] if stated else None,
    )
    gamma, uncertainty = found.gamma_from_a
    spread = float(np.hypot(uncertainty, found.noise_of_gamma))
    if abs(gamma - found.gamma_indicated) > OPPOSITE * spread > abs(gamma + found.gamma_indicated):
        raise FitError(
            f"gamma is {found.gamma_indicated:.6g} from B about A's axis and {gamma:.6g} from A"
            " about B's: equal and opposite",
            hint=(
                "one gyro, or the table, has opposite signs in the two logs; state the sign in"
                " [columns]"
            ),
        )
    flags = [*about_a.flags, *about_b.flags, *found.flags, *_flag_temperatures(apart, spec)]
    if found.mounting_deg[0] > 0.0 and not stated:
        flags.append(
            f"the two runs show a mounting error of {found.mounting_deg[0]:.2g}°, which is in u of"
            f" gamma and alpha with {found.dof[2]:.2g} degrees of freedom (k ="
            f" {gum.coverage_factor(found.dof[2]):.3g}): state how well a mounting repeats in"
            ' [[errors.component]] group = "mounting", effect = "angle"'
        )
    for gyro, run in runs.items():
        flags += table_runs.flag_uncertain(forms.line_name(gyro, gyro), run.scale(gyro))
    return PairFit(runs, found, tuple(dict.fromkeys(flags)))


def _one_temperature(apart_degc: float, spec: GyroPairRecipe) -> gyro_pair.OneTemperature:
    """What brings both runs to the temperature in their middle: the stated temperature coefficients
    of the gyros, or a coefficient of zero within the largest one that is possible, alike for both.
    """
    half, stated = apart_degc / 2.0, spec.pair.temperature_coefficients_ppm_degc
    if stated is None:
        limit = spec.pair.largest_temperature_coefficient_ppm_degc / gjb_figures.PPM
        covariance = np.full((2, 2), limit**2 / 3.0)
        return gyro_pair.OneTemperature((half, -half), np.zeros(2), covariance)
    u = spec.pair.temperature_coefficient_uncertainty_ppm_degc / gjb_figures.PPM
    values = np.array([stated.a, stated.b]) / gjb_figures.PPM
    return gyro_pair.OneTemperature((half, -half), values, u**2 * np.eye(2))


def _flag_temperatures(apart_degc: float, spec: GyroPairRecipe) -> Iterator[str]:
    """Flag for runs at two temperatures, with what N carries of it."""
    if np.isnan(apart_degc):
        yield ("temperature is not logged: N carries no difference between the runs' temperatures")
    elif abs(apart_degc) > FLAGGED_DEGC and spec.pair.temperature_coefficients_ppm_degc is None:
        limit = spec.pair.largest_temperature_coefficient_ppm_degc
        carried = limit * abs(apart_degc) / np.sqrt(3.0)
        yield (
            f"the two runs are {abs(apart_degc):.1f} °C apart: u of N holds {carried:.2g} ppm for"
            f" scale factors that change by up to {limit:g} ppm/°C, gamma that of K_B; run both at"
            " one temperature, or state pair.temperature_coefficients_ppm_degc"
        )
