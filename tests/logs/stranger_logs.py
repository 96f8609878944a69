"""Seventeen kinds of log as loggers, chambers, calibrators and boards write them, each a folder
of small files; and what a person would say that each is for.

They are made from what instruments write, by hand, and know nothing of how logs are recognised.
"""

from __future__ import annotations

import datetime as dt
import io
import re
from dataclasses import dataclass

import h5py
import numpy as np
import scipy.io
from nptdms import ChannelObject, RootObject, TdmsWriter

import bench_physics as bench

FOG = ("fog_thermal",)
STATIC = ("thermal", "bias_temperature")
ACCELEROMETER = ("accelerometer",)
START = dt.datetime(2023, 5, 4, 9, 0, 0)  # noqa: DTZ001 (a logger's clock knows no zone)


@dataclass(frozen=True)
class Kind:
    """What it is, procedures that are right for it, its writer, and lines that a person changes."""

    right: tuple[str, ...]
    write: object


KINDS = {}


def kind(name, right):
    """Enter a writer (random numbers → file name → bytes) among the kinds."""

    def enter(write):
        KINDS[name] = Kind(right, write)
        return write

    return enter


def files(name):
    """File name → bytes of a kind."""
    return KINDS[name].write(np.random.default_rng([18, *name.encode()]))


def text(head, rows, encoding="utf-8", end="\r\n"):
    """Lines with their ends, encoded."""
    return end.join([*head, *rows, ""]).encode(encoding)


def rows(formats, *columns, separator=","):
    """Lines of columns, each in its format."""
    return [
        separator.join(form.format(value) for form, value in zip(formats, row, strict=True))
        for row in zip(*columns, strict=True)
    ]


def stamps(seconds, form, start=START):
    """Date-times as a logger writes them."""
    return [(start + dt.timedelta(seconds=float(s))).strftime(form) for s in seconds]


def comma(lines):
    """Decimal commas; a date keeps its points."""
    return [re.sub(r"(?<!\d\.)\b(\d+)\.(\d+)\b(?!\.)", r"\1,\2", line) for line in lines]


# Gyros on ramps, with a second thermometer


@kind("LabVIEW measurement files with decimal commas", FOG)
def labview(rng):
    """Two headers, a separator of tabs, relative time."""
    out = {}
    for rate, t, case, air, gyro in bench.ramps(rng):
        head = [
            "LabVIEW Measurement\t", "Writer_Version\t2", "Reader_Version\t2", "Separator\tTab",
            "Decimal_Separator\t,", "Multi_Headings\tNo", "X_Columns\tOne", "Time_Pref\tRelative",
            "Operator\tHuber", "Date\t2023/05/04", "Time\t09:00:00,1231",
            "***End_of_Header***\t", "\t",
            "Channels\t3\t\t", "Samples\t1\t1\t1\t", "Date\t2023/05/04\t2023/05/04\t2023/05/04\t",
            "Time\t09:00:00,1231\t09:00:00,1231\t09:00:00,1231\t",
            "Y_Unit_Label\tdegC\tdegC\tdeg/h\t",
            "X_Dimension\tTime\tTime\tTime\t", "X0\t0,0E+0\t0,0E+0\t0,0E+0\t",
            "Delta_X\t5,000000\t5,000000\t5,000000\t", "***End_of_Header***\t\t\t",
            "X_Value\tT_Gehaeuse\tT_Kammer\tKreisel\tComment",
        ]  # fmt: skip
        body = rows(["{:.6f}", "{:.4f}", "{:.2f}", "{:.5f}"], t, case, air, gyro, separator="\t")
        name = f"{'auf' if rate > 0 else 'ab'}_{abs(rate):.0f}K.lvm"
        out[name] = text(head, comma(body), "cp1252")
    return out


