import numpy as np
import pytest
from clouds import UTM, clouds
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.cluster import KMeans

from hilbertvae.checks import InputError
from hilbertvae.clusters.lloyd import lloyd
from hilbertvae.clusters.random_start import random_start


def word_for_word(points, centres, iterations):
    potentials = []
    for step in range(iterations + 1):
        away = np.square(points[:, None] - centres).sum(axis=2)
        potentials.append(away.min(axis=1).sum())
        if step < iterations:
            nearest = away.argmin(axis=1)
            centres = np.array([points[nearest == m].mean(axis=0) if (nearest == m).any() else c for m, c in enumerate(centres)])
    return centres, potentials


@settings(max_examples=60)
@given(points=clouds, share=st.floats(0, 1), seed=st.integers(0, 999))
def test_the_potential_never_rises(points, share, seed):
    seeds = random_start(points, max(1, round(share * len(points))), seed)
    centres, potentials = lloyd(points, seeds, 5)
    assert centres.shape == seeds.shape and len(potentials) == 6
    assert all(after <= before * (1 + 1e-12) + 1e-12 for before, after in zip(potentials, potentials[1:], strict=False))


@pytest.mark.parametrize("dimension", [2, 3])
def test_iterations_are_those_of_all_pairs_and_of_scikit_learn(dimension):
    points = np.random.default_rng(0).normal(0, 1, (400, dimension))
    seeds = random_start(points, 30)
    centres, potentials = lloyd(points, seeds, 5)
    for found, expected in zip((centres, potentials), word_for_word(points, seeds, 5), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-10)
    theirs = KMeans(30, init=seeds, n_init=1, max_iter=5, tol=0, algorithm="lloyd").fit(points)
    np.testing.assert_allclose(potentials[5], theirs.inertia_, rtol=1e-10)


def test_a_centre_that_no_point_is_nearest_to_stays():
    centres, _ = lloyd(np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([[0.5, 0.0], [90.0, 90.0]]), 3)
    assert centres.tolist() == [[0.5, 0.0], [90.0, 90.0]]


def test_far_from_the_origin():
    points = np.random.default_rng(0).integers(0, 64, (300, 2)) / 8
    near, far = (lloyd(points + origin, points[:40] + origin, 4)[1] for origin in (0, UTM))
    np.testing.assert_allclose(near, far, rtol=1e-6)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ((np.ones((4, 2)), np.ones((2, 3)), 1), r"seeds: expected shape \(N, 2\)"),
        ((np.ones((4, 2)), np.ones((0, 2)), 1), "seeds: expected at least one"),
        ((np.ones((4, 2)), np.ones((1, 2)), -1), "iterations: expected a whole number of at least 0, got -1"),
    ],
)
def test_bad_input_is_named(given, message):
    with pytest.raises(InputError, match=message):
        lloyd(*given)
