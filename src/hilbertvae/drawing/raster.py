"""A horizontal sheet of cells over a site, which turns clouds and fitted mappers into images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hilbertvae.cloud import OCCUPIED_SHARE, Cloud
from hilbertvae.grids.aligned_grid import FREE, OCCUPIED, UNKNOWN, vote
from hilbertvae.mappers.mapper import Mapper
from hilbertvae.voxel_votes import voxel_index


@dataclass(frozen=True)
class Raster:
    """Square cells of the map's lattice. An image on it is (rows, columns): x runs right along a row, y up from row to row.

    first: (2,) the lattice index of the lower left cell; columns, rows: how many cells; cell_m: their side in metres.
    height_m: of the sheet through a 3D map, which shows the voxels that hold this height; None in 2D.
    """

    first: tuple[int, int]
    columns: int
    rows: int
    cell_m: float
    height_m: float | None = None

    @classmethod
    def around(cls, points: np.ndarray, cell_m: float, margin_m: float = 0.5, height_m: float | None = None) -> Raster:
        """The raster that holds `points (N, D)` in metres and a margin around them. 3D points need a height."""
        if points.shape[1] == 3 and height_m is None:
            raise ValueError("height_m: a picture of 3D points needs the height of its slice")
        low = voxel_index(points[:, :2].min(axis=0) - margin_m, cell_m)
        high = voxel_index(points[:, :2].max(axis=0) + margin_m, cell_m)
        columns, rows = (high - low + 1).tolist()
        return cls((int(low[0]), int(low[1])), columns, rows, cell_m, height_m if points.shape[1] == 3 else None)

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """(left, right, bottom, top) in metres, as `Axes.imshow(origin="lower")` takes it."""
        left, bottom = self.first[0] * self.cell_m, self.first[1] * self.cell_m
        return left, left + self.columns * self.cell_m, bottom, bottom + self.rows * self.cell_m

    def queries(self) -> np.ndarray:
        """(rows * columns, D) metres: the cells' centres, row by row from the bottom, at the sheet's height in 3D."""
        row, column = np.divmod(np.arange(self.rows * self.columns), self.columns)
        centres = (np.stack([column, row], axis=1) + self.first + 0.5) * self.cell_m
        if self.height_m is None:
            return centres
        return np.column_stack([centres, np.full(len(centres), (voxel_index(self.height_m, self.cell_m) + 0.5) * self.cell_m)])

    def image(self, values: np.ndarray) -> np.ndarray:
        """(rows, columns) of one value per cell, in the order of `queries`."""
        return values.reshape(self.rows, self.columns)

    def codes(self, cloud: Cloud) -> np.ndarray:
        """(rows, columns) int8: -1 free, 0 unknown, 1 occupied, by the votes of the cloud's points in each cell of the sheet."""
        index = voxel_index(cloud.points, self.cell_m)
        column, row = index[:, 0] - self.first[0], index[:, 1] - self.first[1]
        inside = (column >= 0) & (column < self.columns) & (row >= 0) & (row < self.rows)
        if self.height_m is not None:
            inside &= index[:, 2] == voxel_index(self.height_m, self.cell_m)
        cell = (row * self.columns + column)[inside]
        weight, occupied = cloud.weight[inside], cloud.occupied[inside]
        hits = np.bincount(cell, weights=weight * occupied, minlength=self.rows * self.columns)
        frees = np.bincount(cell, weights=weight * ~occupied, minlength=self.rows * self.columns)
        return self.image(vote(hits, frees, OCCUPIED_SHARE))

    def probability(self, mapper: Mapper) -> np.ndarray:
        """(rows, columns) p(occupied) of a fitted mapper at the cells' centres, as a map shows it."""
        return self.image(mapper.predict_map(self.queries()))

    def coarse(self, codes: np.ndarray, most_cells: int) -> tuple[np.ndarray, tuple[float, float, float, float]]:
        """Codes on this raster with at most `most_cells` along a side, and their extent.

        A block is occupied if any cell of it is, else free if any is: with fewer pixels than cells a picture would lose walls, which
        are one or two cells thick.
        """
        factor = -(-max(codes.shape) // most_cells)
        padded = np.pad(codes, [(0, -length % factor) for length in codes.shape], constant_values=UNKNOWN)
        rows, columns = padded.shape[0] // factor, padded.shape[1] // factor
        blocks = padded.reshape(rows, factor, columns, factor)
        free, occupied = (blocks == FREE).any(axis=(1, 3)), (blocks == OCCUPIED).any(axis=(1, 3))
        left, _, bottom, _ = self.extent
        extent = (left, left + columns * factor * self.cell_m, bottom, bottom + rows * factor * self.cell_m)
        return np.where(occupied, OCCUPIED, np.where(free, FREE, UNKNOWN)).astype(np.int8), extent
