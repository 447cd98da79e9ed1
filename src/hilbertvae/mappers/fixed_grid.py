"""HM, the Hilbert Map of Ramos & Ott (2015): radial basis features on a fixed grid of centres, and a logistic regression."""

from __future__ import annotations

from itertools import chain

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from hilbertvae.checks import check_positive
from hilbertvae.mappers.logistic import LogisticMapper

SMALLEST = 1e-3
"""The least feature kept; with gamma 4 per m^2 that is a reach of 1.31 m."""
BLOCK = 200_000
"""Pairs of a point and a candidate centre looked at together: few enough to stay in the processor's cache. Changes no number."""


class GridFeatures:
    """Phi_m(x) = exp(-gamma |x - c_m|^2) at grid centres c_m, sparse: what is not above `SMALLEST` is left out.

    The centres are multiples of `spacing_m` on each axis, where data is: the nearest to each point, and its neighbours along the axes.
    """

    def __init__(self, points: np.ndarray, spacing_m: float, gamma_per_m2: float):
        self.spacing_m = spacing_m
        self.gamma_per_m2 = gamma_per_m2
        self.reach_m = np.sqrt(-np.log(SMALLEST) / gamma_per_m2)
        nodes = np.unique(self._cell(points), axis=0)
        steps = np.eye(points.shape[1])
        nodes = np.unique(np.concatenate([nodes, *(nodes + step for step in (*steps, *-steps))]), axis=0)
        self.centres = nodes * spacing_m
        self._tree = cKDTree(self.centres)

    def __call__(self, points: np.ndarray) -> csr_array:
        """(N, M) features of `points (N, D)`; in each row the columns ascend."""
        cells, cell = np.unique(self._cell(points), axis=0, return_inverse=True)
        candidates = self._candidates(cells)
        # One contiguous array per axis, with a last entry out of reach for the padding of `candidates`.
        centres = [np.append(axis, np.inf) for axis in self.centres.T]
        columns, values, lengths = [np.empty(0, np.int32)], [np.empty(0)], [np.zeros(1, np.int64)]
        block = max(1, BLOCK // max(1, candidates.shape[1]))
        for start in range(0, len(points), block):
            part = points[start : start + block]
            column = candidates[cell[start : start + block]]
            squared = np.zeros(column.shape)
            for axis, centre in enumerate(centres):
                away = centre[column]
                away -= part[:, axis, None]
                away *= away
                squared += away
            near = squared < self.reach_m**2
            columns.append(column[near])
            values.append(np.exp(-self.gamma_per_m2 * squared[near]))
            lengths.append(near.sum(axis=1))
        bounds = np.cumsum(np.concatenate(lengths))
        return csr_array((np.concatenate(values), np.concatenate(columns), bounds), shape=(len(points), len(self.centres)))

    def _cell(self, points: np.ndarray) -> np.ndarray:
        """(N, D) the nearest grid node, whole numbers as float64, so that no coordinate is too large."""
        return np.rint(points / self.spacing_m) + 0.0

    def _candidates(self, cells: np.ndarray) -> np.ndarray:
        """(C, K) int32: for each of `cells (C, D)` the centres within reach of some place in it, ascending, padded with M."""
        half_diagonal_m = 0.5 * self.spacing_m * np.sqrt(cells.shape[1])
        radius_m = (self.reach_m + half_diagonal_m) * (1 + 1e-9)
        found = self._tree.query_ball_point(cells * self.spacing_m, radius_m, workers=-1, return_sorted=True)
        sizes = np.fromiter(map(len, found), np.int64, len(found))
        padded = np.full((len(cells), sizes.max(initial=0)), len(self.centres), np.int32)
        flat = np.fromiter(chain.from_iterable(found), np.int32, sizes.sum())
        padded[np.arange(padded.shape[1]) < sizes[:, None]] = flat
        return padded


class FixedGridMapper(LogisticMapper):
    """HM. Far from any centre the answer is the intercept's, about `occupied_share`.

    spacing_m, gamma_per_m2: of the grid and of the features (METHOD 6).
    weight_power: a fit point that stands for n samples weighs n^weight_power; 0 is none, 1 the plain count.
    occupied_share: the share of the total weight that occupied points are given. A thinned cloud is mostly free, and without this the
        map calls few walls occupied at the 0.6 cut; None leaves it so.
    penalty, l1_share: the elastic net. epochs, batch_size, rate, seed: of the gradient descent (see `fit_logistic`).
    """

    def __init__(
        self,
        spacing_m=0.5,
        gamma_per_m2=4.0,
        weight_power=0.5,
        occupied_share=0.4,
        penalty=1e-6,
        l1_share=0.15,
        epochs=10,
        batch_size=1024,
        rate=5.0,
        seed=0,
    ):
        self.spacing_m = spacing_m
        self.gamma_per_m2 = gamma_per_m2
        self.weight_power = weight_power
        self.occupied_share = occupied_share
        self.penalty = penalty
        self.l1_share = l1_share
        self.epochs = epochs
        self.batch_size = batch_size
        self.rate = rate
        self.seed = seed

    def _feature_map(self, points, occupied, weight):
        spacing_m, gamma_per_m2 = check_positive(self.spacing_m, "spacing_m"), check_positive(self.gamma_per_m2, "gamma_per_m2")
        return GridFeatures(points, spacing_m, gamma_per_m2)
