import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hilbertvae import cores
from hilbertvae.cloud import Cloud
from hilbertvae.grids import aligned_grid
from hilbertvae.grids.aligned_grid import (
    FREE,
    OCCUPIED,
    PLACE_STEPS,
    UNKNOWN,
    IndexedCloud,
    bin_places,
    bin_points,
    cell_index,
    count_code,
    vote,
)
from hilbertvae.grids.frame import Frames


def random_frames(rng, count, dimension, turned):
    rotation = np.linalg.qr(rng.normal(size=(count, dimension, dimension)))[0] if turned else np.tile(np.eye(dimension), (count, 1, 1))
    return Frames(rng.uniform(-2, 2, (count, dimension)), rotation, rng.uniform(0.8, 3, count))


def bin_by_loop(cloud, frames, cells):
    dimension = cloud.points.shape[1]
    hits, frees = np.zeros((2, len(frames), *(cells,) * dimension))
    for m in range(len(frames)):
        for point, occupied, weight in zip(cloud.points, cloud.occupied, cloud.weight, strict=True):
            inside = (point - frames.centre[m]) @ frames.rotation[m] / frames.scale[m]
            cell = tuple(int(np.floor((x + 0.5) * cells)) for x in inside)
            if all(0 <= i < cells for i in cell):
                (hits if occupied else frees)[m][cell] += weight
    return hits, frees


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), dimension=st.integers(2, 3), turned=st.booleans(), cells=st.integers(2, 6))
def test_binning_equals_brute_force(seed, dimension, turned, cells):
    rng = np.random.default_rng(seed)
    cloud = Cloud(rng.uniform(-3, 3, (80, dimension)), rng.random(80) < 0.4, rng.integers(1, 9, 80).astype(float))
    frames = random_frames(rng, 5, dimension, turned)
    for found, expected in zip(bin_points(cloud, frames, cells), bin_by_loop(cloud, frames, cells), strict=True):
        assert found.shape == expected.shape
        np.testing.assert_array_equal(found, expected)


def test_portions_of_frames_and_threads_change_nothing(monkeypatch):
    rng = np.random.default_rng(0)
    cloud = Cloud(rng.uniform(-3, 3, (300, 2)), rng.random(300) < 0.4, np.ones(300))
    frames = random_frames(rng, 11, 2, True)
    whole = bin_points(cloud, frames, 8)
    monkeypatch.setattr(aligned_grid, "CELLS_AT_ONCE", 2 * 8**2)
    monkeypatch.setattr(cores, "cores", lambda: 4)
    for found, expected in zip(bin_points(cloud, frames, 8), whole, strict=True):
        np.testing.assert_array_equal(found, expected)


def test_no_more_points_are_looked_at_than_fit(monkeypatch):
    """Of voxels finer than cells: so many boxes at a time as have few enough, or one."""
    rng, counted = np.random.default_rng(0), []
    cloud = Cloud(rng.uniform(-3, 3, (3000, 2)), rng.random(3000) < 0.4, rng.uniform(1, 2, 3000))
    frames = random_frames(rng, 30, 2, True)
    whole, places, original = bin_points(cloud, frames, 8), bin_places(cloud, frames, 8), aligned_grid.count_votes
    monkeypatch.setattr(aligned_grid, "POINTS_AT_ONCE", 1000)
    monkeypatch.setattr(
        aligned_grid,
        "count_votes",
        lambda of, found, shape: counted.append((found.count(), len(found.point))) or original(of, found, shape),
    )
    for found, expected in zip(bin_points(cloud, frames, 8), whole, strict=True):
        np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(bin_places(cloud, frames, 8), places)
    assert all(points <= 1000 or boxes == 1 for boxes, points in counted)
    assert sum(boxes for boxes, _ in counted) == 30 and 1 < len(counted) < 30


