"""Colours of a map's cells, those of the pictures."""

from __future__ import annotations

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.drawing.colours import PROBABILITY
from hilbertvae.drawing.lit_colours import LIT, height_colours
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


def cell_colours(cells: MapCells, by: str = "probability") -> np.ndarray:
    """(V, 3) uint8 by `probability`, or in 3D by `height` above the ground, tinted green where they are predicted."""
    if by == "probability":
        colours = (PROBABILITY if cells.dimension == 2 else LIT)(cells.probability.astype(np.float64), bytes=True)
        return colours[:, :3]
    if by != "height" or cells.dimension == 2:
        raise InputError(f"colour: expected probability, or in 3D height, got {by!r} for a {cells.dimension}D map")
    return height_colours(heights_above_ground(cells), ~cells.observed)
