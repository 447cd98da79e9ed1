"""A map that is already there, of another tool's or of ours, to be filled: OctoMap's files and map_server's."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from hilbertvae.cloud import Cloud
from hilbertvae.mappers.octomap_mapper import OCTREES, read_octree
from hilbertvae.mappers.octree_cloud import octree_cloud
from hilbertvae.observed_map import ros_map_cloud, ros_map_header

MAPS = (".yaml", ".yml", ".pgm", *OCTREES)
"""How the names of maps that can be filled end."""
LARGEST_CELL_M = 5.0
"""No robot's map has larger cells; one in millimetres has."""
SAME_CELL = 1e-6
"""Of a cell: one that is larger by less is as large. ROS keeps the side of cells in single precision, 0.1 as 0.10000000149."""
ON_LATTICE = 0.01
"""Of a cell: so near to the lattice that maps are written on a given one counts as on it."""


@dataclass(frozen=True)
class GivenMap:
    """dimension: 2 or 3; cell_m: the side of its cells, metres. cloud(resolution_m): its known cells as labelled points, for a mapper
    of such voxels. files: what it is read from. corner: the pose (x, y, yaw) of a ROS map's lower left corner, metres and radians; an
    OctoMap has none, since its cells count from (0, 0, 0), as those of maps that are written do."""

    dimension: int
    cell_m: float
    cloud: Callable[[float], Cloud]
    files: tuple[Path, ...]
    corner: tuple[float, float, float] | None = None


def is_given_map(path: str | os.PathLike) -> bool:
    """Whether a path ends as the file of a map does, and is no folder of scans."""
    return Path(path).suffix.lower() in MAPS and not Path(path).is_dir()


def read_given_map(path: str | os.PathLike) -> GivenMap:
    """The map at a path, with a `UserWarning` for cells that can't be in metres. Raises `InputError` for a file that is missing or
    damaged; a ROS map's image is read by `cloud`."""
    found = _octree(path) if Path(path).suffix.lower() in OCTREES else _ros_map(path)
    if found.cell_m > LARGEST_CELL_M:
        warnings.warn(f"{path}: has cells of {found.cell_m:g} m; are they in millimetres?", stacklevel=3)
    return found


def warn_of_moved_walls(path: str | os.PathLike, given: GivenMap, resolution_m: float, voxel_m: float) -> None:
    """A `UserWarning` where a ROS map's cells don't lie on the lattice through (0, 0), on which maps are written, since OctoMap's files and
    those of grids have no word for another, or where cells of a map are written in others of which they are not made. It says how far
    walls move at most.

    resolution_m: the written cells; voxel_m: those of the mapper, a whole number of which makes a written one.
    """
    *corner, yaw = given.corner or (0.0, 0.0)
    parts = given.cell_m / resolution_m
    beside = max((abs(place / given.cell_m - round(place / given.cell_m)) for place in corner), default=0.0)  # in cells
    if turned := max(abs(math.cos(yaw)), abs(math.sin(yaw))) < 1 - 1e-12:
        lies = f"are turned by {math.degrees(yaw):.3g} degrees"
    elif beside > ON_LATTICE:
        lies = f"begin at {corner[0]:.9g} {corner[1]:.9g} m, which is no whole number of them from 0 0"
    elif abs(parts - round(parts)) > SAME_CELL * parts:
        lies = f"are written in cells of {resolution_m:g} m"
    else:
        return
    # Cell by cell only where each becomes one; else a wall's cell may reach into two, and both are the wall's.
    whole = not turned and max(abs(resolution_m / given.cell_m - 1), abs(voxel_m / given.cell_m - 1)) < SAME_CELL
    moved_m = beside * given.cell_m if whole else resolution_m
    warnings.warn(
        f"{path}: its cells of {given.cell_m:g} m {lies}; those that are written count from 0 0 along the axes, so walls move by up to "
        f"{moved_m:.2g} m along each axis, and masks or overlays made for its cells no longer fit exactly",
        stacklevel=3,
    )


def _octree(path: str | os.PathLike) -> GivenMap:
    mapper = read_octree(path)
    return GivenMap(len(mapper.shift_), mapper.resolution_, partial(octree_cloud, mapper), (Path(path),))


def _ros_map(path: str | os.PathLike) -> GivenMap:
    header = ros_map_header(path)
    files = (header.path, header.image)
    return GivenMap(2, header.resolution_m, lambda resolution_m: ros_map_cloud(header, resolution_m), files, header.origin)
