"""Scans from a path: the format is guessed from it, and everything else has a default."""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass
from pathlib import Path

from hilbertvae.checks import InputError
from hilbertvae.scans.bag_files import BAG_FILES, METADATA, is_bag
from hilbertvae.scans.bags import read_bag
from hilbertvae.scans.carmen import read_carmen
from hilbertvae.scans.kitti import OWN_CAR_M, is_kitti, read_kitti
from hilbertvae.scans.point_files import READERS, read_point_file
from hilbertvae.scans.scan import Scans
from hilbertvae.scans.scan_folder import read_scan_folder
from hilbertvae.scans.upright import warn_of_lying

CARMEN = (".log", ".log.gz", ".clf", ".clf.gz")
EXTENSIONS = (*CARMEN, *BAG_FILES, *READERS)
MANY_NEAR = 0.1
"""Of all returns. A car's own are hardly any; of a smaller robot, or of one indoors, a car's length is much of what is around."""


@dataclass
class ReadingSettings:
    """How a path is read. What is left unset is the format's own: its reader has the default."""

    max_range_m: float | None = None
    """Metres. Beams as long as this and longer are dropped: 30 for CARMEN logs, 80 for everything else."""
    min_range_m: float | None = None
    """Metres. Beams as short as this and shorter are dropped: 2.5 for KITTI's layout, 0 for everything else."""
    every: int = 1
    """Only every n-th scan is read."""
    sensor_origin_m: list[float] | None = None
    """Metres, file frame. Where the beams of a single point file started, if it does not say, or says it in another frame: [0, 0, 0] in a
    sensor's own frame."""
    beam_origin: str = "centre"
    """Where a scan's beams start, for a folder of scans and a bag's clouds: `centre`, `hdl64`, or three numbers in metres, sensor frame, as
    '0, 0, 0.2'."""
    beam_step_deg: float | None = None
    """Of a CARMEN log: degrees between beams, the middle one straight ahead. Known for 180, 181, 360, 361, 541, 721 and 1081 beams,
    and for 682, 683, 726 and 769; `ROBOTLASER1` messages say it."""
    poses: str | None = None
    """`kiss_icp` finds the poses of 3D scans in the order of travel, in a folder or a bag, from the scans alone (extra `poses`,
    Python below 3.14)."""
    topic: str | None = None
    """Of a bag: the topic of its scans. By default the one with most messages."""
    fixed_frame: str | None = None
    """Of a bag: the frame of the map. By default `map` if its transforms, or its odometry with them, lead there, else `odom`, else that of
    its odometry."""
    odometry: str | None = None
    """Of a bag: the topic of odometry that says where the sensor was, also where transforms do. By default one is taken where transforms
    don't, that is of the sensor's robot, and of several the one with most messages. One of `PoseStamped`,
    `PoseWithCovarianceStamped`, `TransformStamped` or `Path` is taken where it is given here: of these only `TransformStamped` says of what
    it is; the others are poses of the sensor. Of a `Path` the last message counts."""
    deskew: bool = True
    """Of a bag: beams are turned back one by one where its messages say when each was measured (a cloud's `t`, `time` or `timestamp`, a
    laser's `time_increment`). `deskew=off` is for clouds that were deskewed before and still have the field."""


def is_scan_path(reference: str) -> bool:
    """Whether a reference is a path and no name of a catalogue: it has a separator, or ends as a file of scans does.

    The disk is not asked, so a reference means the same wherever it is used; a folder beside is `./name`.
    """
    separators = [mark for mark in (os.sep, os.altsep) if mark]
    is_file = reference.lower().endswith(EXTENSIONS)
    return reference in (".", "..") or is_file or any(mark in reference for mark in separators)


def read_scans_path(path: str | os.PathLike, reading: ReadingSettings | None = None) -> Scans:
    """The scans at a path: a CARMEN log, a ROS bag, a folder of scans (KITTI's layout among them), or a single point file.

    Coordinates that can't be metres give a `UserWarning`, and so do poses that are doubtful, and scans that seem to lie on their side.
    Raises `InputError` for a path that is not there, an unknown extension, a setting that does not go with the format, and files that
    can't be read.
    """
    scans = _read(Path(path), reading or ReadingSettings())
    warn_of_lying(scans, path)
    return scans


def _read(path: Path, reading: ReadingSettings) -> Scans:
    """The scans at a path, by the reader of its format."""
    ranges = {key: value for key in ("max_range_m", "min_range_m") if (value := getattr(reading, key)) is not None}
    of_bags, of_logs = ("topic", "fixed_frame", "odometry", "deskew"), "beam_step_deg"
    if path.name.lower().endswith(CARMEN) and not path.is_dir():
        _refuse(path, "a CARMEN log", reading, "sensor_origin_m", "beam_origin", "poses", *of_bags)
        return read_carmen(path, every=reading.every, step_deg=reading.beam_step_deg, **ranges)
    if is_bag(path):
        _refuse(path, "a ROS bag", reading, "sensor_origin_m", of_logs)
        of_scans = {"every": reading.every, "poses": reading.poses, "deskew": reading.deskew, "odometry": reading.odometry}
        return read_bag(path, reading.topic, reading.fixed_frame, reading.beam_origin, **of_scans, **ranges)
    if path.is_dir():
        _refuse(path, "a folder of scans", reading, "sensor_origin_m", *of_bags, of_logs)
        if bags := sorted(each.name for each in path.iterdir() if each.suffix.lower() in BAG_FILES):
            expected = f"scans, a ROS 2 bag with {METADATA}, or the parts of one recording, from name_0 on"
            raise InputError(f"{path}: expected {expected}; found bags to be read one by one: {', '.join(bags)}")
        read = read_kitti if is_kitti(path) else read_scan_folder
        scans = read(path, beam_origin=reading.beam_origin, every=reading.every, poses=reading.poses, **ranges)
        near, _, seen = scans.left_out
        if reading.min_range_m is None and near > MANY_NEAR * seen:
            cut = f"{near} of {seen} returns are {OWN_CAR_M:g} m or nearer and are left out, as a car's own are in KITTI's layout"
            warnings.warn(f"{path}: {cut}; reading.min_range_m=0 keeps them", stacklevel=2)
        return scans
    if path.suffix.lower() in READERS:
        _refuse(path, "a single point file", reading, "beam_origin", "poses", *of_bags, of_logs)
        return read_point_file(path, reading.sensor_origin_m, every=reading.every, **ranges)
    if not path.exists():
        raise InputError(f"{path}: no such file or folder")
    raise InputError(f"{path}: unknown extension {path.suffix!r}; known are {' '.join(EXTENSIONS)}, and folders of scans")


def _refuse(path: Path, kind: str, reading: ReadingSettings, *names: str) -> None:
    for name in names:
        if getattr(reading, name) != getattr(ReadingSettings(), name):
            raise InputError(f"reading.{name}: {path} is {kind}, where this has no meaning; leave it unset")
