"""Simulated logs of a fibre-optic gyro on temperature ramps, with their true values.

    indication = earth's rate + bias + turn-on bias + ω_drift + N, B and K noise, in whole pulses
    ω_drift = Σ_k p_k (T − 25)^k + (1 + c (T − 25)) (s_r T' + s_g (T_o' − T_i')) + hysteresis(T)
    T = (1 − f) T_o + f T_i

T_o and T_i are the coil's outer and inner layers, which follow case and air by the heat balance of
three nodes (`_flows`); p is the bias in equilibrium, s_r and s_g the Shupe effect (Shupe 1980,
Applied Optics 19:654) of the temperature rate and of the gradient's rate, the hysteresis a sum of
play operators. Every fitted model only approximates this.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.polynomial import chebyshev, polynomial
from numpy.typing import NDArray

from calibkit.numeric.arrays import Array
from calibkit.numeric.constants import EARTH_RATE_DPH, SECONDS_PER_MINUTE
from calibkit.numeric.dispersion import rms
from calibkit.simulate import noise
from calibkit.simulate.campaign import Campaign
from calibkit.simulate.chamber import Chamber, Programme

REFERENCE_DEGC = 25.0
"""Temperature at which drift is zero, in equilibrium and before any hysteresis [°C]."""
COLD_DEGC, HOT_DEGC = -40.0, 60.0
LATITUDE_DEG = 34.2
"""Latitude of the laboratory [°]; the input axis points up."""
STEP = 4
"""Integration step of the heat flow [samples]: a tenth of the usual shortest time constant of a
coil, a fifth of any.
"""


@dataclass(frozen=True, slots=True)
class FogGyro:
    """Constants of one gyro: heat flow, drift, noise and resolution."""

    tau_case_s: float
    """Lag of the case behind the air on a steady ramp, at small differences."""
    tau_outer_s: float
    """Lag of the coil's outer layers behind the case on a steady ramp at the reference temperature.
    """
    tau_inner_s: float
    """Lag of the coil's inner layers behind the outer ones, likewise."""
    coil_share: float
    """Heat capacity of the coil relative to the whole gyro."""
    inner_share: float
    """Heat capacity of the inner layers relative to the coil."""
    self_heating_degc: float
    """Excess of the case over still air due to the electronics, at small differences."""
    convection_per_degc: float
    """Relative growth of the heat transfer to the air with its temperature difference [1/°C]."""
    conduction_per_degc: float
    """Relative growth of the internal conductances with temperature [1/°C]."""
    static_dph: tuple[float, ...]
    """Bias in equilibrium: coefficients of (T − 25)¹, (T − 25)² ... [°/h/°C, °/h/°C² ...]."""
    shupe_rate: float
    """Shupe effect of the coil's mean temperature rate [°/h/(°C/min)]."""
    shupe_gradient_rate: float
    """Shupe effect of the rate of the difference of outer and inner layers [°/h/(°C/min)]."""
    shupe_per_degc: float
    """Relative growth of both Shupe effects with temperature [1/°C], as the fibre's index gets
    steeper.
    """
    hysteresis_dph: float
    """Bias cooling less bias heating, far from the turning points."""
    hysteresis_play_degc: tuple[float, ...]
    """Half widths of equally weighted play operators."""
    bias_dph: float
    turn_on_dph: float
    """Standard deviation of the turn-on bias between logs."""
    input_rate_dph: float
    """True rotation rate: the earth's."""
    N: float
    """Angle random walk [°/√h]."""
    B: float
    """Bias instability (flicker) [°/h]."""
    K: float
    """Rate random walk [°/h/√h]."""
    resolution_dph: float
    """One pulse a second."""
    case_noise_degc: float
    """Standard deviation of a reading of the case thermometer before rounding."""
    case_resolution_degc: float

    def scale_drift(self, *, drift_scale: float = 1.0, hysteresis_scale: float = 1.0) -> "FogGyro":
        """Gyro with all drift, or the hysteresis alone, multiplied by a factor."""
        return replace(
            self,
            static_dph=tuple(factor * drift_scale for factor in self.static_dph),
            shupe_rate=self.shupe_rate * drift_scale,
            shupe_gradient_rate=self.shupe_gradient_rate * drift_scale,
            hysteresis_dph=self.hysteresis_dph * drift_scale * hysteresis_scale,
        )

    def heat_flow(self, air_degc: Array, rest_degc: float) -> "Heat":
        """Temperatures of case and coil for air temperatures [n, °C] at 1 Hz, from equilibrium with
        air at `rest_degc`.

        Classical Runge-Kutta in steps of 4 s, cubic Hermite between them.
        """
        from scipy.interpolate import CubicHermiteSpline  # a slow import

        count = len(air_degc)
        # a last step that is not full is continued straight on
        padded = np.pad(air_degc, (0, -(count - 1) % STEP), mode="reflect", reflect_type="odd")
        before, middle, after = (
            padded[offset : offset - STEP or None : STEP].tolist()
            for offset in (0, STEP // 2, STEP)
        )
        # the whole gyro in equilibrium with still air: the root of its heat balance
        heating, growth = self.self_heating_degc, self.convection_per_degc
        # (case - air)(1 + growth (case - air)) = heating
        start = rest_degc + 2.0 * heating / (1.0 + math.sqrt(1.0 + 4.0 * growth * heating))
        temperatures = np.full(3, start)
        nodes, half = [temperatures], STEP / 2.0
        for air_before, air_middle, air_after in zip(before, middle, after, strict=True):
            k1 = _flows(self, air_before, temperatures)
            k2 = _flows(self, air_middle, temperatures + half * k1)
            k3 = _flows(self, air_middle, temperatures + half * k2)
            k4 = _flows(self, air_after, temperatures + STEP * k3)
            temperatures = temperatures + STEP / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
            nodes.append(temperatures)
        coarse = np.array(nodes)
        slopes = _flows(self, padded[::STEP], coarse.T).T
        places = np.arange(len(nodes)) * float(STEP)
        smooth = CubicHermiteSpline(places, coarse, slopes)(np.arange(count))
        case, outer, inner = smooth.T
        _, outer_rate, inner_rate = _flows(self, air_degc, smooth.T)
        return Heat(case, outer, inner, outer_rate, inner_rate)

    def hysteresis(self, coil_degc: Array) -> Array:
        """Hysteresis of the bias [n, °/h] for coil temperatures [n, °C]: Prandtl-Ishlinskii sum of
        play operators.
        """
        if self.hysteresis_dph == 0.0:
            return np.zeros(len(coil_degc))
        widths = self.hysteresis_play_degc
        play_sum: Array = np.sum(
            [_play(coil_degc, half_width) - coil_degc for half_width in widths], axis=0
        )
        return self.hysteresis_dph / (2.0 * sum(widths)) * play_sum

    def drift(self, heat: "Heat") -> Array:
        """Bias [n, °/h] relative to equilibrium at the reference temperature: static part, Shupe
        effects, hysteresis.
        """
        share = self.inner_share
        # light passes all layers: the drift is that of their mean by heat capacity
        coil = (1.0 - share) * heat.outer + share * heat.inner
        coil_rate = (1.0 - share) * heat.outer_rate + share * heat.inner_rate
        rise = coil - REFERENCE_DEGC
        shupe = self.shupe_rate * coil_rate + self.shupe_gradient_rate * (
            heat.outer_rate - heat.inner_rate
        )
        static: Array = polynomial.polyval(rise, np.array([0.0, *self.static_dph]))
        return (
            static
            + shupe * SECONDS_PER_MINUTE * (1.0 + self.shupe_per_degc * rise)
            + self.hysteresis(coil)
        )

    @classmethod
    def draw(cls, seed: int) -> Self:
        """Draw a gyro whose drift is 0.5 to 3 °/h peak to peak over a ramp of 1 to 10 °C/min from
        −40 to 60 °C.
        """
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
            static_dph=_static_shape(static_pp, rng),
            shupe_rate=sign[0] * static_pp * rng.uniform(0.05, 0.15),
            shupe_gradient_rate=sign[1] * static_pp * rng.uniform(0.05, 0.15),
            shupe_per_degc=rng.uniform(0.0, 2e-3),
            hysteresis_dph=static_pp * rng.uniform(0.01, 0.04),
            hysteresis_play_degc=(2.0, 5.0, 10.0, 20.0),
            bias_dph=rng.normal(0.0, 0.5),
            turn_on_dph=0.02,
            input_rate_dph=EARTH_RATE_DPH * np.sin(np.radians(LATITUDE_DEG)),
            N=0.01,
            B=rng.uniform(0.002, 0.006),
            K=rng.uniform(0.0, 0.002),
            resolution_dph=float(rng.choice((0.01, 0.02, 0.05))),
            case_noise_degc=0.02,
            case_resolution_degc=0.0625,
        )


