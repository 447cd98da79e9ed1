"""Where a robot can be: polygons drawn on a raster, and the clearance of each of its cells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from hilbertvae.simulate.floor_plan import FloorPlan
from hilbertvae.simulate.shapes import edges

CELL_M = 0.1


@dataclass(frozen=True)
class FreeSpace:
    """Clearance on a raster.

    clearance_m: (ny, nx) float64, at least how far a cell's centre is from anything solid; 0 where there is no floor.
    lower: (2,) metres, the corner of the raster; cell_m: its cells' side.
    """

    clearance_m: np.ndarray
    lower: np.ndarray
    cell_m: float

    def at(self, points: np.ndarray) -> np.ndarray:
        """(N,) at least how far `points` (N, 2) are from anything solid, metres; 0 off the raster."""
        places = (points - self.lower) / self.cell_m
        cells = np.floor(places).astype(int)
        inside = ((cells >= 0) & (cells < self.clearance_m.shape[::-1])).all(axis=1)
        cells = np.where(inside[:, None], cells, 0)
        offset_m = self.cell_m * np.linalg.norm(places - cells - 0.5, axis=1)
        return np.where(inside, np.maximum(self.clearance_m[cells[:, 1], cells[:, 0]] - offset_m, 0.0), 0.0)


def find_free_space(plan: FloorPlan) -> FreeSpace:
    """The free space of a plan: on a floor or in a doorway, outside all solids and panes."""
    # Doorways belong to no floor, so what is free is what is connected with a floor; outdoors may be, by a lost wall.
    solid_edges = np.concatenate([edges(plan.solids), edges(plan.glass)])
    floors = np.array([floor.polygon for floor in plan.floors], dtype=object)
    floor_edges = edges(floors)
    lower = floor_edges.reshape(-1, 2).min(axis=0) - 1.0
    cells = np.ceil((floor_edges.reshape(-1, 2).max(axis=0) + 1.0 - lower) / CELL_M).astype(int)
    solid = inside(solid_edges, lower, cells, CELL_M) | on_outline(solid_edges, lower, cells, CELL_M)
    labels, _ = ndimage.label(~solid)
    floor = inside(floor_edges, lower, cells, CELL_M) & ~solid
    indoors = np.unique(labels[floor])
    outdoors = np.unique(np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]]))
    free = np.isin(labels, np.setdiff1d(indoors, np.append(outdoors, 0)))
    # To the centre of the nearest solid cell; what is solid in it may lie half a diagonal nearer.
    distance = ndimage.distance_transform_edt(free) * CELL_M - CELL_M * np.sqrt(0.5)
    return FreeSpace(np.maximum(distance, 0.0), lower, CELL_M)


def inside(edges: np.ndarray, lower: np.ndarray, cells: np.ndarray, cell_m: float) -> np.ndarray:
    """(ny, nx) bool: cells whose centres lie in a polygon. `edges` is (E, 2, 2) of `shapes.edges`; overlaps are fine."""
    nx, ny = int(cells[0]), int(cells[1])
    places = (edges - lower) / cell_m - 0.5  # in cells, cell centres at whole numbers
    (x0, y0), (x1, y1) = places[:, 0].T, places[:, 1].T
    first, last = (
        np.ceil(np.minimum(y0, y1)).clip(0, ny).astype(int),
        np.ceil(np.maximum(y0, y1)).clip(0, ny).astype(int),
    )
    edge = np.repeat(np.arange(len(edges)), last - first)
    row = np.arange(len(edge)) - np.repeat(np.cumsum(last - first) - (last - first), last - first) + first[edge]
    crossing = x0[edge] + (row - y0[edge]) / (y1 - y0)[edge] * (x1 - x0)[edge]
    column = np.ceil(crossing).clip(0, nx).astype(int)
    # Winding numbers: outer rings run clockwise, so each overlapping polygon adds one of the same sign.
    turns = np.bincount(row * (nx + 1) + column, weights=np.sign(y1 - y0)[edge], minlength=ny * (nx + 1))
    return np.abs(np.cumsum(turns.reshape(ny, nx + 1), axis=1)[:, :nx]) > 0.5


def on_outline(edges: np.ndarray, lower: np.ndarray, cells: np.ndarray, cell_m: float) -> np.ndarray:
    """(ny, nx) bool: cells that an edge runs through, up to corners it only grazes: for what is thinner than a cell."""
    lengths = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1)
    count = np.ceil(lengths / (cell_m / 2)).astype(int) + 1
    edge = np.repeat(np.arange(len(edges)), count)
    step = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    share = step / np.maximum(count[edge] - 1, 1)
    points = edges[edge, 0] + share[:, None] * (edges[edge, 1] - edges[edge, 0])
    cell = np.floor((points - lower) / cell_m).astype(int)
    cell = cell[((cell >= 0) & (cell < cells)).all(axis=1)]
    drawn = np.zeros((int(cells[1]), int(cells[0])), dtype=bool)
    drawn[cell[:, 1], cell[:, 0]] = True
    return drawn
