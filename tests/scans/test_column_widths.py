import numpy as np
import pytest

from hilbertvae.checks import InputError
from hilbertvae.scans.column_widths import width_by_columns
from hilbertvae.scans.velodyne import read_velodyne


def numbers(count, seed=0):
    """(count, 8): x, y, z of a street, intensity, ring, time, ambient light and a flag, in random order."""
    rng = np.random.default_rng(seed)
    place = rng.normal(0, [15, 12, 1.5], (count, 3))
    place[: count // 3, 2] = rng.normal(-1.7, 0.05, count // 3)
    others = (rng.integers(0, 256, count), rng.integers(0, 64, count), rng.uniform(0, 0.1, count), rng.gamma(2, 300, count))
    return rng.permutation(np.column_stack([place, *others, np.zeros(count)])).astype("<f4")


def padded(count):
    """(count, 8): as PCL has x, y, z and intensity in memory."""
    rows = numbers(count)
    return np.column_stack([rows[:, :3], np.ones(count), rows[:, 3], np.zeros((count, 3))]).astype("<f4")


def with_normals(count, ahead):
    """(count, 8): x, y, z and a normal, with intensity ahead of it or behind, and curvature."""
    rows, normal = numbers(count), np.random.default_rng(3).normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    between = [rows[:, 3:4] / 256, normal] if ahead else [normal, rows[:, 3:4] / 256]
    return np.column_stack([rows[:, :3], *between, rows[:, 5]]).astype("<f4")


@pytest.mark.parametrize("count", [480, 12000])
@pytest.mark.parametrize("width", [3, 5, 6, 7, 8])
def test_another_width_is_told_in_any_order(tmp_path, width, count):
    rows = numbers(count)[:, :width]
    for order in (rows, rows[np.argsort(np.arctan2(rows[:, 1], rows[:, 0]))], np.unique(rows, axis=0)):
        assert width_by_columns(order.ravel()) == width
    rows.tofile(tmp_path / "a.bin")
    with pytest.raises(InputError, match=rf"a.bin: expected 4 numbers a return.*; it looks like {width}"):
        read_velodyne(tmp_path / "a.bin")


@pytest.mark.parametrize("rows", [padded(400), with_normals(400, True), with_normals(400, False)], ids=["padded", "ahead", "behind"])
def test_eight_numbers_of_other_programs(rows):
    assert width_by_columns(rows.ravel()) == 8


@pytest.mark.parametrize("count", [3, 60, 420])
def test_few_returns_of_four_are_left_alone(count):
    for seed in range(100):
        assert width_by_columns(numbers(840, seed)[:count, :4].ravel()) is None


def test_returns_of_four_that_take_turns_are_left_alone():
    """Two sensors, whole intensities of one of them among them; and each second return none."""
    rows, flipped = numbers(840)[:, :4], numbers(840, 1)[:, :4] * np.float32([-3, 0.2, 5, 1])
    assert width_by_columns(np.stack([rows, flipped], axis=1).ravel()) is None
    assert width_by_columns(np.stack([rows, np.zeros_like(rows)], axis=1).ravel()) is None


def test_alike_columns_of_four_are_left_alone():
    for seed in range(30):
        rows = np.random.default_rng(seed).normal(size=(840, 4)).astype("<f4")
        assert width_by_columns(rows.ravel()) is None


def test_real_scans_are_left_alone_in_any_order_and_those_without_intensity_told(real_scans):
    for path in real_scans:
        rows = np.fromfile(path, "<f4").reshape(-1, 5 if path.name.endswith(".pcd.bin") else 4)[:, :4]
        rows = rows[: len(rows) // 840 * 840]  # a size that all widths divide
        for order in (rows, np.random.default_rng(0).permutation(rows)):
            assert width_by_columns(order.ravel()) is None
            assert width_by_columns(np.ascontiguousarray(order[:, :3]).ravel()) == 3