@dataclass(frozen=True, slots=True)
class Heat:
    """Temperatures [n, °C] of case and coil at 1 Hz, and the coil's rates [n, °C/s]."""

    case: Array
    outer: Array
    inner: Array
    outer_rate: Array
    inner_rate: Array


def _static_shape(peak_to_peak: float, rng: np.random.Generator) -> tuple[float, ...]:
    """Draw a quartic in T − 25 °C without constant term, with a peak-to-peak value [°/h] over the
    chamber's range.
    """
    orders = [0.0, rng.choice((-1.0, 1.0)), *(rng.normal(0.0, size) for size in (0.5, 0.2, 0.01))]
    in_chamber = chebyshev.Chebyshev(orders, domain=[COLD_DEGC, HOT_DEGC])
    swing = np.ptp(in_chamber(np.linspace(COLD_DEGC, HOT_DEGC, 401)))
    # the map from this domain to [−1, 1] is T − 25
    powers = in_chamber.convert(
        kind=polynomial.Polynomial, domain=[REFERENCE_DEGC - 1.0, REFERENCE_DEGC + 1.0]
    )
    return tuple(float(factor) * peak_to_peak / float(swing) for factor in powers.coef[1:])


def _flows(device: FogGyro, air_degc: float | Array, temperatures: Array) -> Array:
    """Rates [3, °C/s or 3 × n] of case, outer and inner layers, whose temperatures are given, by
    the heat balance of three nodes; heat capacities are relative to that of the whole gyro.

    The conductances follow from the lags: at small differences, a steady ramp of rate r has case =
    air − r τ_case + self-heating, outer = case − r τ_outer, inner = outer − r τ_inner.
    """
    case, outer, inner = temperatures
    difference, coil = air_degc - case, device.coil_share
    convection = 1.0 + device.convection_per_degc * abs(difference)
    to_case = (difference * convection + device.self_heating_degc) / device.tau_case_s
    warmer = 0.5 * (case + outer) - REFERENCE_DEGC
    conduction = 1.0 + device.conduction_per_degc * warmer
    to_outer = coil / device.tau_outer_s * (case - outer) * conduction
    warmer, inside = 0.5 * (outer + inner) - REFERENCE_DEGC, coil * device.inner_share
    conduction = 1.0 + device.conduction_per_degc * warmer
    to_inner = inside / device.tau_inner_s * (outer - inner) * conduction
    of_case, of_outer = (to_case - to_outer) / (1.0 - coil), (to_outer - to_inner) / (coil - inside)
    return np.array([of_case, of_outer, to_inner / inside])


