"""Gaussian radial basis features at given centres, sparse: each speaks near its centre alone."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain

import numpy as np
from scipy.sparse import csr_array, get_index_dtype
from scipy.spatial import cKDTree

from hilbertvae.cores import workers

BLOCK = 200_000
"""Pairs of a point and a candidate centre looked at together: few enough to stay in the processor's cache. Changes no number."""
Pairs = tuple[slice | np.ndarray, np.ndarray, np.ndarray]
"""A block: which points, d^2 (B, K) from each to its candidates, m^2, and the columns (B, K) of these, ascending in each row."""


class RadialFeatures:
    """Phi_m(x) = exp(-gamma |x - c_m|^2) at `centres (M, D)`, metres; what is not above `smallest` is left out.

    cell_m: points whose nearest multiple of it, along each axis, is the same share their search for centres. Changes no number.
    """

    def __init__(self, centres: np.ndarray, gamma_per_m2: float, smallest: float, cell_m: float):
        self.centres = centres
        self.gamma_per_m2 = gamma_per_m2
        self.cell_m = cell_m
        self.reach_m = np.sqrt(-np.log(smallest) / gamma_per_m2)
        self._tree = cKDTree(centres)

    def __call__(self, points: np.ndarray) -> csr_array:
        """(N, M) features of `points (N, D)`; in each row the columns ascend."""
        return gaussian_rows(self._pairs(points), (len(points), len(self.centres)), self.gamma_per_m2, self.reach_m)

    def _pairs(self, points: np.ndarray) -> Iterator[Pairs]:
        cells, cell = np.unique(nearest_node(points, self.cell_m), axis=0, return_inverse=True)
        candidates = self._candidates(cells)
        # One contiguous array per axis, with a last entry for the padding of `candidates`.
        centres = [np.append(axis, np.inf) for axis in self.centres.T]
        block = max(1, BLOCK // max(1, candidates.shape[1]))
        for start in range(0, len(points), block):
            rows = slice(start, start + block)
            column = candidates[cell[rows]]
            squared = np.zeros(column.shape)
            for axis, centre in enumerate(centres):
                away = centre[column]
                away -= points[rows, axis, None]
                away *= away
                squared += away
            yield rows, squared, column

    def _candidates(self, cells: np.ndarray) -> np.ndarray:
        """(C, K) int32: for each of `cells (C, D)` the centres within reach of some place in it, ascending, padded with M."""
        half_diagonal_m = 0.5 * self.cell_m * np.sqrt(cells.shape[1])
        radius_m = (self.reach_m + half_diagonal_m) * (1 + 1e-9)
        found = self._tree.query_ball_point(cells * self.cell_m, radius_m, workers=workers(len(cells)), return_sorted=True)
        sizes = np.fromiter(map(len, found), np.int64, len(found))
        padded = np.full((len(cells), sizes.max(initial=0)), len(self.centres), np.int32)
        flat = np.fromiter(chain.from_iterable(found), np.int32, sizes.sum())
        padded[np.arange(padded.shape[1]) < sizes[:, None]] = flat
        return padded


def gaussian_rows(pairs: Iterable[Pairs], shape: tuple[int, int], gamma_per_m2: float, reach_m: float) -> csr_array:
    """(N, M) features of that `shape`: exp(-gamma d^2) where d is less than `reach_m`; M among the columns of `pairs` stands for none."""
    columns, values, lengths = [np.empty(0, np.int32)], [np.empty(0)], np.zeros(shape[0], np.int64)
    for rows, squared, column in pairs:
        near = (squared < reach_m**2) & (column < shape[1])
        columns.append(column[near])
        values.append(np.exp(-gamma_per_m2 * squared[near]))
        lengths[rows] = near.sum(axis=1)
    bounds = np.append(0, np.cumsum(lengths))
    bounds = bounds.astype(get_index_dtype(maxval=bounds[-1]))  # else columns take eight bytes each, too
    return csr_array((np.concatenate(values), np.concatenate(columns), bounds), shape=shape)


def nearest_node(points: np.ndarray, cell_m: float) -> np.ndarray:
    """(N, D) the multiple of `cell_m` nearest to each of `points (N, D)`: whole numbers as float64, so that no coordinate is too large."""
    return np.rint(points / cell_m) + 0.0
