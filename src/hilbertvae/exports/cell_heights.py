"""How high the cells of a 3D map lie above its ground, which their colours tell."""

from __future__ import annotations

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.exports.map_cells import MapCells
from hilbertvae.ground import find_ground

GROUND_QUANTILE = 0.02
"""Where a map is too wide for tiles of ground, height counts from this quantile of the cells' own heights."""


def heights_above_ground(cells: MapCells) -> np.ndarray:
    """(V,) metres of a 3D map's cells above the ground below them, which is found from its observed occupied ones."""
    z = cells.centres[:, 2]
    seen = cells.centres[cells.observed & cells.occupied]
    try:
        return find_ground(seen if len(seen) else cells.centres).height_above(cells.centres)
    except InputError:
        return z - np.quantile(z, GROUND_QUANTILE) if len(z) else z
