"""A mapper that remembers what it was shown and asked."""

import numpy as np
from scipy.spatial import cKDTree

from hilbertvae.mappers.mapper import Mapper
from hilbertvae.voxel_votes import voxel_index


class Spy(Mapper):
    """Keeps what it, and copies of it, are fitted on and asked; answers like the nearest point of its own cloud, or 0.5 far from it."""

    needs_both_classes = False
    chunk = 1_000_000  # one portion: those of several come from threads, and so in any order

    def __init__(self, seed=0):
        self.seed = seed
        self.fits_, self.asked_ = [], []

    def _fit(self, points, occupied, weight):
        self.fits_.append((points, occupied, weight, self.seed))
        self.tree_, self.occupied_ = cKDTree(points), occupied

    def _probability(self, queries):
        distance, index = self.tree_.query(queries)
        self.asked_.append(queries)
        return np.where(distance < 0.15, self.occupied_[index], 0.5)


def voxels(points, resolution_m):
    return {tuple(index) for index in voxel_index(points, resolution_m).tolist()}