@kind("German table of a gyro, and the chamber's monitor of the day", FOG)
def two_loggers(rng):
    """Six runs of one day and one chamber file; clocks 37 s apart, the chamber at 5 s to 60 s."""
    out, day = {}, []
    start = START
    for k, (_, t, case, air, gyro) in enumerate(bench.ramps(rng), start=1):
        time = stamps(t, "%d.%m.%Y %H:%M:%S", start)
        body = rows(["{}", "{:.3f}", "{:.4f}"], time, case, gyro, separator=";")
        head = [
            "Prüfling;FOG 0815;",
            "Prüfer;Huber;",
            "Zeitstempel;Gehäusetemperatur (°C);Drehrate (°/h)",
        ]
        out[f"Lauf_{k}.csv"] = text(head, comma(body), "cp1252")
        taken = np.unique(np.cumsum(rng.integers(1, 12, len(t))).clip(0, len(t) - 1))
        late = start - dt.timedelta(seconds=37)
        day += rows(
            ["{}", "{:.1f}", "{:.1f}"],
            stamps(t[taken], "%d.%m.%Y %H:%M:%S", late),
            air[taken],
            air[taken].round(0),
            separator=";",
        )
        start += dt.timedelta(seconds=float(t[-1]) + 1800.0)
    head = ["Zeit;Temperatur Istwert [°C];Temperatur Sollwert [°C]"]
    out["Klimaschrank.csv"] = text(head, comma(day), "cp1252")
    return out


@kind("gyro table and recorded replies of a Vötsch chamber", FOG)
def voetsch(rng):
    """Replies to $01I every 10 s beside a board's own log."""
    out, day, start = {}, [], START
    for rate, t, case, air, gyro in bench.ramps(rng):
        time = stamps(t, "%Y-%m-%d %H:%M:%S", start)
        body = rows(["{}", "{:.4f}", "{:.3f}"], time, gyro, case)
        out[f"run_{rate:+.0f}.csv"] = text(["timestamp,rate [deg/h],temp [degC]"], body)
        for s, now in zip(stamps(t[::2], "%Y-%m-%d %H:%M:%S", start), air[::2], strict=True):
            fields = [now, now] + [0.0] * 10
            day.append(s + " " + " ".join(f"{f:06.1f}" for f in fields) + " " + "01" * 16)
        start += dt.timedelta(seconds=float(t[-1]) + 1800.0)
    out["chamber.txt"] = text([], day, "ascii")
    return out


# Static instruments with one thermometer


@kind("hobby board warming up, counts and milliseconds", STATIC)
def board(rng):
    """MPU-6050 registers, a thermometer in counts beside one in °C, ms since the start."""
    t, temp = bench.warm_up(rng, 4000, 0.25)
    counts = [
        (a + b * (temp - 25.0) + rng.normal(0.0, s, len(t))).round()
        for a, b, s in (
            (8, 1, 8),
            (110, -3, 8),
            (16500, 4, 12),
            (9, 0.4, 2),
            (-4, -0.7, 2),
            (-20, 0.2, 2),
        )
    ]
    millis = (1000.0 * t + 17139 + rng.integers(0, 3, len(t))).astype(int)
    raw = ((temp - 36.53) * 340.0).round()
    body = rows(
        ["{:.0f}"] * 6 + ["{:.0f}", "{:.2f}", "{:.2f}", "{}"],
        *counts,
        raw,
        temp + 1.4,
        1008.0 + 0 * t,
        millis,
    )
    return {"Tempdata.csv": text(["Ax,Ay,Az,Gx,Gy,Gz,dTemp,Temp ,Press,Time"], body, end="\n")}


@kind("static IMU swept over a chamber's range in one HDF5 file", STATIC)
def swept(rng):
    """52 → −18 → 74 → 36 °C, groups of gyro, accelerometer and thermometer."""
    t, air = bench.chamber((52.0, -18.0, 74.0, 36.0), (1.0, 1.5, 1.0), 4.0, 1200.0, rng)
    temp = bench.lagged(air, t, 400.0)
    rate = np.stack([bench.thermal_rate(t, temp, rng) / 3600.0 for _ in range(3)], axis=1)
    force = np.stack([0.02 + 3e-4 * temp, -0.05 - 2e-4 * temp, bench.G + 1e-3 * temp], axis=1)
    whole = io.BytesIO()
    with h5py.File(whole, "w") as file:
        file.attrs["device"] = "IMU 12"
        for name, values, unit in (
            ("gyro", rate, "deg/s"),
            ("accel", force + rng.normal(0, 2e-3, force.shape), "m/s^2"),
        ):
            group = file.create_group(name)
            group["t"] = t
            group["t"].attrs["units"] = "s"
            for axis, column in zip("xyz", values.T, strict=True):
                group[axis] = column
                group[axis].attrs["units"] = unit
        group = file.create_group("temperature")
        group["t"] = t
        group["t"].attrs["units"] = "s"
        group["T"] = temp
        group["T"].attrs["units"] = "degC"
    return {"sweep_imu12.h5": whole.getvalue()}


