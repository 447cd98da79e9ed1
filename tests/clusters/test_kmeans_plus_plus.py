import numpy as np
import pytest
from clouds import UTM, are_among, clouds
from hypothesis import given, settings
from hypothesis import strategies as st

from hilbertvae.checks import InputError
from hilbertvae.clusters.kmeans_plus_plus import kmeans_plus_plus


@settings(max_examples=40)
@given(points=clouds, share=st.floats(0, 1), seed=st.integers(0, 2**40))
def test_as_many_points_of_the_cloud_as_asked_for(points, share, seed):
    count = max(1, round(share * len(points)))
    seeds = kmeans_plus_plus(points, count, seed=seed)
    assert seeds.shape == (count, points.shape[1]) and are_among(seeds, points)
    if len(np.unique(points, axis=0)) == len(points):
        assert len(np.unique(seeds, axis=0)) == count
    np.testing.assert_array_equal(seeds, kmeans_plus_plus(points, count, seed=seed))


def test_far_from_the_origin_the_same_points_are_picked():
    points = np.random.default_rng(0).uniform(0, 1, (256, 2))  # no round numbers, whose products have all their digits there, too
    for seed in range(3):
        near, far = kmeans_plus_plus(points, 60, seed=seed), kmeans_plus_plus(points + UTM, 60, seed=seed)
        np.testing.assert_allclose(near, far - UTM, rtol=0, atol=1e-8)


def test_a_point_without_weight_is_no_seed_and_a_heavy_one_most_often():
    points, weight = np.arange(10.0).reshape(5, 2), np.array([1.0, 0.0, 50.0, 1.0, 1.0])
    drawn = np.array([kmeans_plus_plus(points, 1, weight, seed)[0, 0] for seed in range(300)])
    assert 2.0 not in drawn and (drawn == 4.0).mean() > 0.8


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ((np.ones((4, 5)), 1), "points: expected shape"),
        ((np.ones((4, 2)), 5), "count: expected a whole number from 1 to 4, got 5"),
        ((np.ones((4, 2)), True), "count: expected a whole number"),
        ((np.ones((4, 2)), 2, np.ones(3)), "weight: expected 4 numbers"),
        ((np.ones((4, 2)), 2, [1, 1, -1, 1]), "weight: expected 4 numbers of at least 0"),
        ((np.ones((4, 2)), 2, np.zeros(4)), "weight: .*not all of them 0"),
    ],
)
def test_bad_input_is_named(given, message):
    with pytest.raises(InputError, match=message):
        kmeans_plus_plus(*given)
