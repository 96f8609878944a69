"""Simulated logs of a fibre-optic gyro on temperature ramps, with their true values.

indication = earth's rate + bias + turn-on bias + drift of the coil (`simulate_gyro`)
+ angle random walk + flicker + rate random walk,      in whole pulses
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibkit.arrays import Array
from calibkit.instruments.fog_thermal.simulate_gyro import (
    CASE_RESOLUTION_DEGC,
    COLD_DEGC,
    HOT_DEGC,
    FogGyro,
    Heat,
)
from calibkit.numeric.dispersion import rms
from calibkit.simulate import noise
from calibkit.simulate.campaign import Campaign
from calibkit.simulate.chamber import Chamber, Programme

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


def _log(
    device: FogGyro, chamber: Chamber, programme: Programme, rng: np.random.Generator
) -> SimulatedLog:
    """Simulate a log at 1 Hz of a gyro in a chamber programme; both start at rest. The indication
    in whole pulses is earth's rate, bias, turn-on bias, drift and noise.
    """
    time, set_degc = programme.set_points()
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
    random = (
        noise.angle_random_walk(device.N, time.size, rng)
        + noise.flicker(device.B, time.size, rng)
        + noise.rate_random_walk(device.K, time.size, rng)
    )
    steady_dph = device.input_rate_dph + device.bias_dph + turn_on_dph
    columns["gyro_dph"] = noise.pulses(steady_dph + drift_dph + random, device.resolution_dph)
    return SimulatedLog(columns, air_degc, heat, drift_dph, turn_on_dph)


def programmes(
    rates: Sequence[float] = (1.0, 5.0, 8.0, 10.0),
    withheld: Sequence[float] = (3.0,),
    *,
    steps: bool = False,
    soak_before_s: float = 600.0,
    soak_after_s: float = 3600.0,
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
                    *ends, rate, soak_before_s=soak_before_s, soak_after_s=soak_after_s
                )
        if steps:
            runs[f"steps_{sense}.csv"] = Programme.staircase(*ends)
    return runs


def logs(
    device: FogGyro, runs: Mapping[str, Programme], seed: int, chamber: Chamber
) -> dict[str, SimulatedLog]:
    """Simulate the logs of programmes by file name; each log has its own random stream, independent
    of the other logs.
    """
    return {
        name: _log(
            device,
            chamber,
            runs[name],
            np.random.default_rng(np.random.SeedSequence([seed, *name.encode()])),
        )
        for name in sorted(runs)
    }


def campaign(
    seed: int,
    *,
    rates: Sequence[float] = (1.0, 5.0, 8.0, 10.0),
    withheld: Sequence[float] = (3.0,),
    steps: bool = False,
    drift_scale: float = 1.0,
    hysteresis_scale: float = 1.0,
    case_resolution_degc: float = CASE_RESOLUTION_DEGC,
) -> Campaign:
    """Simulate one gyro on heating and cooling ramps, one ramp per file, withheld ramps in a
    separate folder.

    Parameters
    ----------
    seed : what gyro and noise are drawn from.
    rates, withheld : unsigned rates [°C/min].
    steps : whether the chamber also climbs and descends in steps of 1 °C.
    drift_scale : multiplies all drift; 0 is a gyro without any.
    hysteresis_scale : multiplies the hysteresis alone.
    case_resolution_degc : of the case thermometer [°C].
    """
    device = replace(
        FogGyro.draw(seed).scale_drift(drift_scale=drift_scale, hysteresis_scale=hysteresis_scale),
        case_resolution_degc=case_resolution_degc,
    )
    chamber, runs = Chamber(), programmes(rates, withheld, steps=steps)
    simulated = logs(device, runs, seed, chamber)
    truth = describe(device, chamber, runs, simulated) | {"seed": seed}
    return Campaign({name: log.columns for name, log in simulated.items()}, DECIMALS, truth)


def describe(
    device: FogGyro,
    chamber: Chamber,
    runs: Mapping[str, Programme],
    simulated: Mapping[str, SimulatedLog],
) -> dict[str, object]:
    """Truth of a campaign, but for its seed; of each log a row every 60 s."""
    logs = {}
    for name, log in simulated.items():
        programme, heat = runs[name], log.heat
        series = {
            "air_degc": (log.air, 3),
            "case_degc": (heat.case, 3),
            "coil_outer_degc": (heat.outer, 3),
            "coil_inner_degc": (heat.inner, 3),
            "drift_dph": (log.drift, 5),
        }
        logs[name] = {
            "set_rate_degc_per_min": programme.rate_degc_per_min,
            "set_time_s": programme.time_s,
            "set_degc": programme.set_degc,
            "turn_on_dph": log.turn_on_dph,
            "drift_rms_dph": rms(log.drift),
            "drift_peak_to_peak_dph": float(np.ptp(log.drift)),
            "time_s": log.columns["time_s"][::TRUTH_EVERY].tolist(),
        }
        for column, (values, digits) in series.items():
            logs[name][column] = np.round(values[::TRUTH_EVERY], digits).tolist()
    return {
        "procedure": "fog_thermal",
        "gyro": asdict(device),
        "chamber": asdict(chamber),
        "drift_reference": (
            "bias less the bias of a coil in equilibrium at 25 degC before any hysteresis; turn-on"
            " bias, earth rate and noise are not drift"
        ),
        "logs": logs,
    }


CAMPAIGNS = {"fog_thermal": campaign}
