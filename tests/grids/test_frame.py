import itertools
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from hilbertvae.bucket_index import BucketIndex
from hilbertvae.checks import InputError
from hilbertvae.cloud import Cloud
from hilbertvae.clusters.clusters import Clusters
from hilbertvae.clusters.quick_means import quick_means
from hilbertvae.gaps import random_gaps
from hilbertvae.grids import frame
from hilbertvae.grids.aligned_grid import cell_index
from hilbertvae.grids.frame import CENTRES, ROTATIONS, SCALES, Frames, FrameSettings, cluster_frames

CHOICES = list(itertools.product(CENTRES, ROTATIONS, SCALES))
DIAMETER_M = 3.2


def random_frames(rng, count, dimension):
    rotation = np.linalg.qr(rng.normal(size=(count, dimension, dimension)))[0]
    rotation[:, :, 0] *= np.linalg.det(rotation)[:, None]
    return Frames(rng.uniform(-5, 5, (count, dimension)), rotation, rng.uniform(0.5, 4, count))


def clusters_of(cloud, seed=0):
    return quick_means(cloud.points[cloud.occupied], DIAMETER_M / 2, 0.9, 5, seed)


def frames_of(cloud, *choice, seed=0, snap_m=0.1):
    return cluster_frames(clusters_of(cloud, seed), cloud, DIAMETER_M, snap_m, FrameSettings(*choice))


@settings(max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), dimension=st.integers(2, 3), turned=st.booleans())
def test_into_the_frame_and_back(seed, dimension, turned):
    rng = np.random.default_rng(seed)
    frames = random_frames(rng, 4, dimension)
    if not turned:
        frames = Frames(frames.centre, np.broadcast_to(np.eye(dimension), (4, dimension, dimension)), frames.scale)
    assert frames.turned == turned
    points, frame = rng.uniform(-9, 9, (20, dimension)), rng.integers(0, 4, 20)
    np.testing.assert_allclose(frames.back(frames.into(points, frame), frame), points, atol=1e-9)
    np.testing.assert_allclose(frames.into(frames.back(points, frame), frame), points, atol=1e-9)


@pytest.mark.parametrize("dimension", [2, 3])
def test_equation_9_by_an_explicit_loop(dimension):
    rng = np.random.default_rng(0)
    frames = random_frames(rng, 5, dimension)
    points, frame = rng.uniform(-9, 9, (30, dimension)), rng.integers(0, 5, 30)
    for point, m, found in zip(points, frame, frames.into(points, frame), strict=True):
        expected = [
            sum((point[d] - frames.centre[m, d]) * frames.rotation[m, d, e] for d in range(dimension)) / frames.scale[m]
            for e in range(dimension)
        ]
        np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize("dimension", [2, 3])
def test_boxes_hold_their_corners_tightly(dimension):
    frames = random_frames(np.random.default_rng(1), 6, dimension)
    corners = np.array(list(itertools.product([-0.5, 0.5], repeat=dimension)))
    low, high = frames.boxes()
    for m in range(6):
        placed = frames.back(corners, np.full(len(corners), m))
        np.testing.assert_allclose(placed.min(axis=0), low[m], atol=1e-9)
        np.testing.assert_allclose(placed.max(axis=0), high[m], atol=1e-9)


