"""Single files of points (PLY, PCD, LAS, LAZ, E57, text, NPY, NPZ, KITTI's .bin) as scans."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.scans.beam_lengths import ClippedCheck, UnitCheck, beam_lengths, within_range, without_zeros
from hilbertvae.scans.e57 import read_e57
from hilbertvae.scans.file_points import LIDAR_RANGE_M, FilePoints, NoRows, check_reading
from hilbertvae.scans.las import read_las
from hilbertvae.scans.npy import read_npy
from hilbertvae.scans.npz import read_npz
from hilbertvae.scans.pcd import read_pcd
from hilbertvae.scans.ply import read_ply
from hilbertvae.scans.point_text import read_point_text
from hilbertvae.scans.rounded import warn_if_rounded
from hilbertvae.scans.scan import Scans
from hilbertvae.scans.velodyne import read_velodyne

READERS: dict[str, Callable[[Path], FilePoints]] = {
    ".asc": read_point_text,
    ".bin": read_velodyne,
    ".csv": read_point_text,
    ".e57": read_e57,
    ".las": read_las,
    ".laz": read_las,
    ".npy": read_npy,
    ".npz": read_npz,
    ".pcd": read_pcd,
    ".ply": read_ply,
    ".pts": read_point_text,
    ".txt": read_point_text,
    ".xyz": read_point_text,
}
BARE = (".asc", ".bin", ".csv", ".pts", ".txt", ".xyz")
"""Formats without a header."""


def read_points(path: str | os.PathLike, may_be_empty: bool = False) -> FilePoints:
    """The returns of one file, by its extension; an `InputError` for an unknown one.

    One for a file without a single return, too, unless it `may_be_empty`, as one of many scans may: then there are no points. Velodyne's
    files of no return have no byte, and text files no row.
    """
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path}: expected a file of points, found a folder")
    if path.suffix.lower() not in READERS:
        raise InputError(f"{path}: unknown extension {path.suffix!r}; known are {' '.join(READERS)}")
    if may_be_empty and path.suffix.lower() in BARE and path.is_file() and not path.stat().st_size:
        return FilePoints(np.empty((0, 3)))
    try:
        found = READERS[path.suffix.lower()](path)
    except NoRows:
        if not may_be_empty:
            raise
        return FilePoints(np.empty((0, 3)))
    returned = np.isfinite(found.points).all(axis=1)
    if may_be_empty and not returned.any():
        return FilePoints(found.points[:0])
    if not len(found.points):
        raise InputError(f"{path}: expected at least one point, found none")
    if not returned.any():
        raise InputError(f"{path}: expected returns, found {len(found.points)} points and all of them NaN or inf")
    if found.origins is not None and not np.isfinite(found.origins if found.origins.ndim == 1 else found.origins[returned]).all():
        raise InputError(f"{path}: expected finite origins")
    return found


def read_point_file(
    path: str | os.PathLike,
    sensor_origin_m: Sequence[float] | None = None,
    max_range_m: float = LIDAR_RANGE_M,
    min_range_m: float = 0.0,
    every: int = 1,
) -> Scans:
    """The returns of one file, whose frame is the map frame. One file is one scan unless it says otherwise (NPZ, E57).

    The beams start at `sensor_origin_m` (D numbers, metres, file frame), which is (0, 0, 0) for a cloud in its sensor's frame, else where
    the file says, which may be in another frame than its points. Without either there are no rays, and nothing is made up: that is an
    `InputError`, as are damaged files.
    A beam as long as `max_range_m` and more, as short as `min_range_m` and less, or without a return (NaN) is dropped. So are points at
    (0, 0, 0) where a cloud with one origin has two or more: drivers write them for beams without a return. `every` keeps every n-th
    scan. Beams are numbered in the file's order within each scan, dropped ones included.
    """
    check_reading(min_range_m, max_range_m, every)
    found = read_points(path)
    origins = np.broadcast_to(_origin(path, found, sensor_origin_m), found.points.shape)
    order, scan, beam = _sweeps(found)
    # Sweeps, or an origin for each beam, make a map's frame, where a place at zero is like any other.
    posed = found.scan is not None or (found.origins is not None and found.origins.ndim == 2)
    points = found.points if posed else without_zeros(found.points, at_least=2)
    lengths, unit = beam_lengths(points[order], origins[order]), UnitCheck(max_range_m, min_range_m=min_range_m)
    unit.see(lengths)
    unit.warn(path)
    clipped = ClippedCheck(max_range_m, of_points=True)
    clipped.see(lengths)
    clipped.warn(path)
    warn_if_rounded(points, path)
    if found.origins is not None and sensor_origin_m is None:
        warn_if_rounded(found.origins, path, "origins", found.origin_type)
    kept = within_range(lengths, min_range_m, max_range_m) & (scan % every == 0)
    if not kept.any():
        raise InputError(
            f"{path}: expected beams of {min_range_m} to {max_range_m} m, found none among {len(found.points)}; "
            f"the first starts at {origins[0].tolist()} and ends at {found.points[0].tolist()}{unit.hint(max_range_m)}"
        )
    order, number = order[kept], (scan[kept] // every).astype(np.int32)
    return Scans(found.points[order], origins[order], number, beam[kept].astype(np.int32), unit.left_out)


def _origin(path, found: FilePoints, sensor_origin_m: Sequence[float] | None) -> np.ndarray:
    dimension = found.points.shape[1]
    if sensor_origin_m is None:
        if found.origins is not None:
            return found.origins
        raise InputError(
            f"{path}: says not where its beams started; set reading.sensor_origin_m to {dimension} numbers in metres, in the file's frame "
            f"({[0] * dimension} for a cloud in its sensor's frame)"
        )
    try:
        origin = np.array([float(number) for number in sensor_origin_m])
    except (TypeError, ValueError):
        origin = np.empty(0)
    if origin.shape != (dimension,) or not np.isfinite(origin).all():
        raise InputError(f"reading.sensor_origin_m: expected {dimension} numbers in metres for {path}, got {sensor_origin_m!r}")
    if found.origins is not None:
        places = np.unique(found.origins.reshape(-1, dimension), axis=0)
        said = places[0].tolist() if len(places) == 1 else f"{len(places)} places, the first {places[0].tolist()}"
        if len(places) > 1 or (places[0] != origin).any():
            warnings.warn(
                f"{path}: says that its beams started at {said}; reading.sensor_origin_m={origin.tolist()} is taken", stacklevel=3
            )
    return origin


def _sweeps(found: FilePoints) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The order that puts a file's returns scan by scan, their scans from 0 without gaps, and their places within them."""
    order = np.arange(len(found.points))
    if found.scan is None:
        return order, np.zeros(len(order), np.int64), order
    order = np.argsort(found.scan, kind="stable")
    _, first, scan = np.unique(found.scan[order], return_index=True, return_inverse=True)
    return order, scan, np.arange(len(order)) - first[scan]
