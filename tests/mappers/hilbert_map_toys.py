"""Hilbert Maps with a tiny network whose weights are drawn."""

import numpy as np

from hilbertvae.gaps import random_gaps
from hilbertvae.mappers.weights import RankWeights
from toy_rooms import tiny_reconstructor

FEATURES = 16
"""What evidence says of a query in an observed voxel."""


def learned(neighbours=5, seed=0):
    rng = np.random.default_rng(seed)
    unseen, everywhere = rng.uniform(0.1, 1, (2, neighbours + 1))
    return RankWeights(unseen, rng.uniform(-0.3, 0.3, FEATURES + 2), everywhere, beyond=np.array([-0.4, -0.3]), spread=-0.7).plain()


def reconstructor(dimension=2):
    made = tiny_reconstructor(dimension)
    made.map_weights = {"voxels": learned(), "points": learned(seed=1)}
    return made


def gapped(place, seed=0):
    return random_gaps(place.fit, 1.2, place.resolution_m, seed).cut(place.fit)


def fit(mapper, cloud):
    return mapper.fit(cloud.points, cloud.occupied, cloud.weight)
