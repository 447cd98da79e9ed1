"""An existing map as what was observed: its cells become labelled points, as if scans had been there; and the reader of ROS maps.

map_server's rules: https://docs.nav2.org/configuration/packages/configuring-map-server.html and nav2_map_server/src/map_io.cpp.
"""

from __future__ import annotations

import math
import os
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from PIL import Image

from hilbertvae.checks import InputError, check_cell_m, check_positive, named
from hilbertvae.cloud import Cloud, labelled_voxels
from hilbertvae.scans.file_points import check_fits, reading
from hilbertvae.scans.plain_yaml import check_plain_yaml
from hilbertvae.voxel_votes import voxel_index

OCCUPIED_PIXEL, FREE_PIXEL, UNKNOWN_PIXEL = 0, 254, 205
"""What map savers write."""
MODES = ("trinary", "scale", "raw")
OCCUPIED_ABOVE_PERCENT, FREE_BELOW_PERCENT = 60, 40
"""The cuts of our own maps, for cells that have a probability and no label."""
CELL_WEIGHT = 8.0
"""How many samples a voxel of a map counts for, which maps don't say. The log loss of voxels that csail's held-out beams crossed is 0.010
with its scans, with its map read back 0.032, 0.024, 0.024 and 0.029 for 3, 8, 10 and 30, and with one of half the cells (so that a cell
is a quarter of this) 0.037, 0.040, 0.052 and 0.070 for 4, 8, 16 and 32; on kitti00_start 0.010, and 0.027, 0.022, 0.023 and 0.028 for 3, 8,
10 and 30 (docs/decisions.md, "How far from data a map is written, and what a cell of an existing map counts for")."""
MOST_YAML_BYTES = 1 << 16
MOST_CELLS = 1 << 27
PIECES = {2: 2, 3: 1}
"""By dimension, into so many pieces a side of a mapper's voxel is split that a cell gives one point: of this alone a turned box's cells
would often get none. In csail's gaps the AUC is 0.836 and 0.900 (two gap seeds) with one piece, 0.840 and 0.904 with two, and with three
as with two; in kitti00_start's 0.915 and 0.914."""
MOST_PIECES = 1 << 22
"""Points of a map beyond which voxels are not split, for memory's sake."""
FINE = 2
"""Cells of a fine map along a voxel's side: most maps for robots have cells of 0.05 m."""
AS_TYPED = 1e-5
"""Radians: quarter turns are typed as 1.5708 and 3.14159, which would move no wall by a cell in an image of any size."""
ON_SIDE = 1e-3
"""Of a voxel: points nearer than this to a side of the mapper's voxels are moved off it, all of a map's alike."""


def cloud_of_cells(
    centres: np.ndarray, occupied: np.ndarray, cell_m: float, resolution_m: float | None = None, sides: np.ndarray | None = None
) -> Cloud:
    """The cells of a map as labelled points.

    centres: (N, D) metres, map frame; occupied: (N,) bool. resolution_m: the voxel of the mapper that gets the cloud: cells that are
    larger are split into as many points as it takes to leave no voxel in them without one, and each voxel with a point into `PIECES`, which
    leave no cell of a turned box without one. A voxel counts for `CELL_WEIGHT`, however many points it has. sides: (D, D), unit vectors
    along the cells' sides; the axes unless given.
    Raises `InputError` for more than 2^27 points.
    """
    dimension = centres.shape[1]
    sides = np.eye(dimension) if sides is None else sides
    turned = np.abs(sides).max(axis=1).min() < 1 - 1e-12
    longest = cell_m * (math.sqrt(dimension) if turned else 1)
    parts = 1 if resolution_m is None else math.ceil(longest / check_positive(resolution_m, "resolution_m") - 1e-6)
    if len(centres) * parts**dimension > MOST_CELLS:
        raise InputError(f"resolution_m: {len(centres)} cells of {cell_m:g} m would be more than {MOST_CELLS} points at {resolution_m:g} m")
    if parts > 1:
        steps = _grid((np.arange(parts) + 0.5) / parts - 0.5, dimension) * cell_m
        centres = (centres[:, None] + steps @ sides).reshape(-1, dimension)
        occupied = np.repeat(occupied, len(steps))
    if not turned and len(centres):
        # Else rounding alone would put two points of a row into one voxel, and none into the next.
        voxel_m = resolution_m or cell_m
        phase = centres[0] / voxel_m
        centres = centres + np.where(np.abs(phase - np.rint(phase)) < ON_SIDE, 2 * ON_SIDE * voxel_m, 0.0)
    apart = min(1.0, cell_m / parts / (resolution_m or cell_m))  # of a voxel's side
    weight = CELL_WEIGHT * apart**dimension
    pieces = 1 if resolution_m is None else math.ceil(PIECES[dimension] * apart - 1e-6)
    if pieces > 1 and len(centres) * pieces**dimension <= MOST_PIECES:
        # Of the voxel that a point lies in, and not of its cell: this may reach into the next one, and a wall's would be in both.
        within = (_grid((np.arange(pieces) + 0.5) / pieces, dimension) * resolution_m)[None]
        centres = (voxel_index(centres, resolution_m)[:, None] * resolution_m + within).reshape(-1, dimension)
        occupied, weight = np.repeat(occupied, pieces**dimension), weight / pieces**dimension
    return Cloud(centres, occupied, np.full(len(centres), weight))


