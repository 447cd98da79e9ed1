"""The files of a map for other tools, by the name under which a user asks for them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from hilbertvae.checks import InputError
from hilbertvae.exports.grid_npz import write_grid
from hilbertvae.exports.map_cells import MapCells
from hilbertvae.exports.mesh_ply import write_mesh_ply
from hilbertvae.exports.octree import write_octree_map
from hilbertvae.exports.points_ply import write_points_ply
from hilbertvae.exports.rerun_recording import write_rerun
from hilbertvae.exports.ros_map import write_ros_map


@dataclass(frozen=True)
class Export:
    """One format. file: the name of what is written (formats that can't tell what is predicted add a file `..._observed`)."""

    write: Callable[[MapCells, Path], object]
    file: str
    dimensions: tuple[int, ...] = (2, 3)
    module: str | None = None
    """That has to be installed; such a format is written only where it is asked for."""


EXPORTS: dict[str, Export] = {
    "ros": Export(write_ros_map, "map.yaml", (2,)),
    "ot": Export(write_octree_map, "map.ot"),
    "bt": Export(write_octree_map, "map.bt"),
    "points": Export(write_points_ply, "points.ply"),
    "mesh": Export(write_mesh_ply, "mesh.ply", (3,)),
    "npz": Export(write_grid, "map.npz"),
    "rerun": Export(write_rerun, "map.rrd", module="rerun"),
}


def check_exports(names: Sequence[str] | None, dimension: int) -> list[str]:
    """The names of the formats to write; an `InputError` for one that is unknown, does not suit the dimension or needs an extra."""
    if names is None:
        return [name for name, kind in EXPORTS.items() if dimension in kind.dimensions and not kind.module]
    for name in names:
        if name not in EXPORTS:
            raise InputError(f"exports: expected some of {', '.join(EXPORTS)}, got {name!r}")
        if dimension not in EXPORTS[name].dimensions:
            raise InputError(f"exports: {name} is for {EXPORTS[name].dimensions[0]}D maps, got a {dimension}D one")
        if EXPORTS[name].module and find_spec(EXPORTS[name].module) is None:
            raise InputError(f"exports: {name} needs the extra {name!r}: pip install hilbertvae[{name}]")
    return list(dict.fromkeys(names))


def write_exports(names: Sequence[str], cells: MapCells, folder: Path) -> None:
    """Write the files of these formats into `folder`."""
    for name in names:
        EXPORTS[name].write(cells, folder / EXPORTS[name].file)
