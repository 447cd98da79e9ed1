"""Pictures of voxels from obliquely above, with numpy alone: parallel rays, the nearest voxel of each pixel, shading that shows shape."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np
from matplotlib.colors import Colormap, to_rgb

from hilbertvae.checks import check_points, check_positive
from hilbertvae.drawing.colours import GAP_COLOUR
from hilbertvae.voxel_votes import voxel_index

SUPERSAMPLE = 2
"""Rays along a pixel's side."""
RAYS_AT_ONCE = 2_000_000
TINT = 0.7
"""The share of the tint's colour in a tinted voxel."""
CREASES = 0.025
"""How dark creases are."""
CREASE_PX = (2, 5, 12)
"""At these distances, in rays, neighbours are looked at: fine edges, and a wider shade around what stands on something."""
ROWS_AT_ONCE = 64
"""Rows of rays whose creases are found together, so that what they need stays in the processor's cache."""
GRID_PX = 10
"""Voxels at least so large show their edges."""
ELEVATION_DEG = 38.0
"""How far down pictures look."""
WHOLE_PX = 1300
"""The width of a whole site's picture."""


@dataclass(frozen=True)
class Camera:
    """A parallel view. centre: (3,) metres, what the picture's middle shows; pixels: (width, height); pixel_m: metres per pixel.

    azimuth_deg: where the camera looks to, counter-clockwise from the map's x axis; elevation_deg: how far down it looks, 0 to 90.
    """

    centre: np.ndarray
    azimuth_deg: float
    elevation_deg: float
    pixel_m: float
    pixels: tuple[int, int]

    @classmethod
    def around(cls, points: np.ndarray, azimuth_deg: float, elevation_deg: float, pixels=(1600, 900), margin: float = 0.02) -> Camera:
        """The closest view that shows all `points (N, 3)` with a margin, a share of the picture."""
        check_points(points, "points", dimension=3)
        camera = cls(points.mean(axis=0), azimuth_deg, elevation_deg, 1.0, pixels)
        seen = (points - camera.centre) @ camera.axes.T
        low, high = seen.min(axis=0), seen.max(axis=0)
        pixel_m = max(((high - low)[:2] / np.array(pixels)).max() / (1 - 2 * margin), 1e-6)
        return replace(camera, centre=camera.centre + (low + high) / 2 @ camera.axes, pixel_m=float(pixel_m))

    @property
    def axes(self) -> np.ndarray:
        """(3, 3): the picture's right, its up and the direction of sight, as unit vectors of the map."""
        turn, tilt = np.radians(self.azimuth_deg), np.radians(self.elevation_deg)
        forward = np.array([np.cos(turn) * np.cos(tilt), np.sin(turn) * np.cos(tilt), -np.sin(tilt)])
        right = np.array([np.sin(turn), -np.cos(turn), 0.0])
        return np.stack([right, np.cross(right, forward), forward])

    def project(self, points: np.ndarray) -> np.ndarray:
        """(N, 3): column and row in pixels from the upper left corner, depth in metres from the picture's middle."""
        right, up, depth = self.axes @ (points - self.centre).T
        width, height = self.pixels
        return np.stack([width / 2 + right / self.pixel_m, height / 2 - up / self.pixel_m, depth], axis=1)


def whole_view(points: np.ndarray) -> Camera:
    """A view across the longer side of a site, as high as the site needs, without the few points far off."""
    if len(points) >= 1000:
        low, high = np.quantile(points, [0.001, 0.999], axis=0)
        points = points[((points >= low) & (points <= high)).all(axis=1)]
    flat = points[:, :2] - points[:, :2].mean(axis=0)
    along = np.linalg.eigh(flat.T @ flat)[1][:, 1]
    azimuth = math.degrees(math.atan2(along[1], along[0])) + 90
    seen = Camera(points.mean(axis=0), azimuth, ELEVATION_DEG, 1.0, (1, 1)).project(points)
    across, up = np.ptp(seen[:, :2], axis=0)
    height = int(np.clip(WHOLE_PX * up / max(across, 1e-6), WHOLE_PX / 4, WHOLE_PX)) + 20
    return Camera.around(points, azimuth, ELEVATION_DEG, (WHOLE_PX, height))


