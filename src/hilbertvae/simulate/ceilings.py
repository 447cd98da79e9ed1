"""What hangs from ceilings: rows of lamps, beams, pipes and ducts."""

from __future__ import annotations

import numpy as np
import shapely

from hilbertvae.simulate.furniture import lattice
from hilbertvae.simulate.shapes import turned
from hilbertvae.simulate.soup import Soup, boxes_3d, joined, tubes

HIGH_M = 3.5
"""Below a higher ceiling there is always something."""


def draw_ceiling(rng: np.random.Generator, floor: shapely.Polygon, ceiling_m: float) -> Soup:
    """What hangs above a floor, in metres of the plan."""
    middle, reach_m, angle = lattice(floor)
    drop_m = rng.choice([0.0, 0.05, 0.4, 0.8] if ceiling_m > 2.9 else [0.0, 0.05])
    hanging = _lamps(rng, floor, middle, reach_m, angle, ceiling_m - drop_m) if drop_m else joined([])
    if rng.random() < 0.3 or ceiling_m > HIGH_M:
        hanging = joined([hanging, *_across(rng, floor, middle, reach_m, angle + np.pi / 2 * rng.integers(2), ceiling_m)])
    return hanging


def _lamps(rng, floor, middle, reach_m: float, angle: float, height_m: float) -> Soup:
    rows = np.arange(-reach_m, reach_m, rng.uniform(1.8, 3.5))
    places = middle + turned(np.stack(np.meshgrid(rows, rows), axis=-1).reshape(-1, 2), angle)
    places = places[shapely.contains_xy(floor.buffer(-0.7), places[:, 0], places[:, 1])]
    if len(places) == 0:
        return joined([])
    return boxes_3d(np.column_stack([places, np.full(len(places), height_m - 0.06)]), [rng.uniform(0.3, 1.4), 0.2, 0.08], angle)


def _across(rng, floor, middle, reach_m: float, angle: float, ceiling_m: float):
    """Beams or pipes from wall to wall, all in one direction."""
    apart_m, thick_m, round_ones = rng.uniform(2.0, 6.0), rng.uniform(0.1, 0.35), rng.random() < 0.5
    for row in np.arange(-reach_m, reach_m, apart_m):
        line = shapely.LineString(middle + turned(np.array([[-reach_m, row], [reach_m, row]]), angle))
        for piece in shapely.get_parts(line.intersection(floor)):
            if piece.length < 1:
                continue
            start, end = shapely.get_coordinates(piece)
            if round_ones:
                height_m = ceiling_m - thick_m * rng.uniform(0.6, 1.5)
                yield tubes([[*start, height_m]], [[*end, height_m]], thick_m / 2, thick_m / 2, 8)
            else:
                yield boxes_3d([[*(start + end) / 2, ceiling_m - thick_m]], [piece.length, thick_m, thick_m], angle)
