"""The ground below slopes, cars, walls and stray returns."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hilbertvae.checks import InputError
from hilbertvae.ground import ABOVE_GROUND_M, BLOCK_M, Ground, find_ground, find_wide_ground


def road(rng, slope, count=40_000, extent_m=40.0):
    """Returns of an even slope, with 2 cm of noise."""
    flat = rng.uniform(0, extent_m, (count, 2))
    return np.column_stack([flat, flat @ slope + rng.normal(0, 0.02, count)])


def box(rng, centre, size, bottom_m, count=4000):
    """Returns of a box's top and sides."""
    points = rng.uniform(-0.5, 0.5, (count, 3))
    side = rng.integers(0, 3, count)
    points[np.arange(count), side] = np.where(side == 2, 0.5, 0.5 * rng.choice([-1, 1], count))
    return points * size + [*centre, bottom_m + size[2] / 2]


@settings(max_examples=20)
@given(seed=st.integers(0, 999), angle=st.floats(0, 6.28), steepness=st.floats(0, 0.1))
def test_a_slope_is_ground_and_a_car_on_it_is_not(seed, angle, steepness):
    rng = np.random.default_rng(seed)
    slope = steepness * np.array([np.cos(angle), np.sin(angle)])
    plain = road(rng, slope)
    below = np.array([20.0, 20.0]) @ slope
    car = box(rng, [20.0, 20.0], np.array([1.8, 4.4, 1.3]), below + 0.25)
    under_car = (np.abs(plain[:, 0] - 20) < 0.9) & (np.abs(plain[:, 1] - 20) < 2.2)  # no beam gets there
    ground = find_ground(np.concatenate([plain[~under_car], car]))
    assert (np.abs(ground.height_above(plain)) < ABOVE_GROUND_M).mean() > 0.995
    top = car[car[:, 2] > below + 1.0]
    assert (ground.height_above(top) > ABOVE_GROUND_M).all()


def test_walls_stand_on_it_and_stray_returns_below_do_not_pull_it_down():
    rng = np.random.default_rng(0)
    plain = road(rng, np.zeros(2))
    wall = np.column_stack([np.full(3000, 10.0), rng.uniform(0, 40, 3000), rng.uniform(0, 6, 3000)])
    stray = np.column_stack([rng.uniform(0, 40, (60, 2)), rng.uniform(-4, -1, 60)])
    ground = find_ground(np.concatenate([plain, wall, stray]))
    assert np.abs(ground.height_above(plain)).max() < 0.2
    assert ((ground.height_above(wall) > ABOVE_GROUND_M) == (wall[:, 2] > ABOVE_GROUND_M)).mean() > 0.97


def test_tiles_without_returns_and_points_beyond_take_the_nearest_height():
    ground = find_ground(np.array([[0.0, 0.0, 1.0], [30.0, 0.0, 1.0]]))
    np.testing.assert_allclose(ground.height_above(np.array([[15.0, 0.0, 1.5], [-99.0, 5.0, 0.0]])), [0.5, -1.0])


def test_a_wide_map_has_the_ground_of_its_parts(monkeypatch):
    """Whole or by blocks it is the same, but for where tiles begin; far-off parts change nothing."""
    rng = np.random.default_rng(0)
    plain = road(rng, np.array([0.05, -0.02]), count=300_000, extent_m=300.0) - [150.0, 150.0, 0.0]
    car = box(rng, [100.0, 0.0], np.array([1.8, 4.4, 1.3]), 0.25 + 250 * 0.05 - 150 * 0.02)
    returns = np.concatenate([plain, car])
    whole = find_wide_ground(returns)
    assert isinstance(whole, Ground)
    far = np.array([5 * BLOCK_M + 3, -70 * BLOCK_M, 40.0])
    wide = find_wide_ground(np.concatenate([returns, road(rng, np.zeros(2)) + far]))
    assert len(wide.key) == len(wide.parts) == 4 * 4 + 1
    np.testing.assert_allclose(wide.height_above(returns), whole.height_above(returns), atol=0.1)
    asked = np.array([[5.0, 5.0, 155 * 0.03 + 1.0], far + np.array([5.0, 5.0, 1.0])])
    np.testing.assert_allclose(wide.height_above(asked), 1.0, atol=0.2)
    monkeypatch.setattr("hilbertvae.ground.WIDE_TILES", 1)
    np.testing.assert_allclose(find_wide_ground(returns).height_above(returns), whole.height_above(returns), atol=0.1)


@pytest.mark.parametrize(
    ("returns", "words"),
    [
        (np.zeros((0, 3)), "at least one"),
        (np.zeros((5, 2)), r"\(N, 3\)"),
        ([[0, 0, 0], [1e9, 1e9, 0]], "outlier"),
        ([[0, 0, 0], [1e30, 3e9, 0]], "outlier"),
    ],
)
def test_bad_returns(returns, words):
    with pytest.raises(InputError, match=words):
        find_ground(np.asarray(returns, float))
