import os
from decimal import Decimal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hilbertvae.checks import InputError
from hilbertvae.mappers.voxel_bricks import BITS, KEY_BITS
from hilbertvae.scans.scan import Scans
from hilbertvae.voxel_votes import MOST_ALONG, voxel_index, voxel_votes


def test_an_outlier_is_named_before_its_beam_is_sampled():
    """At 0.2 m a beam of 1e6 m has five million samples, and bricks tell fewer voxels apart along an axis. No laser sees 100 km far."""
    points, origins = np.array([[1.0, 0, 0], [1e6, 0, 0]]), np.zeros((2, 3))
    with pytest.raises(InputError, match="extent .*too large for voxels of 0.2 m; is there an outlier"):
        voxel_votes(Scans(points, origins, np.zeros(2, np.int32), np.arange(2, dtype=np.int32)), 0.2)
    flat = Scans(points[:, :2] * 0.6, origins[:, :2], np.zeros(2, np.int32), np.arange(2, dtype=np.int32))
    with pytest.raises(InputError, match=r"a beam of 600000 m is too long for voxels of 0.5 m"):
        voxel_votes(flat, 0.5)


@pytest.mark.parametrize("far_m", [1e17, 1e18, -1e19, 1e200])
def test_outliers_beyond_whole_numbers_are_named(far_m):
    number = np.arange(2, dtype=np.int32)
    for points in ([[1.0, 0], [far_m, 0]], [[far_m, 0], [far_m, 0]]):
        with pytest.raises(InputError, match="too large for voxels of 0.1 m; is there an outlier"):
            voxel_votes(Scans(points, points, number, number), 0.1)


def test_a_map_can_tell_apart_as_many_voxels_as_votes_are_made_of():
    for dimension, most in MOST_ALONG.items():
        assert most == 1 << (KEY_BITS[dimension] - 1 + BITS[dimension])


def test_more_voxels_than_memory_holds_are_refused(monkeypatch):
    """Of beams that fill 30 000 voxels, where there is memory for 1000, looked at each time that sums are joined."""
    rng = np.random.default_rng(0)
    scans = Scans(rng.uniform(0, 40, (3000, 3)), rng.uniform(0, 40, (3000, 3)), np.zeros(3000, np.int32), np.arange(3000, dtype=np.int32))
    monkeypatch.setattr("hilbertvae.voxel_votes.SAMPLES_AT_ONCE", 1000)
    voxel_votes(scans, 0.5)
    monkeypatch.setattr("hilbertvae.voxel_votes.BYTES_A_VOXEL", os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1000)
    with pytest.raises(InputError, match="resolution_m: beams pass more than .* voxels of 0.5 m, which take more than"):
        voxel_votes(scans, 0.5)


@pytest.mark.parametrize("resolution", ["0.05", "0.07", "0.1", "0.15", "0.2", "0.25", "0.3"])
@pytest.mark.parametrize("first", ["0", "-12.35", "4567.8", "5428345.2"])
def test_a_lattice_in_decimals_has_one_point_a_voxel(resolution, first):
    """Whichever way its coordinates are made: in decimals, by steps, or by whole numbers of them."""
    cell, steps = Decimal(resolution), range(-2000, 2000)
    lowest = int(Decimal(first) / cell)
    exact = np.array([[float(cell * (lowest + step))] for step in steps])
    stepped = float(cell * lowest) + np.arange(-2000, 2000)[:, None] * float(cell)
    for points in (exact, stepped, np.arange(lowest - 2000, lowest + 2000)[:, None] * float(cell)):
        np.testing.assert_array_equal(voxel_index(points, float(cell))[:, 0], lowest + np.array(steps))


@given(st.floats(-1e4, 1e4), st.sampled_from([0.05, 0.1, 0.2, 0.3]))
def test_a_voxel_holds_its_point_but_for_rounding(place, resolution_m):
    index = voxel_index(np.array([[place]]), resolution_m)[0, 0]
    assert index - 1e-7 <= place / resolution_m <= index + 1
