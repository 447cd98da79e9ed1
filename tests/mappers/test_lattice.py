"""Returns on a lattice, as in whole centimetres, lie on sides of voxels; a grid's cell is then still the voxel that the map says."""

import numpy as np
import pytest

from hilbertvae.cloud import cloud_from_scans
from hilbertvae.grids.cluster_grids import GridSettings, bin_shown
from hilbertvae.grids.kernel import FrameIndex, kernel
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.voxel_votes import voxel_index

GRID = GridSettings(cells=32, cluster_diameter_m=3.2, inner_radius_m=0.9, minimum_points=3)
"""Whose cells are voxels, in boxes that seeds place."""


@pytest.mark.parametrize("offset", [0.0, -7.3, 100.3])
def test_a_wall_on_a_side_is_in_its_own_cell(offset):
    rng = np.random.default_rng(0)
    wall = np.round(rng.uniform(-2, 2, (400, 2)), 1) + offset  # all on sides and corners
    cloud = cloud_from_scans([wall], np.array([[0.013 + offset, 0.017 + offset]]))
    mapper = HilbertMap(grid=GRID).fit(cloud.points, cloud.occupied, cloud.weight)
    assert len(mapper.frames_)
    np.testing.assert_array_equal(bin_shown(mapper.evidence_.cloud(), mapper.frames_, mapper.grid_, False), mapper.grids_)
    returns = cloud.points[cloud.occupied]
    middles = (voxel_index(returns, 0.1) + 0.5) * 0.1  # of what the returns' own voxels are, all boxes say the same
    holding = FrameIndex(mapper.frames_).holding(middles, 3)
    told = (kernel(mapper.grids_, mapper.frames_, points, holding) for points in (returns, middles))
    np.testing.assert_array_equal(*told)


@pytest.mark.parametrize("seed", range(4))
def test_grids_that_grew_are_those_of_what_was_observed(seed):
    rng = np.random.default_rng(seed)
    mapper = HilbertMap(grid=GRID)
    for number in range(8):
        points = np.round(rng.uniform(-2, 2, (60, 2)) + [0.3 * number, 0], 1)
        cloud = cloud_from_scans([points], np.array([[0.013 + 0.3 * number, 0.017]]))
        mapper.partial_fit(cloud.points, cloud.occupied, cloud.weight)
    np.testing.assert_array_equal(bin_shown(mapper.evidence_.cloud(), mapper.frames_, mapper.grid_, False), mapper.grids_)