def render_voxels(
    points: np.ndarray,
    values: np.ndarray,
    camera: Camera,
    resolution_m: float,
    colours: Colormap,
    limits: tuple[float, float] = (0.0, 1.0),
    tinted: np.ndarray | None = None,
    tint: str = GAP_COLOUR,
) -> np.ndarray:
    """(height, width, 3) uint8: the voxels of `points (N, 3)`, in the colours of `values (N,)` between `limits`, on white.

    tinted: (N,) bool, the voxels to colour with `tint`, such as those in gaps.
    """
    check_points(points, "points", dimension=3, allow_empty=True)
    check_positive(resolution_m, "resolution_m")
    low, high = limits
    base = colours(np.clip((np.asarray(values, np.float64) - low) / max(high - low, 1e-12), 0, 1))[:, :3].astype(np.float32)
    if tinted is not None:
        base[tinted] = (1 - TINT) * base[tinted] + TINT * np.array(to_rgb(tint), np.float32)
    fine = replace(camera, pixel_m=camera.pixel_m / SUPERSAMPLE, pixels=tuple(SUPERSAMPLE * p for p in camera.pixels))
    centres = (voxel_index(points, resolution_m) + 0.5) * resolution_m
    voxel = visible(centres, fine, resolution_m)
    hit = voxel >= 0
    image = np.ones((*voxel.shape, 3), np.float32)
    if hit.any():
        depth, light = _lit(centres, voxel, fine, resolution_m)
        light *= _creases(depth, resolution_m)[hit]
        image[hit] = base[voxel[hit]] * light[:, None]
    rays = [image[down::SUPERSAMPLE, aside::SUPERSAMPLE] for down in range(SUPERSAMPLE) for aside in range(SUPERSAMPLE)]
    image = reduce(np.add, rays) / np.float32(len(rays))  # a fifth of the time of a mean along two axes
    return np.round(np.clip(image, 0, 1) * 255).astype(np.uint8)