@pytest.mark.parametrize("choice", CHOICES, ids="-".join)
def test_every_frame_is_a_proper_rotation_of_the_cluster(place, choice):
    cloud, (centre, rotation, scale) = place.fit, choice
    clusters, frames = clusters_of(cloud), frames_of(cloud, *choice)
    assert len(frames) == len(clusters) > 5
    dimension = place.dimension
    for matrix in frames.rotation:
        np.testing.assert_allclose(matrix @ matrix.T, np.eye(dimension), atol=1e-9)
        assert np.linalg.det(matrix) == pytest.approx(1.0)
        if rotation == "none":
            np.testing.assert_array_equal(matrix, np.eye(dimension))
        if rotation == "yaw" and dimension == 3:
            np.testing.assert_array_equal(matrix[2], [0, 0, 1])
            np.testing.assert_array_equal(matrix[:, 2], [0, 0, 1])
    returns = cloud.points[cloud.occupied]
    for m in range(len(clusters)):
        members = returns[clusters.members[clusters.offsets[m] : clusters.offsets[m + 1]]]
        expected = clusters.seeds[m] if centre == "seed" else np.median(members, axis=0)
        if rotation == "none" and scale == "fixed":
            expected = np.round(expected / 0.1) * 0.1
        np.testing.assert_allclose(frames.centre[m], expected, atol=1e-12)
        if scale == "fixed":
            assert frames.scale[m] == DIAMETER_M
        else:  # the farthest member lies on a side of the box, and none beyond
            inside = frames.into(members, np.full(len(members), m))
            assert np.abs(inside).max() == pytest.approx(0.5 / (1 + frame.MARGIN), rel=1e-9)
            assert np.abs(inside).max() <= 0.5


@pytest.mark.parametrize("rotation", ["full", "yaw"])
def test_axes_are_eigenvectors_the_largest_first_and_point_to_free_space(place, rotation):
    cloud, dimension = place.fit, place.dimension
    axes = 2 if rotation == "yaw" else dimension
    clusters, frames = clusters_of(cloud), frames_of(cloud, "seed", rotation, "fixed")
    returns, free = cloud.points[cloud.occupied], cloud.points[~cloud.occupied]
    for m in range(len(clusters)):
        members = returns[clusters.members[clusters.offsets[m] : clusters.offsets[m + 1]], :axes]
        turn = frames.rotation[m][:axes, :axes]
        covariance = turn.T @ np.cov(members.T, bias=True) @ turn
        np.testing.assert_allclose(covariance - np.diag(np.diag(covariance)), 0, atol=1e-9)
        assert (np.diff(np.diag(covariance)) <= 1e-9).all()
        near = free[np.linalg.norm(free - clusters.seeds[m], axis=1) <= DIAMETER_M / 2]  # and none from another storey
        side = (near[:, :axes].mean(axis=0) - members.mean(axis=0)) @ turn
        # All axes point to the free space but, at most, the one on which it is least clear where that is.
        wrong = np.flatnonzero(side < 0)
        assert len(wrong) <= 1 and all(np.abs(side[k]) == np.abs(side).min() for k in wrong)


