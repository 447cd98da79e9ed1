import tracemalloc

import numpy as np
import pytest
from scipy.sparse import csr_array

from hilbertvae.mappers.dense_features import RowsOnDemand
from hilbertvae.mappers.fourier_features import FourierFeatures, FourierMapper
from hilbertvae.mappers.logistic import fit_logistic
from hilbertvae.mappers.nystroem_features import NystroemFeatures, NystroemMapper


def cloud(count, seed=0):
    points = np.random.default_rng(seed).uniform(0, 6, (count, 2))
    return points, points[:, 0] < 1


@pytest.mark.parametrize("kind", [FourierFeatures, NystroemFeatures])
def test_rows_on_demand_fit_as_the_whole_matrix(kind):
    points, occupied = cloud(300)
    features = FourierFeatures(points.mean(axis=0), 40, 4.0, 0) if kind is FourierFeatures else NystroemFeatures(points, 40, 4.0, 0)
    whole = csr_array((features(points) @ np.eye(40, dtype=features(points).dtype)).astype(float))
    how = {"penalty": 1e-3, "l1_share": 0.15, "epochs": 10, "batch_size": 64, "rate": 5.0, "seed": 0}
    expected, intercept = fit_logistic(whole, occupied, np.ones(300), **how)
    found, found_intercept = fit_logistic(RowsOnDemand(features, points), occupied, np.ones(300), **how)
    np.testing.assert_allclose(found, expected, atol=0.02)
    assert found_intercept == pytest.approx(intercept, abs=1e-3)


@pytest.mark.parametrize("mapper", [FourierMapper(components=500, epochs=1), NystroemMapper(components=500, epochs=1)])
def test_the_feature_matrix_is_never_whole_in_memory(mapper):
    points, occupied = cloud(40_000)
    tracemalloc.start()
    mapper.fit(points, occupied).predict_proba(points)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 40_000 * 500 * 8 / 2
