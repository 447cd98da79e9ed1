"""How high the cells of a 3D map lie above its ground, which their colours tell."""

from __future__ import annotations

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.exports.map_cells import MapCells
from hilbertvae.ground import Ground, find_ground

GROUND_QUANTILE = 0.02
"""Where a map is too wide for tiles of ground, height counts from this quantile of the cells' own heights."""


def ground_below(cells: MapCells) -> Ground | None:
    """The ground of a 3D map, found from its observed occupied cells; None of a map without cells, or one too wide for tiles of ground."""
    seen = cells.centres[cells.observed & cells.occupied]
    try:
        return find_ground(seen if len(seen) else cells.centres)
    except InputError:
        return None


def heights_above_ground(cells: MapCells) -> np.ndarray:
    """(V,) metres of a 3D map's cells above the ground below them."""
    ground = ground_below(cells)
    if ground is not None:
        return ground.height_above(cells.centres)
    z = cells.centres[:, 2]
    return z - np.quantile(z, GROUND_QUANTILE) if len(z) else z