def _grid(along: np.ndarray, dimension: int) -> np.ndarray:
    """(n^D, D) the points of a grid with these coordinates on each axis."""
    return np.stack(np.meshgrid(*[along] * dimension, indexing="ij"), axis=-1).reshape(-1, dimension)


def map_of(cloud: Cloud, cell_m: float, resolution_m: float) -> Cloud:
    """What is read of a map that says what the `fit_cloud` of voxels of `cell_m` says: of each a label, and nothing of its votes.

    resolution_m: the voxel of the mapper that gets it (`cloud_of_cells`).
    """
    cells = labelled_voxels(cloud, cell_m)
    return cloud_of_cells(cells.points, cells.occupied, cell_m, resolution_m)


@dataclass(frozen=True)
class RosHeader:
    """What the YAML file of a map_server map says. path: that file; resolution_m: the side of a cell, metres; origin: the pose (x, y, yaw)
    of the lower left corner, metres and radians."""

    path: Path
    image: Path
    resolution_m: float
    origin: tuple[float, float, float]
    negate: bool
    occupied_thresh: float
    free_thresh: float
    mode: str

    def codes(self, shade: np.ndarray, opaque: np.ndarray | bool = True) -> np.ndarray:
        """int8: 1 occupied, -1 free, 0 unknown, of shades from 0 (black) to 1 (white)."""
        occ = shade if self.negate else 1 - shade
        percent = np.rint((occ - self.free_thresh) / (self.occupied_thresh - self.free_thresh) * 100)
        occupied, free = occ > self.occupied_thresh, occ < self.free_thresh
        if self.mode == "raw":
            percent = np.rint(shade * 255)
            opaque, occupied, free = percent <= 100, percent > OCCUPIED_ABOVE_PERCENT, percent <= FREE_BELOW_PERCENT
        elif self.mode == "scale":
            occupied, free = occupied | (percent > OCCUPIED_ABOVE_PERCENT), free | (percent <= FREE_BELOW_PERCENT)
        elif not self.negate:
            # Nav2's saver writes 205 for unknown and a free_thresh of 0.25, by which 205, 0.196, would be free.
            opaque = opaque & (np.abs(shade - UNKNOWN_PIXEL / 255) > 1e-4)
        return np.where(opaque, occupied.astype(np.int8) - (free & ~occupied).astype(np.int8), 0).astype(np.int8)


def read_ros_map(path: str | os.PathLike, resolution_m: float | None = None) -> Cloud:
    """The cells of a map_server map that are occupied or free, as a labelled 2D cloud; unknown ones are left out.

    path: the YAML file, `.yaml` or `.yml`, or the image beside it. Modes, `negate`, thresholds and an origin with a yaw are
    map_server's. But 205 is unknown in trinary maps whatever `free_thresh` says, and transparent pixels are unknown. Cells with a
    probability count as occupied above 0.6 and as free up to 0.4.
    resolution_m: see `cloud_of_cells`.
    Raises `InputError` for files that are missing or damaged, wrong keys, forged sizes, and a map without a known cell.
    """
    return ros_map_cloud(ros_map_header(path), resolution_m)


def ros_map_cloud(header: RosHeader, resolution_m: float | None = None) -> Cloud:
    """As `read_ros_map`, of the map whose YAML file was read before."""
    codes = _image_codes(header)
    row, column = np.nonzero(codes)
    if not len(row):
        raise InputError(f"{header.image}: expected occupied or free cells, found unknown ones only")
    x, y, yaw = header.origin
    cell = np.stack([column + 0.5, codes.shape[0] - row - 0.5], axis=1) * header.resolution_m
    sides = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
    return cloud_of_cells(cell @ sides + np.array([x, y]), codes[row, column] > 0, header.resolution_m, resolution_m, sides)


def warn_of_filled(path: Path) -> None:
    """A `UserWarning` for a map of ours with predicted cells, where nothing tells these from observed ones once it is read."""
    seen = f"{path.stem}_observed{path.suffix}"
    warnings.warn(f"{path}: was filled before, and what was predicted is now taken as seen; {seen} has what was", stacklevel=3)


