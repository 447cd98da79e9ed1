"""A folder of point files, one scan each, with `poses.txt`."""

from __future__ import annotations

import contextlib
import os
import warnings
from collections import Counter
from collections.abc import Sequence
from itertools import chain, islice
from pathlib import Path

import numpy as np

from hilbertvae.checks import InputError, named
from hilbertvae.progress import track
from hilbertvae.scans.beam_lengths import ClippedCheck, beam_lengths, without_zeros
from hilbertvae.scans.beam_origins import find_beam_origins
from hilbertvae.scans.file_points import LIDAR_RANGE_M, FilePoints, check_reading, reading
from hilbertvae.scans.names_in_order import names_in_order
from hilbertvae.scans.odometry import FINDING, KISS_ICP, KissOdometry, check_poses_choice
from hilbertvae.scans.own_origins import OwnOrigins, in_space
from hilbertvae.scans.point_files import READERS, read_points
from hilbertvae.scans.pose_times import warn_of_other_times
from hilbertvae.scans.poses import MOST_TILT_DEG, leans, lidar_poses, read_timed_poses
from hilbertvae.scans.scan import Scans
from hilbertvae.scans.scan_collector import ScanCollector

POSES, VELODYNE = "poses.txt", "velodyne"
POSES_FOLDER = "poses"
"""Beside KITTI's `sequences`: `poses/00.txt` are those of the camera of `sequences/00`."""
POSED = ".e57"
"""Files of this ending may have taken their points to the map by a pose of their own."""
ARRAY = ".npy"
"""Files of this ending may be anything, such as labels, beside scans of another."""
NOT_SCANS = {POSES, "times.txt", "timestamps.txt", "calib.txt", "readme.txt", "license.txt"}
MOST_FOLDERS = 100
"""So many are looked through for scans that are not where they were looked for."""


def read_scan_folder(
    folder: str | os.PathLike,
    beam_origin: str | Sequence[float] = "centre",
    max_range_m: float = LIDAR_RANGE_M,
    min_range_m: float = 0.0,
    every: int = 1,
    poses: str | None = None,
) -> Scans:
    """The scans of a folder, in the order of their names (`names_in_order`): 2.pcd stands before 10.pcd.

    Each file is in its sensor's frame, and the pose of the same place in `poses.txt` (see `read_timed_poses`) takes it to the map frame; of
    files of two coordinates, the frame's x and y are kept.
    Beams start where the file says (in the frame of its points; see `OwnOrigins` for files that mean another), else where `beam_origin`
    says: a name of `BEAM_ORIGINS`, or three numbers in metres, sensor frame.
    Ranges as in `read_point_file`; `every` keeps every n-th scan. Kept scans are numbered from 0, beams by their place in the file.
    Without `poses.txt`, E57 files are placed by their own poses, in whose frame one file without a pose may be.
    With `poses="kiss_icp"` poses are found by odometry (see `KissOdometry`) and `poses.txt`, if there is one, is not read.
    Raises `InputError` for files of several formats, for another number of poses than of scans, and for files that can't be read.
    """
    folder = Path(folder)
    return read_posed_scans(scan_files(folder), folder / POSES, beam_origin, max_range_m, min_range_m, every, poses)


def scan_files(folder: Path) -> list[Path]:
    """The scans in a folder, in the order of their names; an `InputError` unless they are of one format."""
    with reading(folder, "a folder of scans"):
        files = _with_points(folder)
    if len({path.suffix.lower() for path in files}) != 1:
        found = _counted(files) or "none" + _further_down(folder)
        raise InputError(f"{folder}: expected scans of one format ({' '.join(READERS)}), found {found}")
    return names_in_order(files)


def _with_points(folder: Path) -> list[Path]:
    files = [path for path in folder.iterdir() if path.suffix.lower() in READERS and path.name.lower() not in NOT_SCANS]
    files = [path for path in files if path.is_file() and not path.name.startswith(".")]
    return [path for path in files if path.suffix.lower() != ARRAY] or files


def _counted(files: Sequence[Path]) -> str:
    kinds = Counter(path.suffix.lower() for path in files)
    return ", ".join(f"{count} {kind}" for kind, count in sorted(kinds.items()))


def _further_down(folder: Path) -> str:
    """Where the most scans lie up to three folders further down, as in KITTI's odometry; nothing where there are none."""
    below = islice(chain(folder.glob("*/"), folder.glob("*/*/"), folder.glob("*/*/*/")), MOST_FOLDERS)
    below = (each for each in below if each.name != POSES_FOLDER)
    with contextlib.suppress(OSError):  # a folder that nobody may look into
        if most := max(map(_with_points, below), key=len, default=[]):
            return f"; in {most[0].parent.relative_to(folder)} there are {_counted(most)}"
    return ""


def kitti_poses(folder: Path) -> Path:
    """Where a drive in KITTI's layout has its poses: its own `poses.txt`, or if that is not there, what KITTI's odometry has for it."""
    own, drive = folder / POSES, Path(os.path.abspath(folder))
    apart = drive.parent.parent / POSES_FOLDER / f"{drive.name}.txt"
    return apart if apart.is_file() and not own.exists() else own


