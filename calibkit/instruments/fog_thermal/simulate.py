"""Simulated logs of a fibre-optic gyro on temperature ramps, with their true values."""

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
from calibkit.simulate.chamber import (
    Chamber,
    Programme,
)

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


def _indication(
    device: FogGyro, drift_dph: Array, turn_on_dph: float, rng: np.random.Generator
) -> Array:
    """Indication [n, °/h] at 1 Hz in whole pulses: earth's rate, bias, drift [n, °/h] and noise."""
    count = len(drift_dph)
    random = (
        noise.angle_random_walk(device.N, count, rng)
        + noise.flicker(device.B, count, rng)
        + noise.rate_random_walk(device.K, count, rng)
    )
    return noise.pulses(
        device.input_rate_dph + device.bias_dph + turn_on_dph + drift_dph + random,
        device.resolution_dph,
    )


def _log(
    device: FogGyro, chamber: Chamber, programme: Programme, rng: np.random.Generator
) -> SimulatedLog:
    """Simulate a log at 1 Hz of a gyro in a chamber programme; both start at rest."""
    time, set_degc = programme.set_points()
    air_degc = chamber.air(set_degc, rng)
    heat = device.heat_flow(air_degc, float(set_degc[0]))
    drift_dph = device.drift(heat)
    turn_on_dph = rng.normal(0.0, 1.0) * device.turn_on_dph
    columns: dict[str, NDArray[Any]] = {
        "time_s": time.astype(np.int64),
        "temp_case_degc": noise.reading(
            heat.case, device.case_resolution_degc, device.case_noise_degc, rng
        ),
        "temp_env_degc": chamber.air_reading(air_degc, rng),
        "gyro_dph": _indication(device, drift_dph, turn_on_dph, rng),
    }
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
    ends = {"heating": (COLD_DEGC, HOT_DEGC), "cooling": (HOT_DEGC, COLD_DEGC)}
    ramps = {
        f"{folder}ramp_{sense}_{rate:02g}.csv": Programme.ramp(
            *between, rate, soak_before_s=soak_before_s, soak_after_s=soak_after_s
        )
        for folder, members in (("", rates), ("withheld/", withheld))
        for sense, between in ends.items()
        for rate in members
    }
    return ramps | (
        {f"steps_{sense}.csv": Programme.staircase(*between) for sense, between in ends.items()}
        if steps
        else {}
    )


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
    device = FogGyro.draw(seed).scale_drift(
        drift_scale=drift_scale, hysteresis_scale=hysteresis_scale
    )
    device = replace(device, case_resolution_degc=case_resolution_degc)
    chamber, runs = Chamber(), programmes(rates, withheld, steps=steps)
    made = logs(device, runs, seed, chamber)
    truth = describe(device, chamber, runs, made) | {"seed": seed}
    return Campaign({name: made[name].columns for name in made}, DECIMALS, truth)


def describe(
    device: FogGyro,
    chamber: Chamber,
    runs: Mapping[str, Programme],
    made: Mapping[str, SimulatedLog],
) -> dict[str, object]:
    """Truth of a campaign, but for its seed."""
    return {
        "procedure": "fog_thermal",
        "gyro": asdict(device),
        "chamber": asdict(chamber),
        "drift_reference": (
            "bias less the bias of a coil in equilibrium at 25 degC before any hysteresis; turn-on"
            " bias, earth rate and noise are not drift"
        ),
        "logs": {name: _truth_of(runs[name], made[name]) for name in made},
    }


def _truth_of(programme: Programme, simulated: SimulatedLog) -> dict[str, object]:
    """True values of one log every 60 s, as a JSON object."""
    heat = simulated.heat
    series = {
        "air_degc": (simulated.air, 3),
        "case_degc": (heat.case, 3),
        "coil_outer_degc": (heat.outer, 3),
        "coil_inner_degc": (heat.inner, 3),
        "drift_dph": (simulated.drift, 5),
    }
    return {
        "set_rate_degc_per_min": programme.rate_degc_per_min,
        "set_time_s": programme.time_s,
        "set_degc": programme.set_degc,
        "turn_on_dph": simulated.turn_on_dph,
        "drift_rms_dph": rms(simulated.drift),
        "drift_peak_to_peak_dph": float(np.ptp(simulated.drift)),
        "time_s": simulated.columns["time_s"][::TRUTH_EVERY].tolist(),
    } | {
        name: np.round(values[::TRUTH_EVERY], digits).tolist()
        for name, (values, digits) in series.items()
    }


CAMPAIGNS = {"fog_thermal": campaign}
