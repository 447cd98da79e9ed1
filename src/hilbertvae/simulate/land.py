"""Whose the land of a street is: what may stand where, so that no house stands in a side street and no car in a garage's wall."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import shapely

from hilbertvae.simulate.shapes import turned
from hilbertvae.simulate.soup import Soup

ON_ROADS = ("vehicle", "cyclist", "person", "bicycle")
BARRIERS = ("hedge", "wall", "fence", "rail")
SOFT = (*BARRIERS, "bush")
"""May touch what stands, and grow around it, but go through no house."""
HOUSES = ("house", "garage", "shelter")
LOW_M = 1.2
"""Only what of a thing is lower takes land: a crown or a lamp's arm may reach over a car."""
TOUCH_M = 0.15
"""Neighbours may touch: terraces share walls."""


def footprint(kind: str, soup: Soup, place: tuple[float, float], angle_rad: float) -> shapely.Geometry:
    """The rectangle, in the plan, around what of a thing at `place` that faces `angle_rad` is lower than `LOW_M`.

    Of a house, from its front on: steps and bays may reach between the bins of a pavement.
    """
    low = soup.triangles[soup.triangles[..., 2].min(axis=1) < LOW_M, :, :2].reshape(-1, 2)
    if not len(low):
        return shapely.Polygon()
    (x0, y0), (x1, y1) = low.min(axis=0), low.max(axis=0)
    y0 = max(y0, 0.0) if kind == "house" else y0
    corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    return shapely.polygons(turned(corners, angle_rad) + np.array(place))


@dataclass
class Land:
    """Which land is taken. road: the carriageway; kept_free: where nothing may be parked, as before entrances."""

    road: shapely.Geometry
    kept_free: shapely.Geometry
    _taken: list = field(default_factory=list)
    _houses: list = field(default_factory=list)

    def __post_init__(self):
        self.road = shapely.buffer(self.road, -TOUCH_M)
        shapely.prepare(self.road)

    def take(self, kind: str, place: shapely.Geometry) -> bool:
        """Whether a thing may stand at a footprint; if so, the land is its own from now on."""
        if kind == "grass":
            return True
        if shapely.intersects(self.kept_free if kind in ON_ROADS else self.road, place):
            return False
        inner = _shrunk(place, np.inf if kind in SOFT else TOUCH_M)
        if shapely.intersects(np.array(self._houses if kind in SOFT else self._taken, dtype=object), inner).any():
            return False
        if kind not in SOFT:
            self._taken.append(inner)
        if kind in HOUSES:
            self._houses.append(inner)
        return True


def _shrunk(place: shapely.Geometry, by_m: float) -> shapely.Geometry:
    """A footprint without its edge; what is too thin for that keeps a fifth of its width."""
    width = shapely.area(place) / max(shapely.length(place) / 2, 1e-9)
    return shapely.buffer(place, -min(by_m, 0.4 * width), join_style="mitre")
