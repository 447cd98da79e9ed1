"""Maps to be saved."""

import numpy as np

from hilbertvae.mappers.weights import RankWeights
from toy_rooms import tiny_reconstructor

FEATURES = 16


def network(dimension=2):
    made = tiny_reconstructor(dimension)
    rng = np.random.default_rng(0)
    drawn = rng.uniform(0.1, 1, 6), rng.uniform(-0.3, 0.3, FEATURES + 2), rng.uniform(0.1, 1, 6)
    made.map_weights = {"voxels": RankWeights(*drawn, spread=-0.7).plain()}
    return made
