import io
import pickle
import tracemalloc
import warnings
import zipfile

import numpy as np
import pytest
from point_writers import POINTS, write_npz

from hilbertvae.checks import InputError
from hilbertvae.scans.formats import read_scans_path
from hilbertvae.scans.npz import read_npz
from hilbertvae.scans.point_files import read_point_file

SCAN = np.arange(len(POINTS)) // 20


@pytest.mark.parametrize("dimension", [2, 3])
def test_origins_of_each_shape(tmp_path, dimension):
    points = POINTS[:, :dimension]
    each, per_scan = points + 1, points[:3] - 5
    for origins, expected in [(each, each), (points[0], points[0]), (per_scan, per_scan[SCAN])]:
        found = read_npz(write_npz(tmp_path / "a.npz", points, origins=origins, scan=SCAN, colour=np.zeros(4)))
        np.testing.assert_array_equal(found.points, points)
        np.testing.assert_array_equal(found.origins, expected)
        np.testing.assert_array_equal(found.scan, SCAN)


def test_other_arrays_may_have_any_name_beside_the_right_ones(tmp_path):
    found = read_npz(write_npz(tmp_path / "a.npz", POINTS, origins=POINTS[0], origin=POINTS[1], scan=SCAN, scans=SCAN[:3]))
    np.testing.assert_array_equal(found.origins, POINTS[0])
    np.testing.assert_array_equal(found.scan, SCAN)


@pytest.mark.parametrize("points", [[], np.empty((0, 2)), np.empty((0, 3), "f4")])
def test_a_scan_of_no_return_is_one(tmp_path, points):
    """However it says where its beams, of which there are none, started."""
    for number in range(3):
        np.savez(tmp_path / f"{number}.npz", points=POINTS, origins=POINTS[0])
    np.savez(tmp_path / "1.npz", points=points, origins=np.zeros((1, 3)), scan=np.zeros(0, int))
    assert len(read_npz(tmp_path / "1.npz").points) == 0
    with pytest.raises(InputError, match="1.npz: expected at least one point"):
        read_point_file(tmp_path / "1.npz")
    (tmp_path / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * 3)
    with pytest.warns(UserWarning, match="1 of 3 scans have no return and are left out"):
        assert set(read_scans_path(tmp_path).scan.tolist()) == {0, 1}


def test_an_archive_that_is_not_packed_and_in_columns_order(tmp_path):
    np.savez(tmp_path / "a.npz", points=np.asfortranarray(POINTS.astype("f4")))
    np.testing.assert_array_equal(read_npz(tmp_path / "a.npz").points, POINTS)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"points": POINTS[:, :1]}, "expected points of shape"),
        ({"points": POINTS.ravel()}, "expected points of shape"),
        ({"points": POINTS.astype(str)}, "expected points of numbers"),
        ({"points": POINTS.astype(complex)}, "expected points of numbers"),
        ({"points": POINTS > 0}, "expected points of numbers"),
        ({"cloud": POINTS}, "expected an array points, found cloud$"),
        ({"xyz": POINTS, "origin": POINTS}, "expected an array points, found xyz, origin$"),
        ({"points": POINTS, "scans": SCAN}, "expected an array scan, found scans, which would be passed over; rename it"),
        ({"points": POINTS, "scan": SCAN, "origin": POINTS[0]}, "expected an array origins, found origin, which"),
        ({"points": POINTS, "scan": SCAN[:-1]}, "expected scan of shape"),
        ({"points": POINTS, "scan": SCAN.astype(float)}, "expected scan of shape"),
        ({"points": POINTS, "origins": POINTS[:3]}, "expected origins of shape"),
        ({"points": POINTS, "origins": POINTS[:, :2]}, "expected origins of shape"),
        ({"points": POINTS, "scan": SCAN, "origins": POINTS[:2]}, "scan numbers of 0 to 1"),
        ({"points": POINTS, "scan": SCAN - 1, "origins": POINTS[:3]}, "scan numbers of 0 to 2"),
    ],
)
def test_bad_arrays_are_named(tmp_path, arrays, message):
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(InputError, match=f"a.npz.*{message}"):
        read_npz(tmp_path / "a.npz")


class Trap:
    def __reduce__(self):
        return (pytest.fail, ("an array was unpickled",))


def test_nothing_is_unpickled(tmp_path):
    array = np.empty((1, 3), object)
    array[:] = Trap()
    np.savez(tmp_path / "a.npz", points=array)
    with pytest.raises(InputError, match="expected points of numbers"):
        read_npz(tmp_path / "a.npz")
    (tmp_path / "b.npz").write_bytes(pickle.dumps(Trap()))
    with pytest.raises(InputError, match="b.npz"):
        read_npz(tmp_path / "b.npz")


def forged(path, shape, data, member=zipfile.ZIP_DEFLATED):
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": False, "shape": shape})
    with zipfile.ZipFile(path, "w", member) as archive:
        archive.writestr("points.npy", file.getvalue() + data)
    return path


def test_forged_shapes_and_bombs_take_no_memory(tmp_path):
    bomb = forged(tmp_path / "bomb.npz", (3_000_000, 3), bytes(72_000_000))
    tracemalloc.start()
    with pytest.raises(InputError, match="bomb.npz.*claim to unpack"):
        read_npz(bomb)
    for shape in [(10**9, 3), (10**18, 3), (59, 3), (-1, -180), (2**62, 2**62)]:
        with pytest.raises(InputError, match="forged.npz: truncated or forged"):
            read_npz(forged(tmp_path / "forged.npz", shape, POINTS.tobytes()))
    assert tracemalloc.get_traced_memory()[1] < 20e6
    tracemalloc.stop()
    with pytest.raises(InputError, match="expected members that are stored or deflated"):
        read_npz(forged(tmp_path / "a.npz", POINTS.shape, POINTS.tobytes(), zipfile.ZIP_LZMA))


def test_single_precision_that_moves_walls_is_told(tmp_path):
    """UTM, to a quarter of a metre; a float64 file of the same place says nothing."""
    points = np.random.default_rng(0).uniform(-5, 5, (50, 2)) + [500_000.0, 4_000_000.0]
    for kind, told in ((np.float32, 1), (np.float64, 0)):
        np.savez(tmp_path / "utm.npz", points=points.astype(kind), origins=np.array([500_000.0, 4_000_000.0]))
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            read_point_file(tmp_path / "utm.npz")
        assert [f"{tmp_path / 'utm.npz'}: its coordinates, up to 400" in str(one.message) for one in caught] == [True] * told