@pytest.mark.parametrize("dimension", [2, 3])
def test_boxes_of_very_different_sizes(dimension):
    """Beside many of a millimetre, buckets for which a large one would be of more than can be looked up."""
    rng = np.random.default_rng(0)
    cloud = Cloud(rng.uniform(-3, 3, (80, dimension)), rng.random(80) < 0.4, np.ones(80))
    frames = random_frames(rng, 5, dimension, True)
    usual = IndexedCloud.around(cloud, frames)
    assert usual.index.size_m == np.median(frames.scale) / 4
    mixed = Frames(np.concatenate([frames.centre, cloud.points[:9]]), np.concatenate([frames.rotation] * 3)[:14], np.full(14, 1e-3))
    mixed.scale[:5] = frames.scale
    assert IndexedCloud.around(cloud, mixed).index.size_m == frames.scale.max() / aligned_grid.LARGE / 4
    for found, expected in zip(bin_points(cloud, mixed, 4), bin_by_loop(cloud, mixed, 4), strict=True):
        np.testing.assert_array_equal(found, expected)


def test_a_box_on_the_lattice_has_a_voxel_per_cell():
    """Voxel centres of the map, one by one, fall into cells one by one."""
    index = np.stack(np.meshgrid(np.arange(13, 21), np.arange(-4, 4), indexing="ij"), axis=-1).reshape(-1, 2)
    cloud = Cloud((index + 0.5) * 0.1, np.ones(64, bool), np.arange(1.0, 65.0))
    frames = Frames(np.array([[1.7, 0.0]]), np.eye(2)[None], np.array([0.8]))
    hits, frees = bin_points(cloud, frames, 8)
    np.testing.assert_array_equal(hits[0], np.arange(1.0, 65.0).reshape(8, 8))
    assert not frees.any()


def test_points_on_lattice_planes_fall_into_the_upper_cell():
    """The lower side of a box belongs to it, the upper does not."""
    frames = Frames(np.array([[0.4, 0.4]]), np.eye(2)[None], np.array([0.8]))
    edges = np.arange(9) * 0.1
    points = np.column_stack([edges, np.full(9, 0.05)])
    cell, inside = cell_index(frames, points, np.zeros(9, int), 8)
    assert inside.tolist() == [True] * 8 + [False]
    np.testing.assert_array_equal(cell[:8], 8 * np.arange(8))


