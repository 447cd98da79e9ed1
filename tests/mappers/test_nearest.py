import numpy as np
import pytest

from hilbertvae.checks import InputError
from hilbertvae.mappers.nearest import NearestMapper


@pytest.mark.parametrize("neighbours", [1, 4, 15, 1000])
@pytest.mark.parametrize("dimension", [2, 3, 5])
def test_share_of_occupied_neighbours_by_brute_force(neighbours, dimension):
    rng = np.random.default_rng(0)
    points, occupied, queries = rng.normal(size=(200, dimension)), rng.random(200) < 0.3, rng.normal(size=(50, dimension))
    mapper = NearestMapper(neighbours).fit(points, occupied)
    expected = [occupied[np.argsort(np.linalg.norm(points - query, axis=1))[:neighbours]].mean() for query in queries]
    np.testing.assert_array_equal(mapper.predict_proba(queries)[:, 1], expected)


def test_ties_do_not_hang_on_the_order_of_the_cloud():
    rng = np.random.default_rng(1)
    points = rng.integers(0, 4, (300, 2)).astype(float)
    occupied, queries = rng.random(300) < 0.5, rng.integers(0, 8, (60, 2)) / 2
    for neighbours in (1, 3, 15):
        expected = NearestMapper(neighbours).fit(points, occupied).predict_proba(queries)
        for _ in range(5):
            order = rng.permutation(300)
            np.testing.assert_array_equal(NearestMapper(neighbours).fit(points[order], occupied[order]).predict_proba(queries), expected)


@pytest.mark.parametrize("neighbours", [0, -1, 1.5, True, "3"])
def test_bad_neighbours_are_refused(neighbours):
    with pytest.raises(InputError, match="neighbours: expected a whole number"):
        NearestMapper(neighbours).fit([[0.0, 0.0], [1.0, 0.0]], [False, True])
