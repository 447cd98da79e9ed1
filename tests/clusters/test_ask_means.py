import numpy as np
import pytest
from clouds import UTM, are_among, assert_same_law, clouds, shares
from hypothesis import given, settings
from hypothesis import strategies as st

import hilbertvae.clusters.ask_means
from hilbertvae.checks import InputError
from hilbertvae.clusters.ask_means import Pool, ask_means


def squared_to(points, seeds):
    return np.square(points[:, None] - points[seeds]).sum(axis=2).min(axis=1)


def word_for_word(points, threshold_m, candidates, rng):
    """ASK-Means as METHOD 2 states it: all distances anew for every seed."""
    seeds = [rng.integers(len(points))]
    while True:
        squared = squared_to(points, seeds)
        squared[squared < threshold_m**2] = 0
        if not squared.any():
            return seeds
        drawn = rng.choice(len(points), candidates, p=squared / squared.sum())
        seeds.append(drawn[squared[drawn].argmax()])


@settings(max_examples=60)
@given(points=clouds, threshold_m=st.floats(0.05, 2.0), candidates=st.integers(1, 6), seed=st.integers(0, 999))
def test_invariants(points, threshold_m, candidates, seed):
    seeds = ask_means(points, threshold_m, candidates, seed)
    assert are_among(seeds, points)
    apart = np.linalg.norm(seeds[:, None] - seeds, axis=2)
    assert (apart[np.triu_indices(len(seeds), 1)] >= threshold_m * (1 - 1e-12)).all()
    # Squares, as the method compares: a root of one just below the threshold's may round to the threshold itself.
    assert (np.square(points[:, None] - seeds).sum(axis=2).min(axis=1) < threshold_m**2).all()
    np.testing.assert_array_equal(seeds, ask_means(points, threshold_m, candidates, seed))


@settings(max_examples=60)
@given(points=clouds, threshold_m=st.floats(0.05, 2.0), seed=st.integers(0, 999))
def test_distances_kept_are_those_to_the_nearest_seed(points, threshold_m, seed):
    rng = np.random.default_rng(seed)
    pool, seeds = Pool(points, threshold_m), []
    while pool.left:
        seeds.append(pool.draw(1, rng)[0] if seeds else rng.integers(len(points)))
        pool.take(seeds[-1])
        expected = squared_to(points, seeds)
        expected[expected < threshold_m**2] = 0
        np.testing.assert_allclose(pool.squared, expected, rtol=1e-12)
        assert pool.left == np.count_nonzero(expected)


@pytest.mark.parametrize("tries", [1, 128])
def test_candidates_are_drawn_by_squared_distance(tries, monkeypatch):
    """Whether draws are rejected by the bound, or there are too few for that."""
    monkeypatch.setattr(hilbertvae.clusters.ask_means, "TRIES", tries)
    points = np.column_stack([[0.0, 0.5, 1.0, 1.5, 2.0, 4.0], np.zeros(6)])
    pool = Pool(points, 0.8)
    pool.take(0)
    drawn = np.concatenate([pool.draw(3, np.random.default_rng([tries, k])) for k in range(3000)])
    share = np.bincount(drawn, minlength=6) / len(drawn)
    wanted = np.array([0, 0, 1.0, 2.25, 4.0, 16.0]) / 23.25
    assert (np.abs(share - wanted) <= 4 * np.sqrt(wanted * (1 - wanted) / len(drawn))).all()


@pytest.mark.parametrize("tries", [2, 128])
def test_seeds_follow_the_law_of_the_algorithm(tries, monkeypatch):
    monkeypatch.setattr(hilbertvae.clusters.ask_means, "TRIES", tries)
    points = np.column_stack([[0.0, 0.6, 1.2, 1.5, 2.4, 3.1], np.zeros(6)])
    ours = shares(lambda k: tuple(ask_means(points, 1.0, 2, seed=k)[:, 0].tolist()), 3000)
    theirs = shares(lambda k: tuple(points[word_for_word(points, 1.0, 2, np.random.default_rng([k, 1])), 0].tolist()), 3000)
    assert_same_law(ours, theirs, 3000)


def test_far_from_the_origin_the_same_points_are_picked():
    points = np.random.default_rng(0).integers(0, 64, (500, 2)) / 8  # eighths are whole at any distance
    np.testing.assert_array_equal(ask_means(points, 0.7, seed=3) + UTM, ask_means(points + UTM, 0.7, seed=3))


def test_a_smaller_threshold_gives_more_seeds_and_another_seed_others(room):
    returns = room.fit.points[room.fit.occupied]
    counts = [len(ask_means(returns, threshold_m)) for threshold_m in (0.3, 0.8, 2.0, 50.0)]
    assert counts == sorted(counts, reverse=True) and counts[0] > 2 * counts[1] and counts[-1] == 1
    assert not np.array_equal(ask_means(returns, 0.3, seed=0)[0], ask_means(returns, 0.3, seed=1)[0])


def test_one_far_point_leaves_draws_nothing_to_reject():
    points = np.append(np.random.default_rng(0).uniform(0, 1, (400, 2)), [[1e6, 1e6]], axis=0)
    seeds = ask_means(points, 0.2)
    assert (seeds == points[-1]).all(axis=1).sum() == 1


def test_points_that_coincide_are_one_seed():
    assert ask_means(np.zeros((50, 3)), 0.5).tolist() == [[0, 0, 0]]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ((np.empty((0, 2)), 1.0), "points: expected at least one"),
        (([[0.0, np.nan]], 1.0), "points: .*NaN"),
        ((np.ones((4, 2)), 0.0), "threshold_m: expected a positive"),
        ((np.ones((4, 2)), 1.0, 0), "candidates: expected a whole number of at least 1, got 0"),
    ],
)
def test_bad_input_is_named(given, message):
    with pytest.raises(InputError, match=message):
        ask_means(*given)
