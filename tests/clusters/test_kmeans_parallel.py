import numpy as np
import pytest
from clouds import UTM, are_among, clouds
from hypothesis import given, settings
from hypothesis import strategies as st

import hilbertvae.clusters.kmeans_parallel
from hilbertvae.checks import InputError
from hilbertvae.clusters.kmeans_parallel import Candidates, kmeans_parallel
from hilbertvae.clusters.lloyd import lloyd
from hilbertvae.clusters.random_start import random_start


@settings(max_examples=60)
@given(points=clouds, share=st.floats(0, 1), oversampling=st.sampled_from([0.1, 2.0, 10.0]), seed=st.integers(0, 999))
def test_as_many_points_of_the_cloud_as_asked_for(points, share, oversampling, seed):
    count = max(1, round(share * len(points)))
    seeds = kmeans_parallel(points, count, oversampling, 3, seed)
    assert seeds.shape == (count, points.shape[1]) and are_among(seeds, points)
    if len(np.unique(points, axis=0)) == len(points):
        assert len(np.unique(seeds, axis=0)) == count
    np.testing.assert_array_equal(seeds, kmeans_parallel(points, count, oversampling, 3, seed))


@settings(max_examples=60)
@given(points=clouds, parts=st.lists(st.integers(0, 4), min_size=1, max_size=4), seed=st.integers(0, 999))
def test_nearest_candidates_are_those_of_all_pairs(points, parts, seed):
    """However the candidates come in."""
    order = np.random.default_rng(seed).permutation(len(points))
    candidates = Candidates(points)
    for start, size in zip(np.cumsum([0, *parts]), [1, *parts], strict=False):
        candidates.add(order[start : start + size])
        away = np.square(points[:, None] - points[candidates.chosen]).sum(axis=2)
        np.testing.assert_allclose(candidates.squared, away.min(axis=1), rtol=1e-12)
        np.testing.assert_allclose(away[np.arange(len(points)), candidates.nearest], away.min(axis=1), rtol=1e-12)


def word_for_word(points, count, oversampling, rounds, rng):
    """Bahmani et al., Algorithm 2, steps 1 to 6: each point of each round drawn on its own."""
    chosen = {int(rng.integers(len(points)))}
    for _ in range(rounds):
        squared = [min(float(np.square(x - points[c]).sum()) for c in chosen) for x in points]
        potential = sum(squared)
        chosen |= {k for k in range(len(points)) if rng.random() < (oversampling * count * squared[k] / potential if potential else 0)}
    return chosen


@pytest.mark.parametrize("oversampling", [0.7, 2.0])
def test_candidates_follow_the_law_of_the_algorithm_and_weigh_what_they_stand_for(monkeypatch, oversampling):
    points = np.column_stack([[0.0, 0.1, 0.6, 1.2, 1.5, 2.4, 3.1, 7.0], np.zeros(8)])
    runs, caught = 3000, []
    monkeypatch.setattr(hilbertvae.clusters.kmeans_parallel, "kmeans_plus_plus", lambda *given, seed: caught.append(given))
    for k in range(runs):
        kmeans_parallel(points, 2, oversampling, 2, seed=k)
    assert all(weight.sum() == 8 and len(weight) == len(candidates) for candidates, _, weight in caught)
    caught = [candidates for candidates, _, _ in caught if len(candidates) > 2]  # no others were filled up

    theirs = [word_for_word(points, 2, oversampling, 2, np.random.default_rng([k, 1])) for k in range(runs)]
    theirs = [chosen for chosen in theirs if len(chosen) > 2]
    assert abs(len(theirs) - len(caught)) <= 4 * np.sqrt(runs / 2)
    runs = len(theirs)
    for k, point in enumerate(points):
        ours, wanted = np.mean([point[0] in candidates[:, 0] for candidates in caught]), np.mean([k in chosen for chosen in theirs])
        assert abs(ours - wanted) <= 4 * np.sqrt(2 * wanted * (1 - wanted) / runs)


def test_every_heap_gets_a_seed_which_random_points_miss():
    rng = np.random.default_rng(0)
    heaps = rng.uniform(0, 1000, (40, 2))
    points = heaps[np.minimum(rng.geometric(0.1, 4000), 40) - 1] + rng.normal(0, 0.1, (4000, 2))
    missed = [lloyd(points, start(points, 40, seed=0), 0)[1][0] for start in (random_start, kmeans_parallel)]
    assert missed[1] < 0.01 * missed[0]


def test_far_from_the_origin_the_same_points_are_picked():
    points = np.random.default_rng(0).uniform(0, 1, (300, 2))  # no round numbers, whose products have all their digits there, too
    for seed in range(3):
        near, far = kmeans_parallel(points, 40, seed=seed), kmeans_parallel(points + UTM, 40, seed=seed)
        np.testing.assert_allclose(near, far - UTM, rtol=0, atol=1e-8)


def test_another_seed_gives_others(room):
    returns = room.fit.points[room.fit.occupied]
    assert not np.array_equal(*(kmeans_parallel(returns, 20, seed=seed) for seed in (0, 1)))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (([[0.0, np.inf]], 1), "points: .*inf"),
        ((np.ones((4, 2)), 5), "count: expected a whole number from 1 to 4, got 5"),
        ((np.ones((4, 2)), 0), "count: expected a whole number"),
        ((np.ones((4, 2)), 2, 0.0), "oversampling: expected a positive"),
        ((np.ones((4, 2)), 2, 2.0, 0), "rounds: expected a whole number"),
    ],
)
def test_bad_input_is_named(given, message):
    with pytest.raises(InputError, match=message):
        kmeans_parallel(*given)
