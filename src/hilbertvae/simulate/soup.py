"""Triangle soups: surfaces as loose triangles, each with what it is made of. Streets are built of them in bulk."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np


class Surface(IntEnum):
    """What a triangle is made of; `surfaces.py` says how a laser sees it."""

    WALL = 0
    ROAD = 1
    GRASS = 2
    LEAF = 3
    PAINT = 4
    DARK = 5
    GLASS = 6
    PANE = 7
    NET = 8
    CLOTH = 9


@dataclass(frozen=True)
class Soup:
    """triangles: (F, 3, 3) float64, metres; surface: (F,) int8, values of `Surface`."""

    triangles: np.ndarray
    surface: np.ndarray

    def __len__(self) -> int:
        return len(self.triangles)

    def moved(self, place: np.ndarray, heading_rad: float = 0.0) -> Soup:
        """Turned counter-clockwise about z, then shifted by `place` (3,)."""
        cosine, sine = np.cos(heading_rad), np.sin(heading_rad)
        turn = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1.0]])
        return Soup(self.triangles @ turn.T + np.asarray(place, dtype=float), self.surface)


def soup(triangles: np.ndarray, surface) -> Soup:
    """Triangles (..., 3, 3) of one surface, or of one surface each."""
    triangles = np.asarray(triangles, dtype=np.float64).reshape(-1, 3, 3)
    return Soup(triangles, _one_each(surface, len(triangles)))


def _one_each(surface, count: int) -> np.ndarray:
    """(count,) int8, of one for all or of one each. Streets are of thousands of small soups, of which `np.broadcast_to` took most time."""
    found = np.empty(count, np.int8)
    found[:] = surface
    return found


def joined(soups) -> Soup:
    """All soups as one."""
    soups = [part for part in soups if len(part)]
    if not soups:
        return soup(np.empty((0, 3, 3)), 0)
    return Soup(np.concatenate([part.triangles for part in soups]), np.concatenate([part.surface for part in soups]))


def quads(corners: np.ndarray, surface) -> Soup:
    """Quadrilaterals (..., 4, 3), corners in order around; `surface` is one for all or one each."""
    corners = np.asarray(corners, dtype=np.float64).reshape(-1, 4, 3)
    return soup(corners[:, [[0, 1, 2], [0, 2, 3]]], np.repeat(surface, 2) if np.ndim(surface) else surface)


def sheet(grid: np.ndarray, surface) -> Soup:
    """The surface through a lattice of points (..., R, C, 3); `surface` is one for all or (..., R - 1, C - 1)."""
    before, after = grid[..., :-1, :, :], grid[..., 1:, :, :]
    corners = np.stack([before[..., :-1, :], after[..., :-1, :], after[..., 1:, :], before[..., 1:, :]], axis=-2)
    surface = np.asarray(surface)
    return quads(corners, surface.ravel() if surface.ndim else surface)


def boxes_3d(feet: np.ndarray, sizes: np.ndarray, headings_rad=0.0, surface=Surface.WALL) -> Soup:
    """Upright boxes on `feet` (K, 3), the middles of their undersides; `sizes` (K, 3) are length, width, height."""
    feet = np.atleast_2d(np.asarray(feet, dtype=float))
    sizes = np.broadcast_to(sizes, feet.shape)
    headings = np.broadcast_to(headings_rad, len(feet))
    unit = np.array([[x, y, z] for z in (0, 1) for x, y in ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))])
    local = sizes[:, None] * unit
    cosine, sine = np.cos(headings)[:, None], np.sin(headings)[:, None]
    corners = np.stack(
        [cosine * local[..., 0] - sine * local[..., 1], sine * local[..., 0] + cosine * local[..., 1], local[..., 2]], axis=-1
    )
    corners += feet[:, None]
    sides = np.array([[0, 1, 2, 3], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]])
    return quads(corners[:, sides], surface)


def tubes(
    starts: np.ndarray, ends: np.ndarray, start_radii_m, end_radii_m, sides: int = 6, surface=Surface.WALL, caps: bool = False
) -> Soup:
    """Cones cut off at both ends, from `starts` to `ends` (K, 3); open unless `caps`."""
    starts, ends = np.atleast_2d(np.asarray(starts, dtype=float)), np.atleast_2d(np.asarray(ends, dtype=float))
    if len(starts) == 0:
        return joined([])
    along = ends - starts
    along = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    helper = np.where(np.abs(along[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    first = _cross(along, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = _cross(along, first)
    angles = np.arange(sides) * 2 * np.pi / sides
    ring = np.cos(angles)[:, None] * first[:, None] + np.sin(angles)[:, None] * second[:, None]
    low = starts[:, None] + np.broadcast_to(start_radii_m, len(starts))[:, None, None] * ring
    high = ends[:, None] + np.broadcast_to(end_radii_m, len(starts))[:, None, None] * ring
    parts = [quads(np.stack([low, np.roll(low, -1, 1), np.roll(high, -1, 1), high], axis=2), surface)]
    if caps:
        for middle, rim in ((starts, low), (ends, high)):
            middle = np.broadcast_to(middle[:, None], rim.shape)
            parts.append(soup(np.stack([middle, rim, np.roll(rim, -1, 1)], axis=2), surface))
    return joined(parts)


def ellipsoids(middles: np.ndarray, radii: np.ndarray, surface=Surface.CLOTH) -> Soup:
    """Closed ellipsoids of few facets around `middles` (K, 3) with half axes `radii` (K, 3)."""
    rings, sides = 4, 7
    polar, around = np.linspace(0, np.pi, rings + 1), np.arange(sides + 1) * 2 * np.pi / sides
    unit = np.stack(
        np.broadcast_arrays(np.sin(polar)[:, None] * np.cos(around), np.sin(polar)[:, None] * np.sin(around), np.cos(polar)[:, None]), -1
    )
    return sheet(np.atleast_2d(middles)[:, None, None] + unit * np.atleast_2d(radii)[:, None, None], surface)


def _cross(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """`np.cross` of (K, 3) each, in a third of its time for few of them."""
    (a, b, c), (d, e, f) = one.T, other.T
    return np.stack([b * f - c * e, c * d - a * f, a * e - b * d], axis=1)


def facets(rng: np.random.Generator, middles: np.ndarray, sizes_m, surface=Surface.LEAF, outward: np.ndarray | None = None) -> Soup:
    """A triangle around each of `middles` (K, 3), its corners about `sizes_m` / 2 away: leaves, or sprays of them.

    They lie in any direction, or mostly across `outward` (K, 3), as the sprays on the outside of a crown do.
    """
    middles = np.atleast_2d(middles)
    corners = rng.normal(size=(len(middles), 3, 3))
    if outward is not None:
        way = outward / np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-9)
        corners -= 0.45 * np.einsum("kij,kj->ki", corners, way)[..., None] * way[:, None]
    corners -= corners.mean(axis=1, keepdims=True)
    corners /= np.maximum(np.linalg.norm(corners, axis=2, keepdims=True), 0.3)
    return soup(middles[:, None] + corners * np.broadcast_to(sizes_m, len(middles))[:, None, None] / 2, surface)
