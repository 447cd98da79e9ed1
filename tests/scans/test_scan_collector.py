import numpy as np
import pytest

from hilbertvae.checks import InputError
from hilbertvae.scans.scan_collector import ScanCollector


@pytest.mark.parametrize("rows", [3, 4])
@pytest.mark.parametrize("dimension", [2, 3])
def test_each_return_is_placed_by_its_own_pose(rows, dimension):
    """Beam by beam, in homogeneous coordinates."""
    rng, found, wanted = np.random.default_rng(0), ScanCollector(0.0, 80.0), []
    for number, size in enumerate((5, 0, 7)):
        points, starts = rng.normal(size=(2, size + 3, 3))
        kept = np.sort(rng.choice(size + 3, size, replace=False))
        pose = np.eye(4)
        pose[:3] = np.column_stack([np.linalg.qr(rng.normal(size=(3, 3)))[0], rng.normal(size=3)])
        found.add(points, starts, kept, pose[:rows], dimension)
        for beam in kept:
            ends = [(pose @ np.append(place[beam], 1.0))[:dimension] for place in (points, starts)]
            wanted.append((*ends, number, beam))
    assert len(found) == 3
    whole = found.whole("a", 3)
    for row, (point, origin, scan, beam) in enumerate(wanted):
        np.testing.assert_allclose(whole.points[row], point)
        np.testing.assert_allclose(whole.origins[row], origin)
        assert (whole.scan[row], whole.beam[row]) == (scan, beam)
    assert len(whole) == len(wanted) and whole.scan.dtype == whole.beam.dtype == np.int32


def test_the_coarsest_of_far_scans_is_told():
    """Of scans that stations have in a grid of the land, each in float32; what their poses do is of float64."""
    found, rng = ScanCollector(0.0, 1e9), np.random.default_rng(0)
    for far_m in (5.0, 500_000.0, 100.0):
        points = (far_m + rng.normal(size=(9, 3))).astype(np.float32).astype(float)
        found.add(points, points + 1, np.arange(9), np.eye(4))
    with pytest.warns(UserWarning, match="a: its coordinates, up to 50000. m, are in single precision, which keeps them to 0.031 m"):
        found.warn("a")


def test_beams_out_of_range_and_without_a_return_are_left_out():
    found = ScanCollector(0.5, 80.0)
    np.testing.assert_array_equal(found.within(np.array([0.5, 0.6, np.nan, 79.9, 80.0, np.inf])), [1, 3])


def test_scans_without_a_beam_are_told_with_what_their_lengths_say():
    found = ScanCollector(0.5, 80.0)
    assert not len(found.within(np.full(9, 3000.0)))
    found.add(np.ones((9, 3)), np.zeros((9, 3)), np.empty(0, int), np.eye(4))
    with pytest.warns(UserWarning, match="a: half of the beams are longer than 3000 m"):
        found.warn("a")
    told = "a: expected beams of 0.5 to 80.0 m on /scan, found none in 4 scans; half of the beams are longer than 3000 m"
    with pytest.raises(InputError, match=told):
        found.whole("a", 4, " on /scan")
