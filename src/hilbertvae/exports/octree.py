"""A map as an octree that OctoMap's tools and planners read: `.ot` with probabilities, `.bt` with free and occupied alone."""

from __future__ import annotations

import os
import warnings
from pathlib import Path

import numpy as np
from scipy.special import logit

from hilbertvae.checks import InputError
from hilbertvae.exports.map_cells import MapCells
from hilbertvae.files import atomic
from hilbertvae.mappers.octomap_mapper import OCTREES, ORIGIN, OctoMapMapper, voxel_shift, write_octree
from hilbertvae.mappers.octree import DEPTH, Leaves, morton

SURE = 1e-6
"""Probabilities are kept so far from 0 and 1, whose log-odds are not finite."""


def write_octree_map(cells: MapCells, path: str | os.PathLike) -> list[Path]:
    """Write `path`, which ends in `.ot` or `.bt`, and beside it `<name>_observed` with the observed cells alone; returns both paths.

    The formats have no word for what is predicted. `.ot` has the log-odds of every cell; OctoMap itself then calls occupied what has
    p > 0.5, and everything else free. `.bt` has only cells that are occupied (p > 0.6) or free (p <= 0.4): for a planner the safer one.
    A 2D map is one layer of voxels. Both files are shifted alike by whole voxels where the map lies far off (see `OctoMapMapper`).
    Raises `InputError` for another ending, an empty map, and an extent of more than 65 536 voxels along an axis.
    """
    path = Path(path)
    if path.suffix not in OCTREES:
        raise InputError(f"{path}: expected a name that ends in .ot or .bt")
    shift = octree_shift(cells)
    told = cells if path.suffix == ".ot" else cells.select(cells.occupied | cells.free)
    other = path.with_name(f"{path.stem}_observed{path.suffix}")
    if shift.any():
        metres = ", ".join(f"{length:.10g}" for length in shift * cells.resolution_m)
        reach = f"OctoMap's files reach {ORIGIN * cells.resolution_m:,.0f} m from the origin"
        warnings.warn(f"{path.name}: {reach}; add ({metres}) m to its coordinates", stacklevel=2)
    with atomic(other) as observed, atomic(path) as whole:
        write_octree(_octree(told, shift), whole, "observed" if told.observed.all() else "all")
        write_octree(_octree(told.select(told.observed), shift), observed)
    return [path, other]


def octree_shift(cells: MapCells) -> np.ndarray:
    """(3,) by how many voxels the coordinates in both files are less than the map's: none, but for a map that lies far off."""
    low, shape = cells.box()
    return voxel_shift((np.stack([low, low + np.array(shape) - 1]) + 0.5) * cells.resolution_m, cells.resolution_m)


def _octree(cells: MapCells, shift: np.ndarray) -> OctoMapMapper:
    """The fitted mapper whose leaves are the cells."""
    keys = np.full((len(cells), 3), ORIGIN)
    keys[:, : cells.dimension] += cells.index - shift.astype(np.int64)
    code = morton(keys)
    order = np.argsort(code)
    if (np.diff(code[order]) == 0).any():
        raise InputError("cells: expected each once, got one twice")
    log_odds = logit(np.clip(cells.probability[order].astype(np.float64), SURE, 1 - SURE)).astype(np.float32)
    mapper = OctoMapMapper(cells.resolution_m)
    mapper.classes_, mapper.n_features_in_ = np.array([False, True]), cells.dimension
    mapper.resolution_, mapper.shift_ = cells.resolution_m, shift
    mapper.leaves_ = Leaves(code[order], np.full(len(code), DEPTH, np.int8), log_odds)
    return mapper
