from collections import defaultdict

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hilbertvae import voxel_votes as votes_module
from hilbertvae.cloud import Cloud, fit_cloud, labelled_voxels, placed_as, points_cloud, voxel_cloud
from hilbertvae.scans.scan import Scans
from hilbertvae.voxel_votes import sorted_keys, voxel_index, voxel_votes


def random_scans(seed, count, dimension, offset_m=0.0) -> Scans:
    rng = np.random.default_rng(seed)
    origins = rng.uniform(-1, 1, (count, dimension)) + offset_m
    points = origins + rng.normal(0, 1.5, (count, dimension))
    return Scans(points, origins, np.zeros(count, np.int32), np.arange(count, dtype=np.int32))


def samples_by_loop(scans, resolution_m):
    """(sample, hit): each return, and its beam every voxel length from half a one on, as long as one cell is left before the return."""
    found = []
    for end, start in zip(scans.points, scans.origins, strict=True):
        length = np.linalg.norm(end - start)
        found.append((end, True))
        step = 0
        while (step + 1.5) * resolution_m <= length:
            found.append((start + (end - start) * ((step + 0.5) * resolution_m / length), False))
            step += 1
    return found


def votes_by_loop(scans, resolution_m):
    voxels = defaultdict(lambda: ([], []))
    for sample, hit in samples_by_loop(scans, resolution_m):
        voxels[tuple(int(np.floor(x / resolution_m)) for x in sample)][hit].append(sample)
    return voxels


@pytest.mark.parametrize(("dimension", "resolution_m", "offset_m"), [(2, 0.1, 0.0), (2, 0.35, -7.0), (3, 0.2, 0.0), (2, 0.1, 5.4e6)])
def test_votes_and_means_equal_brute_force(dimension, resolution_m, offset_m):
    scans = random_scans(1, 60, dimension, offset_m)
    votes, expected = voxel_votes(scans, resolution_m), votes_by_loop(scans, resolution_m)
    assert {tuple(index) for index in votes.index.tolist()} == set(expected)
    for k, index in enumerate(votes.index.tolist()):
        frees, hits = expected[tuple(index)]
        assert (votes.frees[k], votes.hits[k]) == (len(frees), len(hits))
        if frees:
            np.testing.assert_allclose(votes.free_mean[k], np.mean(frees, axis=0), rtol=0, atol=1e-7)
        if hits:
            np.testing.assert_allclose(votes.hit_mean[k], np.mean(hits, axis=0), rtol=0, atol=1e-7)


@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 60), dimension=st.integers(2, 3), resolution_m=st.sampled_from([0.1, 0.2, 1.3]))
def test_no_sample_is_lost_or_counted_twice(seed, count, dimension, resolution_m):
    scans = random_scans(seed, count, dimension)
    samples = samples_by_loop(scans, resolution_m)
    votes = voxel_votes(scans, resolution_m)
    assert votes.hits.sum() == count and votes.frees.sum() == len(samples) - count
    assert ((votes.hits + votes.frees) >= 1).all()
    assert len(np.unique(votes.index, axis=0)) == len(votes.index)
    # The centre of mass is kept as well.
    for weight, mean, hit in ((votes.hits, votes.hit_mean, True), (votes.frees, votes.free_mean, False)):
        total = sum((sample for sample, label in samples if label == hit), np.zeros(dimension))
        np.testing.assert_allclose((weight[:, None] * mean).sum(axis=0), total, atol=1e-8)


def test_free_samples_stop_short_of_the_return_by_about_a_cell():
    resolution_m = 0.1
    for end in np.linspace(0.01, 1.2, 60):
        scans = Scans(np.array([[end, 0.0]]), np.zeros((1, 2)), np.zeros(1, np.int32), np.zeros(1, np.int32))
        votes = voxel_votes(scans, resolution_m)
        free = votes.free_mean[votes.frees > 0, 0]
        assert (end - free >= resolution_m - 1e-9).all()
        assert not len(free) or (end - free).min() < 2 * resolution_m