def test_spread_boxes_stand_at_four_angles_by_their_seeds_alone(place):
    clusters, frames = clusters_of(place.fit), frames_of(place.fit, "seed", "spread", "fixed")
    angle = np.degrees(np.arctan2(frames.rotation[:, 1, 0], frames.rotation[:, 0, 0]))
    for seed, found in zip(clusters.seeds, angle, strict=True):
        assert found == pytest.approx([0, 22.5, 45, 67.5][int((seed[0] // 1 + 2 * (seed[1] // 1)) % 4)])
    assert len(set(angle.round(3))) == 4
    np.testing.assert_array_equal(frames.centre, clusters.seeds)  # no lattice is theirs
    some = np.arange(len(clusters)) % 3 == 0
    returns = cKDTree(place.fit.points[place.fit.occupied])
    alone = Clusters(clusters.seeds[some], returns, DIAMETER_M / 2)
    fewer = cluster_frames(alone, place.fit, DIAMETER_M, 0.1, FrameSettings("seed", "spread", "fixed"))
    np.testing.assert_array_equal(fewer.rotation, frames.rotation[some])


@pytest.mark.parametrize("choice", CHOICES, ids="-".join)
@pytest.mark.parametrize("returns", [2, 30])
def test_no_clusters_and_no_free_point_near_make_frames_too(choice, returns):
    """Two returns are no cluster; thirty are one, whose free points lie far away."""
    rng = np.random.default_rng(0)
    points = np.concatenate([rng.uniform(0, 1, (returns, 2)), rng.uniform(50, 51, (5, 2))])
    cloud = Cloud(points, np.arange(len(points)) < returns, np.ones(len(points)))
    clusters = clusters_of(cloud)
    frames = cluster_frames(clusters, cloud, DIAMETER_M, 0.1, FrameSettings(*choice))
    assert len(frames) == len(clusters) and (len(clusters) > 0) == (returns == 30)
    assert np.isfinite(frames.centre).all() and frames.rotation.shape == (len(frames), 2, 2)


def test_a_turned_site_has_turned_frames():
    """The point of aligning: in its frame a wall looks the same whichever way the site lies."""
    rng = np.random.default_rng(3)
    wall = np.column_stack([rng.uniform(-1.5, 1.5, 80), rng.normal(0, 0.02, 80)])
    free = rng.uniform([-1.5, 0.1], [1.2, 1.5], (400, 2))
    points, occupied = np.concatenate([wall, free]), np.arange(480) < 80
    clusters = quick_means(wall, 5.0, 5.0, 5)
    plain = cluster_frames(clusters, Cloud(points, occupied, np.ones(480)), 10.0, 0.1, FrameSettings("median", "full", "extent"))
    angle = 0.7
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    moved = Cloud(points @ turn + [3.0, -8.0], occupied, np.ones(480))
    # Eigenvectors only: a per-axis median is no vector that turns along.
    other = cluster_frames(quick_means(moved.points[:80], 5.0, 5.0, 5), moved, 10.0, 0.1, FrameSettings("seed", "full", "fixed"))
    np.testing.assert_allclose(turn.T @ plain.rotation[0], other.rotation[0], atol=1e-9)


@settings(max_examples=20)
@given(
    seed=st.integers(0, 2**32 - 1),
    dimension=st.integers(2, 3),
    cells=st.sampled_from([2, 15, 32]),
    centre=st.sampled_from(["seed", "median"]),
)
def test_a_box_as_large_as_its_cluster_has_a_cell_for_each_of_its_returns(seed, dimension, cells, centre):
    rng = np.random.default_rng(seed)
    points = rng.uniform(0, 8, (300, dimension)) + rng.choice([0.0, 5e6], dimension)
    clusters = quick_means(points, DIAMETER_M / 2, 0.9, 5, 0)
    frames = cluster_frames(clusters, Cloud(points, np.ones(300, bool), np.ones(300)), 10.0, 0.1, FrameSettings(centre, "full", "extent"))
    assert cell_index(frames, points[clusters.members], clusters.numbers, cells)[1].all()


@pytest.mark.parametrize("cells", [15, 16])
def test_a_cell_of_an_unturned_box_is_a_voxel_whatever_their_number(place, cells):
    """No side of a cell runs through a voxel: the box begins at a corner of the lattice."""
    diameter_m = cells * 0.2
    frames = cluster_frames(clusters_of(place.fit, 0), place.fit, diameter_m, 0.2, FrameSettings("seed", "none", "fixed"))
    corners = (frames.centre - diameter_m / 2) / 0.2
    np.testing.assert_allclose(corners, np.round(corners), atol=1e-6)


def test_unturned_boxes_lie_on_the_lattice(place):
    frames = frames_of(place.fit, "seed", "none", "fixed", snap_m=0.2)
    low, high = frames.boxes()
    for side in (low, high):
        np.testing.assert_allclose(side / 0.2, np.round(side / 0.2), atol=1e-6)
    seeds = clusters_of(place.fit).seeds
    assert np.abs(frames.centre - seeds).max() <= 0.1 + 1e-9


@pytest.mark.parametrize("limits", [{"AT_ONCE": 3}, {"MEMBERS_AT_ONCE": 300}, {"MEMBERS_AT_ONCE": 1}, {"FREE_AT_ONCE": 1}], ids=str)
@pytest.mark.parametrize("choice", [("median", "full", "extent"), ("median", "yaw", "fixed"), ("seed", "none", "extent")], ids="-".join)
def test_portions_of_clusters_change_nothing(place, choice, limits, monkeypatch):
    whole, shown, original = frames_of(place.fit, *choice), [], frame._frames
    for name, value in limits.items():
        monkeypatch.setattr(frame, name, value)
    monkeypatch.setattr(frame, "_frames", lambda clusters, *how: shown.append(clusters.sizes) or original(clusters, *how))
    found = frames_of(place.fit, *choice)
    for name in ("centre", "rotation", "scale"):
        np.testing.assert_array_equal(getattr(found, name), getattr(whole, name))
    most = limits.get("AT_ONCE", 256), limits.get("MEMBERS_AT_ONCE", 2**18)
    assert all(len(sizes) <= most[0] and (sizes.sum() <= most[1] or len(sizes) == 1) for sizes in shown)


def test_no_more_free_points_are_looked_at_than_fit(place, monkeypatch):
    looked_at, original = [], BucketIndex.in_portions

    def watched(self, *how):
        for some, box, point in original(self, *how):
            looked_at.append((some.stop - some.start, len(point)))
            yield some, box, point

    monkeypatch.setattr(BucketIndex, "in_portions", watched)
    monkeypatch.setattr(frame, "FREE_AT_ONCE", 5000)
    frames = frames_of(place.fit, "seed", "full", "fixed")
    assert all(points <= 5000 or boxes == 1 for boxes, points in looked_at)
    assert sum(boxes for boxes, _ in looked_at) == len(frames) and len(looked_at) > 1


def test_a_cluster_of_returns_that_coincide_has_a_box():
    points = np.concatenate([np.ones((20, 2)), np.random.default_rng(0).uniform(10, 12, (20, 2))])
    frames = frames_of(Cloud(points, np.ones(40, bool), np.ones(40)), "median", "full", "extent")
    assert frames.scale.min() == frame.LEAST_SCALE_M == 1e-3 and frames.scale.max() > 1
    assert np.isfinite(frames.into(points[:1], frames.scale.argmin(keepdims=True))).all()


@pytest.mark.parametrize("seed", range(3))
def test_a_gap_does_not_move_seed_frames_but_median_and_full_ones(place, seed):
    """The same clusters with part of their members hidden: seeds stay where they are (METHOD 3)."""
    whole = place.fit
    gaps = random_gaps(whole, 2.0, place.resolution_m, seed)
    shown = gaps.cut(whole)
    returns = shown.points[shown.occupied]
    every = whole.points[whole.occupied]
    clusters = quick_means(returns, DIAMETER_M / 2, 0.9, 5, seed)
    uncut = Clusters(clusters.seeds, cKDTree(every), DIAMETER_M / 2)
    assert len(uncut.members) > len(clusters.members)

    def both(*choice):
        given = FrameSettings(*choice)
        return cluster_frames(clusters, shown, DIAMETER_M, 0.1, given), cluster_frames(uncut, whole, DIAMETER_M, 0.1, given)

    cut, full = both("seed", "none", "fixed")
    for name in ("centre", "rotation", "scale"):
        np.testing.assert_array_equal(getattr(cut, name), getattr(full, name))
    cut, full = both("median", "full", "extent")
    assert np.abs(cut.centre - full.centre).max() > 0.05
    assert np.abs(cut.rotation - full.rotation).max() > 0.01


@pytest.mark.parametrize(("name", "value"), [("centre", "mean"), ("rotation", "pitch"), ("scale", ""), ("scale", ["fixed"])])
def test_unknown_choices_are_named(name, value):
    with pytest.raises(InputError, match=f"frame.{name}: expected one of .*, got {re.escape(repr(value))}"):
        FrameSettings(**{name: value})
