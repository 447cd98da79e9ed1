import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hilbertvae.checks import InputError
from hilbertvae.cloud import Cloud
from hilbertvae.gaps import INSIDE, OUTSIDE, RIM, Gaps, random_gaps
from hilbertvae.voxel_votes import voxel_index


def part_by_loop(gaps, point):
    """Every corner of the point's voxel in a ball: inside. Its nearest point in a ball, but not all corners: rim. Without a rim its
    middle decides."""
    low = np.floor(point / gaps.resolution_m) * gaps.resolution_m
    high = low + gaps.resolution_m
    for centre, radius in zip(gaps.centres, gaps.radius_m, strict=True):
        if not gaps.rim:
            if np.linalg.norm((low + high) / 2 - centre) < radius:
                return INSIDE
            continue
        corners = [np.array(corner) for corner in itertools.product(*zip(low, high, strict=True))]
        if all(np.linalg.norm(corner - centre) < radius for corner in corners):
            return INSIDE
        nearest = np.array([min(max(c, a), b) for c, a, b in zip(centre, low, high, strict=True)])
        if np.linalg.norm(nearest - centre) < radius:
            return RIM
    return OUTSIDE


@settings(max_examples=25)
@given(
    seed=st.integers(0, 2**32 - 1),
    dimension=st.integers(2, 3),
    balls=st.integers(0, 3),
    resolution_m=st.sampled_from([0.1, 0.4]),
    corner_m=st.sampled_from([0.0, -700.0, 5.4e6]),
    rim=st.booleans(),
)
def test_parts_equal_brute_force(seed, dimension, balls, resolution_m, corner_m, rim):
    """Also where UTM coordinates are."""
    rng = np.random.default_rng(seed)
    centres = rng.uniform(-1, 1, (balls, dimension)) + 3 * np.arange(balls)[:, None] + corner_m
    gaps = Gaps(centres, rng.uniform(0.3, 1.2, balls), resolution_m, rim=rim)
    points = rng.uniform(-2, 8, (150, dimension)) + corner_m
    points[:60] = (centres[0] if balls else corner_m) + rng.normal(0, 0.7, (60, dimension))
    part, gap = gaps.part(points), gaps.gap_of(points)
    np.testing.assert_array_equal(part, [part_by_loop(gaps, point) for point in points])
    np.testing.assert_array_equal(gap >= 0, part == INSIDE)
    alone = [replace(gaps, centres=gaps.centres[[ball]], radius_m=gaps.radius_m[[ball]]) for ball in range(balls)]
    assert all(part_by_loop(alone[ball], point) == INSIDE for ball, point in zip(gap, points, strict=True) if ball >= 0)
    assert gaps.count(points).tolist() == [int(np.sum(gap == ball)) for ball in range(balls)]


@pytest.mark.parametrize(("dimension", "apart_m"), [(2, 5e6), (3, 2e5)])
def test_balls_far_apart_take_no_raster_between_them(dimension, apart_m):
    """As of a scan whose pose was forgotten, in a file of UTM coordinates: each ball is what it is alone."""
    rng = np.random.default_rng(0)
    centres = np.array([[0.0] * dimension, [apart_m] * dimension])
    points = np.concatenate([rng.uniform(-3, 3, (400, dimension)) + centre for centre in centres])
    both = Gaps(centres, np.array([1.25, 1.25]), 0.1)
    alone = [Gaps(centre[None], np.array([1.25]), 0.1).part(points) for centre in centres]
    found = both.part(points)
    np.testing.assert_array_equal(found, np.where(alone[0] != OUTSIDE, alone[0], alone[1]))
    assert {*found[:400]} == {*found[400:]} == {INSIDE, OUTSIDE, RIM}


def test_the_voxel_decides_not_the_point(place):
    gaps = random_gaps(place.fit, 2.5, place.resolution_m, seed=0)
    parts = {}
    for cloud in (place.fit, place.whole, place.points, place.voxels):
        for index, part in zip(map(tuple, voxel_index(cloud.points, place.resolution_m).tolist()), gaps.part(cloud.points), strict=True):
            assert parts.setdefault(index, part) == part
    assert set(parts.values()) == {INSIDE, OUTSIDE, RIM}


def test_no_point_inside_a_ball_is_shown_and_none_on_the_rim(place):
    gaps = random_gaps(place.fit, 2.5, place.resolution_m, seed=1)
    for cloud in (place.fit, place.points, place.voxels):
        left, part = gaps.cut(cloud), gaps.part(cloud.points)
        distance = np.linalg.norm(left.points[:, None] - gaps.centres, axis=2)
        assert (distance >= gaps.radius_m).all()
        assert len(left) == (part == OUTSIDE).sum() < len(cloud)
        removed = cloud.points[part == INSIDE]
        assert (np.linalg.norm(removed[:, None] - gaps.centres, axis=2) < gaps.radius_m).any(axis=1).all()