def _play(degc: Array, half_width: float) -> Array:
    """Play operator [n, °C] of a temperature [n, °C]: it follows only if pushed by more than its
    half width.

    It starts at the reference temperature (Krasnosel'skii & Pokrovskii 1989, chapter 1).
    """
    # hysteresis begins unloaded where the drift is zero
    state = REFERENCE_DEGC
    followed = []
    for low, high in zip((degc - half_width).tolist(), (degc + half_width).tolist(), strict=True):
        state = min(max(state, low), high)
        followed.append(state)
    return np.array(followed)


TRUTH_EVERY = 60
"""Samples between two rows of true values."""
DECIMALS = {"temp_case_degc": 4, "temp_env_degc": 1, "gyro_dph": 3}


@dataclass(frozen=True, slots=True)
class SimulatedLog:
    """Simulated log: logged columns and true values."""

    columns: Mapping[str, NDArray[Any]]
    air: Array
    heat: Heat
    drift: Array
    """Bias [n, °/h] relative to equilibrium at 25 °C, without turn-on bias, earth's rate and noise.
    """
    turn_on_dph: float


def programmes(
    rates: Sequence[float] = (1.0, 5.0, 8.0, 10.0),
    withheld: Sequence[float] = (3.0,),
    *,
    steps: bool = False,
) -> dict[str, Programme]:
    """Programmes by file name: a heating and a cooling ramp for each rate [°C/min], and with
    `steps` staircases of 1 °C in both directions.
    """
    runs = {}
    for sense, ends in {
        "heating": (COLD_DEGC, HOT_DEGC),
        "cooling": (HOT_DEGC, COLD_DEGC),
    }.items():
        for folder, members in (("", rates), ("withheld/", withheld)):
            for rate in members:
                runs[f"{folder}ramp_{sense}_{rate:02g}.csv"] = Programme.ramp(
                    *ends, rate, soak_before_s=600.0, soak_after_s=3600.0
                )
        if steps:
            runs[f"steps_{sense}.csv"] = Programme.staircase(*ends)
    return runs


