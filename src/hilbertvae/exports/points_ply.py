"""A map's cells as coloured points in a PLY file, for viewers such as CloudCompare and MeshLab."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from hilbertvae.drawing.ply import write_ply_table
from hilbertvae.exports.cell_colours import cell_colours
from hilbertvae.exports.map_cells import MapCells
from hilbertvae.mappers.mapper import OCCUPIED_ABOVE


def write_points_ply(cells: MapCells, path: str | os.PathLike, colour: str = "probability", above: float = OCCUPIED_ABOVE) -> Path:
    """Write the centres of cells with p > `above` as points: binary, coordinates as doubles in metres, z = 0 in 2D.

    Properties besides: red, green, blue (see `cell_colours`), `probability`, `std`, and `observed`, 1 or 0 where the cell is predicted.
    above: occupied cells unless given; -1 for all of them.
    """
    chosen = cells.select(cells.probability > np.float32(above))
    colours = cell_colours(chosen, colour)
    places = np.zeros((len(chosen), 3))
    places[:, : chosen.dimension] = chosen.centres
    columns = dict(zip(("x", "y", "z"), places.T, strict=True)) | dict(zip(("red", "green", "blue"), colours.T, strict=True))
    columns |= {"probability": chosen.probability, "std": chosen.std, "observed": chosen.observed}
    return write_ply_table(path, columns, comment=f"metres, map frame; cells of {cells.resolution_m!r} m; observed 0: predicted")
