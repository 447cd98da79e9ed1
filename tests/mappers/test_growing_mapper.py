"""Maps that are fitted scan by scan, against the batch on the same clusters."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from growing_toys import add, answers, clouds, network, queries_of, streamed
from scipy.spatial import cKDTree

from hilbertvae.cloud import fit_cloud
from hilbertvae.clusters.clusters import Clusters, search_tree
from hilbertvae.grids.cluster_grids import GridSettings, bin_detailed, bin_grids, frames_of
from hilbertvae.grids.frame import FrameSettings
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.saved_map import load_map, save_map
from toy_rooms import tiny_grid


def test_after_all_scans_grids_are_those_of_the_batch(place):
    """In the same boxes, to the bit: what is shown to the network, and what it makes of that."""
    whole = fit_cloud(place.scans, place.resolution_m)
    raw = streamed(HilbertMap(weights="unit", grid=tiny_grid(place.dimension)), clouds(place))
    np.testing.assert_array_equal(raw.grids_, bin_grids(whole, raw.frames_, raw.grid_))
    made = network(place.dimension)
    mapper = streamed(HilbertMap(made), clouds(place))
    expected = made.complete(bin_grids(whole, mapper.frames_, mapper.grid_), mapper.flips_)
    np.testing.assert_allclose(mapper.grids_, expected.value, rtol=1e-2, atol=1e-3)
    np.testing.assert_allclose(mapper.known_.astype(int), expected.known, rtol=0, atol=1)
    assert len(mapper.frames_) > 10


def test_a_detailed_network_is_shown_what_the_batch_shows_it(place):
    """Counts and places change where labels don't. Means add up in another order, so that a place may be the code beside it."""
    whole = fit_cloud(place.scans, place.resolution_m)
    made = network(place.dimension, encoding="detailed")
    mapper = streamed(HilbertMap(made), clouds(place))
    shown = bin_detailed(mapper.evidence_.cloud(), mapper.frames_, mapper.grid_)
    expected = bin_detailed(whole, mapper.frames_, mapper.grid_)
    np.testing.assert_array_equal(shown[:, :3], expected[:, :3])
    np.testing.assert_allclose(shown[:, 3:].astype(int), expected[:, 3:], rtol=0, atol=1)
    np.testing.assert_allclose(mapper.grids_, made.complete(shown, mapper.flips_).value, rtol=1e-2, atol=1e-3)
    assert np.abs(mapper.grids_ - made.complete(expected, mapper.flips_).value).max() < 0.1


def test_answers_are_those_of_a_batch_map_with_the_same_clusters(place):
    whole = fit_cloud(place.scans, place.resolution_m)
    mapper = streamed(HilbertMap(network(place.dimension)), clouds(place))
    batch = HilbertMap(network(place.dimension)).fit(whole.points, whole.occupied, whole.weight)
    batch.frames_, batch.seeds_, batch.grids_, batch.known_ = mapper.frames_, mapper.seeds_, mapper.grids_, mapper.known_
    for ours, theirs in zip(answers(mapper, queries_of(place)), answers(batch, queries_of(place)), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-5)


@pytest.mark.parametrize(
    "frame", [FrameSettings("median", "full", "extent"), FrameSettings("seed", "yaw", "fixed"), FrameSettings("seed", "spread", "fixed")]
)
def test_frames_are_those_of_the_batch(place, frame):
    grid = tiny_grid(place.dimension)
    grid.frame = frame
    mapper = streamed(HilbertMap(weights="unit", grid=grid), clouds(place, every=2))
    cloud = mapper.evidence_.cloud()
    found = Clusters(mapper.seeds_, search_tree(cloud.points[cloud.occupied]), grid.cluster_diameter_m / 2)
    expected = frames_of(found, cloud, grid)
    for name in ("centre", "rotation", "scale"):
        np.testing.assert_allclose(getattr(mapper.frames_, name), getattr(expected, name), rtol=0, atol=1e-9)
    assert (mapper.grids_ != bin_grids(cloud, mapper.frames_, grid)).mean() < 1e-4  # points on a cell's side


def test_every_return_has_a_seed_and_every_seed_its_room(place):
    """Quick-Means' rule: no return farther than the inner radius from all seeds, no two seeds nearer."""
    mapper = streamed(HilbertMap(weights="unit", grid=tiny_grid(place.dimension)), clouds(place))
    cloud, grid = mapper.evidence_.cloud(), mapper.grid_
    returns, seeds = cloud.points[cloud.occupied], np.concatenate([mapper.seeds_, mapper.small_seeds_])
    # A mean return moves a little with later scans, and its seed does not.
    assert cKDTree(seeds).query(returns)[0].max() <= grid.inner_radius_m + place.resolution_m
    assert not cKDTree(seeds).query_pairs(grid.inner_radius_m)
    tree, radius_m = cKDTree(returns), grid.cluster_diameter_m / 2
    assert (tree.query_ball_point(mapper.seeds_, radius_m, return_length=True) > grid.minimum_points).all()
    assert (tree.query_ball_point(mapper.small_seeds_, radius_m, return_length=True) <= grid.minimum_points).all()


