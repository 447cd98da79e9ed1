"""Colours of a map's cells, those of the pictures."""

from __future__ import annotations

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.exports.map_cells import MapCells
from hilbertvae.reports.colours import PROBABILITY
from hilbertvae.reports.lit_colours import LIT, height_colours

GROUND_QUANTILE = 0.02
"""Height counts from this quantile of the cells' own heights."""


def cell_colours(cells: MapCells, by: str = "probability") -> np.ndarray:
    """(V, 3) uint8 by `probability`, or in 3D by `height` above the low end of the cells, tinted green where they are predicted."""
    if by == "probability":
        colours = (PROBABILITY if cells.dimension == 2 else LIT)(cells.probability.astype(np.float64), bytes=True)
        return colours[:, :3]
    if by != "height" or cells.dimension == 2:
        raise InputError(f"colour: expected probability, or in 3D height, got {by!r} for a {cells.dimension}D map")
    if not len(cells):
        return np.empty((0, 3), np.uint8)
    z = cells.centres[:, 2]
    return height_colours(z - np.quantile(z, GROUND_QUANTILE), ~cells.observed)
