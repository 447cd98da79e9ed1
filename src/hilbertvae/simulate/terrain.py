"""The ground of a street: a bent way with slope, crossfall and bumps, a carriageway, and pavements raised over it by a kerb.

Plans are drawn straight, in (s, t): s metres along the street, t metres to its left. The ground bends them into the world.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from hilbertvae.simulate.shapes import edges, united, without
from hilbertvae.simulate.soup import Soup, Surface, joined, quads, soup

CELL_M = 3.0
RAMP_M = 1.0


@dataclass(frozen=True)
class StreetGround:
    """curvature: 1 / m, of the line t = 0. slope: metres up per metre along; crossfall: per metre to the left.

    camber: metres down per metre from t = 0, as far as `flat_from_m`. banks: metres up per metre beyond `flat_from_m`, right and left.
    waves: (K, 4): s and t frequency (radians per metre), phase, height (m).
    road: the carriageway in (s, t). kerb_m: how high the rest lies above it. drives: (K, 3) s, t and half width where the kerb is lowered.
    """

    curvature: float
    slope: float
    crossfall: float
    camber: float
    flat_from_m: float
    banks: tuple[float, float]
    waves: np.ndarray
    road: shapely.Geometry
    kerb_m: float
    drives: np.ndarray

    def in_world(self, s: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """x, y in metres of places of the plan."""
        angle = self.curvature * np.asarray(s, dtype=float)
        # sin(a) / a and (1 - cos(a)) / a stay exact on a straight way.
        x = s * np.sinc(angle / np.pi) - t * np.sin(angle)
        return x, s * np.sinc(angle / 2 / np.pi) * np.sin(angle / 2) + t * np.cos(angle)

    def heading(self, s: np.ndarray) -> np.ndarray:
        """Direction of the street, radians."""
        return self.curvature * np.asarray(s, dtype=float)

    def level(self, s: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Heights of the carriageway, also where pavement lies over it."""
        s, t = np.broadcast_arrays(np.asarray(s, dtype=float), np.asarray(t, dtype=float))
        beyond = np.maximum(np.abs(t) - self.flat_from_m, 0)
        z = self.slope * s + self.crossfall * t - self.camber * np.minimum(np.abs(t), self.flat_from_m)
        z = z + np.where(t < 0, *self.banks) * 6 * np.tanh(beyond / 6)
        for along, across, phase, height in self.waves:
            z = z + height * np.sin(along * s + across * t + phase)
        return z

    def kerb(self, s: np.ndarray, t: np.ndarray) -> np.ndarray:
        """How far the pavement at a place lies above the carriageway: less at drives."""
        lowered = np.zeros(np.broadcast(s, t).shape)
        for middle, side, half_width in self.drives:
            away = np.maximum(np.abs(s - middle) - half_width, 0) + 0.3 * np.abs(t - side)
            lowered = np.maximum(lowered, np.clip(1 - away / RAMP_M, 0, 1))
        return self.kerb_m * (1 - 0.8 * lowered)

    def height(self, s: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Heights of the ground that things stand on."""
        return self.level(s, t) + np.where(shapely.contains_xy(self.road, s, t), 0.0, self.kerb(s, t))

    def place(self, s, t, up_m=0.0) -> np.ndarray:
        """(..., 3): world coordinates of places on the ground, or `up_m` above it."""
        x, y = self.in_world(s, t)
        return np.stack(np.broadcast_arrays(x, y, self.height(s, t) + up_m), axis=-1)


def ground_soup(ground: StreetGround, extent, grass: shapely.Geometry) -> Soup:
    """Carriageway, kerbs and what lies beside, within `extent` (s0, t0, s1, t1). `grass`: which of it is grown over."""
    s0, t0, s1, t1 = extent
    s, t = np.arange(s0, s1 + CELL_M, CELL_M), np.arange(t0, t1 + CELL_M, CELL_M)
    left, low = (grid.ravel() for grid in np.meshgrid(s[:-1], t[:-1], indexing="ij"))
    cells = shapely.box(left, low, left + CELL_M, low + CELL_M)
    beside = without(shapely.box(s[0], t[0], s[-1], t[-1]), ground.road)
    parts = []
    for area, raised in (
        (shapely.buffer(ground.road, 0.05), False),
        (without(beside, grass), True),
        (shapely.intersection(beside, grass), True),
    ):
        kind = Surface.ROAD if len(parts) < 2 else Surface.GRASS
        corners = _triangulated(cells, area)
        flat_s, flat_t = corners[..., 0], corners[..., 1]
        z = ground.level(flat_s, flat_t) + (ground.kerb(flat_s, flat_t) if raised else 0.0)
        parts.append(soup(np.stack([*ground.in_world(flat_s, flat_t), z], axis=-1), kind))
    rim = edges(shapely.get_parts(shapely.segmentize(ground.road, 0.8)))
    return joined([*parts, _kerb_faces(ground, rim)])


def _triangulated(cells: np.ndarray, area: shapely.Geometry) -> np.ndarray:
    """(K, 3, 2): triangles that cover `area`, none larger than half a cell."""
    shapely.prepare(area)
    inside = shapely.contains_properly(area, cells)
    corners = shapely.get_coordinates(cells[inside]).reshape(-1, 5, 2)
    whole = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
    cut = cells[~inside & shapely.intersects(area, cells)]
    pieces = shapely.get_parts(shapely.get_parts(shapely.intersection(cut, area)))
    pieces = pieces[shapely.area(pieces) > 1e-6]
    small = shapely.get_parts(shapely.constrained_delaunay_triangles(pieces))
    return np.concatenate([whole, shapely.get_coordinates(small).reshape(-1, 4, 2)[:, :3]])


def _kerb_faces(ground: StreetGround, rim: np.ndarray) -> Soup:
    s, t = rim[..., 0], rim[..., 1]
    x, y = ground.in_world(s, t)
    low = ground.level(s, t)
    high = low + ground.kerb(s, t)
    lower, upper = np.stack([x, y, low - 0.1], axis=-1), np.stack([x, y, high], axis=-1)
    return quads(np.stack([lower[:, 0], lower[:, 1], upper[:, 1], upper[:, 0]], axis=1), Surface.WALL)


def strips(boxes) -> shapely.Geometry:
    """The union of rectangles (s0, t0, s1, t1)."""
    return united([shapely.box(*box) for box in boxes]) if len(boxes) else shapely.Polygon()
