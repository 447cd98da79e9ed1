"""A map's occupied cells as coloured points in a PLY file, for viewers such as CloudCompare and MeshLab."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from hilbertvae.drawing.colours import PROBABILITY
from hilbertvae.drawing.lit_colours import LIT
from hilbertvae.drawing.ply import write_ply_table
from hilbertvae.exports.map_cells import MapCells


def write_points_ply(cells: MapCells, path: str | os.PathLike) -> Path:
    """Write the centres of occupied cells as points: binary, coordinates as doubles in metres, z = 0 in 2D.

    Properties besides: red, green, blue by p(occupied), `probability`, `std`, and `observed`, 1 or 0 where the cell is predicted.
    """
    chosen = cells.select(cells.occupied)
    colours = (PROBABILITY if cells.dimension == 2 else LIT)(chosen.probability.astype(np.float64), bytes=True)[:, :3]
    places = np.zeros((len(chosen), 3))
    places[:, : chosen.dimension] = chosen.centres
    columns = dict(zip(("x", "y", "z"), places.T, strict=True)) | dict(zip(("red", "green", "blue"), colours.T, strict=True))
    columns |= {"probability": chosen.probability, "std": chosen.std, "observed": chosen.observed}
    return write_ply_table(path, columns, comment=f"metres, map frame; cells of {cells.resolution_m!r} m; observed 0: predicted")
