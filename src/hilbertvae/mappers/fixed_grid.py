"""HM, the Hilbert Map of Ramos & Ott (2015): radial basis features on a fixed grid of centres, and a logistic regression (Eq. 14 to 16)."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from hilbertvae.checks import InputError, check_positive
from hilbertvae.mappers.logistic import check_logistic_settings, fit_logistic, logistic
from hilbertvae.mappers.mapper import Mapper


class GridFeatures:
    """Phi_m(x) = exp(-gamma |x - c_m|^2) at lattice nodes c_m, sparse: what is at most `smallest` is left out.

    The nodes are multiples of `spacing_m`, those only that are the nearest node of a point or lie `rings` lattice steps from one.
    """

    smallest = 1e-3
    """The least feature kept; with gamma 4 per m^2 the reach is 1.31 m."""
    block = 16_384
    """Points spread over their candidate nodes at once; bounds memory, changes nothing."""

    def __init__(self, points: np.ndarray, spacing_m: float, gamma_per_m2: float, rings: int):
        self.spacing_m = spacing_m
        self.gamma_per_m2 = gamma_per_m2
        self.reach_m = np.sqrt(-np.log(self.smallest) / gamma_per_m2)
        nodes = np.unique(self._cell(points), axis=0)
        steps = np.vstack([np.eye(points.shape[1], dtype=np.int64), -np.eye(points.shape[1], dtype=np.int64)])
        for _ in range(rings):
            nodes = np.unique(np.vstack([nodes, *(nodes + step for step in steps)]), axis=0)
        self.centres = nodes * spacing_m
        self._tree = cKDTree(self.centres)

    def _cell(self, points: np.ndarray) -> np.ndarray:
        return np.rint(points / self.spacing_m).astype(np.int64)

    def __call__(self, points: np.ndarray) -> csr_array:
        """(N, M) features of `points (N, D)`; each row stands by itself, its columns ascending."""
        # All points of one cell share their candidates: what lies within reach of any place in the cell.
        cells, cell = np.unique(self._cell(points), axis=0, return_inverse=True)
        half_diagonal_m = 0.5 * self.spacing_m * np.sqrt(points.shape[1])
        found = self._tree.query_ball_point(cells * self.spacing_m, self.reach_m + half_diagonal_m * (1 + 1e-9), return_sorted=True)
        counts = np.fromiter(map(len, found), np.int64, len(found))
        offsets = np.concatenate([[0], np.cumsum(counts)])
        candidates = np.concatenate([np.asarray(each, dtype=np.int32) for each in found]) if len(found) else np.empty(0, np.int32)
        columns, values, lengths = [], [], []
        for start in range(0, len(points), self.block):
            part, of = points[start : start + self.block], cell[start : start + self.block]
            row = np.repeat(np.arange(len(part)), counts[of])
            within = np.arange(len(row)) - np.repeat(np.cumsum(counts[of]) - counts[of], counts[of])
            column = candidates[np.repeat(offsets[of], counts[of]) + within]
            squared = np.zeros(len(row))
            for axis in range(points.shape[1]):
                squared += (part[row, axis] - self.centres[column, axis]) ** 2
            near = squared < self.reach_m**2
            columns.append(column[near])
            values.append(np.exp(-self.gamma_per_m2 * squared[near]))
            lengths.append(np.bincount(row[near], minlength=len(part)))
        if not columns:
            return csr_array((0, len(self.centres)))
        bounds = np.concatenate([[0], np.cumsum(np.concatenate(lengths))])
        return csr_array((np.concatenate(values), np.concatenate(columns), bounds), shape=(len(points), len(self.centres)))


class FixedGridMapper(Mapper):
    pass