def test_portions_change_nothing(monkeypatch):
    scans = random_scans(2, 80, 3)
    whole = voxel_votes(scans, 0.2)
    monkeypatch.setattr(votes_module, "SAMPLES_AT_ONCE", 50)
    parts = voxel_votes(scans, 0.2)
    np.testing.assert_array_equal(parts.index, whole.index)
    np.testing.assert_array_equal(parts.hits, whole.hits)
    np.testing.assert_array_equal(parts.frees, whole.frees)
    np.testing.assert_allclose(parts.free_mean, whole.free_mean, atol=1e-12)


def test_fit_cloud_has_a_point_per_voxel_and_label(place):
    cloud = fit_cloud(place.scans, place.resolution_m)
    for label in (False, True):
        index = voxel_index(cloud.points[cloud.occupied == label], place.resolution_m)
        assert len(np.unique(index, axis=0)) == len(index)
    assert cloud.weight[cloud.occupied].sum() == len(place.scans)
    votes = voxel_votes(place.scans, place.resolution_m)
    assert cloud.weight[~cloud.occupied].sum() == votes.frees.sum()
    assert len(cloud) == (votes.hits > 0).sum() + (votes.frees > 0).sum()


def test_a_mean_of_samples_on_the_side_of_a_voxel_stays_in_the_voxel():
    """Else a thinned point would lie in a voxel that holds none of its samples, and gaps would cut the clouds differently."""
    rng = np.random.default_rng(0)
    points = np.column_stack([np.repeat([0.7, 1.4, 2.3, -1.1, 2.8], 400), rng.uniform(0, 3, 2000)])
    scans = Scans(points, np.full((2000, 2), 0.33), np.zeros(2000, np.int32), np.arange(2000, dtype=np.int32))
    seen = {tuple(index) for index in voxel_index(points, 0.1).tolist()}
    cloud = fit_cloud(scans, 0.1)
    assert {tuple(index) for index in voxel_index(cloud.points[cloud.occupied], 0.1).tolist()} == seen


def test_voxels_are_occupied_from_fifteen_percent_of_returns_on():
    # Twenty beams along a corridor's axis cross the voxel around x = 0.55; k more end in it.
    for returns, occupied in ((3, False), (4, True)):
        through = np.tile([[2.05, 0.05]], (20, 1))
        stopped = np.tile([[0.55, 0.05]], (returns, 1))
        points = np.concatenate([through, stopped])
        number = np.arange(len(points), dtype=np.int32)
        scans = Scans(points, np.full(points.shape, 0.05), np.zeros_like(number), number)
        cloud = voxel_cloud(scans, 0.1)
        at = np.flatnonzero((voxel_index(cloud.points, 0.1) == [5, 0]).all(axis=1))
        assert len(at) == 1
        assert cloud.occupied[at[0]] == occupied == (returns / (20 + returns) >= 0.15)


def test_voxel_cloud_by_brute_force():
    scans = random_scans(5, 200, 2)
    cloud, expected = voxel_cloud(scans, 0.3), votes_by_loop(scans, 0.3)
    assert len(cloud) == len(expected) and (cloud.weight == 1).all()
    for point, occupied in zip(cloud.points, cloud.occupied, strict=True):
        index = tuple(int(np.floor(x / 0.3)) for x in point)
        np.testing.assert_allclose(point, (np.array(index) + 0.5) * 0.3)
        frees, hits = expected[index]
        assert occupied == (len(hits) >= 0.15 * (len(hits) + len(frees)))


@pytest.mark.parametrize("dimension", [2, 3])
def test_points_cloud_follows_the_authors_rule(dimension):
    scans = random_scans(3, 300, dimension)
    scans = Scans(scans.origins + 4 * (scans.points - scans.origins), scans.origins, scans.scan, scans.beam)
    cloud, beam = points_cloud(scans, 0.1)
    np.testing.assert_array_equal(cloud.points[: len(scans)], scans.points)
    np.testing.assert_array_equal(cloud.occupied, np.arange(len(cloud)) < len(scans))
    for k in range(len(scans)):
        start, end = scans.origins[k], scans.points[k]
        length = np.linalg.norm(end - start)
        free = cloud.points[(beam == k) & ~cloud.occupied]
        assert len(free) == max(1, int(length / 2))
        along = (free - start) @ (end - start) / length
        np.testing.assert_allclose(free, start + along[:, None] * (end - start) / length, atol=1e-9)
        assert (along >= 0).all() and (along <= max(length - 0.1, 0) + 1e-9).all()


