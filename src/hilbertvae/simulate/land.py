"""Whose the land of a street is: what may stand where, so that no house stands in a side street and no car in a garage's wall."""

from __future__ import annotations

import numpy as np
import shapely

from hilbertvae.simulate.shapes import turned
from hilbertvae.simulate.soup import Soup

ON_ROADS = ("vehicle", "cyclist", "person")
BARRIERS = ("hedge", "wall", "fence", "rail")
"""May touch what stands, but go through no house that was there before; as bushes, they take no land."""
HOUSES = ("house", "garage", "shelter")
LOW_M = 1.2
"""Only what of a thing is lower takes land: a crown or a lamp's arm may reach over a car."""
TOUCH_M = 0.15
"""Neighbours may touch: terraces share walls."""


def footprint(kind: str, soup: Soup, place: tuple[float, float], angle_rad: float) -> shapely.Geometry:
    """The rectangle, in the plan, around what of a thing at `place` that faces `angle_rad` is lower than `LOW_M`.

    Of a house, from its front on: between its steps and bays there may be bins.
    """
    low = soup.triangles[soup.triangles[..., 2].min(axis=1) < LOW_M, :, :2].reshape(-1, 2)
    if not len(low):
        return shapely.Polygon()
    (x0, y0), (x1, y1) = low.min(axis=0), low.max(axis=0)
    y0 = max(y0, 0.0) if kind == "house" else y0
    corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    return shapely.polygons(turned(corners, angle_rad) + np.array(place))


def shrunk(place: shapely.Geometry, by_m: float = TOUCH_M) -> shapely.Geometry:
    """A footprint without its edge; what is too thin for that keeps its middle."""
    width = shapely.area(place) / max(shapely.length(place) / 2, 1e-9)
    return shapely.buffer(place, -min(by_m, 0.4 * width), join_style="mitre")


class Land:
    """Which land is taken. road: the carriageway; kept_free: where nothing may be parked, as before entrances."""

    def __init__(self, road: shapely.Geometry, kept_free: shapely.Geometry):
        self._road, self._kept_free = shapely.buffer(road, -TOUCH_M), kept_free
        shapely.prepare(self._road)
        self._taken, self._houses = [], []

    def free(self, kind: str, place: shapely.Geometry) -> bool:
        """Whether a thing may stand at a footprint."""
        if kind == "grass":
            return True
        if shapely.intersects(self._kept_free if kind in ON_ROADS else self._road, place):
            return False
        inner = shrunk(place, np.inf if kind in (*BARRIERS, "bush") else TOUCH_M)
        return not shapely.intersects(np.array(self._houses if kind in BARRIERS else self._taken, dtype=object), inner).any()

    def take(self, kind: str, place: shapely.Geometry) -> bool:
        """As `free`; the land is the thing's from now on."""
        if not self.free(kind, place):
            return False
        if kind not in (*BARRIERS, "bush", "grass"):
            self._taken.append(shrunk(place))
        if kind in HOUSES:
            self._houses.append(shrunk(place))
        return True