@settings(max_examples=12)
@given(seed=st.integers(0, 2**32 - 1), diameter_m=st.sampled_from([1.0, 1.5, 2.5, (1.0, 2.5)]))
def test_ten_to_fifteen_percent_in_balls_that_lie_apart(room, seed, diameter_m):
    cloud = room.fit
    gaps = random_gaps(cloud, diameter_m, room.resolution_m, seed)
    gone = (gaps.part(cloud.points) != OUTSIDE).mean()
    assert 0.10 <= gone <= 0.15
    low, high = np.broadcast_to(diameter_m, 2) / 2
    assert ((gaps.radius_m >= low) & (gaps.radius_m <= high)).all()
    for (a, r), (b, s) in itertools.combinations(zip(gaps.centres, gaps.radius_m, strict=True), 2):
        assert np.linalg.norm(a - b) >= r + s
    # Each ball was put around an occupied point: moved by at most the radius.
    nearest = np.linalg.norm(gaps.centres[:, None] - cloud.points[cloud.occupied], axis=2).min(axis=1)
    assert (nearest <= gaps.radius_m).all()


def test_centred_balls_stand_on_occupied_points_and_others_do_not(place):
    returns = place.fit.points[place.fit.occupied]

    def distances(centred):
        gaps = [random_gaps(place.fit, 1.5, place.resolution_m, seed, centred) for seed in range(5)]
        centres = np.concatenate([each.centres for each in gaps])
        return np.linalg.norm(centres[:, None] - returns, axis=2).min(axis=1)

    assert (distances(centred=True) == 0).all()
    assert (distances(centred=False) > 0).all()


def test_offsets_are_uniform_in_the_ball():
    """With one occupied point in a wide field of free ones, the centres are its offsets."""
    rng = np.random.default_rng(0)
    for dimension in (2, 3):
        points = np.vstack([np.zeros(dimension), rng.uniform(-1.5, 1.5, (400, dimension))])
        cloud = Cloud(points, np.arange(401) == 0, np.ones(401))
        centres = np.array([random_gaps(cloud, 0.8, 0.05, seed, attempts=1).centres[0] for seed in range(500)])
        share = (np.linalg.norm(centres, axis=1) / 0.4) ** dimension  # uniform in [0, 1] for a uniform ball
        assert (share <= 1).all()
        np.testing.assert_allclose(np.quantile(share, [0.25, 0.5, 0.75]), [0.25, 0.5, 0.75], atol=0.08)
        np.testing.assert_allclose(centres.mean(axis=0), 0, atol=0.04)


def test_the_same_seed_gives_the_same_balls(room):
    first, again, other = (random_gaps(room.fit, 1.5, room.resolution_m, seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first.centres, again.centres)
    assert first.centres.shape != other.centres.shape or (first.centres != other.centres).any()


def test_a_site_too_small_for_a_gap(room):
    with pytest.raises(InputError, match="gaps of 40.0 m: none fits .* more than 15%"):
        random_gaps(room.fit, 40.0, room.resolution_m, seed=0, centred=True, attempts=50)


def test_the_share_that_is_gone_is_told(place):
    gaps = random_gaps(place.fit, 1.5, place.resolution_m, seed=1)
    assert gaps.share == pytest.approx(1 - len(gaps.cut(place.fit)) / len(place.fit))


def test_nothing_to_put_gaps_around():
    cloud = Cloud(np.random.default_rng(0).uniform(0, 9, (50, 2)), np.zeros(50, bool), np.ones(50))
    with pytest.raises(InputError, match="expected occupied points to put gaps around"):
        random_gaps(cloud, 2.5, 0.1, seed=0)
    with pytest.raises(InputError, match="diameter_m: expected a positive number"):
        random_gaps(Cloud(cloud.points, ~cloud.occupied, cloud.weight), 0.0, 0.1, seed=0)
    for resolution_m in (0.0, np.nan):
        with pytest.raises(InputError, match="resolution_m: expected a positive number"):
            random_gaps(Cloud(cloud.points, ~cloud.occupied, cloud.weight), 2.5, resolution_m, seed=0)


@pytest.mark.parametrize("seed", [-1, 0.5, None])
def test_a_bad_seed_is_named(room, seed):
    with pytest.raises(InputError, match="^seed: expected a whole number of at least 0, got"):
        random_gaps(room.fit, 2.5, 0.1, seed)


@pytest.mark.parametrize("diameter_m", [(1.5,), (3.5, 1.5), (1.0, 2.0, 3.0), (1.5, "3.5"), [0.0, 2.0], [None, 2.0], np.ones((2, 2))])
def test_diameters_that_are_no_range(room, diameter_m):
    with pytest.raises(InputError, match="gap diameters: expected one in metres, or the smallest and the largest"):
        random_gaps(room.fit, diameter_m, 0.1, seed=0)


def test_diameters_of_any_kind_of_sequence(room):
    found = [random_gaps(room.fit, kind([0.4, 1]), 0.1, 0).radius_m for kind in (list, tuple, np.array)]
    np.testing.assert_array_equal(found, [found[0]] * 3)
    with pytest.raises(InputError, match="diameter_m: expected a positive number, got None"):
        random_gaps(room.fit, None, 0.1, seed=0)


def test_diameters_are_uniform_in_their_range(room):
    radii = np.concatenate([random_gaps(room.fit, (0.4, 1.2), 0.1, seed).radius_m for seed in range(40)])
    np.testing.assert_allclose(np.quantile(radii, [0.1, 0.5, 0.9]), [0.24, 0.4, 0.56], rtol=0, atol=0.06)
