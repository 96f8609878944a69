"""Files of several tables: side by side, behind each other, or one of them with its own units."""

import h5py
import numpy as np
import pytest
import scipy.io

from calibkit.errors import LogFormatError
from calibkit.readers import registry
from calibkit.recipe.logs import Logs

TIME = np.arange(5.0)


@pytest.fixture
def imu(tmp_path):
    """Return an HDF5 file with groups of a gyro and an accelerometer, each with t and x."""
    path = tmp_path / "imu.h5"
    with h5py.File(path, "w") as file:
        for name, unit, values in (("accel", "m/s^2", 9.8 + TIME), ("gyro", "deg/s", TIME)):
            file[f"{name}/t"] = TIME
            file[f"{name}/x"] = values
            file[f"{name}/x"].attrs["units"] = unit
    return path


def read(path, **keys):
    """Return the table of a file."""
    return registry.read(path, path.name, Logs(files=("*",), **keys), ())


@pytest.mark.parametrize(("table", "unit"), [("accel", "m/s^2"), ("gyro", "deg/s")])
def test_a_column_has_the_unit_of_its_own_group(imu, table, unit):
    """Two groups with a column x: the unit of the other group's x is not taken."""
    assert read(imu, table=table).units == {"x": unit}


def test_groups_of_one_clock_are_read_side_by_side(imu):
    """Columns are called by their paths, with their units; the time stands once."""
    found = read(imu, table="*")
    assert list(found.frame.columns) == ["accel/t", "accel/x", "gyro/x"]
    assert found.units == {"accel/x": "m/s^2", "gyro/x": "deg/s"}
    with h5py.File(imu, "a") as file:
        file["gyro/t"][...] += 0.5
    with pytest.raises(LogFormatError, match="'gyro/t' and 'accel/t' are different times"):
        read(imu, table="*")


def test_tables_behind_each_other_are_one_log(tmp_path):
    """Two sweeps of a matrix each: rows of the second follow; other columns are refused."""
    up, down = np.column_stack([TIME, 2.0 * TIME]), np.column_stack([-TIME, -2.0 * TIME])
    path = tmp_path / "sweeps.mat"
    scipy.io.savemat(path, {"up": up, "down": down, "wide": np.ones((4, 3))})
    found = read(path, tables=("up", "down"), names=("rate", "out"))
    np.testing.assert_array_equal(found.frame.to_numpy(), np.vstack([up, down]))
    assert list(found.frame.index + 2) == list(range(1, 11))
    with pytest.raises(LogFormatError, match="'wide' is a matrix of 4 × 3"):
        read(path, tables=("up", "wide"), names=("rate", "out"))
