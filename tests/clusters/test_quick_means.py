import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hilbertvae.checks import InputError
from hilbertvae.clusters import clusters as clusters_module
from hilbertvae.clusters import quick_means as walk
from hilbertvae.clusters.clusters import flat
from hilbertvae.clusters.quick_means import quick_means


def algorithm_1(points, outer_radius_m, inner_radius_m, minimum_points, rng):
    """Alg. 1 to the letter: draw a live point, take its outer ball over all points, consume the live members of its inner ball."""
    live, seeds = list(range(len(points))), []
    while live:
        drawn = live[rng.integers(len(live))]
        distance = np.linalg.norm(points - points[drawn], axis=1)
        if (distance <= outer_radius_m).sum() > minimum_points:
            seeds.append(drawn)
        live = [k for k in live if distance[k] > inner_radius_m]
    return seeds


clouds = st.tuples(st.integers(0, 2**32 - 1), st.integers(1, 60), st.integers(2, 3))


@settings(max_examples=40)
@given(cloud=clouds, inner_m=st.floats(0.05, 1.0), factor=st.floats(1.0, 3.0), minimum=st.integers(0, 6), seed=st.integers(0, 999))
def test_invariants(cloud, inner_m, factor, minimum, seed):
    state, count, dimension = cloud
    points = np.random.default_rng(state).normal(0, 1, (count, dimension))
    outer_m = inner_m * factor
    every, found = (quick_means(points, outer_m, inner_m, least, seed) for least in (0, minimum))
    # With no least size every drawn point is a seed: each point lies within the inner radius of one, and they lie apart.
    assert (np.linalg.norm(points[:, None] - every.seeds, axis=2).min(axis=1) <= inner_m).all()
    for a in range(len(every)):
        for b in range(a):
            assert np.linalg.norm(every.seeds[a] - every.seeds[b]) > inner_m
    # The least size only drops clusters, and members are the whole ball around a seed.
    kept = [seed for seed in every.seeds if (np.linalg.norm(points - seed, axis=1) <= outer_m).sum() > minimum]
    np.testing.assert_array_equal(found.seeds, np.reshape(kept, (-1, dimension)))
    assert len(found.offsets) == len(found) + 1 and found.offsets[-1] == len(found.members)
    for m in range(len(found)):
        ball = np.flatnonzero(np.linalg.norm(points - found.seeds[m], axis=1) <= outer_m)
        np.testing.assert_array_equal(found.members[found.offsets[m] : found.offsets[m + 1]], ball)
        assert (found.numbers[found.offsets[m] : found.offsets[m + 1]] == m).all()


def test_seeds_follow_the_law_of_algorithm_1():
    """On a short line of points each set of seeds comes as often as when points are drawn as the paper says."""
    points = np.column_stack([[0.0, 0.6, 1.2, 1.5, 2.4, 3.1], np.zeros(6)])
    runs = 3000

    def frequencies(draw):
        drawn = [tuple(sorted(draw(k))) for k in range(runs)]
        return {seeds: drawn.count(seeds) / runs for seeds in set(drawn)}

    ours = frequencies(lambda k: quick_means(points, 1.5, 1.0, 2, seed=k).seeds[:, 0].tolist())
    theirs = frequencies(lambda k: points[algorithm_1(points, 1.5, 1.0, 2, np.random.default_rng([k, 1])), 0].tolist())
    assert len(theirs) > 3
    for seeds in set(ours) | set(theirs):
        # Four standard deviations of the difference of two shares of 3000 draws.
        share = (ours.get(seeds, 0) + theirs.get(seeds, 0)) / 2
        assert abs(ours.get(seeds, 0) - theirs.get(seeds, 0)) <= 4 * np.sqrt(2 * share * (1 - share) / runs)