def ros_map_header(path: str | os.PathLike) -> RosHeader:
    """The YAML file of a map_server map, or that beside its image, with a `UserWarning` if it was filled before; raises `InputError` as
    `read_ros_map` does."""
    path = Path(path)
    if path.name and path.suffix.lower() not in (".yaml", ".yml"):
        beside = path.with_suffix(".yaml"), path.with_suffix(".yml")
        path = next((file for file in beside if file.exists()), beside[0])
    with reading(path, "a map_server YAML file"):
        content = yaml.safe_load(check_plain_yaml(path, MOST_YAML_BYTES))
    if not isinstance(content, dict):
        raise InputError(f"{path}: expected keys as image and resolution, got {type(content).__name__}")
    if content.get("hilbertvae_cells") == "all":
        warn_of_filled(path)
    missing = [key for key in ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh") if content.get(key) is None]
    if missing:
        raise InputError(f"{path}: expected the key{'s' * (len(missing) > 1)} {', '.join(missing)} of a map_server map")
    image, origin, mode = content["image"], content["origin"], content.get("mode", "trinary")
    mode = mode.lower() if isinstance(mode, str) else mode  # as Nav2 takes it
    if not isinstance(image, str) or not image or "\0" in image:
        raise InputError(f"{path}: image: expected the name of a file, got {_said(image)}")
    if not isinstance(origin, list) or len(origin) != 3:
        raise InputError(f"{path}: origin: expected [x, y, yaw], got {_said(origin)}")
    if mode not in MODES:
        raise InputError(f"{path}: mode: expected one of {', '.join(MODES)}, got {_said(mode)}")
    if content["negate"] not in (0, 1):
        raise InputError(f"{path}: negate: expected 0 or 1, got {_said(content['negate'])}")
    resolution, occupied, free = (_number(path, key, content[key]) for key in ("resolution", "occupied_thresh", "free_thresh"))
    with named(path):
        check_cell_m(resolution, "resolution")
    if not 0 <= free < occupied <= 1:
        raise InputError(f"{path}: expected 0 <= free_thresh < occupied_thresh <= 1, got {free} and {occupied}")
    x, y, yaw = (_number(path, "origin", value) for value in origin)
    quarter = round(yaw / (math.pi / 2)) * math.pi / 2
    pose = (x, y, quarter if abs(yaw - quarter) < AS_TYPED else yaw)
    return RosHeader(path, path.parent / image, resolution, pose, bool(content["negate"]), occupied, free, mode)


def _number(path: Path, key: str, value) -> float:
    # PyYAML takes 5e-2 for a word.
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise InputError(f"{path}: {key}: expected a finite number, got {_said(value)}")
    return number


def _said(value) -> str:
    """A value of a YAML file in a message: a short file can name a part of it so often that its text would fill the memory."""
    try:
        return repr(str(value)[:60]) if isinstance(value, (str, int, float)) else f"a {type(value).__name__}"
    except ValueError:  # Python writes no whole number of more than 4300 digits
        return "a number of thousands of digits"


def _image_codes(header: RosHeader) -> np.ndarray:
    """(rows from the top, columns) int8."""
    with reading(header.image, "a PGM, PNG or BMP image"), warnings.catch_warnings():
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)
        with Image.open(header.image, formats=("PPM", "PNG", "BMP")) as image:
            _check_size(header.image, image)
            if image.mode == "L":
                return header.codes(np.arange(256) / 255)[np.asarray(image)]
            if image.mode.startswith("I"):
                return header.codes(np.asarray(image, dtype=np.float64) / 65535)
            channels = np.asarray(image.convert("RGBA"), dtype=np.float32) / 255
    opaque = channels[..., 3] == 1
    return header.codes(channels[..., :3].mean(axis=2, dtype=np.float64), opaque)


def _check_size(path: Path, image: Image.Image) -> None:
    """An `InputError` for more cells than the file can hold, before memory is taken for them."""
    width, height = image.size
    if width * height > MOST_CELLS:
        raise InputError(f"{path}: expected at most {MOST_CELLS} cells, got {width} x {height}")
    if image.format != "PPM":
        return
    with open(path, "rb") as file:
        magic = file.read(2)
    if magic not in (b"P5", b"P2"):
        raise InputError(f"{path}: expected a PGM image, P5 or P2, got {magic.decode('latin-1')}")
    each = 2 if magic == b"P2" or image.mode != "L" else 1  # a digit and a space, or bytes
    check_fits(path, f"{width} x {height} pixels", width * height * each - (magic == b"P2"), path.stat().st_size)