def test_seeds_with_few_returns_wait_for_more():
    grid = tiny_grid()
    mapper = HilbertMap(weights="unit", grid=grid).partial_fit([[0.05, 0.05], [0.15, 0.05]], [True, True])
    assert mapper.cluster_count() == 0 and len(mapper.small_seeds_) == 1
    mapper.partial_fit([[0.25, 0.05], [0.35, 0.05]], [True, True])
    assert mapper.cluster_count() == 1 and len(mapper.small_seeds_) == 0
    assert np.count_nonzero(mapper.grids_) == 4


def test_only_what_a_scan_touches_is_reconstructed(room, monkeypatch):
    made, shown = network(2), []
    mapper = streamed(HilbertMap(made), clouds(room))
    before, frames = mapper.grids_.copy(), mapper.frames_
    original = type(made).complete
    monkeypatch.setattr(
        type(made), "complete", lambda self, grids, *rest, **named: shown.append(grids) or original(self, grids, *rest, **named)
    )
    cloud = mapper.evidence_.cloud()
    again = np.flatnonzero(cloud.occupied)[:1]
    add(mapper, cloud.select(again))
    assert not shown  # one more return where there were some: no cell of any grid changes
    beside = cKDTree(mapper.seeds_).query(cloud.points)[0] < 0.8 * mapper.grid_.inner_radius_m  # no return there makes a cluster
    free = beside & ~cloud.occupied & (cKDTree(cloud.points[cloud.occupied]).query(cloud.points)[0] > 0.2)
    place = cloud.points[np.flatnonzero(free)[0]]
    mapper.partial_fit([place], [True], [1000.0])
    low, high = frames.boxes()
    held = ((place >= low) & (place < high)).all(axis=1)
    assert [len(grids) for grids in shown] == [held.sum()] and 0 < held.sum() < len(frames)
    np.testing.assert_array_equal(mapper.grids_[~held], before[~held])
    assert (mapper.grids_[held] != before[held]).any(axis=(1, 2)).all()


def test_reconstruction_may_wait_for_a_query(place):
    parts = clouds(place)
    eager, lazy = streamed(HilbertMap(network(place.dimension)), parts), HilbertMap(network(place.dimension))
    for part in parts:
        add(lazy, part, reconstruct=False)
    waiting = pickle.loads(pickle.dumps(lazy))
    assert lazy.cluster_count() == eager.cluster_count() and lazy._growing.stale.all()
    np.testing.assert_array_equal(lazy.observed(queries_of(place)), eager.observed(queries_of(place)))
    assert lazy._growing.stale.all()
    for mapper in (lazy, waiting):
        for ours, theirs in zip(answers(mapper, queries_of(place)), answers(eager, queries_of(place)), strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=0, atol=2e-3)
    lazy.settle()
    assert not lazy._growing.stale.any()


def test_a_query_reconstructs_the_boxes_that_answer_it_and_no_others(place):
    lazy = HilbertMap(network(place.dimension))
    for part in clouds(place):
        add(lazy, part, reconstruct=False)
    here = place.fit.points[:1]
    answer = lazy.predict_proba(here)
    needed = lazy.index_.holding(here, lazy.neighbours)[0]
    assert np.flatnonzero(~lazy._growing.stale).tolist() == sorted(needed[needed >= 0])
    np.testing.assert_array_equal(lazy.settle().predict_proba(here), answer)


