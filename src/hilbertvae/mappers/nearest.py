"""Nearest neighbours: a query is as occupied as the fit points around it. The baseline that every table has (METHOD 6)."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from hilbertvae.checks import check_count
from hilbertvae.cores import workers
from hilbertvae.mappers.mapper import Mapper


class NearestMapper(Mapper):
    """p(occupied) is the share of occupied points among the `neighbours` nearest fit points, each with one vote whatever its weight."""

    def __init__(self, neighbours=1):
        self.neighbours = neighbours

    def check_settings(self) -> None:
        super().check_settings()
        check_count(self.neighbours, "neighbours")

    def _fit(self, points, occupied, weight):
        # Sorted, so that which of equally near points gets a vote does not hang on the order in which they were given.
        order = np.lexsort([occupied, *points.T])
        self.tree_ = cKDTree(points[order])
        self.occupied_ = occupied[order]

    def _probability(self, queries):
        if not len(queries):
            return np.empty(0)
        nearest = np.arange(1, min(self.neighbours, len(self.occupied_)) + 1)
        return self.occupied_[self.tree_.query(queries, k=nearest, workers=workers(len(queries)))[1]].mean(axis=1)