def logs(
    device: FogGyro, runs: Mapping[str, Programme], seed: int, chamber: Chamber
) -> dict[str, SimulatedLog]:
    """Simulate the logs at 1 Hz of a gyro in a chamber, by file name; both start at rest. Each log
    has its own random stream, independent of the other logs.

    The indication in whole pulses is earth's rate, bias, turn-on bias, drift and noise.
    """
    simulated = {}
    for name in sorted(runs):
        # a log added to a campaign leaves the others as they were
        rng = np.random.default_rng(np.random.SeedSequence([seed, *name.encode()]))
        time, set_degc = runs[name].set_points()
        # the gyro sees the air, not the set point: the chamber lags and overshoots
        air_degc = chamber.air(set_degc, rng)
        heat = device.heat_flow(air_degc, float(set_degc[0]))
        drift_dph, turn_on_dph = device.drift(heat), rng.normal(0.0, 1.0) * device.turn_on_dph
        # drawn in this order, so that a seed gives the same log
        columns: dict[str, NDArray[Any]] = {
            "time_s": time.astype(np.int64),
            "temp_case_degc": noise.reading(
                heat.case, device.case_resolution_degc, device.case_noise_degc, rng
            ),
            "temp_env_degc": chamber.air_reading(air_degc, rng),
        }
        random = noise.angle_random_walk(device.N, time.size, rng)
        random += noise.flicker(device.B, time.size, rng)
        random += noise.rate_random_walk(device.K, time.size, rng)
        steady_dph = device.input_rate_dph + device.bias_dph + turn_on_dph
        columns["gyro_dph"] = noise.pulses(steady_dph + drift_dph + random, device.resolution_dph)
        simulated[name] = SimulatedLog(columns, air_degc, heat, drift_dph, turn_on_dph)
    return simulated


def campaign(
    seed: int, device: FogGyro | None = None, runs: Mapping[str, Programme] | None = None
) -> Campaign:
    """Simulate a gyro, drawn by the seed unless one is given, in the programmes `runs`, by default
    heating and cooling ramps, one a file, withheld ones in a separate folder; of each log the truth
    has a row every 60 s.
    """
    device, chamber = FogGyro.draw(seed) if device is None else device, Chamber()
    runs = programmes() if runs is None else runs
    simulated = logs(device, runs, seed, chamber)
    true_logs = {}
    for name, log in simulated.items():
        programme, heat = runs[name], log.heat
        series = {
            "air_degc": (log.air, 3),
            "case_degc": (heat.case, 3),
            "coil_outer_degc": (heat.outer, 3),
            "coil_inner_degc": (heat.inner, 3),
            "drift_dph": (log.drift, 5),
        }
        true_logs[name] = {
            "set_rate_degc_per_min": programme.rate_degc_per_min,
            "set_time_s": programme.time_s,
            "set_degc": programme.set_degc,
            "turn_on_dph": log.turn_on_dph,
            "drift_rms_dph": rms(log.drift),
            "drift_peak_to_peak_dph": float(np.ptp(log.drift)),
            "time_s": log.columns["time_s"][::TRUTH_EVERY].tolist(),
        }
        for column, (values, digits) in series.items():
            true_logs[name][column] = np.round(values[::TRUTH_EVERY], digits).tolist()
    truth = {
        "procedure": "fog_thermal",
        "gyro": asdict(device),
        "chamber": asdict(chamber),
        "drift_reference": (
            "bias less the bias of a coil in equilibrium at 25 degC before any hysteresis; turn-on"
            " bias, earth rate and noise are not drift"
        ),
        "logs": true_logs,
        "seed": seed,
    }
    return Campaign({name: log.columns for name, log in simulated.items()}, DECIMALS, truth)
