import numpy as np
import pytest

from hilbertvae.scans.scan_collector import ScanCollector


@pytest.mark.parametrize("rows", [3, 4])
@pytest.mark.parametrize("dimension", [2, 3])
def test_each_return_is_placed_by_its_own_pose(rows, dimension):
    """Beam by beam, in homogeneous coordinates."""
    rng, found, wanted = np.random.default_rng(0), ScanCollector(), []
    for number, size in enumerate((5, 0, 7)):
        points, starts = rng.normal(size=(2, size + 3, 3))
        kept = np.sort(rng.choice(size + 3, size, replace=False))
        pose = np.eye(4)
        pose[:3] = np.column_stack([np.linalg.qr(rng.normal(size=(3, 3)))[0], rng.normal(size=3)])
        found.add(points, starts, kept, pose[:rows], dimension)
        for beam in kept:
            ends = [(pose @ np.append(place[beam], 1.0))[:dimension] for place in (points, starts)]
            wanted.append((*ends, number, beam))
    assert len(found) == 3 and found.returns() == 12
    whole = found.whole()
    for row, (point, origin, scan, beam) in enumerate(wanted):
        np.testing.assert_allclose(whole.points[row], point)
        np.testing.assert_allclose(whole.origins[row], origin)
        assert (whole.scan[row], whole.beam[row]) == (scan, beam)
    assert len(whole) == len(wanted) and whole.scan.dtype == whole.beam.dtype == np.int32