def visible(centres: np.ndarray, camera: Camera, resolution_m: float) -> np.ndarray:
    """(height, width) int32: the voxel of `centres (N, 3)`, on one lattice, that the ray of each pixel meets first; -1 for none.

    Drawn from the farthest centre to the nearest. For cubes of a lattice and parallel rays that order is exact: a ray that leaves one
    cube for another never steps back along any axis.
    """
    width, height = camera.pixels
    column, row, depth = camera.project(centres).T
    half = resolution_m / 2 * np.abs(camera.axes[:2]).sum(axis=1) / camera.pixel_m
    chosen = np.flatnonzero((np.abs(column - width / 2) < width / 2 + half[0]) & (np.abs(row - height / 2) < height / 2 + half[1]))
    chosen = chosen[np.argsort(-depth[chosen], kind="stable")].astype(np.int32)
    across, along = _footprint(camera, resolution_m, half)
    # A margin as wide as a cube on all sides takes what falls beside the picture.
    margin = np.ceil(2 * half).astype(int) + 2
    wide, high = width + 2 * margin[0], height + 2 * margin[1]
    image = np.full(wide * high, -1, np.int32)
    step = (along * wide + across).astype(np.int64)
    portion = max(1, RAYS_AT_ONCE // len(step))
    for start in range(0, len(chosen), portion):
        part = chosen[start : start + portion]
        first_column, first_row = np.floor(column[part]), np.floor(row[part])
        x = (first_column + 0.5 - column[part]).astype(np.float32)[:, None] + across
        y = (first_row + 0.5 - row[part]).astype(np.float32)[:, None] + along
        enter, leave = _slabs(x, y, camera, resolution_m)
        met = reduce(np.maximum, enter) <= reduce(np.minimum, leave)
        first = ((first_row + margin[1]) * wide + first_column + margin[0]).astype(np.int64)
        # Of repeated indices the last is kept: the nearest voxel.
        image[(first[:, None] + step)[met]] = np.repeat(part, np.count_nonzero(met, axis=1))
    return image.reshape(high, wide)[margin[1] : margin[1] + height, margin[0] : margin[0] + width]


def _footprint(camera: Camera, resolution_m: float, half: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pixels right and down (k,), float32, from the one that a cube's centre lies in, to all those that the cube may cover."""
    steps = [np.arange(-np.ceil(reach), np.ceil(reach) + 1) for reach in half]
    across, along = (grid.ravel().astype(np.float32) for grid in np.meshgrid(*steps))
    # The centre is up to half a diagonal from its pixel's middle.
    enter, leave = _slabs(across, along, camera, resolution_m + np.sqrt(2) * camera.pixel_m)
    reached = reduce(np.maximum, enter) <= reduce(np.minimum, leave)
    return across[reached], along[reached]


def _slabs(x: np.ndarray, y: np.ndarray, camera: Camera, resolution_m: float) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Where rays enter and leave the three slabs of a cube, in metres along the ray from the cube's centre.

    x, y: how many pixels right of the centre and below it each ray is.
    """
    right, up, forward = camera.axes
    forward = np.where(np.abs(forward) < 1e-6, 1e-6, forward)
    enter, leave = [], []
    for axis in range(3):
        middle = x * np.float32(-right[axis] * camera.pixel_m / forward[axis])
        middle += y * np.float32(up[axis] * camera.pixel_m / forward[axis])
        half = np.float32(resolution_m / 2 / abs(forward[axis]))
        enter.append(middle - half)
        leave.append(middle + half)
    return enter, leave


def _lit(centres: np.ndarray, voxel: np.ndarray, camera: Camera, resolution_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Depth (height, width) float32, inf where nothing is, and the light (n,) on the face that each hit pixel shows."""
    row, column = np.nonzero(voxel >= 0)
    centre = camera.project(centres)[voxel[row, column]]
    x, y = (column + 0.5 - centre[:, 0]).astype(np.float32), (row + 0.5 - centre[:, 1]).astype(np.float32)
    enter = _slabs(x, y, camera, resolution_m)[0]
    into = reduce(np.maximum, enter)
    face = np.where(enter[0] == into, np.int8(0), np.where(enter[1] == into, np.int8(1), np.int8(2)))
    depth = np.full(voxel.shape, np.inf, np.float32)
    depth[row, column] = centre[:, 2] + into
    right, up, forward = camera.axes
    # From above and from the left, a little from behind the camera, so that the three faces that show differ.
    lamp = 0.9 * np.array([0.0, 0.0, 1.0]) - 0.55 * right - 0.35 * forward
    normals = -np.sign(np.where(np.abs(forward) < 1e-6, 1.0, forward)) * np.eye(3)
    light = (0.5 + 0.5 * np.clip(normals.diagonal() * lamp / np.linalg.norm(lamp) * 1.25, 0, 1)).astype(np.float32)[face]
    if resolution_m / camera.pixel_m >= GRID_PX * SUPERSAMPLE:
        light *= np.where(_rim(x, y, into, face, camera, resolution_m), np.float32(0.86), np.float32(1))
    return depth, light


def _rim(x, y, into, face, camera: Camera, resolution_m: float) -> np.ndarray:
    """(n,) bool: the pixels at the edge of their voxel's face."""
    right, up, forward = camera.axes
    across, along = np.float32(camera.pixel_m) * right.astype(np.float32), np.float32(camera.pixel_m) * up.astype(np.float32)
    inner = np.float32(resolution_m / 2 - 0.75 * SUPERSAMPLE / 2 * camera.pixel_m)
    rim = np.zeros(len(face), bool)
    for axis in range(3):
        spot = x * across[axis] - y * along[axis] + into * np.float32(forward[axis])
        rim |= (np.abs(spot) > inner) & (face != axis)  # across the face itself every spot is half a voxel from the middle
    return rim


def _creases(depth: np.ndarray, resolution_m: float) -> np.ndarray:
    """(height, width) factors up to 1, darker where neighbours on both sides are nearer on the whole: in creases and behind edges.

    Eye-dome lighting (Boucheny and Ribes, 2011) with the second difference of the depth, which leaves slanted planes alone.
    """
    margin = CREASE_PX[-1]
    there = np.pad(np.isfinite(depth), margin, mode="edge")
    wide = np.where(there, np.pad(depth, margin, mode="edge"), np.float32(0))
    factors = np.empty(depth.shape, np.float32)
    for first in range(0, len(depth), ROWS_AT_ONCE):
        rows = slice(first, first + ROWS_AT_ONCE + 2 * margin)
        shade = _shade(wide[rows], there[rows].astype(np.float32), 4 * resolution_m)
        factors[first : first + ROWS_AT_ONCE] = np.exp(-CREASES * shade / resolution_m)
    return factors


def _shade(depth: np.ndarray, there: np.ndarray, most: float) -> np.ndarray:
    """What neighbours on both sides are nearer, summed over directions, of all pixels but a margin of `CREASE_PX[-1]` on each side.

    there: 1 where `depth` is of something, 0 of the background, which is infinitely far: from or to it there is no crease.
    """
    margin = CREASE_PX[-1]
    height, width = depth.shape[0] - 2 * margin, depth.shape[1] - 2 * margin
    shade = np.zeros((height, width), np.float32)
    for reach in CREASE_PX:
        for down, aside in ((0, reach), (reach, 0), (reach, reach), (reach, -reach)):
            # From each pixel to its neighbour that way: of all pixels, and of those that have one of these for a neighbour.
            left, right = max(aside, 0), max(-aside, 0)
            rows, columns = slice(margin - down, margin + height), slice(margin - left, margin + width + right)
            next_rows, next_columns = slice(margin, margin + height + down), slice(margin - left + aside, margin + width + right + aside)
            step = depth[rows, columns] - depth[next_rows, next_columns]
            np.clip(step, -most, most, out=step)
            step *= there[rows, columns]
            step *= there[next_rows, next_columns]
            deeper = step[down:, left : left + width] - step[:height, right : right + width]
            shade += np.maximum(deeper, 0, out=deeper)
    return shade
