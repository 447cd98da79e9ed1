"""Reader of scans in numpy's `.npz`: `points`, and where known `origins` and `scan`. Nothing is unpickled."""

from __future__ import annotations

import os
import zipfile
from pathlib import Path

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.scans.file_points import FilePoints, check_expansion, reading
from hilbertvae.scans.npz_arrays import array_header, read_array

MISTAKEN = {"scan": "scans", "origins": "origin"}
"""Names that are nearly right. Passed over, they would leave all beams to one scan, or to an origin that is not theirs."""


def read_npz(path: str | os.PathLike) -> FilePoints:
    """The arrays `points` (N, D), metres; `scan` (N,) integers; `origins` (N, D), (D,) or, with `scan`, (S, D) with a row per scan number.

    Other arrays are passed over. Raises `InputError` for a file that is missing, damaged or foreign, for other shapes or types, for
    arrays whose declared size does not agree with what the archive holds, and for `scans` or `origin` where the right name is meant.
    """
    path = Path(path)
    with reading(path, "a .npz file"), zipfile.ZipFile(path) as archive:
        headers = {name: array_header(path, archive, name) for name in ("points", "origins", "scan") if f"{name}.npy" in archive.namelist()}
        if "points" in headers and headers["points"][0][:1] == (0,):  # numpy makes (0,) of an empty list, and nothing has to go together
            return FilePoints(np.empty((0, 2)))
        _check(path, archive, headers)
        arrays = {name: read_array(archive, name) for name in headers}
        scan, origins = arrays.get("scan"), arrays.get("origins")
        points = np.asarray(arrays["points"], dtype=np.float64)
        if origins is not None and origins.ndim == 2 and origins.shape != points.shape:
            if scan.min() < 0 or scan.max() >= len(origins):
                raise InputError(f"{path}: expected scan numbers of 0 to {len(origins) - 1}, a row of origins each")
            origins = origins[scan]
        if origins is None:
            return FilePoints(points, None, scan)
        return FilePoints(points, np.asarray(origins, dtype=np.float64), scan, origin_type=origins.dtype)


def _check(path: Path, archive: zipfile.ZipFile, headers: dict) -> None:
    """Shapes and types that go together, and sizes that the file can hold, before any array is read."""
    names = [name.removesuffix(".npy") for name in archive.namelist()]
    if "points" not in headers:
        raise InputError(f"{path}: expected an array points, found {', '.join(names)[:60] or 'none'}")
    for wanted, mistaken in MISTAKEN.items():
        if wanted not in headers and mistaken in names:
            raise InputError(f"{path}: expected an array {wanted}, found {mistaken}, which would be passed over; rename it")
    shape, dtype = headers["points"]
    if len(shape) != 2 or shape[1] not in (2, 3):
        raise InputError(f"{path}: expected points of shape (N, 2) or (N, 3), got {shape}")
    check_expansion(path, "points", shape[0] * shape[1] * dtype.itemsize, archive.getinfo("points.npy").compress_size)
    # The other arrays may pack a thousandfold (one origin repeated), but are no longer than the points.
    if "scan" in headers and (headers["scan"][0] != shape[:1] or headers["scan"][1].kind not in "iu"):
        raise InputError(f"{path}: expected scan of shape ({shape[0]},) and whole numbers, got {headers['scan'][0]} {headers['scan'][1]}")
    if "origins" in headers:
        found = headers["origins"][0]
        per_scan = "scan" in headers and shape[0] and len(found) == 2 and found[1] == shape[1] and 0 < found[0] <= shape[0]
        if found not in (shape, shape[1:]) and not per_scan:
            raise InputError(f"{path}: expected origins of shape {shape}, {shape[1:]} or, with scan, (S, {shape[1]}), got {found}")