def test_points_cloud_is_fixed_by_its_seed_and_uniform():
    scans = Scans(np.tile([[40.0, 0.0]], (200, 1)), np.zeros((200, 2)), np.zeros(200, np.int32), np.arange(200, dtype=np.int32))
    first, again, other = points_cloud(scans, 0.1)[0], points_cloud(scans, 0.1)[0], points_cloud(scans, 0.1, seed=1)[0]
    np.testing.assert_array_equal(first.points, again.points)
    assert (first.points != other.points).any()
    quarter = np.histogram(first.points[~first.occupied, 0], bins=4, range=(0, 39.9))[0]
    np.testing.assert_allclose(quarter / quarter.sum(), 0.25, atol=0.04)  # 4000 points: one standard deviation is 0.007
    assert 39.8 < first.points[~first.occupied, 0].max() <= 39.9  # a cell short of the return


@given(st.lists(st.integers(0, 5) | st.integers(0, 2**62), min_size=1, max_size=50))
def test_keys_are_sorted_as_argsort_does_however_large(keys):
    keys = np.array(keys, np.int64)
    order, found = sorted_keys(keys)
    np.testing.assert_array_equal(order, np.argsort(keys, kind="stable"))
    np.testing.assert_array_equal(found, np.sort(keys))


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_cloud_is_placed_as_one_of_some_of_its_scans(dimension):
    """Against one voxel after the other: of its own label if the other has one, else of the other label, else where it was."""
    rng = np.random.default_rng(dimension)
    scans = Scans(
        rng.uniform(-1, 1, (300, dimension)), rng.uniform(-1, 1, (300, dimension)), np.repeat(np.arange(10), 30), np.tile(np.arange(30), 10)
    )
    whole, some = fit_cloud(scans, 0.1), fit_cloud(scans.select(scans.scan % 3 == 0), 0.1)
    theirs = {}
    for point, occupied in zip(some.points, some.occupied, strict=True):
        theirs[(*np.floor(point / 0.1), occupied)] = point
    placed, kinds = placed_as(whole, some, 0.1), [0, 0, 0]
    for point, before, occupied in zip(placed.points, whole.points, whole.occupied, strict=True):
        voxel = tuple(np.floor(before / 0.1))
        options = [theirs.get((*voxel, occupied)), theirs.get((*voxel, not occupied)), before]
        kind = next(kind for kind, option in enumerate(options) if option is not None)
        kinds[kind] += 1
        np.testing.assert_array_equal(point, options[kind])
    assert min(kinds) > 10
    np.testing.assert_array_equal(placed.weight, whole.weight)
    np.testing.assert_array_equal(placed.occupied, whole.occupied)


def test_a_cloud_placed_as_nothing_stays():
    cloud = Cloud(np.zeros((1, 2)), np.ones(1, bool), np.ones(1))
    nothing = cloud.select(np.zeros(1, bool))
    assert placed_as(cloud, nothing, 0.1) is cloud and placed_as(nothing, cloud, 0.1) is nothing


def test_voxels_of_a_fit_cloud_have_the_labels_of_all_its_scans(place):
    found = labelled_voxels(fit_cloud(place.scans, place.resolution_m), place.resolution_m)
    wanted = voxel_cloud(place.scans, place.resolution_m)
    ours, theirs = (np.lexsort(cloud.points.T) for cloud in (found, wanted))
    np.testing.assert_allclose(found.points[ours], wanted.points[theirs])
    np.testing.assert_array_equal(found.occupied[ours], wanted.occupied[theirs])
    assert not len(labelled_voxels(found.select(slice(0)), place.resolution_m))


def test_a_voxel_counts_once_by_its_votes():
    """Of 100 beams 15 end in the first voxel, of 100 others 14 in the second; the third is free, and lies below zero."""
    points = np.array([[0.01, 0.02], [0.05, 0.09], [0.11, 0.0], [0.19, 0.05], [-0.01, 0.05]])
    cloud = Cloud(points, np.array([True, False, True, False, False]), np.array([15.0, 85.0, 14.0, 86.0, 3.0]))
    found = labelled_voxels(cloud, 0.1)
    np.testing.assert_allclose(found.points, [[-0.05, 0.05], [0.05, 0.05], [0.15, 0.05]])
    assert found.occupied.tolist() == [False, True, False] and (found.weight == 1).all()