@pytest.mark.parametrize("cells", [16, 64])
@pytest.mark.parametrize("origin", [(0, 0, 0), (5_000_000, 40_000_000, 3200)], ids=["near", "map grid"])
@pytest.mark.parametrize("dimension", [2, 3])
def test_voxel_centres_in_boxes_about_voxel_centres(dimension, origin, cells):
    """Each side of a cell then runs through centres, and by integers it is plain which cell, and which box, has which, also where
    coordinates are those of a map grid."""
    rng, voxel_m, half = np.random.default_rng(0), 0.1, cells // 2
    index = np.unique(rng.integers(-half - 3, half + 3, (4000, dimension)), axis=0) + np.array(origin[:dimension])
    seeds = np.array(origin[:dimension]) + rng.integers(-3, 4, (12, dimension))
    cloud = Cloud((index + 0.5) * voxel_m, rng.random(len(index)) < 0.5, np.ones(len(index)))
    frames = Frames((seeds + 0.5) * voxel_m, np.tile(np.eye(dimension), (12, 1, 1)), np.full(12, cells * voxel_m))
    expected = np.zeros((2, 12, *(cells,) * dimension))
    for m, seed in enumerate(seeds):
        cell = index - seed + half
        inside = ((cell >= 0) & (cell < cells)).all(axis=1)
        expected[(cloud.occupied[inside].astype(int), m, *cell[inside].T)] += 1
    for found, wanted in zip(bin_points(cloud, frames, cells), expected[::-1], strict=True):
        np.testing.assert_array_equal(found, wanted)
    places = bin_places(cloud, frames, cells)
    returns = np.broadcast_to(expected[1][:, None] > 0, places.shape)
    assert (places[returns] == -PLACE_STEPS // 2).all() and not places[~returns].any()  # at the lower corner of their cells


@pytest.mark.parametrize("dimension", [2, 3])
def test_nothing_to_bin(dimension):
    frames = random_frames(np.random.default_rng(0), 3, dimension, False)
    nothing = Cloud(np.empty((0, dimension)), np.empty(0, bool), np.empty(0))
    assert [part.shape for part in bin_points(nothing, frames, 4)] == [(3, *(4,) * dimension)] * 2
    none = Frames(np.empty((0, dimension)), np.empty((0, dimension, dimension)), np.empty(0))
    some = Cloud(np.ones((4, dimension)), np.ones(4, bool), np.ones(4))
    assert [part.shape for part in bin_points(some, none, 4)] == [(0, *(4,) * dimension)] * 2


def test_votes_cell_by_cell():
    hits = np.array([[0, 1, 1, 2, 3, 14, 15, 3]], np.float32)
    frees = np.array([[0, 0, 1, 3, 1, 86, 85, 17]], np.float32)
    assert vote(hits, frees).tolist() == [[UNKNOWN, OCCUPIED, OCCUPIED, FREE, OCCUPIED, FREE, FREE, FREE]]  # the tie goes to occupied
    assert vote(hits, frees, 0.15).tolist() == [[UNKNOWN, OCCUPIED, OCCUPIED, OCCUPIED, OCCUPIED, FREE, OCCUPIED, OCCUPIED]]
    assert vote(hits, frees).dtype == np.int8
    np.testing.assert_array_equal(vote(hits.astype(int), frees.astype(int), 0.15), vote(hits, frees, 0.15))


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), dimension=st.integers(2, 3), turned=st.booleans(), cells=st.integers(2, 6))
def test_places_in_cells_equal_brute_force(seed, dimension, turned, cells):
    rng = np.random.default_rng(seed)
    cloud = Cloud(rng.uniform(-3, 3, (80, dimension)), np.ones(80, bool), rng.integers(1, 9, 80).astype(float))
    frames = random_frames(rng, 5, dimension, turned)
    found = bin_places(cloud, frames, cells)
    assert found.dtype == np.int8 and found.shape == (5, dimension, *(cells,) * dimension)
    weight, moved = np.zeros((5, *(cells,) * dimension)), np.zeros(found.shape)
    for m in range(5):
        for point, one in zip(cloud.points, cloud.weight, strict=True):
            inside = ((point - frames.centre[m]) @ frames.rotation[m] / frames.scale[m] + 0.5) * cells
            cell = tuple(np.floor(inside).astype(int))
            if all(0 <= i < cells for i in cell):
                weight[m][cell] += one
                moved[(m, slice(None), *cell)] += one * (inside - np.floor(inside) - 0.5)
    expected = PLACE_STEPS * moved / np.maximum(weight, 1)[:, None]
    np.testing.assert_allclose(found, expected, rtol=0, atol=0.5 + 1e-6)
    assert (np.abs(found) <= PLACE_STEPS / 2).all() and not found[np.broadcast_to(weight[:, None] == 0, found.shape)].any()


@given(st.lists(st.floats(0, 1e9), min_size=2))
def test_codes_of_counts_rise_and_tell_none_from_some(votes):
    votes = np.sort(np.array(votes))
    codes = count_code(votes)
    assert codes.dtype == np.int8 and (np.diff(codes.astype(int)) >= 0).all()
    assert (codes[votes == 0] == 0).all() and (codes[votes >= 1] >= 8).all()
    small = votes[votes < 30_000]
    np.testing.assert_allclose(np.expm1(count_code(small) / 12.0), small, rtol=0.05, atol=0.05)


def test_places_of_weights_beyond_double_precision():
    cloud = Cloud(np.array([[0.12, 0.3], [0.16, 0.3]]), np.ones(2, bool), np.full(2, 1e308))
    frames = Frames(np.zeros((1, 2)), np.eye(2)[None], np.ones(1))
    usual = Cloud(cloud.points, cloud.occupied, np.ones(2))
    np.testing.assert_array_equal(bin_places(cloud, frames, 4), bin_places(usual, frames, 4))


def test_weights_beyond_single_precision_stay_votes():
    cloud = Cloud(np.zeros((2, 2)), np.array([True, True]), np.array([1e39, 1.0]))
    frames = random_frames(np.random.default_rng(0), 1, 2, turned=False)
    frames.centre[:] = 0
    hits, frees = bin_points(cloud, frames, 4)
    assert np.isfinite(hits).all() and (vote(hits, frees) == OCCUPIED).sum() == 1