@kind("serial capture with a torn line and no header", STATIC)
def serial(rng):
    """A comment of the logger, rows of blanks, one line torn, three rates and a thermometer."""
    t, temp = bench.warm_up(rng)
    rates = [bench.thermal_rate(t, temp, rng) / 3600.0 + 0.004 * k for k in range(3)]
    body = rows(["{:.2f}", "{:.6f}", "{:.6f}", "{:.6f}", "{:.2f}"], t, *rates, temp, separator=" ")
    body[6] = "-0.3-0.31"
    return {"capture.txt": text(["% 2014-03-21 17:31:51  by logger 3"], body, end="\n")}


@kind("flight controller's export, a topic a file, microseconds", STATIC)
def topics(rng):
    """Timestamp of µs without a unit, one file of the gyro and one of the accelerometer."""
    t, temp = bench.warm_up(rng, 2400)
    micros = (1e6 * t + 256551300).astype(int)
    gyro = [np.radians(bench.thermal_rate(t, temp, rng) / 3600.0) + 0.001 * k for k in range(3)]
    force = [a + 1e-3 * temp + rng.normal(0, 0.003, len(t)) for a in (0.05, -0.08, -bench.G)]
    clip = np.zeros(len(t), int)
    form = ["{}", "{:.8f}", "{:.8f}", "{:.8f}", "{:.3f}", "{}"]
    head = ["timestamp,x,y,z,temperature,clip_counter"]
    return {
        "log_3_sensor_gyro_0.csv": text(head, rows(form, micros, *gyro, temp, clip), end="\n"),
        "log_3_sensor_accel_0.csv": text(head, rows(form, micros, *force, temp, clip), end="\n"),
    }


# Accelerometers


@kind("six logs of an IMU, one a face", ACCELEROMETER)
def faces(rng):
    """m/s² and °/s at 20 Hz, ten seconds a face."""
    whole = bench.triad(np.repeat(bench.directions(6, rng), 200, axis=0), rng) * bench.G
    out = {}
    for k, name in enumerate(("x_up", "y_up", "z_up", "x_down", "y_down", "z_down")):
        force = whole[200 * k : 200 * (k + 1)].T
        rate = rng.normal(0.0, 0.05, (3, 200)) + 0.2
        body = rows(
            ["{:.2f}"] + ["{:.5f}"] * 3 + ["{:.4f}"] * 3, 0.05 * np.arange(200), *force, *rate
        )
        head = ["t(s),acc_x(m/s2),acc_y(m/s2),acc_z(m/s2),gyr_x(deg/s),gyr_y(deg/s),gyr_z(deg/s)"]
        out[f"{name}.csv"] = text(head, body)
    return out


@kind("headerless counts of an accelerometer turned by hand", ACCELEROMETER)
def tumble(rng):
    """Seconds and three registers around 32,768, positions held for four seconds."""
    series = bench.held(bench.directions(24, rng), 4.0, 1.0, 25.0)
    counts = (32768.0 + 4070.0 * bench.triad(series, rng)).round()
    t = 0.0298 + 0.04 * np.arange(len(counts))
    body = rows(["   {:.7e}"] * 4, t, *counts.T, separator="")
    return {"acc_dump.dat": text([], body, end="\n")}


