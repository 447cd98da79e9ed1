"""Scans, one after the other, and a map that grows by them, for the tests of growing maps."""

import numpy as np

from hilbertvae.cloud import fit_cloud
from hilbertvae.mappers.weights import RankWeights
from toy_rooms import tiny_reconstructor


def clouds(place, every=1):
    """The `fit` cloud of each scan."""
    scans = place.scans
    return [fit_cloud(scans.select(scans.scan == k), place.resolution_m) for k in np.unique(scans.scan)[::every]]


def add(mapper, cloud, **how):
    return mapper.partial_fit(cloud.points, cloud.occupied, cloud.weight, **how)


def streamed(mapper, parts, **how):
    for part in parts:
        add(mapper, part, **how)
    return mapper.settle()


def network(dimension, **settings):
    made = tiny_reconstructor(dimension, **settings)
    rng = np.random.default_rng(0)
    drawn = rng.uniform(0.1, 1, 6), rng.uniform(-0.3, 0.3, 18), rng.uniform(0.1, 1, 6)
    made.map_weights = {"voxels": RankWeights(*drawn, spread=-0.7).plain()}
    return made


def queries_of(place, count=400):
    low, high = place.fit.points.min(axis=0) - 1, place.fit.points.max(axis=0) + 1
    return np.random.default_rng(0).uniform(low, high, (count, place.dimension))


def answers(mapper, queries):
    return [getattr(mapper, ask)(queries) for ask in ("predict_proba", "predict_map", "predict_std", "known", "observed")]
