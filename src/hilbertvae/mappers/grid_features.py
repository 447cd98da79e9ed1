"""Gaussian radial basis features at the nodes of a regular grid where data is: those of HM."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np
from scipy.sparse import csr_array

from hilbertvae.checks import InputError
from hilbertvae.mappers.radial_features import BLOCK, Pairs, gaussian_rows, nearest_node

SMALLEST = 1e-3
"""The least feature kept; with gamma 4 per m^2 that is a reach of 1.31 m."""
MOST_PLACES = 2**62
"""Places of the grid's bounding box, beyond which they can't be numbered."""


class GridFeatures:
    """Phi_m(x) = exp(-gamma |x - c_m|^2) at `centres (M, D)`, metres; what is not above `SMALLEST` is left out.

    The centres are multiples of `spacing_m` on each axis, where data is: the nearest to each point, and its neighbours along the axes. A
    search structure is not needed: from the node nearest to a point all others within reach lie at the same few steps.
    Raises `InputError` for points too far apart.
    """

    def __init__(self, points: np.ndarray, spacing_m: float, gamma_per_m2: float):
        self.spacing_m, self.gamma_per_m2 = spacing_m, gamma_per_m2
        self.reach_m = math.sqrt(-math.log(SMALLEST) / gamma_per_m2)
        dimension = points.shape[1]
        self.steps = self._steps(dimension)
        node = nearest_node(points, spacing_m)
        widest = int(self.steps.max()) + 1
        self._low = node.min(axis=0) - widest
        shape = [int(side) for side in node.max(axis=0) - self._low + 1 + widest]
        if math.prod(shape) > MOST_PLACES:
            extent = f"extent {np.ptp(points, axis=0).tolist()} m"
            raise InputError(f"points: {extent} is too large for centres every {spacing_m} m; is there an outlier?")
        self._shape = np.array(shape)
        # What one step along each axis adds to a place's number, so that a step in space is a sum, and places ascend as rows of nodes do.
        self._stride = np.append(np.cumprod(self._shape[:0:-1])[::-1], 1)
        place = np.unique((node - self._low).astype(np.int64) @ self._stride)
        beside = [place, *(place + side * step for step in self._stride for side in (-1, 1))]
        self._places = np.unique(np.concatenate(beside))
        nodes = np.stack(np.unravel_index(self._places, shape), axis=1) + self._low
        self.centres = nodes * spacing_m

    def _steps(self, dimension: int) -> np.ndarray:
        """(K, D) from a point's nearest node to all nodes that may lie within reach of the point, in the order of their numbers."""
        farthest = math.floor(self.reach_m / self.spacing_m + 0.5)
        steps = np.array(list(itertools.product(range(-farthest, farthest + 1), repeat=dimension)))
        nearest_m = np.maximum(np.abs(steps) - 0.5, 0.0) * self.spacing_m
        return steps[(nearest_m**2).sum(axis=1) <= self.reach_m**2 * (1 + 1e-9)]

    def __call__(self, points: np.ndarray) -> csr_array:
        """(N, M) features of `points (N, D)`; in each row the columns ascend."""
        return gaussian_rows(self._pairs(points), (len(points), len(self.centres)), self.gamma_per_m2, self.reach_m)

    def _pairs(self, points: np.ndarray) -> Iterator[Pairs]:
        node = nearest_node(points, self.spacing_m)
        near = ((node >= self._low) & (node < self._low + self._shape)).all(axis=1)
        chosen = np.flatnonzero(near)
        node = node[chosen]
        places, cell = np.unique((node - self._low).astype(np.int64) @ self._stride, return_inverse=True)
        candidates = self._candidates(places)
        farthest = int(self.steps.max())
        away_m = np.arange(-farthest, farthest + 1) * self.spacing_m
        apart = points[chosen] - node * self.spacing_m
        block = max(1, BLOCK // len(self.steps))
        for start in range(0, len(chosen), block):
            part = apart[start : start + block]
            # An axis has few steps, so squares are taken of those, and pairs only add them up.
            squared = np.zeros((len(part), len(self.steps)))
            for axis, step in enumerate(self.steps.T):
                squared += np.square(away_m - part[:, axis, None]).take(step + farthest, axis=1)
            yield chosen[start : start + block], squared, candidates[cell[start : start + block]]

    def _candidates(self, places: np.ndarray) -> np.ndarray:
        """(C, K) int32: the column of the centre at each of `steps` from `places (C,)`, M where there is none."""
        found = np.empty((len(places), len(self.steps)), np.int32)
        for number, step in enumerate(self.steps @ self._stride):
            beside = places + step
            column = np.searchsorted(self._places, beside)
            column[column == len(self._places)] = 0
            found[:, number] = np.where(self._places[column] == beside, column, len(self._places))
        return found


def grid_nodes(points: np.ndarray, spacing_m: float) -> np.ndarray:
    """(M, D) whole numbers: the nodes of `GridFeatures` in any number of dimensions, in ascending order."""
    nodes = np.unique(nearest_node(points, spacing_m), axis=0)
    steps = np.eye(points.shape[1])
    return np.unique(np.concatenate([nodes, *(nodes + step for step in (*steps, *-steps))]), axis=0)
