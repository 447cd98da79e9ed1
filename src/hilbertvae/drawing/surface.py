"""The surface of a 3D map: marching cubes where p(occupied) crosses the cut, block by block and without seams."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree
from skimage.measure import marching_cubes

from hilbertvae.drawing.field import BLOCK, Field
from hilbertvae.drawing.ply import write_ply_table
from hilbertvae.mappers.mapper import OCCUPIED_ABOVE
from hilbertvae.voxel_blocks import padded

OFF_THE_CUT = 1e-3
"""Values nearer to the cut are moved so far off it: a vertex then lies clearly on one edge of the lattice, not on a node of it."""
OBSERVED_CELLS = 1.5
"""A vertex this many cells from an occupied point, or nearer, counts as observed."""


@dataclass(frozen=True)
class Surface:
    """Triangles around what a map calls occupied, counter-clockwise seen from outside.

    vertices: (V, 3) float64, metres, map frame; faces: (F, 3) int64. probability: (V,) the highest p(occupied) within a cell of the
    vertex, since at the vertex itself it is the cut. observed: (V,) bool, whether the mapper was shown an occupied point there.
    """

    vertices: np.ndarray
    faces: np.ndarray
    probability: np.ndarray
    observed: np.ndarray

    def __len__(self) -> int:
        return len(self.vertices)


def field_surface(field: Field, seen: np.ndarray, cut: float = OCCUPIED_ABOVE) -> Surface:
    """The surface p(occupied) = `cut` of a `Field`: closed, except where its reach ends. `seen (N, 3)` are the occupied points that the
    mapper was shown."""
    keys = np.array(list(field.blocks), dtype=np.int64).reshape(-1, 3)
    # Around the blocks alone: with the origin, the edges of maps in UTM coordinates would outnumber 64 bits.
    low, high = (keys.min(axis=0), keys.max(axis=0)) if len(keys) else (np.zeros(3, np.int64),) * 2
    shape = tuple((high - low + 1) * BLOCK + 1)
    edges, places, peaks, faces = [np.empty(0, np.int64)], [np.empty((0, 3))], [np.empty(0)], [np.empty((0, 3), np.int64)]
    count = 0
    for key in field.blocks:
        found = _block_surface(padded(field.blocks, key, 1, 2, np.nan), cut)
        if found is None:
            continue
        vertices, base, axis, peak, triangles = found
        first = (np.array(key) - low) * BLOCK
        edges.append(np.ravel_multi_index(tuple((base + first).T), shape) * 4 + axis)
        places.append((vertices + np.array(key) * BLOCK + 0.5) * field.resolution_m)
        peaks.append(peak)
        faces.append(triangles + count)
        count += len(vertices)
    # Blocks share the edges on their sides: one vertex per edge makes one surface of them.
    _, chosen, number = np.unique(np.concatenate(edges), return_index=True, return_inverse=True)
    vertices, faces = np.concatenate(places)[chosen], number[np.concatenate(faces)]
    observed = np.zeros(len(vertices), bool)
    if len(seen) and len(vertices):
        reach = OBSERVED_CELLS * field.resolution_m
        observed = np.isfinite(cKDTree(seen).query(vertices, distance_upper_bound=reach)[0])
    return Surface(vertices, faces, np.concatenate(peaks)[chosen], observed)


def _block_surface(values: np.ndarray, cut: float):
    """Marching cubes in a block of values with a margin of 1 before and 2 after, NaN where unknown; None where nothing crosses the cut.

    Returns vertices (V, 3) in cells from the block's first node, the edge that each lies on (first node (V, 3) and axis (V,), 3 for
    one inside a cell), the highest value within a cell (V,), and faces (F, 3).
    """
    inner = values[1:-1, 1:-1, 1:-1]
    if not (inner > cut).any() or not (inner <= cut).any():
        return None
    filled = np.nan_to_num(values, nan=0.0)
    clear = filled[1:-1, 1:-1, 1:-1].copy()
    close = np.abs(clear - cut) < OFF_THE_CUT
    clear[close] = cut + np.where(clear[close] > cut, OFF_THE_CUT, -OFF_THE_CUT)
    # Over x, y, z, where scikit-image expects z, y, x: so its descent is our ascent.
    vertices, faces, _, _ = marching_cubes(clear, cut, gradient_direction="ascent")
    vertices, faces = vertices.astype(np.float64), faces.astype(np.int64)

    # A cell with an unknown corner has no surface. The filter looks back from a cell's last corner to its first.
    cells = ndimage.minimum_filter(np.isfinite(inner).astype(np.uint8), 2, origin=-1, mode="nearest")
    inside = np.floor(vertices[faces].mean(axis=1)).astype(np.int64)
    faces = faces[cells[tuple(inside.T)] > 0]
    used, faces = np.unique(faces, return_inverse=True)
    vertices, faces = vertices[used], faces.reshape(-1, 3)
    if not len(faces):
        return None

    nearest = np.rint(vertices).astype(np.int64)
    off = np.abs(vertices - nearest)
    axis = off.argmax(axis=1)
    base = nearest.copy()
    rows = np.arange(len(vertices))
    base[rows, axis] = np.floor(vertices[rows, axis])
    central = (off > OFF_THE_CUT / 2).sum(axis=1) > 1  # marching cubes adds a vertex inside some ambiguous cells
    axis[central], base[central] = 3, np.floor(vertices[central])
    peak = ndimage.maximum_filter(filled, 3)[tuple((nearest + 1).T)]
    return vertices, base, axis, peak, faces


def write_ply(path: str | os.PathLike, surface: Surface, colours: np.ndarray) -> Path:
    """The surface as a binary PLY at `path`, whole or not there. colours: (V, 3) uint8.

    Coordinates are doubles, which keep map coordinates such as UTM; `probability` and `observed` are properties of the vertices.
    """
    columns = dict(zip(("x", "y", "z"), surface.vertices.T, strict=True))
    columns |= dict(zip(("red", "green", "blue"), colours.T, strict=True))
    columns |= {"probability": surface.probability.astype(np.float32), "observed": surface.observed}
    comment = "metres, map frame; observed: an occupied point was shown there"
    return write_ply_table(path, columns, surface.faces, comment)
