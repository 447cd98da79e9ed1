"""`MapCells.coarser` and `joined`, against a loop over cells."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hilbertvae.checks import InputError
from hilbertvae.exports.map_cells import MapCells


def some_cells(dimension, seed, count=120):
    rng = np.random.default_rng(seed)
    index = np.unique(rng.integers(-9, 9, (count, dimension)), axis=0) + rng.integers(-50_000_000, 50_000_000, dimension)
    n = len(index)
    return MapCells(index, 0.1, rng.random(n), rng.random(n) / 2, rng.random(n) < 0.5)


@pytest.mark.parametrize("dimension", [2, 3])
@given(seed=st.integers(0, 1000), resolution_m=st.sampled_from([0.2, 0.3, 0.25, 0.1001, 1.0, 7.0]))
@settings(max_examples=30)
def test_of_those_that_become_one_an_occupied_one_then_one_that_was_seen_then_the_likeliest(dimension, seed, resolution_m):
    cells = some_cells(dimension, seed)
    found = cells.coarser(resolution_m)
    expected: dict = {}
    ratio = Fraction("0.1") / Fraction(str(resolution_m))
    for k, index in enumerate(cells.index.tolist()):
        key = tuple(math.floor((i + Fraction(1, 2)) * ratio) for i in index)
        rank = (cells.probability[k] > 0.6, bool(cells.observed[k]), float(cells.probability[k]))
        if key not in expected or rank > expected[key][0]:
            expected[key] = rank, k
    assert {tuple(index) for index in found.index.tolist()} == set(expected)
    for index, p, std, seen in zip(found.index.tolist(), found.probability, found.std, found.observed, strict=True):
        k = expected[tuple(index)][1]
        assert (p, std, seen) == (cells.probability[k], cells.std[k], cells.observed[k])
    assert found.resolution_m == resolution_m


def test_whole_factors_join_whole_cells():
    """Cells 2k and 2k + 1 become cell k, however far away: no rounding decides."""
    index = np.column_stack([np.arange(54_321_000, 54_321_100), np.full(100, -7)])
    cells = MapCells(index, 0.1, np.linspace(0, 1, 100), np.zeros(100), np.ones(100, bool))
    found = cells.joined(2)
    np.testing.assert_array_equal(np.sort(found.index[:, 0]), np.arange(27_160_500, 27_160_550))
    assert set(found.index[:, 1]) == {-4}
    np.testing.assert_array_equal(np.sort(found.probability), cells.probability[1::2])


def test_a_predicted_wall_outlasts_the_free_cell_before_it():
    cells = MapCells(np.array([[4, 6], [5, 6]]), 0.1, np.array([0.9, 0.02]), np.zeros(2), np.array([False, True]))
    joined = cells.joined(2)
    assert joined.occupied.tolist() == [True] and joined.observed.tolist() == [False]


def test_the_same_resolution_changes_nothing():
    cells = some_cells(2, 0)
    assert cells.coarser(0.1) is cells


def test_a_resolution_that_is_none():
    with pytest.raises(InputError, match="resolution_m"):
        some_cells(2, 0).coarser(0.0)