def read_posed_scans(
    files: list[Path],
    poses_path: Path,
    beam_origin: str | Sequence[float],
    max_range_m: float,
    min_range_m: float,
    every: int,
    poses: str | None = None,
    lidar_to_camera: np.ndarray | None = None,
) -> Scans:
    """The scans of `files`, the k-th under the k-th pose; see `read_scan_folder`. lidar_to_camera: given where poses are a camera's."""
    check_reading(min_range_m, max_range_m, every)
    check_poses_choice(poses)
    beam_origins = find_beam_origins(beam_origin)
    given = _given_poses(files, poses_path, lidar_to_camera) if poses is None else None
    odometry, own = KissOdometry(), OwnOrigins(files, given, poses_path, beam_origins)
    clipped = ClippedCheck(max_range_m, of_points=True)
    kept, empty, dimension, first, unposed = ScanCollector(min_range_m, max_range_m), 0, 0, "", []
    # Odometry goes from scan to scan, so it sees those too that are left out.
    taken = range(0, len(files), every if poses is None else 1)
    for index in taken if poses is None else track(taken, FINDING):
        found = read_points(files[index], may_be_empty=True)
        if not len(found.points):
            empty += 1
            continue
        if found.scan is not None and len(np.unique(found.scan)) > 1:
            raise InputError(f"{files[index]}: expected one scan, since a folder has one pose for each file")
        if not dimension:
            dimension, first = found.points.shape[1], files[index].name
            _warn_of_unnamed(files[index], found, given)
        if found.points.shape[1] != dimension or (dimension == 2 and poses is not None):
            wanted = "to find poses from" if poses is not None else f"as in {first}"
            raise InputError(f"{files[index]}: expected {5 - found.points.shape[1]}D points {wanted}, got {found.points.shape[1]}D ones")
        points = without_zeros(in_space(found.points), at_least=1 if found.origins is None else 2)
        start, pose = own.place(index, found, points)
        if given is None and poses is None:
            unposed += [files[index].name] if found.pose is None else []
            _check_unposed(files, poses_path, unposed)
            pose = np.eye(3, 4)
        lengths = beam_lengths(points, start)
        clipped.see(lengths)
        chosen = kept.within(lengths)
        with named(files[index]):
            pose = odometry.register(points[chosen]) if pose is None else pose
        if index % every:
            continue
        if dimension == 2 and leans(pose):
            raise InputError(f"{poses_path}, pose {index + 1}: expected less than {MOST_TILT_DEG:.0f} degrees of tilt under a 2D scan")
        kept.add(points, start, chosen, pose, dimension)
    if empty:
        warnings.warn(f"{files[0].parent}: {empty} of {len(taken)} scans have no return and are left out", stacklevel=3)
    own.warn()
    kept.warn(files[0].parent)
    clipped.warn(files[0].parent)
    odometry.warn(files[0].parent)
    return kept.whole(files[0].parent, len(kept))


def _warn_of_unnamed(file: Path, found: FilePoints, given: np.ndarray | None) -> None:
    """Scans in the plane may have intensities where three coordinates have z, and would make a 3D map without a word."""
    if found.named or found.points.shape[1] < 3 or given is None:
        return
    in_the_plane = (given[:, 2] == [0.0, 0.0, 1.0, 0.0]).all() and (given != np.eye(3, 4)).any()
    if in_the_plane and np.nanmax(found.points[:, 2]) > np.nanmin(found.points[:, 2]):
        taken = "its columns have no names, so the first three are taken as x, y and z, though poses lie in the plane"
        warnings.warn(f"{file}: {taken}; name the columns (a first line x,y,...) if the third is not z", stacklevel=4)


def _check_unposed(files: list[Path], poses_path: Path, unposed: list[str]) -> None:
    if len(unposed) > 1 or (unposed and len(files) == 1):
        wanted = f"expected a pose for each of {len(files)} scans, there or in their files, of which one may be in the frame of the others"
        raise InputError(f"{poses_path}: no such file; {wanted}; no pose is in {' and '.join(unposed)}")


def _given_poses(files: list[Path], poses_path: Path, lidar_to_camera: np.ndarray | None) -> np.ndarray | None:
    """(S, 3, 4), a pose for each of `files`; None where these may have their own."""
    if not poses_path.exists() and files[0].suffix.lower() == POSED:
        return None
    if not poses_path.exists():
        folder = poses_path.absolute().parent
        if folder.name == VELODYNE and (there := kitti_poses(folder.parent)).exists():
            where = "one is in the folder above" if there.name == POSES else f"there is {there}"
            raise InputError(f"{poses_path}: no such file, but {where}: to read KITTI's layout, give {folder.parent}")
        raise InputError(
            f"{poses_path}: no such file; expected a pose for each of {len(files)} scans. 3D scans in the order of travel can do without: "
            f"set reading.poses={KISS_ICP} to find their poses"
        )
    poses, times = read_timed_poses(poses_path)
    if len(poses) != len(files):
        raise InputError(f"{poses_path}: expected a pose for each scan, got {len(poses)} poses for {len(files)} scans ({files[0].parent})")
    if times is not None:
        warn_of_other_times(files, times, poses_path)
    return poses if lidar_to_camera is None else lidar_poses(poses, lidar_to_camera)