@kind("one session of six positions and turns of 360° by hand", ACCELEROMETER)
def session(rng):
    """Sample numbers, °/s and m/s² at 51.2 Hz; three turns behind the positions."""
    still = bench.held(bench.directions(6, rng), 6.0, 2.0, 51.2)
    angle = np.concatenate([np.linspace(0.0, 2.0 * np.pi, 256)] * 3)
    turns = np.stack([np.sin(angle), 0.02 * np.sin(angle), np.cos(angle)], axis=1)
    force = bench.triad(np.vstack([still, turns]), rng) * bench.G
    rate = rng.normal(0.0, 0.1, force.shape) - 0.3
    moving = np.linalg.norm(np.gradient(np.vstack([still, turns]), axis=0), axis=1) > 1e-6
    rate[moving] += rng.normal(0.0, 30.0, (moving.sum(), 3))
    body = rows(["{}"] + ["{:.6f}"] * 6, range(len(force)), *rate.T, *force.T)
    return {"session.csv": text(["n_samples,gyr_x,gyr_y,gyr_z,acc_x,acc_y,acc_z"], body, end="\n")}


# Rate tables


RATES = (1.0, 5.0, 10.0, 30.0, 60.0, 100.0)


@kind("MATLAB sweeps, one row per held rate, ± apart", ("rate_table",))
def sweeps(rng):
    """One matrix of rates and outputs upwards, one downwards, and notes."""
    rates = np.array([0.0, *RATES, 150.0, 200.0])
    out = io.BytesIO()
    lines = {}
    for name, sign in (("cw", 1.0), ("ccw", -1.0)):
        pulses = 512.3 * sign * rates * (1.0 + 4e-6 * np.sin(rates / 40.0)) + 3.1
        lines[name] = np.stack([sign * rates, pulses + rng.normal(0.0, 0.02, len(rates))], axis=1)
    scipy.io.savemat(out, {**lines, "serial": "F-12", "temperature": 23.1})
    return {"scalefactor_F12.mat": out.getvalue()}


def table_log(rng, step_s, responses):
    """Seconds, rate and angle of a table, and counts per second of gyros, each (K, zero)."""
    t, rate, angle = bench.table_run(RATES, 20.0, step_s)
    counts = [k * rate + zero + rng.normal(0.0, 1.5, len(t)) for k, zero in responses]
    return t, rate, angle, counts


@kind("rate-table runs of one gyro at three temperatures", ("rate_table",))
def runs(rng):
    """Semicolons, commanded rate, pulses per second, the case's temperature."""
    out = {}
    for temp in (-30, 22, 65):
        t, rate, _, (pulses,) = table_log(
            rng, 0.5, [(1000.0 * (1.0 + 2e-5 * temp), 25.0 + 0.1 * temp)]
        )
        body = rows(
            ["{:.1f}", "{:.5f}", "{:.0f}", "{:.2f}"],
            t, rate, pulses, temp + rng.normal(0.0, 0.02, len(t)), separator=";",
        )  # fmt: skip
        head = ["Time [s];Table rate [deg/s];FOG [pulse/s];T housing [degC]"]
        out[f"SF_{temp:+d}C.csv"] = text(head, body)
    return out


@kind("two gyros, the table about each one's axis", ("gyro_pair",))
def pair(rng):
    """Two logs in one folder, both gyros in both."""
    out = {}
    for name, first, second in (
        ("axis_1", (1000.0, 20.0), (1.3, 22.0)),
        ("axis_2", (-0.9, 21.0), (998.0, 23.0)),
    ):
        t, rate, angle, (a, b) = table_log(rng, 0.5, [first, second])
        body = rows(
            ["{:.1f}", "{:.4f}", "{:.5f}", "{:.0f}", "{:.0f}"], t, angle, rate, a, b, separator="\t"
        )
        head = ["Time s\tTable position deg\tTable rate deg/s\tGyro1 pulse/s\tGyro2 pulse/s"]
        out[f"{name}.txt"] = text(head, body)
    return out


@kind("three gyros, the table about each axis", ("gyro_triad",))
def three(rng):
    """Board's registers of three gyros, the table's encoder beside."""
    matrix = 131.0 * (np.eye(3) + rng.normal(0.0, 0.01, (3, 3)))
    out = {}
    for k, axis in enumerate("XYZ"):
        t, rate, _, counts = table_log(
            rng, 0.5, [(row[k], 4.0 + n) for n, row in enumerate(matrix)]
        )
        body = rows(
            ["{:.1f}", "{:.4f}", "{:.0f}", "{:.0f}", "{:.0f}", "{:.2f}"],
            t,
            rate,
            *counts,
            24.0 + 0 * t,
        )
        head = ["t [s],omega_table [dps],Gx [LSB],Gy [LSB],Gz [LSB],T [C]"]
        out[f"Table_about_{axis}.csv"] = text(head, body)
    return out