def test_clusters_overlap_and_the_seed_alone_decides(room):
    returns = room.fit.points[room.fit.occupied]
    first, again, other = (quick_means(returns, 2.5, 1.375, 10, seed) for seed in (0, 0, 1))
    np.testing.assert_array_equal(first.seeds, again.seeds)
    np.testing.assert_array_equal(first.members, again.members)
    assert first.seeds.shape != other.seeds.shape or (first.seeds != other.seeds).any()
    assert len(first.members) > 1.5 * len(returns)  # far more members than points: Alg. 1 lets clusters share them
    assert {tuple(seed) for seed in first.seeds} <= {tuple(point) for point in returns}


def test_points_that_coincide():
    clusters = quick_means(np.zeros((50, 2)), 1.0, 0.5)
    assert len(clusters) == 1 and len(clusters.members) == 50


def test_clusters_too_small_to_keep():
    clusters = quick_means(np.array([[0.0, 0.0], [9.0, 9.0]]), 1.0, 0.5, minimum_points=1)
    assert len(clusters) == 0 and clusters.seeds.shape == (0, 2) and clusters.offsets.tolist() == [0]


@pytest.mark.parametrize(
    ("points", "radii", "message"),
    [
        (np.empty((0, 2)), (1.0, 0.5), "points: expected at least one"),
        (np.ones((4, 5)), (1.0, 0.5), "points: expected shape"),
        ([[0.0, np.nan]], (1.0, 0.5), "NaN"),
        (np.ones((4, 2)), (1.0, 1.5), r"inner_radius_m: expected at most outer_radius_m \(1.0\), got 1.5"),
        (np.ones((4, 2)), (0.0, 0.0), "outer_radius_m: expected a positive"),
        (np.ones((4, 2)), (1.0, -1.0), "inner_radius_m: expected a positive"),
    ],
)
def test_bad_input_is_named(points, radii, message):
    with pytest.raises(InputError, match=message):
        quick_means(points, *radii)


@pytest.mark.parametrize("at_once", [1, 8, 1024])
def test_one_permutation_is_walked_and_consumed_points_are_skipped(room, monkeypatch, at_once):
    """Stretch by stretch, of which a site takes several."""
    monkeypatch.setattr(walk, "LIVE_AT_ONCE", at_once)
    returns, seeds = room.fit.points[room.fit.occupied], []
    for k in np.random.default_rng(3).permutation(len(returns)):
        if not seeds or np.linalg.norm(returns[seeds] - returns[k], axis=1).min() > 0.5:
            seeds.append(k)
    np.testing.assert_array_equal(quick_means(returns, 1.0, 0.5, 0, seed=3).seeds, returns[seeds])


@pytest.mark.parametrize(("seeds", "members"), [(3, 2**20), (4096, 100), (4096, 1)])
def test_members_are_whole_balls_in_every_portion_of_seeds(room, monkeypatch, seeds, members):
    returns, listed = room.fit.points[room.fit.occupied], []
    monkeypatch.setattr(clusters_module, "SEEDS_AT_ONCE", seeds)
    monkeypatch.setattr(clusters_module, "MEMBERS_AT_ONCE", members)
    monkeypatch.setattr(clusters_module, "flat", lambda balls: listed.append([len(ball) for ball in balls]) or flat(balls))
    found = quick_means(returns, 1.0, 0.5, 0)
    balls = [np.flatnonzero(np.linalg.norm(returns - seed, axis=1) <= 1.0) for seed in found.seeds]
    np.testing.assert_array_equal(found.members, np.concatenate(balls))
    assert all(len(sizes) <= seeds and (sum(sizes) <= members or len(sizes) == 1) for sizes in listed)


def test_some_clusters_are_those_of_all(room):
    """Whether or not their points have been counted before."""
    found, uncounted = (quick_means(room.fit.points[room.fit.occupied], 1.0, 0.5, 0) for _ in range(2))
    assert len(found.sizes) == len(found) > 4
    for some in (slice(1, 4), np.array([4, 0])):
        for part in (found.select(some), uncounted.select(some)):
            np.testing.assert_array_equal(part.sizes, found.sizes[some])
            np.testing.assert_array_equal(
                part.members, np.concatenate([np.split(found.members, found.offsets)[k + 1] for k in np.r_[some]])
            )
