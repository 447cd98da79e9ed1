"""Whether scans in space seem to lie on their side, as in the frame of a camera, where y goes down and z ahead."""

from __future__ import annotations

import os
import warnings

import numpy as np

from hilbertvae.scans.scan import Scans
from hilbertvae.sums import sums_by

LOOKED_AT = 3
"""Scans of a drive whose surfaces are counted: the first one, the last one and one between."""
BLOCK_M, LEAST_RETURNS = 0.5, 10
"""Of such cubes, with so many returns, each is a surface or none."""
THIN, WIDE = 0.1, 0.1
"""Of the variances along the three axes of a surface, the least against the second, and that against the greatest."""
FACING = 0.9
"""The cosine to an axis from which on a surface faces along it: of 26 degrees."""
LEAST_SURFACES = 50
MOST_FACE, FACE_UP = {True: 0.4, False: 0.55}, {True: 0.5, False: 0.2}
"""Scans lie on a side that at least so many surfaces face, if those that face up are at most the second share of these: less of both is
needed where the sensor went along z more than along any other axis. Of real drives and scans 48 to 94 % of surfaces face up; in simulated
rooms of bare walls, whose floor a lidar hardly sees, up to 52 % face one side, and 10 % up."""
MOVED_M, CLIMBED = 2.0, 0.3
"""A sensor that went farther than the first has to climb so much of its way, too: along walls it may drive, not up them."""


def warn_of_lying(scans: Scans, path: str | os.PathLike) -> None:
    """One `UserWarning` where hardly any surface of scans in space faces along z and most face along another axis: z is to be up, since
    networks have learned so, and streets and rooms are not made otherwise."""
    if scans.dimension != 3 or not len(scans):
        return
    numbers = np.unique(scans.scan)
    chosen = np.unique(numbers[np.linspace(0, len(numbers) - 1, LOOKED_AT).astype(int)])
    facing, count = np.zeros(3), 0
    for number in chosen:
        found = facing_axes(scans.points[scans.scan == number])
        facing, count = facing + found.sum(axis=0), count + len(found)
    side, ways = int(np.argmax(facing)), np.ptp(scans.origins, axis=0)
    went = ways.max() > MOVED_M
    rose = went and ways[2] == ways.max()
    if side == 2 or count < LEAST_SURFACES or facing[side] < MOST_FACE[rose] * count or facing[2] > FACE_UP[rose] * facing[side]:
        return
    if went and ways[2] < CLIMBED * ways.max():
        return
    shares = f"{facing[side] / count:.0%} of the surfaces face along {'xyz'[side]} and {facing[2] / count:.0%} along z"
    warnings.warn(f"{path}: z is to be up, and {shares}: are poses in the frame of a camera? The map would lie on its side", stacklevel=3)


def facing_axes(points: np.ndarray) -> np.ndarray:
    """(S, 3) bool: along which axis, if any, each surface of `points (N, 3)`, metres, faces; one surface a cube, where there is one."""
    cube = np.zeros(len(points), np.int64)
    for axis in points.T:  # a column at a time: whole rows are compared far more slowly
        along = np.unique(np.floor(axis / BLOCK_M), return_inverse=True)[1]
        cube = np.unique(cube * len(points) + along, return_inverse=True)[1]
    number = np.bincount(cube)
    apart = points - (sums_by(cube, points, len(number)) / number[:, None])[cube]
    products = (apart[:, :, None] * apart[:, None, :]).reshape(-1, 9)
    enough = number >= LEAST_RETURNS
    spread = (sums_by(cube, products, len(number)) / number[:, None])[enough].reshape(-1, 3, 3)
    variances, axes = np.linalg.eigh(spread)
    surface = (variances[:, 0] < THIN * variances[:, 1]) & (variances[:, 1] > WIDE * variances[:, 2])
    return np.abs(axes[surface][:, :, 0]) > FACING