def test_a_fitted_map_goes_on(place):
    parts = clouds(place)
    half = len(parts) // 2
    start = fit_cloud(place.scans.select(place.scans.scan < half), place.resolution_m)
    mapper = HilbertMap(weights="unit", grid=tiny_grid(place.dimension)).fit(start.points, start.occupied, start.weight)
    first = mapper.frames_
    streamed(mapper, parts[half:])
    np.testing.assert_array_equal(mapper.frames_.centre[: len(first)], first.centre)
    whole = fit_cloud(place.scans, place.resolution_m)
    np.testing.assert_array_equal(mapper.grids_, bin_grids(whole, mapper.frames_, mapper.grid_))
    returns, seeds = whole.points[whole.occupied], np.concatenate([mapper.seeds_, mapper.small_seeds_])
    assert cKDTree(seeds).query(returns)[0].max() <= mapper.grid_.inner_radius_m + place.resolution_m
    again = HilbertMap(weights="unit", grid=tiny_grid(place.dimension)).fit(start.points, start.occupied, start.weight)
    mapper.fit(start.points, start.occupied, start.weight)  # forgets all scans
    for ours, theirs in zip(answers(mapper, queries_of(place)), answers(again, queries_of(place)), strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_the_same_scans_give_the_same_bits_and_pickles_go_on(room):
    parts = clouds(room)
    mapper = streamed(HilbertMap(network(2)), parts[:10])
    copy = pickle.loads(pickle.dumps(mapper))
    for part in parts[10:]:
        add(mapper, part)
        add(copy, part)
    again = streamed(HilbertMap(network(2)), parts)
    for ours, theirs, others in zip(*(answers(each, queries_of(room)) for each in (mapper, copy, again)), strict=True):
        np.testing.assert_array_equal(ours, theirs)
        np.testing.assert_array_equal(ours, others)


def test_free_space_of_another_storey_turns_no_box():
    """In yaw frames too: what a map that grows looks up is the box, so a batch may not look farther."""
    rng = np.random.default_rng(3)
    along, height = rng.uniform(0, 4, (2, 400)), rng.uniform(0, 2, (2, 400))
    walls = np.concatenate([np.c_[along[0], 0 * along[0], height[0]], np.c_[0 * along[1], along[1], height[1]]])
    free, sky = rng.uniform([0.2, 0.2, 0], [3, 3, 2], (600, 3)), rng.uniform([-3, -3, 9], [0, 0, 16], (3000, 3))
    grid = GridSettings(cells=8, cluster_diameter_m=3.2, inner_radius_m=0.8, minimum_points=1, frame=FrameSettings("seed", "yaw", "fixed"))
    points = np.concatenate([walls, free, sky])
    occupied = np.arange(len(points)) < len(walls)
    mapper = HilbertMap(weights="unit", grid=grid)
    for part in (occupied, ~occupied):  # the sky is seen after its boxes stand
        mapper.partial_fit(points[part], occupied[part])
    cloud = mapper.settle().evidence_.cloud()
    found = Clusters(mapper.seeds_, search_tree(cloud.points[cloud.occupied]), grid.cluster_diameter_m / 2)
    assert mapper.cluster_count() > 5
    np.testing.assert_allclose(mapper.frames_.rotation, frames_of(found, cloud, grid).rotation, rtol=0, atol=1e-9)


@pytest.mark.parametrize("rotation", ["none", "spread"])
@pytest.mark.parametrize("coarser", [1, 2])
def test_a_scan_that_says_nothing_new_changes_nothing(place, rotation, coarser):
    """Also where `fit` was given points finer than voxels, of which a map keeps one a voxel."""
    scans, rng = place.scans, np.random.default_rng(0)
    share = rng.uniform(0.1, 0.9, (len(scans), 1))
    points = np.concatenate([scans.points, scans.origins + share * (scans.points - scans.origins)])
    occupied, grid = np.arange(len(points)) < len(scans), tiny_grid(place.dimension)
    grid = replace(grid, frame=FrameSettings("seed", rotation, "fixed"))
    mapper = HilbertMap(weights="unit", grid=grid, resolution_m=coarser * place.resolution_m).fit(points, occupied)
    before = mapper.grids_.copy()
    mapper.partial_fit(points[:1], occupied[:1], np.full(1, 1e-6))
    assert len(before) == len(mapper.grids_) and np.count_nonzero(before != mapper.grids_) <= 1e-4 * before.size


def test_how_likely_a_place_is_known_is_a_probability_between_cells(place):
    made = network(place.dimension)
    made.grid.interpolated = True
    mapper = HilbertMap(made).fit(place.fit.points, place.fit.occupied, place.fit.weight)
    mapper.known_[:] = 255
    found = mapper.known(queries_of(place, 4000))
    assert found.max() == 1.0 and found.min() >= 0.0


def test_a_seed_that_is_set_counts_where_a_map_grows(room, tmp_path):
    """In memory, as in what was saved of it."""
    parts, made = clouds(room)[:6], network(2)
    checkpoint = made.save(tmp_path / "model.safetensors")
    same, mapper = (streamed(HilbertMap(made, inner_radius_m=0.4), parts[:2]) for _ in range(2))
    mapper.set_params(seed=7)
    loaded = load_map(save_map(mapper, tmp_path / "site.map"), checkpoint=checkpoint)
    for each in (same, mapper, loaded):
        streamed(each, parts[2:])
    np.testing.assert_array_equal(loaded.seeds_, mapper.seeds_)
    assert not np.array_equal(same.seeds_, mapper.seeds_)


def test_what_has_grown_is_pickled_once(place):
    mapper, parts = streamed(HilbertMap(network(place.dimension)), clouds(place)[:4]), clouds(place)[4:6]
    assert pickle.dumps(mapper).count(mapper.grids_.tobytes()) == 1
    again = pickle.loads(pickle.dumps(mapper))
    assert np.shares_memory(again.grids_, again._growing.completed.value)
    for part in parts:
        for each in (mapper, again):
            add(each, part)
    for ours, theirs in zip(answers(again, queries_of(place)), answers(mapper, queries_of(place)), strict=True):
        np.testing.assert_array_equal(ours, theirs)
