import numpy as np
import pytest

from hilbertvae.checks import InputError
from hilbertvae.clusters.random_start import random_start


def test_different_points_each_as_likely_as_any_other():
    points = np.column_stack([np.arange(10.0), np.zeros(10)])
    drawn = np.array([random_start(points, 4, seed)[:, 0] for seed in range(2000)])
    assert all(len(set(row)) == 4 for row in drawn.tolist())
    share = np.bincount(drawn.astype(int).ravel()) / 2000
    assert (np.abs(share - 0.4) <= 4 * np.sqrt(0.4 * 0.6 / 2000)).all()
    np.testing.assert_array_equal(drawn[7], random_start(points, 4, 7)[:, 0])
    assert sorted(random_start(points, 10)[:, 0]) == list(range(10))


@pytest.mark.parametrize("count", [0, 5, 2.0, None])
def test_a_count_that_cannot_be_is_named(count):
    with pytest.raises(InputError, match="count: expected a whole number from 1 to 4"):
        random_start(np.ones((4, 2)), count)
