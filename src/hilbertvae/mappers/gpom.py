"""GPOM (O'Callaghan & Ramos 2012): Gaussian process regression on the labels -1 and +1 of the nearest points, squashed to a probability."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import ndtr

from hilbertvae.checks import InputError, check_count, check_not_negative, check_positive
from hilbertvae.cores import workers
from hilbertvae.mappers.mapper import Mapper
from hilbertvae.sums import sums_by
from hilbertvae.voxel_votes import voxel_floor

BLOCK = 64
"""Queries solved together: few enough that their matrices stay in the processor's cache. Changes no number."""
FAR_M = 1e8
"""Points farther from the query than this count as so far, where every kernel is zero, so that no square overflows."""
LEAST_NOISE = 1e-9
"""So much variance is left to every label, or two points at one place would make a matrix singular."""
BORDER = 1e30
"""On the diagonal of the rows that are only solved for: large enough to be positive definite with any right-hand side."""


def matern(away: np.ndarray, length_m: float) -> np.ndarray:
    """The Matern kernel of smoothness 3/2 (Rasmussen & Williams 2006, Eq. 4.17): (1 + r) exp(-r), r = sqrt(3) distance / length.

    away: (Q, N, D) metres. Returns (Q, N, N), each stack of points against itself.
    """
    scaled = away * (np.sqrt(3.0) / length_m)
    squared = np.zeros((*away.shape[:2], away.shape[1]))
    # One axis at a time: numpy is slow where the last axis is short.
    for axis in range(away.shape[2]):
        step = scaled[:, :, None, axis] - scaled[:, None, :, axis]
        step *= step
        squared += step
    r = np.sqrt(squared, out=squared)
    value = np.exp(-r)
    r += 1.0
    value *= r
    return value


def neural_network(away: np.ndarray, length_m: float) -> np.ndarray:
    """The covariance of a network with infinitely many hidden units (Williams 1998; Rasmussen & Williams 2006, Eq. 4.29).

    (2 / pi) arcsin(2 u.v / sqrt((1 + 2 u.u) (1 + 2 v.v))) with u = (1, x / length). It depends on where the origin is, and is sharpest
    there; `away` is counted from the query, so that every query sees the same kernel. Shapes as for `matern`.
    """
    scaled = away * (np.sqrt(2.0) / length_m)
    product = np.full((*away.shape[:2], away.shape[1]), 2.0)
    for axis in range(away.shape[2]):
        product += scaled[:, :, None, axis] * scaled[:, None, :, axis]
    size = 1.0 / np.sqrt(1.0 + np.einsum("qii->qi", product))
    product *= size[:, :, None]
    product *= size[:, None, :]
    np.minimum(product, 1.0, out=product)
    np.arcsin(product, out=product)
    product *= 2.0 / np.pi
    return product


KERNELS = {"matern": matern, "neural-network": neural_network}


