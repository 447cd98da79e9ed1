"""An OctoMap as what was observed: the voxels of its leaves as labelled points."""

from __future__ import annotations

from sklearn.utils.validation import check_is_fitted

from hilbertvae.checks import InputError
from hilbertvae.cloud import Cloud
from hilbertvae.mappers.octomap_mapper import ORIGIN, OctoMapMapper
from hilbertvae.mappers.octree import DEPTH, morton_keys
from hilbertvae.observed_map import cloud_of_cells

MOST_VOXELS = 1 << 26
"""Of pruned leaves taken apart: a leaf near the root, eight bytes of a file, stands for more voxels than any memory holds."""


def octree_cloud(mapper: OctoMapMapper, resolution_m: float | None = None) -> Cloud:
    """The voxels of a map, as `read_octree` gives it: occupied from p = 0.5 on, as OctoMap says it, else free. By the cuts of scores a wall
    that beams graze, of a hit and two misses (0.51), would be left out, and be filled in again as free.

    resolution_m: see `observed_map.cloud_of_cells`. Raises `InputError` for a map that holds no such voxel, or too many of them.
    """
    check_is_fitted(mapper)
    leaves, cell_m, dimension = mapper.leaves_, mapper.resolution_, len(mapper.shift_)
    if dimension == 2:  # one layer of voxels, so nothing in it is pruned; what a file has besides is not on the map
        leaves = leaves.select((leaves.depth == DEPTH) & (morton_keys(leaves.start)[:, 2] == ORIGIN))
    count = leaves.voxel_count()
    if not 0 < count <= MOST_VOXELS:
        raise InputError(f"octree: expected 1 to {MOST_VOXELS} occupied and free voxels, got {count} of {cell_m:g} m")
    code, leaf = leaves.voxels()
    index = morton_keys(code)[:, :dimension] - ORIGIN + mapper.shift_
    return cloud_of_cells((index + 0.5) * cell_m, leaves.log_odds[leaf] >= 0, cell_m, resolution_m)
