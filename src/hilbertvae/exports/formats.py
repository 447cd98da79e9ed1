"""The files of a map for other tools, by the name under which a user asks for them."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from hilbertvae.checks import InputError, how_to_install
from hilbertvae.cores import on_all_cores
from hilbertvae.exports.grid_npz import write_grid
from hilbertvae.exports.map_cells import MapCells
from hilbertvae.exports.mesh_ply import write_mesh_ply
from hilbertvae.exports.octree import write_octree_map
from hilbertvae.exports.points_ply import write_points_ply
from hilbertvae.exports.rerun_recording import write_rerun
from hilbertvae.exports.ros_map import write_ros_map


@dataclass(frozen=True)
class Export:
    """One format. files: what is written, the main one first (formats that can't tell what is predicted add `..._observed`)."""

    write: Callable[[MapCells, Path], object]
    files: tuple[str, ...]
    dimensions: tuple[int, ...] = (2, 3)
    module: str | None = None
    """That has to be installed; such a format is written only where it is asked for."""


EXPORTS: dict[str, Export] = {
    "ros": Export(write_ros_map, ("map.yaml", "map.pgm", "map_observed.yaml", "map_observed.pgm"), (2,)),
    "ot": Export(write_octree_map, ("map.ot", "map_observed.ot")),
    "bt": Export(write_octree_map, ("map.bt", "map_observed.bt")),
    "points": Export(write_points_ply, ("points.ply",)),
    "mesh": Export(write_mesh_ply, ("mesh.ply",), (3,)),
    "npz": Export(write_grid, ("map.npz",)),
    "rerun": Export(write_rerun, ("map.rrd",), module="rerun"),
}


def check_names(names: Sequence[str] | None) -> None:
    """An `InputError` for what is no list of formats' names, and for one that needs an extra which is not installed."""
    if isinstance(names, str) or not isinstance(names, Sequence | None):
        raise InputError(f"exports: expected a list, some of {', '.join(EXPORTS)}, got {names!r:.60}")
    for name in names or ():
        if not isinstance(name, str) or name not in EXPORTS:
            raise InputError(f"exports: expected some of {', '.join(EXPORTS)}, got {name!r}")
        if EXPORTS[name].module and find_spec(EXPORTS[name].module) is None:
            raise InputError(f"exports: {name} needs the extra {name!r}: {how_to_install(name)}")


def suiting_exports(names: Sequence[str] | None, dimension: int) -> list[str]:
    """The names of the formats to write, all that suit unless given; an `InputError` for one that does not suit the dimension."""
    if names is None:
        return [name for name, kind in EXPORTS.items() if dimension in kind.dimensions and not kind.module]
    for name in names:
        if dimension not in EXPORTS[name].dimensions:
            raise InputError(f"exports: {name} is for {EXPORTS[name].dimensions[0]}D maps, got a {dimension}D one")
    return list(dict.fromkeys(names))


def write_exports(names: Sequence[str], cells: MapCells, folder: Path, asked_for: bool = True) -> None:
    """Write the files of these formats into `folder`, several at a time.

    A map may be too large for a format. What was asked for then ends in an `InputError`; what was not is left out, with a warning.
    """

    def write(name: str) -> None:
        try:
            EXPORTS[name].write(cells, folder / EXPORTS[name].files[0])
        except InputError as error:
            if asked_for:
                raise InputError(f"exports: {name}: {error}") from error
            for file in EXPORTS[name].files:
                (folder / file).unlink(missing_ok=True)
            warnings.warn(f"{name} is left out: {error}", stacklevel=2)

    on_all_cores(write, names)
