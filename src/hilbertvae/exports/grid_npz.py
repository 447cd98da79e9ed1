"""A map in numpy's `.npz`, as a dense grid or as a list of cells. No pickles."""

from __future__ import annotations

import os
import zipfile
from pathlib import Path

import numpy as np

from hilbertvae.checks import InputError, named
from hilbertvae.exports.map_cells import MOST_DENSE, MapCells
from hilbertvae.files import atomic
from hilbertvae.scans.file_points import check_expansion, reading
from hilbertvae.scans.npz_arrays import array_header, read_array

VERSION = 1
DENSE_BELOW = 1 << 25
"""Cells of the box up to which a grid is dense unless told otherwise: 270 MB in memory."""
UNKNOWN = 0.5
"""p and its spread where a map says nothing: a coin's."""
_COLUMNS = {"probability": "f", "std": "f", "observed": "b"}


def write_grid(cells: MapCells, path: str | os.PathLike, dense: bool | None = None) -> Path:
    """Write the cells as `.npz`; dense where their box has at most 2^25 cells unless told.

    Always: `version`; `resolution_m`; `first (D,)`, the index of the cell in the lowest corner, 0 in a list; `origin_m (D,)`, that corner.
    Dense: `probability`, `std` (float32), `observed`, `known` (bool) of shape (nx, ny) or (nx, ny, nz), axes in the order of coordinates:
    cell [i, j] has its centre at (first + [i, j] + 0.5) * resolution_m. Where `known` is false the map says nothing: p = 0.5, std = 0.5.
    A list: `index (V, D)` int64 and `probability`, `std`, `observed (V,)`; a cell's centre is at (index + 0.5) * resolution_m.
    Raises `InputError` for an empty map, another ending, and a dense grid of more than 2^27 cells.
    """
    path = Path(path)
    if path.suffix != ".npz":
        raise InputError(f"{path}: expected a name that ends in .npz")
    low, shape = cells.box()
    if dense is None:
        dense = np.prod(np.array(shape, float)) <= DENSE_BELOW
    first = low if dense else np.zeros_like(low)
    arrays = {"version": np.int64(VERSION), "resolution_m": np.float64(cells.resolution_m)}
    arrays |= {"first": first, "origin_m": first * cells.resolution_m}
    if dense:
        arrays |= {"probability": cells.dense(cells.probability, UNKNOWN), "std": cells.dense(cells.std, UNKNOWN)}
        arrays |= {"observed": cells.dense(cells.observed, False), "known": cells.dense(np.ones(len(cells), bool), False)}
    else:
        arrays |= {"index": cells.index, "probability": cells.probability, "std": cells.std, "observed": cells.observed}
    with atomic(path) as temporary:
        np.savez_compressed(temporary, **arrays)
    return path


def read_grid(path: str | os.PathLike) -> MapCells:
    """The cells that `write_grid` wrote. Raises `InputError` for a file that is missing, damaged, forged or another's."""
    path = Path(path)
    with reading(path, "a map of write_grid"), zipfile.ZipFile(path) as archive:
        names = {name.removesuffix(".npy") for name in archive.namelist()}
        layout = {"known": "b"} if "known" in names else {"index": "i"}
        kinds = {"version": "i", "resolution_m": "f", "first": "i", **_COLUMNS, **layout}
        if not kinds.keys() <= names:
            raise InputError(f"{path}: expected the arrays {', '.join(sorted(kinds))}, found {', '.join(sorted(names))[:80] or 'none'}")
        shapes = {name: array_header(path, archive, name, kind)[0] for name, kind in kinds.items()}
        (leader,) = layout
        _check(path, archive, shapes, leader)
        arrays = {name: read_array(archive, name) for name in kinds}
        if arrays["version"] != VERSION:
            raise InputError(f"{path}: expected version {VERSION}, got {arrays['version']}")
        if leader == "known":
            known = arrays["known"]
            arrays |= {name: arrays[name][known] for name in _COLUMNS}
            arrays["index"] = np.argwhere(known) + arrays["first"]
        with named(path):
            return MapCells(arrays["index"], float(arrays["resolution_m"]), *(arrays[name] for name in _COLUMNS))


def _check(path: Path, archive: zipfile.ZipFile, shapes: dict[str, tuple[int, ...]], leader: str) -> None:
    """Shapes that go together, and sizes that the file can hold, before any array is read."""
    dimension = shapes["first"][0] if len(shapes["first"]) == 1 else 0
    shape = shapes[leader]
    fits = len(shape) == dimension if leader == "known" else len(shape) == 2 and shape[1] == dimension
    columns = shape if leader == "known" else shape[:1]
    scalars = shapes["version"] == shapes["resolution_m"] == ()
    if dimension not in (2, 3) or not fits or not scalars or any(shapes[name] != columns for name in _COLUMNS):
        raise InputError(f"{path}: expected shapes of one grid in 2D or 3D, got {shapes}")
    count = int(np.prod(shape, dtype=object))
    # The columns may pack a thousandfold (free space is alike), but are no longer than what is checked here.
    if leader == "known" and count > MOST_DENSE:
        raise InputError(f"{path}: expected at most {MOST_DENSE} cells of a dense grid, got {count}")
    if leader == "index":
        check_expansion(path, "the cells", 8 * count, archive.getinfo("index.npy").compress_size)
