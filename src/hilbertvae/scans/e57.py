"""Reader of E57 files (ASTM E2807), as terrestrial scanners write them, through pye57 in a process of its own."""

from __future__ import annotations

import os
import struct
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from hilbertvae.checks import InputError, extra_module
from hilbertvae.scans.apart import read_apart
from hilbertvae.scans.file_points import FilePoints, check_fits, reading
from hilbertvae.scans.poses import FARTHEST_M, RIGID

HEADER = struct.Struct("<8sIIQQQQ")
"""Signature, version, and the sizes of the file, of its XML (place and length) and of its pages."""
SCAN = struct.Struct("<qq7d")
MEMORY_BYTES = 2**29
XML_COPIES = 50
"""How much memory a tree of XML may take, of its own length."""
E57_TIMEOUT_S = 60.0
"""What reading may take beyond a second per megabyte."""
NO_MOTION = (0, 0, 0, 0, 0, 0, 1)


def read_e57(path: str | os.PathLike) -> FilePoints:
    """The points of all scans of a file, metres, in the file's frame: float64, so that UTM keeps the centimetre. One scan is one sweep.

    Each scan has a pose, which turns its points into the file's frame; the sensor stood where the pose says. Files of merged or
    resampled clouds have no poses, or the identity for all: those, unless their coordinates are spherical, don't say where beams
    started. Points that are marked invalid are NaN, beams without a return. Raises `InputError` for files that are missing, foreign or
    damaged.
    """
    path = Path(path)
    with reading(path, "an E57 file"):
        xml_bytes = _check_header(path)
        extra_module("points", "pye57")
        size = path.stat().st_size
        found = read_apart(path, "E57 file", "e57_process.py", MEMORY_BYTES + XML_COPIES * xml_bytes, E57_TIMEOUT_S + size / 1e6)
        clouds, places, says_origin, at = [], [], False, 0
        while at < len(found):
            count, is_spherical, *pose = SCAN.unpack_from(found, at)
            at += SCAN.size
            cloud = np.frombuffer(found, "<f8", 3 * count, at).reshape(-1, 3)
            at += cloud.nbytes
            turn, place = _rigid(path, len(clouds), pose)
            clouds.append(cloud @ turn.T + place)
            places.append(place)
            says_origin |= bool(is_spherical) or tuple(pose) != NO_MOTION
        if not clouds:
            return FilePoints(np.empty((0, 3)))
        counts = list(map(len, clouds))
        origins = np.repeat(places, counts, axis=0) if says_origin else None
        scan = np.repeat(np.arange(len(clouds)), counts) if len(clouds) > 1 else None
        moved = np.column_stack([turn, place]) if len(clouds) == 1 and tuple(pose) != NO_MOTION else None
        return FilePoints(np.concatenate(clouds), origins, scan, moved)


def _check_header(path: Path) -> int:
    """The bytes of the file's XML; an `InputError` unless the file is as long as it says."""
    with open(path, "rb") as file:
        start, size = file.read(HEADER.size), os.fstat(file.fileno()).st_size
    if not start.startswith(b"ASTM-E57"):
        raise InputError(f"{path}: expected an E57 file, which starts with 'ASTM-E57'")
    check_fits(path, "the header", HEADER.size, len(start))
    _, major, _, claimed, xml_start, xml_bytes, _ = HEADER.unpack(start)
    if major != 1:
        raise InputError(f"{path}: expected E57 version 1, got {major}")
    check_fits(path, "the header's pages", claimed, size)
    check_fits(path, "the header's XML", xml_start + xml_bytes, size)
    return xml_bytes


def _rigid(path: Path, scan: int, pose: list[float]) -> tuple[np.ndarray, np.ndarray]:
    place, quaternion = np.array(pose[:3]), np.array(pose[3:])
    length = np.sqrt(quaternion @ quaternion)
    if not abs(length - 1) <= RIGID or not np.abs(place).max() <= FARTHEST_M:
        raise InputError(f"{path}, scan {scan}: expected a rigid pose in metres, got translation {pose[:3]} and rotation {pose[3:]}")
    return Rotation.from_quat(quaternion).as_matrix(), place
