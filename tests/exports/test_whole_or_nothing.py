"""A disk that is full while a map is written: what was there stays, and nothing half-written is left."""

import errno
import os

import pytest
from export_toys import random_cells

from hilbertvae.exports.grid_npz import write_grid
from hilbertvae.exports.mesh_ply import write_mesh_ply
from hilbertvae.exports.octree import write_octree_map
from hilbertvae.exports.points_ply import write_points_ply
from hilbertvae.exports.ros_map import write_ros_map

WRITERS = {
    "map.yaml": (write_ros_map, 2),
    "map.ot": (write_octree_map, 3),
    "map.bt": (write_octree_map, 2),
    "points.ply": (write_points_ply, 3),
    "mesh.ply": (write_mesh_ply, 3),
    "map.npz": (write_grid, 2),
}


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("there", [False, True])
def test_a_full_disk(tmp_path, monkeypatch, name, there):
    write, dimension = WRITERS[name]
    if there:
        write(random_cells(dimension, seed=1), tmp_path / name)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}

    def full(handle):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        write(random_cells(dimension, seed=2), tmp_path / name)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
