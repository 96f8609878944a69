"""Hex, S-records, tables, autopilot parameters and deliveries of several units: what they hold,
proven again.
"""

import re
from dataclasses import replace

import numpy as np
import pytest

from calibkit.commands import pipeline
from calibkit.records import coefficients, store
from outputs.firmware_runs import ORDERS, UNITS, warmed_up

RAD_S = np.pi / 180.0 / 3600.0


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Return the folder of runs of three units that warmed up."""
    return warmed_up(tmp_path_factory.mktemp("units"))


def export(calibkit, runs, out, target, *names, code=0, **options):
    """Export and return the folder; hex to 0x08040000."""
    if target == "hex":
        options = {"address": "0x08040000", **options}
    extra = [
        part for key, value in options.items() for part in (f"--{key.replace('_', '-')}", value)
    ]
    outcome = calibkit("export", *(names or UNITS[:1]), *extra, runs=runs, target=target, out=out)
    assert outcome.code == code, outcome.err
    return out if code == 0 else outcome


def bias(runs, name):
    """Model of a channel of the first unit."""
    record = coefficients.loads(
        (runs / "IMU-1" / "r001" / "bias.json").read_text(encoding="utf-8"), "bias.json"
    )
    return record.model(name)


def drift(runs, name, temperature):
    """What `apply` takes out of a channel of the first unit [its own unit], by its coefficient
    file.
    """
    model = bias(runs, name)
    powers = [c.value for c in model.coefficients]
    low, high = model.valid["temp_case_degc"]
    clamped = np.clip(temperature, low, high)
    polyval = np.polynomial.polynomial.polyval
    return polyval(clamped, powers) - polyval(25.0, powers)


@pytest.mark.parametrize("target", ["blob", "hex", "csv", "px4", "ardupilot", "c"])
def test_every_file_of_every_target_verifies(calibkit, runs, tmp_path, target):
    """What export wrote, verify reads again and recomputes."""
    folder = export(calibkit, runs, tmp_path / "o", target)
    outcome = calibkit("verify", *sorted(folder.iterdir()))
    assert outcome.code == 0, outcome.err + outcome.out


@pytest.mark.parametrize("target", ["blob", "hex", "csv", "px4", "ardupilot"])
def test_one_changed_character_is_refused_in_every_target(calibkit, runs, tmp_path, target):
    """Forty places of a file, a digit or a byte changed: verify exits 4 each time, and never with a
    traceback.
    """
    folder = export(calibkit, runs, tmp_path / "o", target)
    suffix = {"blob": "bin", "px4": "params", "ardupilot": "param"}.get(target, target)
    whole = (folder / f"cal.{suffix}").read_bytes()
    for at in np.linspace(0, len(whole) - 2, 40).astype(int).tolist():
        spoilt = bytearray(whole)
        spoilt[at] = ord("7") if spoilt[at] != ord("7") else ord("3")
        (tmp_path / f"spoilt.{suffix}").write_bytes(bytes(spoilt))
        outcome = calibkit("verify", tmp_path / f"spoilt.{suffix}")
        assert outcome.code == 4, (at, outcome.out)


def test_hex_records_hold_the_blob_at_its_address(calibkit, runs, tmp_path):
    """They decode, by hand, to the bytes of the blob at 0x08040000."""
    content = (export(calibkit, runs, tmp_path / "b", "blob") / "cal.bin").read_bytes()
    lines = (export(calibkit, runs, tmp_path / "h", "hex") / "cal.hex").read_text().split()
    memory, base = {}, 0
    for line in lines:
        raw = bytes.fromhex(line[1:])
        assert sum(raw) % 256 == 0
        kind, address, data = raw[3], int.from_bytes(raw[1:3], "big"), raw[4:-1]
        if kind == 4:
            base = int.from_bytes(data, "big") << 16
        elif kind == 0:
            memory |= {base + address + k: byte for k, byte in enumerate(data)}
    assert bytes(memory[k] for k in sorted(memory)) == content
    assert min(memory) == 0x08040000


def test_px4_parameters_give_the_run_s_own_correction(calibkit, runs, tmp_path):
    """Evaluated as PX4 does, in single precision, with clamping: within 1e-4 °/h and 1 µg of the
    coefficient file.
    """
    text = (export(calibkit, runs, tmp_path / "p", "px4") / "cal.params").read_text(
        encoding="ascii"
    )
    values = {
        f[2]: np.float32(f[3])
        for f in (line.split("\t") for line in text.splitlines() if line[0] != "#")
    }
    temperature = np.linspace(0.0, 60.0, 601)
    for name in ORDERS:
        letter, axis = ("G", "A")[name.startswith("accel")], "xyz".index(name.split("_")[1])
        clamped = np.clip(
            temperature, values[f"TC_{letter}0_TMIN"], values[f"TC_{letter}0_TMAX"]
        ).astype(np.float32)
        d = clamped - values[f"TC_{letter}0_TREF"]
        x = [values.get(f"TC_{letter}0_X{k}_{axis}", np.float32(0.0)) for k in range(4)]
        offset = (x[0] + x[1] * d + x[2] * d * d + x[3] * d * d * d).astype(float)
        unit, limit = (RAD_S, 1e-4) if letter == "G" else (9.80665, 1e-6)
        assert np.max(np.abs(offset / unit - drift(runs, name, temperature))) < limit


@pytest.mark.parametrize("target", ["px4", "ardupilot"])
def test_the_error_that_a_parameter_file_states_is_a_bound(calibkit, runs, tmp_path, target):
    """At 100,001 temperatures from TMIN to TMAX, in single precision and in two orders of
    evaluation, no offset is further from the coefficient file; and TMIN to TMAX holds its range.
    """
    (path,) = sorted(export(calibkit, runs, tmp_path / "p", target).iterdir())
    lines = path.read_text(encoding="ascii").splitlines()
    words = [re.split(r"[\t,]", line)[-4:] for line in lines if line[0] != "#"]
    values = {
        w[-3] if target == "px4" else w[-2]: w[-2] if target == "px4" else w[-1] for w in words
    }
    values = {name: np.float32(value) for name, value in values.items()}
    bounds = {
        found[1]: float(found[2])
        for line in lines
        if (found := re.match(r"# error bound   (\w+): (\S+) ", line))
    }
    assert set(bounds) == {"_".join(name.split("_")[:2]) for name in ORDERS}
    for name in ORDERS:
        sensor, axis = name.split("_")[:2]
        if target == "px4":
            stem = f"TC_{'G' if sensor == 'gyro' else 'A'}0"
            c = [values[f"{stem}_X{k}_{'xyz'.index(axis)}"] for k in range(4)]
            low, high, about = (values[f"{stem}_{end}"] for end in ("TMIN", "TMAX", "TREF"))
            scale = np.float32(1.0)
        else:
            letters = "GYR" if sensor == "gyro" else "ACC"
            c = [np.float32(0.0)]
            c += [values[f"INS_TCAL1_{letters}{k}_{axis.upper()}"] for k in (1, 2, 3)]
            low, high, about = values["INS_TCAL1_TMIN"], values["INS_TCAL1_TMAX"], np.float32(35.0)
            scale = np.float32(1e-6)
        (valid,) = bias(runs, name).valid.values()
        assert float(low) <= valid[0]
        assert float(high) >= valid[1]
        temperature = np.linspace(low, high, 100_001, dtype=np.float32)
        d = temperature - about
        exactly = drift(runs, name, np.clip(temperature.astype(float), *valid))
        exactly = exactly * (RAD_S if sensor == "gyro" else 9.80665)
        for offset in (
            (c[0] + (c[1] + (c[2] + c[3] * d) * d) * d) * scale,
            (c[0] + c[1] * d + c[2] * (d * d) + c[3] * (d * d * d)) * scale,
        ):
            error = offset.astype(float) - exactly
            worst = np.ptp(error) if target == "ardupilot" else np.abs(error).max()
            assert bounds[f"{sensor}_{axis}"] / 30.0 < worst <= bounds[f"{sensor}_{axis}"]


def test_ardupilot_parameters_give_the_run_s_own_changes(calibkit, runs, tmp_path):
    """Between any two temperatures, as ArduPilot calculates it: within 1e-3 °/h and 1 µg of the
    coefficient file.
    """
    text = (export(calibkit, runs, tmp_path / "p", "ardupilot") / "cal.param").read_text(
        encoding="ascii"
    )
    values = {
        f[0]: np.float32(f[1])
        for f in (line.split(",") for line in text.splitlines() if line[0] != "#")
    }
    temperature = np.linspace(0.0, 60.0, 601)
    clamped = np.clip(temperature, values["INS_TCAL1_TMIN"], values["INS_TCAL1_TMAX"]).astype(
        np.float32
    )
    d = clamped - np.float32(35.0)
    for name in ORDERS:
        letters, axis = ("GYR", "ACC")[name.startswith("accel")], name.split("_")[1].upper()
        c = [values[f"INS_TCAL1_{letters}{k}_{axis}"] for k in (1, 2, 3)]
        removed = ((c[0] + (c[1] + c[2] * d) * d) * d * np.float32(1e-6)).astype(float)
        removed = (
            removed - removed[300]
        )  # what it adds again at the temperature of the offset calibration
        expected = drift(runs, name, temperature)
        unit, limit = (RAD_S, 1e-3) if letters == "GYR" else (9.80665, 1e-6)
        assert np.max(np.abs(removed / unit - (expected - expected[300]))) < limit


@pytest.mark.parametrize("target", ["px4", "ardupilot"])
def test_a_chain_that_an_autopilot_cannot_hold_is_refused_with_the_reason(
    calibkit, tmp_path, target
):
    """A gyro pair's scale factors are no offsets over temperature: exit 4, nothing written."""
    from conftest import ROOT

    fitted = calibkit(
        "fit", "gyro_pair", data=ROOT / "datasets" / "gyro_pair", serial="P", out=tmp_path / "r"
    )
    assert fitted.code == 0
    outcome = export(calibkit, tmp_path / "r", tmp_path / "o", target, "P", code=4)
    assert "polynomials of temperature and nothing else" in outcome.err
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize("target", ["blob", "hex", "csv", "px4", "ardupilot"])
def test_verify_states_the_verdict_on_each_device_of_every_target(runs, tmp_path, target):
    """A rejected device, one without a verdict, an accepted one: its own file, the table of all
    three and the manifest state it in three values.
    """
    verdicts = (("no verdict", None), ("rejected", False), ("accepted", True))
    three = [
        replace(run, document={**run.document, "verdict": verdict, "accepted": accepted})
        for run, (verdict, accepted) in zip(
            (store.load(runs / name / "r001") for name in UNITS[:3]), verdicts, strict=True
        )
    ]
    address = 0x08040000 if target == "hex" else None
    said = {
        path.name: pipeline.verify(path).what
        for path in pipeline.export(
            three, target, "f32", "cal", tmp_path, address=address, allow_rejected=True
        )
    }
    for name, what in said.items():
        if "IMU-2" in name:
            assert what.endswith(", REJECTED")
        elif name.endswith(("manifest.json", ".csv")):
            assert what.endswith(", REJECTED: IMU-2, no verdict: IMU-1")
        elif "IMU-1" in name:
            assert what.endswith(", no verdict")
        else:
            assert "REJECTED" not in what
            assert "no verdict" not in what


def test_what_cannot_be_delivered_together_is_refused(calibkit, runs, tmp_path):
    """C sources of two units, the same unit twice, and an address beyond 32 bits: one line each,
    nothing written.
    """
    cases = (
        (("c", *UNITS), {}, "this target takes one"),
        (("blob", "IMU-1", "IMU-1@r001"), {}, "IMU-1 stands twice"),
        (("hex", "IMU-1"), {"address": "0xFFFFFFF0"}, "leave 32 bits"),
        (("hex", "IMU-1"), {}, "without --address"),
        (("srec", "IMU-1"), {}, "no such target"),
        (("blob", "IMU-1"), {"address": "0x08040000"}, "only hex states an address"),
        (("csv", "IMU-1"), {"number": "f16"}, "its number formats are"),
        (("elf", "IMU-1"), {}, "no such target"),
    )
    for (target, *names), options, said in cases:
        outcome = calibkit(
            *("export", *names, "--runs", runs, "--target", target, "--out", tmp_path / "o"),
            *(part for key, value in options.items() for part in (f"--{key}", value)),
        )
        assert outcome.code in {2, 4}
        assert said in outcome.err
        assert not (tmp_path / "o").exists()