class GpomMapper(Mapper):
    """GPOM, local: at each query a Gaussian process of zero mean on its nearest thinned points alone.

    From mean m and variance v of the process at the query, p(occupied) = Phi(slope m / sqrt(1 + slope^2 v)), the cumulative Gaussian
    (Rasmussen & Williams 2006, Eq. 6.42; its offset is 0, so that far from every point p is 0.5, unknown).

    kernel: "matern" (smoothness 3/2), or "neural-network", whose `length_m` wants to be about 0.5.
    neighbours: how many points the process knows. length_m: the kernel's length scale.
    free_spacing_m: free points are thinned to one in each cell so large, at their mean, with the sum of their weights; None keeps all.
        In a thinned cloud nine of ten points are free, and so would be a query's nearest: none would tell of the wall beyond them.
    noise, weight_power: the variance of a label that stands for n samples is noise / n^weight_power. 1 would take beams for independent
        looks; 0 forgets that a voxel was passed a hundred times and hit once.
    slope: of the cumulative Gaussian; greater is surer.
    """

    def __init__(self, kernel="matern", neighbours=60, length_m=1.5, free_spacing_m=0.4, noise=0.05, weight_power=0.3, slope=2.0):
        self.kernel = kernel
        self.neighbours = neighbours
        self.length_m = length_m
        self.free_spacing_m = free_spacing_m
        self.noise = noise
        self.weight_power = weight_power
        self.slope = slope

    def _fit(self, points, occupied, weight):
        if self.free_spacing_m is not None:
            free_points, free_weight = _thinned(points[~occupied], weight[~occupied], self.free_spacing_m)
            points, weight = np.concatenate([points[occupied], free_points]), np.concatenate([weight[occupied], free_weight])
            occupied = np.arange(len(points)) < np.count_nonzero(occupied)
        # Sorted, so that which of equally near points is known does not hang on the order in which they were given.
        order = np.lexsort([weight, occupied, *points.T])
        self.tree_ = cKDTree(points[order])
        self.label_ = np.where(occupied[order], 1.0, -1.0)
        self.noise_ = np.maximum(self.noise * weight[order] ** -self.weight_power, LEAST_NOISE)

    def _probability(self, queries):
        mean, variance = self._process(queries)
        return ndtr(self.slope * mean / np.sqrt(1.0 + self.slope**2 * variance))

    def _process(self, queries: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and variance, (Q,) each, of the process at `queries (Q, D)`, without the noise of a label."""
        mean, variance = np.empty((2, len(queries)))
        if not len(queries):
            return mean, variance
        near = self.tree_.query(queries, k=np.arange(1, min(self.neighbours, len(self.label_)) + 1), workers=workers(len(queries)))[1]
        for start in range(0, len(queries), BLOCK):
            part = slice(start, start + BLOCK)
            away = np.clip(self.tree_.data[near[part]] - queries[part, None], -FAR_M, FAR_M)
            mean[part], variance[part] = self._solve(away, self.label_[near[part]], self.noise_[near[part]])
        return mean, variance

    def _solve(self, away: np.ndarray, label: np.ndarray, noise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and variance at the origins of `away (Q, N, D)`, points with `label (Q, N)` and `noise (Q, N)`.

        With K = L L^T, the mean is (L^-1 k) . (L^-1 y) and the variance k(x, x) - |L^-1 k|^2. A Cholesky decomposition has solved for k
        and y, too, if they stand below K as two more rows: one call of numpy for a stack of queries, at half the cost of `solve`.
        """
        count = label.shape[1]
        kernel = KERNELS[self.kernel](np.pad(away, ((0, 0), (0, 1), (0, 0))), self.length_m)
        bordered = np.empty((len(away), count + 2, count + 2))
        bordered[:, :-1, :-1] = kernel
        bordered[:, -1, :count] = label
        bordered[:, -1, count] = 0.0
        diagonal = np.einsum("qii->qi", bordered)
        diagonal[:, :count] += noise
        diagonal[:, count:] = BORDER
        # The upper triangle is not read.
        factor = np.linalg.cholesky(bordered)
        of_query, of_label = factor[:, -2, :count], factor[:, -1, :count]
        variance = kernel[:, -1, -1] - (of_query * of_query).sum(axis=1)
        return (of_query * of_label).sum(axis=1), np.maximum(variance, 0.0)

    def check_settings(self) -> None:
        super().check_settings()
        if self.kernel not in KERNELS:
            raise InputError(f"kernel: expected one of {', '.join(KERNELS)}, got {self.kernel!r}")
        check_count(self.neighbours, "neighbours")
        for name in ("length_m", "noise", "slope"):
            check_positive(getattr(self, name), name)
        if self.free_spacing_m is not None:
            check_positive(self.free_spacing_m, "free_spacing_m")
        check_not_negative(self.weight_power, "weight_power")


def _thinned(points: np.ndarray, weight: np.ndarray, spacing_m: float) -> tuple[np.ndarray, np.ndarray]:
    """At most one point per cell of the lattice of `spacing_m`: the weighted mean (C, D), and the sum of weights (C,)."""
    cell, position = np.unique(voxel_floor(points / spacing_m), axis=0, return_inverse=True)
    total = np.bincount(position, weight)
    # Taken from the cell's corner, so that large coordinates cost no digits.
    away = points - cell[position] * spacing_m
    return cell * spacing_m + sums_by(position, away, len(cell), weight) / total[:, None], total