# Noise and north


@kind("TDMS of an IMU at rest for an hour", ("gyro_noise",))
def at_rest(rng):
    """UTC start and increment, three rates, three accelerations, nearly constant temperature."""
    count = 7200
    out = io.BytesIO()
    properties = {
        "wf_start_time": np.datetime64(START),
        "wf_increment": 0.5,
        "wf_start_offset": 0.0,
    }
    channels = [
        (f"Gyro {axis}", "deg/h", rng.normal(1.0 + k, 3.0, count)) for k, axis in enumerate("XYZ")
    ]
    channels += [
        (f"Accel {axis}", "g", a + rng.normal(0.0, 1e-4, count))
        for a, axis in zip((0.01, -0.02, 0.999), "XYZ", strict=True)
    ]
    channels.append(("Board temperature", "degC", 31.0 + rng.normal(0.0, 0.02, count)))
    objects = [
        ChannelObject("Measurement", name, values, {**properties, "unit_string": unit})
        for name, unit, values in channels
    ]
    with TdmsWriter(out) as writer:
        writer.write_segment([RootObject({"name": "rest"}), *objects])
    return {"rest.tdms": out.getvalue()}


@kind("stations of a tool, typed row by row", ("inclinometer",))
def stations(rng):
    """Semicolons and decimal commas, mg and °/h, a reference heading, a footer."""
    values, azimuth = bench.four_positions(12, rng)
    values[:, 2:4] *= 1000.0
    body = rows(
        ["{:.0f}", "{:.0f}", "{:.2f}", "{:.2f}", "{:.4f}", "{:.4f}", "{:.1f}", "{:.2f}"],
        *values.T, 24.0 + 5.0 * np.repeat(np.arange(12), 4) / 3.0, np.repeat(azimuth, 4),
        separator=";",
    )  # fmt: skip
    head = ["Station;Position;Gx;Gy;Wx;Wy;Temp;Azimut", ";°;mg;mg;°/h;°/h;°C;°"]
    return {"Stationen.csv": text(head, [*comma(body), "gez. Maier"], "cp1252")}


@kind("continuous log of a tool turned through four positions", ("inclinometer",))
def tool(rng):
    """A tool's own capture: seconds, toolface motor, two accelerometers, two gyros, temperature."""
    values, _ = bench.four_positions(8, rng)
    blocks, t = [], 0.0
    for _, position, gx, gy, wx, wy in values:
        seconds = t + np.arange(60.0)
        t = seconds[-1] + 1.0
        noise = rng.normal(0.0, [[2e-5], [2e-5], [0.05], [0.05]], (4, 60))
        signals = np.array([[gx], [gy], [wx], [wy]]) + noise
        blocks.append(
            np.vstack([seconds, np.full(60, position), signals, np.full(60, 41.0 + t / 4000.0)])
        )
        turning = t + np.arange(8.0)
        t = turning[-1] + 1.0
        swing = np.linspace(position, position + 90.0, 10)[1:-1] % 360.0
        moving = np.array([[gx], [gy], [wx], [wy]]) + rng.normal(
            0.0, [[0.05], [0.05], [300.0], [300.0]], (4, 8)
        )
        blocks.append(np.vstack([turning, swing, moving, np.full(8, 41.0)]))
    whole = np.hstack(blocks)
    body = rows(
        ["{:.0f}", "{:.2f}", "{:.6f}", "{:.6f}", "{:.3f}", "{:.3f}", "{:.1f}"],
        *whole,
        separator="\t",
    )
    head = [
        "Time[s]\tMotor[deg]\tAcc X[g]\tAcc Y[g]\tGyro X[deg/h]\tGyro Y[deg/h]\tTool temp[degC]"
    ]
    return {"tool_run.txt": text(head, body)}
