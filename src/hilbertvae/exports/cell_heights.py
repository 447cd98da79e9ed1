"""How high the cells of a 3D map lie above its ground, which their colours tell."""

from __future__ import annotations

import numpy as np

from hilbertvae.exports.map_cells import MapCells
from hilbertvae.ground import BlockGround, Ground, find_wide_ground


def ground_below(cells: MapCells) -> Ground | BlockGround | None:
    """The ground of a 3D map, found from its observed occupied cells, or from all where there are none; None of a map without cells."""
    if not len(cells.index):
        return None
    seen = cells.centres[cells.observed & cells.occupied]
    return find_wide_ground(seen if len(seen) else cells.centres)


def heights_above_ground(cells: MapCells) -> np.ndarray:
    """(V,) metres of a 3D map's cells above the ground below them."""
    ground = ground_below(cells)
    return np.empty(0) if ground is None else ground.height_above(cells.centres)
