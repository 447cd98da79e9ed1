import struct

import numpy as np
import pytest

from hilbertvae.checks import InputError
from hilbertvae.scans.velodyne import read_velodyne


def test_little_endian_float32(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(struct.pack("<8f", 1, 2, 3, 0.5, -4, 5.5, np.nan, 0))
    np.testing.assert_array_equal(read_velodyne(path).points, [[1, 2, 3], [-4, 5.5, np.nan]])


@pytest.mark.parametrize("size", [0, 1, 15, 17])
def test_parts_of_returns(tmp_path, size):
    (tmp_path / "a.bin").write_bytes(bytes(size))
    with pytest.raises(InputError, match=f"a.bin: truncated or foreign; .* got {size} bytes"):
        read_velodyne(tmp_path / "a.bin")


RNG = np.random.default_rng(5)
FIVE = np.column_stack([RNG.normal(0, 20, (400, 3)), RNG.integers(0, 256, 400), np.arange(400) % 32]).astype("<f4")
"""As nuScenes has them: x, y, z, intensity, ring. 8000 bytes are whole returns of 16 bytes as well."""


@pytest.mark.parametrize("name", ["a.pcd.bin", "A.PCD.BIN"])
def test_five_numbers_a_return_by_name(tmp_path, name):
    FIVE.tofile(tmp_path / name)
    np.testing.assert_array_equal(read_velodyne(tmp_path / name).points, FIVE[:, :3])
    (tmp_path / name).write_bytes(bytes(16))
    with pytest.raises(InputError, match=r"expected float32 x, y, z, intensity, ring \(20 bytes a return\), got 16 bytes"):
        read_velodyne(tmp_path / name)


@pytest.mark.parametrize("count", [400, 399])
def test_five_numbers_a_return_under_kittis_name(tmp_path, count):
    FIVE[:count].tofile(tmp_path / "a.bin")
    with pytest.raises(InputError, match="a.bin: expected 4 numbers a return; it looks like 5, as nuScenes writes them: name it .pcd.bin"):
        read_velodyne(tmp_path / "a.bin")


@pytest.mark.parametrize("scale", [0, 1])
def test_four_numbers_a_return_whatever_the_size(tmp_path, scale):
    """Whole intensities and an empty file of zeros among them."""
    four = (scale * FIVE[:, :4]).astype("<f4")
    four.tofile(tmp_path / "a.bin")
    assert four.nbytes % 80 == 0
    np.testing.assert_array_equal(read_velodyne(tmp_path / "a.bin").points, four[:, :3])
    whole = np.arange(80, dtype="<f4").reshape(-1, 4)
    whole.tofile(tmp_path / "b.bin")
    np.testing.assert_array_equal(read_velodyne(tmp_path / "b.bin").points, whole[:, :3])


def street(count):
    """(count, 4): a spinning lidar's returns of the ground and of a wall, firing after firing of 32 lasers, and their intensities."""
    azimuth = 2 * np.pi * (np.arange(count) // 32) / max(count // 32, 1)
    down = np.radians(np.linspace(-30, 10, 32))[np.arange(count) % 32]
    length = np.minimum(1.8 / np.maximum(-np.sin(down), 1e-3), 12 / np.maximum(np.abs(np.cos(azimuth)), 0.2))
    flat = length * np.cos(down)
    place = np.column_stack([flat * np.cos(azimuth), flat * np.sin(azimuth), length * np.sin(down)])
    return np.column_stack([place + RNG.normal(0, 0.02, place.shape), RNG.random(count)])


RING, TIME = np.arange(4800) % 32, np.linspace(0, 0.1, 4800)
OTHERS = {
    "xyz": (3, street(4800)[:, :3]),
    "time": (5, np.column_stack([street(4800), TIME])),
    "ring and time": (6, np.column_stack([street(4800), RING, TIME])),
    "epoch": (6, np.column_stack([street(4800), RING, 1.62e9 + TIME])),
    "epoch, shuffled": (6, RNG.permutation(np.column_stack([20 * street(4800), RING, 1.62e9 + TIME]))),
    "colours": (6, np.column_stack([street(4800)[:, :3], RNG.integers(0, 256, (4800, 3))])),
    "no returns": (6, np.where(RNG.random((4800, 1)) < 0.2, np.nan, np.column_stack([street(4800), RING, TIME]))),
}


@pytest.mark.parametrize("name", OTHERS)
def test_another_number_a_return(tmp_path, name):
    width, rows = OTHERS[name]
    rows.astype("<f4").tofile(tmp_path / "a.bin")
    with pytest.raises(InputError, match=rf"a.bin: expected 4 numbers a return \(x, y, z, intensity\); it looks like {width}"):
        read_velodyne(tmp_path / "a.bin")


@pytest.mark.parametrize("name", ["a.bin", "a.pcd.bin"])
@pytest.mark.parametrize("width", [3, 4, 5])
def test_float64_is_told_from_float32(tmp_path, name, width):
    """Made of float32, of which half of each number is 0 or absurd, of more digits, and of so few that these halves are all 0."""
    rows = np.column_stack([street(4801), RING.repeat(2)[:4801]])[:, :width]
    rows[5:900] = 0
    rows[1000:1500, :3] = np.nan
    for double in (rows.astype("<f4").astype("<f8"), rows, rows.round()):
        double.astype("<f8").tofile(tmp_path / name)
        with pytest.raises(InputError, match=r"bin: expected float32 x, y, z.*look like float64: write them as float32 \(.astype\('<f4'\)"):
            read_velodyne(tmp_path / name)


def test_a_narrow_corridor_is_not_taken_for_float64(tmp_path):
    """Its y and intensity alone could be the upper halves of such numbers."""
    rows = np.column_stack([RNG.uniform(-30, 30, 800), RNG.choice([-1.5, 1.5], 800), RNG.uniform(-1, 2, 800), np.ones(800)])
    rows.astype("<f4").tofile(tmp_path / "a.bin")
    assert len(read_velodyne(tmp_path / "a.bin").points) == 800


@pytest.mark.parametrize("order", ["as scanned", "shuffled"])
@pytest.mark.parametrize(("name", "width"), [("a.bin", 4), ("a.pcd.bin", 5)])
def test_coordinate_by_coordinate_is_told(tmp_path, name, width, order):
    rows = np.column_stack([street(4800), RING])[:, :width]
    rows = rows if order == "as scanned" else RNG.permutation(rows)
    rows.T.astype("<f4").tofile(tmp_path / name)
    with pytest.raises(InputError, match=rf"\(N, {width}\); it looks like all x, then all y, as \({width}, N\): write its transpose"):
        read_velodyne(tmp_path / name)


def random_clouds():
    """Clouds of 4 numbers in random order and in one, near and far, flat and with no-returns; of few returns, too."""
    for seed in range(60):
        rng = np.random.default_rng(seed)
        rows = rng.choice([60, 120, 1200, 4800])
        spread = rng.choice([0.01, 0.3, 5, 40, 3e6], 4)
        cloud = rng.normal(0, spread, (rows, 4)) if seed % 2 else rng.uniform(-1, 1, (rows, 4)) * spread
        cloud[:, 3] = [rng.integers(0, 256, rows), rng.random(rows), np.zeros(rows), cloud[:, 0]][seed % 4]
        if seed % 3 == 0:
            cloud = cloud[np.argsort(cloud[:, rng.integers(4)])]
        if seed % 5 == 0:
            cloud[rng.random(rows) < 0.5, :3] = (0, np.nan)[seed % 2]
        yield cloud + rng.choice([0, 5e6])
    yield street(4800)
    yield np.tile([[10.0, 20, 30, 0], [-10, -20, -30, 1]], (600, 1))  # two sensors in turn


def test_clouds_of_four_are_never_refused(tmp_path):
    for cloud in random_clouds():
        cloud.astype("<f4").tofile(tmp_path / "a.bin")
        np.testing.assert_array_equal(read_velodyne(tmp_path / "a.bin").points, cloud.astype("<f4")[:, :3])


def test_real_scans_are_never_refused(tmp_path, real_scans):
    """Cut to a size that every width divides, so that nothing but the numbers tells; nuScenes' without their rings."""
    for path in real_scans:
        rows = np.fromfile(path, "<f4").reshape(-1, 5 if path.name.endswith(".pcd.bin") else 4)[:, :4]
        rows = rows[: len(rows) // 15 * 15]
        rows.tofile(tmp_path / "a.bin")
        np.testing.assert_array_equal(read_velodyne(tmp_path / "a.bin").points, rows[:, :3])


def test_real_scans_are_told_from_what_was_written_wrongly(tmp_path, real_scans):
    for path in real_scans:
        (tmp_path / path.name).write_bytes(path.read_bytes())
        read_velodyne(tmp_path / path.name)
        rows = np.fromfile(path, "<f4").reshape(-1, 5 if path.name.endswith(".pcd.bin") else 4)
        for wrong, message in ((rows.astype("<f8"), "look like float64"), (np.ascontiguousarray(rows.T), "write its transpose")):
            wrong.tofile(tmp_path / path.name)
            with pytest.raises(InputError, match=message):
                read_velodyne(tmp_path / path.name)


@pytest.mark.parametrize("width", [3, 4, 6])
def test_another_number_a_return_under_nuscenes_name(tmp_path, width):
    """In so many bytes that they could be returns of five."""
    rows = np.column_stack([street(1000)[:, :3], np.full((1000, 3), 0.3)])[:, :width]
    rows.astype("<f4").tofile(tmp_path / "a.pcd.bin")
    with pytest.raises(InputError, match="a.pcd.bin: expected 5 numbers a return .*; the fifth are no rings: name it .bin if it has 4"):
        read_velodyne(tmp_path / "a.pcd.bin")
