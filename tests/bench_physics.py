"""What instruments and chambers do, as plain arrays; no code of calibkit stands behind it."""

from __future__ import annotations

import numpy as np

G = 9.7966  # m/s², of the laboratory
EARTH_DPH = 15.041067


def lagged(values, time_s, constant_s):
    """A first-order lag of the given time constant, settled at the first value."""
    out = np.empty(len(values))
    out[0] = values[0]
    share = 1.0 - np.exp(-np.diff(time_s) / constant_s)
    for k in range(1, len(values)):
        out[k] = out[k - 1] + share[k - 1] * (values[k] - out[k - 1])
    return out


def chamber(levels, rates, step_s, soak_s, rng):
    """Seconds and air of a chamber that goes through levels [°C] at rates [°C/min], with soaks."""
    time, air = [0.0, soak_s], [levels[0], levels[0]]
    for k, rate in enumerate(rates):
        time.append(time[-1] + 60.0 * abs(levels[k + 1] - levels[k]) / rate)
        time.append(time[-1] + soak_s)
        air += [levels[k + 1]] * 2
    seconds = np.arange(0.0, time[-1], step_s)
    clean = lagged(np.interp(seconds, time, air), seconds, 25.0)
    return seconds, clean + rng.normal(0.0, 0.08, len(seconds))


def thermal_rate(seconds, case, rng, noise=0.02):
    """A rate [°/h] that follows case temperature, its slope through a lag, and white noise."""
    z = (case - 25.0) / 50.0
    slope = 60.0 * np.gradient(case, seconds)
    drift = 0.4 * z - 0.15 * z**2 + 0.11 * lagged(slope, seconds, 90.0)
    return 8.1 + drift + rng.normal(0.0, noise, len(seconds))


def ramp(low, high, rate, rng, step_s=5.0, soak_s=900.0):
    """One ramp between soaks: seconds, case, air, rate [°/h]."""
    seconds, air = chamber((low, high), (rate,), step_s, soak_s, rng)
    case = lagged(air, seconds, 320.0) + rng.normal(0.0, 0.01, len(seconds))
    return seconds, case, air, thermal_rate(seconds, case, rng)


def ramps(rng, rates=(1.0, 3.0, 5.0), **options):
    """Ramps both ways between −30 °C and 50 °C: (signed rate, seconds, case, air, rate)."""
    return [
        (sign * rate, *ramp(-40.0 * sign + 10.0, 40.0 * sign + 10.0, rate, rng, **options))
        for rate in rates
        for sign in (1.0, -1.0)
    ]


def warm_up(rng, rows=3000, step_s=1.0):
    """Seconds and temperature of a board that warms up by itself after power-on."""
    seconds = step_s * np.arange(rows)
    return seconds, 14.0 + 21.0 * (1.0 - np.exp(-seconds / (0.3 * seconds[-1])))


def triad(directions, rng, noise=0.0008):
    """Indications [g] of a real triad for gravity along the given directions (rows)."""
    matrix = np.eye(3) + rng.normal(0.0, 0.004, (3, 3))
    zero = rng.normal(0.0, 0.006, 3)
    return directions @ matrix.T + zero + rng.normal(0.0, noise, directions.shape)


def directions(count, rng):
    """Unit vectors, spread over the sphere, faces first."""
    faces = np.vstack([np.eye(3), -np.eye(3)])
    others = rng.normal(size=(max(count - 6, 0), 3))
    others /= np.linalg.norm(others, axis=1, keepdims=True)
    return np.vstack([faces, others])[:count]


def held(positions, hold_s, turn_s, rate_hz):
    """Rows of directions held for a while each, with turns between them, as by hand."""
    hold, turn = round(hold_s * rate_hz), round(turn_s * rate_hz)
    rows = []
    for k, position in enumerate(positions):
        rows.append(np.repeat(position[None, :], hold, axis=0))
        if k + 1 < len(positions):
            share = np.linspace(0.0, 1.0, turn + 2)[1:-1, None]
            between = (
                (1.0 - share) * position + share * positions[k + 1] + 0.3 * np.sin(np.pi * share)
            )
            rows.append(between / np.linalg.norm(between, axis=1, keepdims=True))
    return np.vstack(rows)


def table_run(rates, hold_s, step_s):
    """A rate table's program: seconds, rate [°/s] and angle [°], ± rates with zero between."""
    count = round(hold_s / step_s)
    speed = np.repeat(np.concatenate([[0.0], *([r, -r] for r in rates), [0.0]]), count)
    ramped = np.convolve(np.pad(speed, (1, 1), "edge"), np.ones(3) / 3.0, "valid")
    return step_s * np.arange(1, len(speed) + 1), ramped, np.cumsum(ramped) * step_s % 360.0


def four_positions(stations, rng, latitude_deg=34.2):
    """North-seeking stations: (station, position, gx, gy, wx, wy), azimuth of each station [°]."""
    rows, azimuths = [], []
    for station in range(1, stations + 1):
        theta, phi, psi = rng.uniform(0.15, 1.0), rng.uniform(0.0, 6.28), rng.uniform(0.0, 6.28)
        gravity, earth = _across(theta, phi, psi, np.radians(latitude_deg))
        azimuths.append(np.degrees(psi) % 360.0)
        for position in (0, 90, 180, 270):
            turn = np.exp(-1j * np.radians(position))
            g, w = gravity * turn, earth * turn
            rows.append(
                (station, position, g.real + 0.002, g.imag - 0.001, w.real + 0.8, w.imag - 0.3)
            )
    values = np.array(rows)
    values[:, 2:4] += rng.normal(0.0, 2e-5, (len(values), 2))
    values[:, 4:] += rng.normal(0.0, 0.008, (len(values), 2))
    return values, np.array(azimuths)


def _across(theta, phi, psi, latitude):
    """Gravity [g] and earth's rate [°/h] across a tool, as complex numbers x + iy."""
    about_z = np.array([[np.cos(psi), np.sin(psi), 0], [-np.sin(psi), np.cos(psi), 0], [0, 0, 1]])
    about_y = np.array(
        [[np.cos(theta), 0, -np.sin(theta)], [0, 1, 0], [np.sin(theta), 0, np.cos(theta)]]
    )
    face = np.array([[np.cos(phi), np.sin(phi), 0], [-np.sin(phi), np.cos(phi), 0], [0, 0, 1]])
    turn = face @ about_y @ about_z
    g = turn @ np.array([0.0, 0.0, 1.0])
    w = turn @ (EARTH_DPH * np.array([np.cos(latitude), 0.0, -np.sin(latitude)]))
    return complex(g[0], g[1]), complex(w[0], w[1])
