"""A fibre-optic gyro of three lumped heat capacities on temperature ramps, with its true drift: the
physics of `calibkit simulate fog_thermal`, free to change.

    indication = earth's rate + bias + turn-on bias + ω_drift + N, B and K noise, in whole pulses
    ω_drift = Σ_k p_k (T − 25)^k + (1 + c (T − 25)) (s_r T' + s_g (T_o' − T_i')) + hysteresis(T)
    T = (1 − f) T_o + f T_i

T_o and T_i are the coil's outer and inner layers, which follow case and air by their heat balance
(`LumpedGyro.flows`). A seed gives the logs that `calibkit simulate` gives.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.polynomial import chebyshev, polynomial

from calibkit.simulate import noise
from calibkit.simulate.chamber import Chamber, Programme

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

REFERENCE_DEGC, COLD_DEGC, HOT_DEGC = 25.0, -40.0, 60.0
EARTH_RATE_DPH, LATITUDE_DEG = 15.041067, 34.2
PLAYS_DEGC = (2.0, 5.0, 10.0, 20.0)
"""Half widths of the play operators whose sum is the hysteresis."""
TURN_ON_DPH, ANGLE_RANDOM_WALK = 0.02, 0.01
CASE_NOISE_DEGC, CASE_RESOLUTION_DEGC = 0.02, 0.0625
STEP = 4
"""Integration step of the heat flow [samples]."""


@dataclass(frozen=True)
class LumpedGyro:
    """Constants of one gyro."""

    tau_case_s: float
    """Lag of the case behind the air, of the outer layers behind the case, of the inner ones behind
    the outer ones, on a steady ramp."""
    tau_outer_s: float
    tau_inner_s: float
    coil_share: float
    """Heat capacity of the coil over that of the gyro, of the inner layers over the coil's."""
    inner_share: float
    self_heating_degc: float
    convection_per_degc: float
    """Relative growth of the heat transfer to the air with its temperature difference."""
    conduction_per_degc: float
    static_dph: tuple[float, ...]
    """Bias in equilibrium: coefficients of (T − 25)¹, (T − 25)² …"""
    shupe_rate: float
    """Shupe effect of the coil's mean temperature rate, of its gradient's rate [°/h/(°C/min)]."""
    shupe_gradient_rate: float
    shupe_per_degc: float
    hysteresis_dph: float
    """Bias cooling less bias heating, far from the turning points."""
    bias_dph: float
    flicker_dph: float
    rate_random_walk: float
    resolution_dph: float
    """One pulse a second."""

    @classmethod
    def draw(cls, seed: int) -> LumpedGyro:
        """A gyro whose drift is 0.5 to 3 °/h peak to peak over a ramp of 1 to 10 °C/min."""
        rng = np.random.default_rng(np.random.SeedSequence(seed))
        static_pp = float(np.exp(rng.uniform(np.log(0.8), np.log(1.4))))
        sign = rng.choice((-1.0, 1.0), 2)
        inner_share = rng.uniform(0.35, 0.6)
        return cls(
            tau_case_s=rng.uniform(180.0, 480.0),
            tau_outer_s=rng.uniform(90.0, 360.0),
            tau_inner_s=rng.uniform(60.0, 300.0),
            coil_share=rng.uniform(0.1, 0.3),
            inner_share=inner_share,
            self_heating_degc=rng.uniform(0.5, 4.0),
            convection_per_degc=rng.uniform(0.0, 0.004),
            conduction_per_degc=rng.uniform(0.0, 1e-3),
            static_dph=_draw_static(static_pp, rng),
            shupe_rate=sign[0] * static_pp * rng.uniform(0.05, 0.15),
            shupe_gradient_rate=sign[1] * static_pp * rng.uniform(0.05, 0.15),
            shupe_per_degc=rng.uniform(0.0, 2e-3),
            hysteresis_dph=static_pp * rng.uniform(0.01, 0.04),
            bias_dph=rng.normal(0.0, 0.5),
            flicker_dph=rng.uniform(0.002, 0.006),
            rate_random_walk=rng.uniform(0.0, 0.002),
            resolution_dph=float(rng.choice((0.01, 0.02, 0.05))),
        )

    def scale_drift(self, drift: float, hysteresis: float) -> LumpedGyro:
        """Gyro with all drift multiplied by a factor, and the hysteresis by one more."""
        return replace(
            self,
            static_dph=tuple(drift * power for power in self.static_dph),
            shupe_rate=drift * self.shupe_rate,
            shupe_gradient_rate=drift * self.shupe_gradient_rate,
            hysteresis_dph=drift * hysteresis * self.hysteresis_dph,
        )

    def flows(self, air: Any, temperatures: Array) -> Array:  # noqa: ANN401 (a number or an array)
        """Rates [3, °C/s or 3 × n] of case, outer and inner layers at given temperatures.

        The conductances follow from the lags: at small differences, a steady ramp of rate r has
        case = air − r τ_case + self-heating, outer = case − r τ_outer, inner = outer − r τ_inner.
        """
        case, outer, inner = temperatures
        coil, inside = self.coil_share, self.coil_share * self.inner_share
        convection = 1.0 + self.convection_per_degc * abs(air - case)
        to_case = ((air - case) * convection + self.self_heating_degc) / self.tau_case_s

        def conduct(hot: Array, cold: Array) -> Array:
            warmer = 0.5 * (hot + cold) - REFERENCE_DEGC
            return (hot - cold) * (1.0 + self.conduction_per_degc * warmer)

        to_outer = coil / self.tau_outer_s * conduct(case, outer)
        to_inner = inside / self.tau_inner_s * conduct(outer, inner)
        rates = (to_case - to_outer) / (1.0 - coil), (to_outer - to_inner) / (coil - inside)
        return np.array([*rates, to_inner / inside])

    def heat_flow(self, air: Array, rest_degc: float) -> Array:
        """Temperatures [3, n] of case, outer and inner layers for air [n] at 1 Hz, from equilibrium
        with still air at `rest_degc`: Runge-Kutta in steps of 4 s, cubic Hermite between them.
        """
        from scipy.interpolate import CubicHermiteSpline

        padded = np.pad(air, (0, -(air.size - 1) % STEP), mode="reflect", reflect_type="odd")
        before, middle = padded[:-STEP:STEP].tolist(), padded[STEP // 2 : -STEP // 2 : STEP]
        after = padded[STEP::STEP].tolist()
        heating, growth = self.self_heating_degc, self.convection_per_degc
        start = rest_degc + 2.0 * heating / (1.0 + math.sqrt(1.0 + 4.0 * growth * heating))
        temperatures = np.full(3, start)
        nodes, half = [temperatures], STEP / 2.0
        for first, midway, last in zip(before, middle.tolist(), after, strict=True):
            k1 = self.flows(first, temperatures)
            k2 = self.flows(midway, temperatures + half * k1)
            k3 = self.flows(midway, temperatures + half * k2)
            k4 = self.flows(last, temperatures + STEP * k3)
            temperatures = temperatures + STEP / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
            nodes.append(temperatures)
        coarse = np.array(nodes)
        slopes = self.flows(padded[::STEP], coarse.T).T
        places = STEP * np.arange(len(nodes), dtype=np.float64)
        return np.asarray(CubicHermiteSpline(places, coarse, slopes)(np.arange(air.size)).T)

    def hysteresis(self, coil: Array) -> Array:
        """Hysteresis of the bias [n, °/h] for coil temperatures [n, °C]."""
        if self.hysteresis_dph == 0.0:
            return np.zeros(coil.size)
        plays = np.sum([_play(coil, half_width) - coil for half_width in PLAYS_DEGC], axis=0)
        return np.asarray(self.hysteresis_dph / (2.0 * sum(PLAYS_DEGC)) * plays)

    def drift(self, air: Array, heat: Array) -> tuple[Array, Array]:
        """Bias [n, °/h] against equilibrium at 25 °C, and the hysteresis in it."""
        _, outer_rate, inner_rate = self.flows(air, heat)
        _, outer, inner = heat
        coil = (1.0 - self.inner_share) * outer + self.inner_share * inner
        coil_rate = (1.0 - self.inner_share) * outer_rate + self.inner_share * inner_rate
        rise = coil - REFERENCE_DEGC
        shupe = self.shupe_rate * coil_rate + self.shupe_gradient_rate * (outer_rate - inner_rate)
        static = polynomial.polyval(rise, np.array([0.0, *self.static_dph]))
        hysteresis = self.hysteresis(coil)
        return static + shupe * 60.0 * (1.0 + self.shupe_per_degc * rise) + hysteresis, hysteresis


@dataclass(frozen=True)
class LumpedLog:
    """A log as it is read, and what is true of it: temperatures of air and case [n, °C], the drift
    and the hysteresis in it [n, °/h].
    """

    frame: pd.DataFrame
    air: Array
    case: Array
    drift: Array
    hysteresis: Array


def _draw_static(peak_to_peak: float, rng: np.random.Generator) -> tuple[float, ...]:
    """A quartic in T − 25 °C without constant term, of some size [°/h] over the chamber's range."""
    orders = [0.0, rng.choice((-1.0, 1.0)), *(rng.normal(0.0, size) for size in (0.5, 0.2, 0.01))]
    in_chamber = chebyshev.Chebyshev(orders, domain=[COLD_DEGC, HOT_DEGC])
    swing = float(np.ptp(in_chamber(np.linspace(COLD_DEGC, HOT_DEGC, 401))))
    # the map from this domain to [−1, 1] is T − 25
    domain = [REFERENCE_DEGC - 1.0, REFERENCE_DEGC + 1.0]
    powers = in_chamber.convert(kind=polynomial.Polynomial, domain=domain)
    return tuple(float(factor) * peak_to_peak / swing for factor in powers.coef[1:])


def _play(degc: Array, half_width: float) -> Array:
    """Play operator [n, °C] of a temperature [n, °C], from the reference temperature."""
    state, followed = REFERENCE_DEGC, []
    for low, high in zip((degc - half_width).tolist(), (degc + half_width).tolist(), strict=True):
        state = min(max(state, low), high)
        followed.append(state)
    return np.array(followed)


def ramps(rates: Sequence[float], folder: str = "") -> dict[str, Programme]:
    """Programmes by file name: a heating and a cooling ramp for each rate [°C/min]."""
    soaks = {"soak_before_s": 600.0, "soak_after_s": 3600.0}
    ends = {"heating": (COLD_DEGC, HOT_DEGC), "cooling": (HOT_DEGC, COLD_DEGC)}
    return {
        f"{folder}ramp_{way}_{rate:02g}.csv": Programme.ramp(*ends[way], rate, **soaks)
        for way in ends
        for rate in rates
    }


def record(
    device: LumpedGyro, programmes: Mapping[str, Programme], seed: int
) -> dict[str, LumpedLog]:
    """Logs at 1 Hz of a gyro by file name, each from rest, with random numbers of its own."""
    chamber = Chamber()
    earth = EARTH_RATE_DPH * np.sin(np.radians(LATITUDE_DEG))
    simulated = {}
    for name in sorted(programmes):
        rng = np.random.default_rng(np.random.SeedSequence([seed, *name.encode()]))
        time, set_degc = programmes[name].set_points()
        air = chamber.air(set_degc, rng)
        heat = device.heat_flow(air, float(set_degc[0]))
        drift, hysteresis = device.drift(air, heat)
        steady = earth + device.bias_dph + rng.normal(0.0, 1.0) * TURN_ON_DPH
        # drawn in this order, so that a seed gives the same log
        case = noise.reading(heat[0], CASE_RESOLUTION_DEGC, CASE_NOISE_DEGC, rng)
        columns = {"time_s": time, "temp_case_degc": case}
        columns["temp_env_degc"] = chamber.air_reading(air, rng)
        random = noise.angle_random_walk(ANGLE_RANDOM_WALK, time.size, rng)
        random += noise.flicker(device.flicker_dph, time.size, rng)
        random += noise.rate_random_walk(device.rate_random_walk, time.size, rng)
        columns["gyro_dph"] = noise.pulses(steady + drift + random, device.resolution_dph)
        simulated[name] = LumpedLog(pd.DataFrame(columns), air, heat[0], drift, hysteresis)
    return simulated
