"""A map that is already there, of another tool's or of ours, to be filled: OctoMap's files and map_server's."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from hilbertvae.cloud import Cloud
from hilbertvae.mappers.octomap_mapper import OCTREES, read_octree
from hilbertvae.mappers.octree_cloud import octree_cloud
from hilbertvae.observed_map import read_ros_map, ros_map_cell_m
from hilbertvae.scans.file_points import named

ROS_MAPS = (".yaml", ".yml", ".pgm")
LARGEST_CELL_M = 5.0
"""No robot's map has larger cells; one in millimetres has."""


@dataclass(frozen=True)
class GivenMap:
    """dimension: 2 or 3; cell_m: the side of its cells, metres. cloud(resolution_m): its known cells as labelled points, for a mapper
    of such voxels."""

    dimension: int
    cell_m: float
    cloud: Callable[[float], Cloud]


def is_given_map(path: str | os.PathLike) -> bool:
    """Whether a path ends as the file of a map does, and not as one of scans."""
    return Path(path).suffix.lower() in (*ROS_MAPS, *OCTREES)


def read_given_map(path: str | os.PathLike) -> GivenMap:
    """The map at a path, with a `UserWarning` for cells that can't be in metres. Raises `InputError` for a file that is missing or
    damaged; a ROS map's image is read by `cloud`."""
    found = _octree(path) if Path(path).suffix.lower() in OCTREES else _ros_map(path)
    if found.cell_m > LARGEST_CELL_M:
        warnings.warn(f"{path}: has cells of {found.cell_m:g} m; are they in millimetres?", stacklevel=3)
    return found


def _octree(path: str | os.PathLike) -> GivenMap:
    mapper = read_octree(path)

    def cloud(resolution_m: float) -> Cloud:
        with named(path):
            return octree_cloud(mapper, resolution_m)

    return GivenMap(len(mapper.shift_), mapper.resolution_, cloud)


def _ros_map(path: str | os.PathLike) -> GivenMap:
    return GivenMap(2, ros_map_cell_m(path), lambda resolution_m: read_ros_map(path, resolution_m))
