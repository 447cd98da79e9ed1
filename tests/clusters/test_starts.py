import numpy as np
import pytest
from clouds import are_among

from hilbertvae.checks import InputError
from hilbertvae.clusters.ask_means import ask_means
from hilbertvae.clusters.quick_means import quick_means
from hilbertvae.clusters.starts import COUNTED, STARTS, check_start, find_clusters, quick_means_seeds

OUTER_M, INNER_M = 1.0, 0.5


@pytest.mark.parametrize("start", STARTS)
class TestEveryStart:
    def test_seeds_are_points_and_clusters_are_whole_balls(self, start, place):
        returns = place.fit.points[place.fit.occupied]
        every = find_clusters(returns, OUTER_M, INNER_M, 0, 0, start)
        least = int(np.median(every.sizes))
        found = find_clusters(returns, OUTER_M, INNER_M, least, 0, start)
        assert are_among(every.seeds, returns) and 0 < len(found) < len(every)
        kept = [seed for seed in every.seeds if (np.linalg.norm(returns - seed, axis=1) <= OUTER_M).sum() > least]
        np.testing.assert_array_equal(found.seeds, kept)
        for m in range(len(found)):
            ball = np.flatnonzero(np.linalg.norm(returns - found.seeds[m], axis=1) <= OUTER_M)
            np.testing.assert_array_equal(found.members[found.offsets[m] : found.offsets[m + 1]], ball)

    def test_the_seed_alone_decides(self, start, room):
        returns = room.fit.points[room.fit.occupied]
        first, again, other = (find_clusters(returns, OUTER_M, INNER_M, 1, seed, start).seeds for seed in (0, 0, 1))
        np.testing.assert_array_equal(first, again)
        assert first.shape != other.shape or (first != other).any()

    def test_one_point_is_one_cluster(self, start):
        assert len(find_clusters([[3.0, 4.0]], OUTER_M, INNER_M, 0, 0, start)) == 1
        assert len(find_clusters([[3.0, 4.0]], OUTER_M, INNER_M, 1, 0, start)) == 0

    @pytest.mark.parametrize(
        ("points", "radii", "message"),
        [
            (np.empty((0, 2)), (1.0, 0.5), "points: expected at least one"),
            (np.ones((4, 2)), (1.0, 1.5), r"inner_radius_m: expected at most outer_radius_m \(1.0\), got 1.5"),
            (np.ones((4, 2)), (np.inf, 1.0), "outer_radius_m: expected a positive"),
            (np.ones((4, 2)), (1.0, 0.0), "inner_radius_m: expected a positive"),
        ],
    )
    def test_bad_input_is_named(self, start, points, radii, message):
        with pytest.raises(InputError, match="minimum_points: expected a whole number"):
            find_clusters(np.ones((4, 2)), 1.0, 0.5, minimum_points=-1, start=start)
        with pytest.raises(InputError, match=message):
            find_clusters(points, *radii, start=start)


@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize("seed", [-1, 1.5, None, True, "7"])
def test_a_bad_seed_is_named(start, seed):
    """By those that find seeds for a radius, and by those that find a number of them."""
    points = np.arange(12.0).reshape(6, 2)
    for find in (STARTS[start], find_clusters, *([COUNTED[start]] if start in COUNTED else [])):
        more = {"start": start, "inner_radius_m": 0.5} if find is find_clusters else {}
        with pytest.raises(InputError, match="^seed: expected a whole number of at least 0, got"):
            find(points, 1, seed=seed, **more)


@pytest.mark.parametrize("start", COUNTED)
def test_a_start_that_takes_a_number_finds_as_many_seeds_as_quick_means(start, room):
    returns = room.fit.points[room.fit.occupied]
    for seed in range(3):
        assert len(STARTS[start](returns, INNER_M, seed)) == len(quick_means_seeds(returns, INNER_M, seed))


def test_quick_means_and_ask_means_are_themselves(room):
    returns = room.fit.points[room.fit.occupied]
    found, expected = find_clusters(returns, OUTER_M, INNER_M, 5, 2), quick_means(returns, OUTER_M, INNER_M, 5, 2)
    np.testing.assert_array_equal(found.seeds, expected.seeds)
    np.testing.assert_array_equal(found.members, expected.members)
    found = find_clusters(returns, OUTER_M, INNER_M, 0, 2, "ask_means")
    np.testing.assert_array_equal(found.seeds, ask_means(returns, INNER_M, seed=2))


def test_a_radius_for_seeds_alone_is_checked():
    with pytest.raises(InputError, match="^inner_radius_m: expected a positive"):
        quick_means_seeds(np.ones((4, 2)), -1.0)


def test_an_unknown_start_is_named():
    message = "start: expected one of quick_means, ask_means, kmeans_parallel, kmeans_plus_plus, random, got 'forgy'"
    with pytest.raises(InputError, match=message):
        check_start("forgy")
    with pytest.raises(InputError, match=message):
        find_clusters(np.ones((4, 2)), 1.0, 0.5, start="forgy")
    with pytest.raises(InputError, match=r"start: expected one of quick_means.*got \['random'\]"):
        find_clusters(np.ones((4, 2)), 1.0, 0.5, start=["random"])
