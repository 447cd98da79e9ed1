from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hilbertvae import occlusions
from hilbertvae.occlusions import random_occlusion
from hilbertvae.scans.scan import Scans
from toy_rooms import box_room, square_room

SITES = {2: square_room(), 3: box_room()}


def one_scan(dimension) -> Scans:
    scans = SITES[dimension]
    return scans.select(scans.scan == 0)


@pytest.mark.parametrize("dimension", [2, 3])
@given(seed=st.integers(0, 2**32 - 1))
def test_some_is_kept_and_some_is_not(dimension, seed):
    for scans in (SITES[dimension], one_scan(dimension)):
        kept = random_occlusion(scans, seed)
        assert kept.shape == (len(scans),) and kept.any() and not kept.all()
        np.testing.assert_array_equal(random_occlusion(scans, seed), kept)


@pytest.mark.parametrize("first", [7, 4000])
def test_numbers_count_from_the_first_scan(first):
    """As of a part of a drive, or of frames of a recording: what is hidden is what would be of the same scans from 0 on."""
    scans = SITES[2]
    later = replace(scans, scan=scans.scan + first)
    for seed in range(30):
        np.testing.assert_array_equal(random_occlusion(later, seed), random_occlusion(scans, seed))


def way(name, scans, seed):
    return getattr(occlusions, name)(scans, int(scans.scan.max()) + 1, np.random.default_rng(seed))


@pytest.mark.parametrize("seed", range(20))
def test_sparse_keeps_every_so_many_th_scan(seed):
    kept = np.unique(SITES[2].scan[way("_sparse", SITES[2], seed)])
    steps = np.unique(np.diff(kept))
    assert len(steps) <= 1 and (steps >= 2).all() and len(kept) >= 2
    assert not np.isin(SITES[2].scan[~way("_sparse", SITES[2], seed)], kept).any()  # whole scans


@pytest.mark.parametrize("seed", range(20))
def test_a_stretch_has_no_holes(seed):
    scans = SITES[2]
    kept = np.unique(scans.scan[way("_stretch", scans, seed)])
    assert (np.diff(kept) == 1).all() and 0.3 * 20 - 1 <= len(kept) <= 0.7 * 20 + 1


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("seed", range(10))
def test_a_sector_is_lost_from_every_scan(dimension, seed):
    scans = SITES[dimension]
    kept = way("_sector", scans, seed)
    x, y = (scans.points - scans.origins)[:, :2].T
    bearing = np.sort(np.arctan2(y, x)[kept])
    widest = np.diff(np.append(bearing, bearing[0] + 2 * np.pi)).max()
    assert np.pi / 3 - 0.01 <= widest <= np.pi + 0.3


def test_a_site_of_which_nothing_can_be_hidden_alone_is_shown_whole():
    """Two returns in opposite directions: now and then a draw would keep none, or both. One: nothing else is left."""
    two = Scans(np.array([[1.0, 0.0], [-1.0, 0.1]]), np.zeros((2, 2)), np.zeros(2, np.int32), np.arange(2, dtype=np.int32))
    assert {int(random_occlusion(two, seed).sum()) for seed in range(100)} == {1}
    one = two.select(np.array([True, False]))
    assert random_occlusion(one, 0).tolist() == [True]
