"""The surface of a 3D map's occupied cells as a mesh in a PLY file."""

from __future__ import annotations

import os
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from hilbertvae.checks import InputError
from hilbertvae.drawing.field import BLOCK, Field
from hilbertvae.drawing.lit_colours import surface_colours
from hilbertvae.drawing.surface import Surface, field_surface, write_ply
from hilbertvae.exports.cell_heights import ground_below
from hilbertvae.exports.map_cells import MapCells
from hilbertvae.mappers.mapper import OCCUPIED_ABOVE
from hilbertvae.voxel_blocks import by_block

UNKNOWN = 0.5
"""p of cells of which a map says nothing."""


def write_mesh_ply(cells: MapCells, path: str | os.PathLike) -> Path:
    """Write the surface where p crosses 0.6, coloured by height above the ground, tinted where it is predicted; vertices have
    `probability` and `observed`.

    Memory: 128 KiB per block of 32^3 cells with an occupied one. Raises `InputError` for a 2D map.
    """
    surface = cells_surface(cells)
    return write_ply(path, surface, surface_colours(surface, ground_below(cells)))


def cells_surface(cells: MapCells) -> Surface:
    """The closed surface around the occupied cells; what is not among the cells is unknown, p = 0.5. A vertex was observed if the occupied
    cell nearest to it was."""
    if cells.dimension != 3:
        raise InputError("cells: a mesh is of a 3D map, got a 2D map")
    blocks = {key: np.full((BLOCK,) * 3, UNKNOWN, np.float32) for key in sorted(_touched(cells.index[cells.occupied]))}
    for key, rows in by_block(cells.index):
        if key in blocks:
            blocks[key][tuple((cells.index[rows] % BLOCK).T)] = cells.probability[rows]
    occupied = cells.select(cells.occupied)
    surface = field_surface(Field(blocks, cells.resolution_m), np.empty((0, 3)), OCCUPIED_ABOVE)  # cells say what was seen, not points
    if not len(surface):
        return surface
    return replace(surface, observed=occupied.observed[cKDTree(occupied.centres).query(surface.vertices)[1]])


def _touched(index: np.ndarray) -> set[tuple[int, ...]]:
    """Keys of the blocks that hold a voxel of `index (N, 3)` or a neighbour of one."""
    keys = set()
    for key, rows in by_block(index):
        local = index[rows] % BLOCK
        low, high = local.min(axis=0) == 0, local.max(axis=0) == BLOCK - 1
        steps = [[0, *([-1] if first else []), *([1] if last else [])] for first, last in zip(low, high, strict=True)]
        keys |= {tuple(k + s for k, s in zip(key, step, strict=True)) for step in product(*steps)}
    return keys
