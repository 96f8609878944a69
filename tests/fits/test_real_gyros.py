"""Real gyros: the earth's rate seen by a ring-laser unit, and a Ferraris calibration of a MEMS
unit.
"""

import csv
import json

import numpy as np
import pytest

from calibkit.instruments.gyro_scale.coefficient_files import of_input_axes
from calibkit.numeric import earth
from calibkit.numeric.constants import DPH_PER_DPS
from fits.known_fit import known_fit

LATITUDE_DEG = 51.0784


def columns(path, names):
    """Columns of a CSV file as floats [n, m]."""
    with path.open(encoding="utf-8", newline="") as lines:
        return np.array([[float(row[name]) for name in names] for row in csv.DictReader(lines)])


@pytest.mark.parametrize("form", ["csv", "ins"])
def test_a_ring_laser_gyro_up_and_down_sees_the_earth_and_its_bias(real, form):
    """Half difference 11.73 °/h against the earth's 11.702 °/h, bias −0.25 °/h, to the published
    digits, from either file.
    """
    folder = real / "ln100_up_down"
    if form == "csv":
        means = [
            columns(folder / f"ln100_x_{way}.csv", ["gx_dps"]).mean() for way in ("up", "down")
        ]
    else:
        means = [
            np.fromfile(folder / f"x_LN100_{way}.ins", "<f8").reshape(-1, 7)[:, 1].mean()
            for way in ("up", "down")
        ]
    up, down = (mean * DPH_PER_DPS for mean in means)
    rate, bias = (up - down) / 2.0, (up + down) / 2.0
    assert round(float(rate), 2) == 11.73
    assert round(float(bias), 2) == -0.25
    assert round(float(earth.vertical_rate(LATITUDE_DEG)), 3) == 11.702
    assert float(rate / earth.vertical_rate(LATITUDE_DEG)) == pytest.approx(1.0027, abs=2e-4)


def ferraris(gyro, accel, interval_s, reference):
    """Triad, bias and acceleration sensitivity from six positions and three turns of −360°, as the
    reference did.
    """
    up, down = (
        np.column_stack([gyro[f"{axis}_{way}"].mean(axis=0) for axis in "xyz"]) for way in "pa"
    )
    sensitivity = (up - down) / (2.0 * 9.81)
    # the reference weighs each position by its samples
    bias = np.vstack([gyro[f"{axis}_{way}"] for axis in "xyz" for way in "pa"]).mean(axis=0)
    to_accel = np.linalg.inv(np.array(reference["K_a"]) @ np.array(reference["R_a"]))
    turns = []
    for axis in "xyz":
        acceleration = (accel[f"{axis}_rot"] - np.array(reference["b_a"])) @ to_accel.T
        offset = bias + acceleration @ sensitivity.T
        # ∫(indication − offset) dt over the angle turned
        turns.append((gyro[f"{axis}_rot"] - offset).sum(axis=0) * interval_s / -360.0)
    fit = known_fit(np.column_stack(turns).ravel(), np.zeros((9, 9)))
    return {figure.name: figure.value for figure in of_input_axes(fit, "xyz")}, bias, sensitivity


def check(found, bias, sensitivity, reference):
    """Scale factors, directions, bias and acceleration sensitivity equal the reference to 1e-9 of
    their size.
    """
    size = [found[f"scale_factor.{g}"] for g in "xyz"]
    assert size == pytest.approx(np.diag(reference["K_g"]), rel=1e-9)
    axes = [[found[f"misalignment.{g}{axis}"] for axis in "xyz"] for g in "xyz"]
    assert np.array(axes) == pytest.approx(np.array(reference["R_g"]), abs=1e-9)
    assert bias == pytest.approx(np.array(reference["b_g"]), rel=1e-9)
    assert sensitivity == pytest.approx(np.array(reference["K_ga"]), abs=1e-11)


def test_a_ferraris_session_gives_the_reference_gyro_figures(real):
    """Session in °/s with section limits: K_g, R_g, b_g, K_ga of the reference run; axes within
    0.3° of orthogonal.
    """
    folder = real / "imucal_ferraris"
    names = [f"{kind}_{axis}" for kind in ("gyr", "acc") for axis in "xyz"]
    session = columns(folder / "example_ferraris_session.csv", names)
    limits = json.loads((folder / "example_ferraris_session_list.json").read_text(encoding="utf-8"))
    reference = json.loads((folder / "reference_imucal_result.json").read_text(encoding="utf-8"))
    parts = {name: session[limit["start"] : limit["end"]] for name, limit in limits.items()}
    gyro, accel = ({name: part[:, k : k + 3] for name, part in parts.items()} for k in (0, 3))
    found, bias, sensitivity = ferraris(gyro, accel, 1.0 / 102.4, reference)
    check(found, bias, sensitivity, reference)
    errors = [found[f"orthogonality_error_deg.{pair}"] for pair in ("x_y", "x_z", "y_z")]
    assert np.abs(errors).max() < 0.3


def test_an_annotated_session_in_counts_gives_the_published_gyro_figures(real):
    """Raw counts at 204.8 Hz: the published K_g 16.6777, 16.1879, 16.2534 counts/(°/s), R_g, b_g
    and K_ga.
    """
    folder = real / "imucal_ferraris"
    with (folder / "annotated_session.csv").open(encoding="utf-8", newline="") as lines:
        rows = list(csv.DictReader(lines))
    reference = json.loads((folder / "published_example_cal.json").read_text(encoding="utf-8"))
    labels = np.array([row["part"] for row in rows])
    gyro, accel = (
        {
            name: np.array([[float(row[f"{kind}_{axis}"]) for axis in "xyz"] for row in rows])[
                labels == name
            ]
            for name in np.unique(labels)
        }
        for kind in ("gyr", "acc")
    )
    found, bias, sensitivity = ferraris(gyro, accel, 1.0 / 204.8, reference)
    check(found, bias, sensitivity, reference)
    size = [found[f"scale_factor.{g}"] for g in "xyz"]
    assert size == pytest.approx([16.6777, 16.1879, 16.2534], abs=1e-4)
