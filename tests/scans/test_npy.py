import io
import tracemalloc

import numpy as np
import pytest
from point_writers import POINTS, random_poses, write_drive, write_npy, write_ply

from hilbertvae.checks import InputError
from hilbertvae.scans.formats import ReadingSettings, is_scan_path, read_scans_path
from hilbertvae.scans.npy import read_npy


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("kind", ["f2", ">f4", "f8", "i4"])
def test_numbers_of_each_kind_and_order(tmp_path, dimension, kind):
    points = POINTS[:, :dimension].astype(kind)
    for array in (points, np.asfortranarray(points)):
        np.testing.assert_array_equal(read_npy(write_npy(tmp_path / "a.npy", array)).points, points.astype(float))


def test_an_origin_is_needed_as_of_other_clouds_without_one(tmp_path):
    path = write_npy(tmp_path / "a.npy")
    with pytest.raises(InputError, match=r"a.npy: says not where its beams started; set reading.sensor_origin_m to 3 numbers"):
        read_scans_path(path)
    assert is_scan_path("a.npy") and len(read_scans_path(path, ReadingSettings(sensor_origin_m=[0, 0, 0]))) == len(POINTS)


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.zeros((9, 4)), r"expected points of shape \(N, 2\) or \(N, 3\), got \(9, 4\): write its first columns, points\[:, :3\]"),
        (np.zeros(9), r".* got \(9,\)$"),
        (np.zeros((2, 9, 3)), r".* got \(2, 9, 3\)$"),
        (np.zeros((9, 3), "c8"), "expected points of numbers, got dtype complex64"),
        (np.full((9, 3), "a"), "expected points of numbers, got dtype <U1"),
        (np.array([[None] * 3]), "can't be read as a .npy file"),
        ([], "expected at least one point"),
        (np.zeros((0, 3)), "expected at least one point"),
    ],
)
def test_other_arrays_are_refused(tmp_path, array, message):
    np.save(tmp_path / "a.npy", array, allow_pickle=True)
    with pytest.raises(InputError, match=f"a.npy: {message}"):
        read_scans_path(tmp_path / "a.npy", ReadingSettings(sensor_origin_m=[0, 0, 0]))


def test_a_forged_shape_takes_no_memory(tmp_path):
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "<f8", "fortran_order": False, "shape": (10**9, 3)})
    (tmp_path / "a.npy").write_bytes(head.getvalue() + bytes(240))
    tracemalloc.start()
    with pytest.raises(InputError, match="a.npy: can't be read as a .npy file"):
        read_npy(tmp_path / "a.npy")
    assert tracemalloc.get_traced_memory()[1] < 20e6
    tracemalloc.stop()


def test_a_folder_of_arrays_and_arrays_beside_scans(tmp_path):
    arrays = write_drive(tmp_path / "arrays", POINTS.reshape(3, 20, 3), random_poses(3), "{}.npy", write_npy)
    scans = write_drive(tmp_path / "scans", POINTS.reshape(3, 20, 3), random_poses(3), "{}.ply", write_ply)
    np.save(scans / "labels.npy", np.zeros(60))
    np.testing.assert_allclose(read_scans_path(scans).points, read_scans_path(arrays).points)
