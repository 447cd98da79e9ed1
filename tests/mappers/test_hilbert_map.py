import pickle
import time
from dataclasses import replace

import numpy as np
import pytest
from hilbert_map_toys import fit, gapped, learned, reconstructor
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.base import clone

from hilbertvae import cores as cores_module
from hilbertvae.checks import InputError
from hilbertvae.cloud import Cloud
from hilbertvae.grids.cluster_grids import GridSettings, bin_grids, find_frames
from hilbertvae.mappers import evidence, growing_mapper
from hilbertvae.mappers.evidence import Evidence
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.saved_map import load_map, save_map
from hilbertvae.voxel_votes import voxel_index
from toy_rooms import tiny_grid


def away_by_loop(query, cloud, resolution_m):
    """How far the nearest voxel with a return is, at most 2.5 m; infinite unless the middle of a voxel with a point lies within 4 m."""
    distance = np.linalg.norm((np.floor(cloud.points / resolution_m) + 0.5) * resolution_m - query, axis=1)
    return min(distance[cloud.occupied].min(), 2.5) if (distance < 4).any() else np.inf


def answers_by_loop(mapper, cloud, queries, grids):
    """Eq. 7, 8 and 14 for each query by itself, from grids, frames and evidence."""
    frames, evidence = mapper.frames_, Evidence(cloud.points, cloud.occupied, cloud.weight, mapper.evidence_.resolution_m)
    weights, cells = mapper.rank_weights_, grids.shape[1]
    found = []
    for query in queries:
        held = []
        for m in range(len(frames)):
            inside = (query - frames.centre[m]) / frames.scale[m] + 0.5
            if ((inside >= 0) & (inside < 1)).all():
                factor = 1.0 if mapper.factors_ is None else mapper.factors_[m]
                cell = tuple((inside * cells).astype(int))
                held.append((np.linalg.norm(query - frames.centre[m]), factor * grids[m][cell], grids[m][cell]))
        values = [value for _, value, _ in sorted(held)[: mapper.neighbours]]
        apart = np.std([plain for *_, plain in sorted(held)[: mapper.neighbours]] or [0.0])  # of the boxes themselves
        voxel = evidence.find(query[None])
        if mapper.evidence and voxel[0] >= 0:
            features = [*evidence.features(query[None], voxel)[0], np.mean(values) if values else 0.0, 1.0]
            logit = np.dot(weights.seen, features)
        elif values:
            louder = mapper.neighbours / len(values) if weights.level else 1.0
            logit = np.dot(weights.unseen[: len(values)], values) * louder + weights.unseen[-1] + weights.spread * apart
        else:
            away = away_by_loop(query, cloud, evidence.resolution_m)
            logit = weights.beyond @ [away, 1.0] if mapper.evidence and np.isfinite(away) else 0.0
        found.append(1 / (1 + np.exp(-logit)))
    return found


def test_answers_equal_brute_force(fitted):
    mapper, place = fitted
    cloud = gapped(place)
    low, high = place.fit.points.min(axis=0) - 1, place.fit.points.max(axis=0) + 1
    queries = np.random.default_rng(0).uniform(low, high, (150, place.dimension))
    grids = bin_grids(cloud, find_frames(cloud, mapper.grid_, 0), mapper.grid_)
    if mapper.reconstructor is not None:
        grids = mapper.reconstructor.complete(grids, mapper.flips_).value.astype(float)
    expected = answers_by_loop(mapper, cloud, queries, grids)
    np.testing.assert_allclose(mapper.predict_proba(queries)[:, 1], expected, rtol=0, atol=1e-4)
    assert np.std(expected) > 0.01


def test_without_evidence_only_grids_answer(room):
    cloud = gapped(room)
    mapper = fit(HilbertMap(reconstructor(), evidence=False), cloud)
    np.testing.assert_array_equal(mapper.rank_weights_.unseen, learned()["everywhere"])
    queries = cloud.points[::50]
    np.testing.assert_allclose(
        mapper.predict_proba(queries)[:, 1], answers_by_loop(mapper, cloud, queries, mapper.grids_), rtol=0, atol=1e-4
    )
    assert mapper.observed(queries).all()


def test_whether_evidence_joins_and_gaps_are_filled_is_settled_by_the_fit(room, tmp_path):
    cloud = gapped(room)
    mapper = fit(HilbertMap(reconstructor()), cloud)
    queries = np.concatenate([cloud.points[::50], [mapper.frames_.boxes()[1].max(axis=0) + 0.3]])  # the last is in no box
    before = mapper.predict_proba(queries)
    mapper.set_params(evidence=False, fill=False)
    np.testing.assert_array_equal(mapper.predict_proba(queries), before)
    np.testing.assert_array_equal(load_map(save_map(mapper, tmp_path / "map")).predict_proba(queries), before)
    assert np.abs(fit(mapper.set_params(fill=True), cloud).predict_proba(queries) - before).max() > 0.01


def test_where_nothing_is_known_the_answer_is_exactly_one_half(fitted):
    mapper, place = fitted
    low, high = mapper.frames_.boxes()
    low, high = low.min(axis=0), high.max(axis=0)
    outside = np.concatenate([low - [[4.2], [9.0], [1e6]], high + [[4.2], [9.0], [1e6]]])
    assert not mapper.observed(outside).any()
    np.testing.assert_array_equal(mapper.predict_proba(outside), 0.5)


def test_beyond_all_boxes_and_near_what_was_seen_the_answer_is_learned(place):
    cloud = gapped(place)
    mapper = fit(HilbertMap(reconstructor(place.dimension)), cloud)
    low, high = mapper.frames_.boxes()
    outside = np.stack([low.min(axis=0) - 0.3, high.max(axis=0) + 0.3])
    away = np.array([away_by_loop(query, cloud, mapper.evidence_.resolution_m) for query in outside])
    np.testing.assert_allclose(mapper.predict_proba(outside)[:, 1], 1 / (1 + np.exp(0.4 * away + 0.3)))
    np.testing.assert_array_equal(mapper.predict_map(outside), 0.5)  # shown as unknown all the same
    np.testing.assert_array_equal(mapper.predict_std(outside), 0.5)
    for others in ({"fill": False}, {"weights": "unit"}, {"evidence": False}):
        plain = fit(HilbertMap(reconstructor(place.dimension), **others), cloud)
        np.testing.assert_array_equal(plain.predict_proba(outside), 0.5)


def test_where_no_box_holds_a_query_evidence_answers_alone(room):
    """A wall, and free points far away from any return: seen, but in no box."""
    rng = np.random.default_rng(0)
    wall, far = np.column_stack([rng.uniform(0, 3, 60), rng.normal(0, 0.02, 60)]), rng.uniform(50, 51, (40, 2))
    cloud = Cloud(np.concatenate([wall, far]), np.arange(100) < 60, np.full(100, 4.0))
    for weights in ("unit", "rank"):
        mapper = fit(HilbertMap(reconstructor(), weights=weights), cloud)
        holding = mapper.index_.holding(far, 5)
        assert (holding == -1).all()
        expected = answers_by_loop(mapper, cloud, far, mapper.grids_)
        np.testing.assert_allclose(mapper.predict_proba(far)[:, 1], expected, rtol=0, atol=1e-4)
    unit = fit(HilbertMap(weights="unit", grid=tiny_grid()), cloud)
    assert (unit.predict_proba(far)[:, 1] < 0.4).all() and (unit.predict_proba(wall)[:, 1] > 0.6).all()


@settings(max_examples=10)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 60), pieces=st.integers(1, 5))
def test_each_query_is_answered_alone(fitted, seed, count, pieces):
    mapper, place = fitted
    rng = np.random.default_rng(seed)
    chosen = rng.integers(0, len(place.voxels), count)
    queries = place.voxels.points[chosen] + rng.choice([0.0, 0.03, 2.0]) * rng.normal(size=(count, place.dimension))
    whole, order = mapper.predict_proba(queries), rng.permutation(count)
    np.testing.assert_array_equal(mapper.predict_proba(queries[order]), whole[order])
    cuts = np.sort(rng.integers(0, count + 1, pieces))
    parts = [mapper.predict_proba(part) for part in np.split(queries, cuts)]
    np.testing.assert_array_equal(np.concatenate(parts), whole)


@pytest.mark.parametrize("far_m", [[], [1e9]], ids=["near", "and-far"])
def test_answers_do_not_depend_on_the_chunk(fitted, monkeypatch, far_m):
    mapper, place = fitted
    queries = np.concatenate([place.voxels.points[::5], np.full((len(far_m), place.dimension), np.reshape(far_m, (-1, 1)))])
    queries = queries[np.random.default_rng(0).permutation(len(queries))]
    whole = mapper.predict_proba(queries)
    monkeypatch.setattr(type(mapper), "chunk", 97)
    np.testing.assert_array_equal(mapper.predict_proba(queries), whole)


def test_probabilities_are_probabilities(fitted):
    mapper, place = fitted
    found = mapper.predict_proba(place.voxels.points)
    assert found.shape == (len(place.voxels), 2) and found.dtype == np.float64
    assert ((found >= 0) & (found <= 1)).all()
    np.testing.assert_allclose(found.sum(axis=1), 1.0)
    np.testing.assert_array_equal(mapper.predict(place.voxels.points), found[:, 1] > 0.5)


def test_what_was_observed_is_looked_up(room):
    cloud = gapped(room)
    mapper = fit(HilbertMap(weights="unit", grid=tiny_grid()), cloud)
    seen = {tuple(index) for index in voxel_index(cloud.points, 0.1).tolist()}
    queries = np.random.default_rng(0).uniform(-4, 6, (500, 2))
    np.testing.assert_array_equal(mapper.observed(queries), [tuple(index) in seen for index in voxel_index(queries, 0.1).tolist()])


def test_the_same_cloud_gives_the_same_bits(place):
    cloud, queries = gapped(place), place.voxels.points[::7]
    first, again, other = (fit(HilbertMap(reconstructor(place.dimension), seed=seed), cloud).predict_proba(queries) for seed in (0, 0, 1))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


def test_calibration_chooses_the_weights(room):
    made = reconstructor()
    for reading in ("voxels", "points"):
        mapper = fit(HilbertMap(made, calibration=reading), gapped(room))
        np.testing.assert_array_equal(mapper.rank_weights_.unseen, made.map_weights[reading]["unseen"])
    made.map_weights = {}  # never learned: as in the author's real-time code
    np.testing.assert_array_equal(fit(HilbertMap(made), gapped(room)).rank_weights_.unseen, [1, 1, 1, 1, 1, 0])


def test_maps_of_one_reading_may_be_read_between_cells(place):
    """They answer as if all were, and those of the other as if none were; what is set after a fit waits for the next."""
    made, cloud = reconstructor(place.dimension), gapped(place)
    queries = np.random.default_rng(0).uniform(place.fit.points.min(axis=0), place.fit.points.max(axis=0), (500, place.dimension))
    answers = {}
    for interpolated in (False, True, "voxels", "points"):
        for reading in ("voxels", "points"):
            grid = replace(made.grid, interpolated=interpolated)
            mapper = fit(HilbertMap(made, calibration=reading, grid=grid), cloud).set_params(calibration="voxels")
            answers[interpolated, reading] = np.column_stack(
                [ask(queries) for ask in (mapper.predict_map, mapper.predict_std, mapper.known)]
            )
    for reading in ("voxels", "points"):
        assert (answers[True, reading] != answers[False, reading]).any(axis=0).all()
        for interpolated in ("voxels", "points"):
            np.testing.assert_array_equal(answers[interpolated, reading], answers[interpolated == reading, reading])


def test_parameters_and_clone():
    made, grid = reconstructor(), GridSettings(cells=8)
    mapper = HilbertMap(made, weights="unit", calibration="points", neighbours=3, flips=2, evidence=False, ridge=2.0, grid=grid, seed=7)
    parameters = mapper.get_params()
    assert parameters["reconstructor"] is made and parameters["grid"] is grid
    copy = clone(mapper)
    for name in ("weights", "calibration", "neighbours", "flips", "evidence", "ridge", "seed", "resolution_m", "device"):
        assert getattr(copy, name) == parameters[name]
    assert not hasattr(copy, "grids_")
    assert mapper.set_params(neighbours=4).neighbours == 4


def test_labels_of_any_kind(room):
    cloud = gapped(room)
    plain = fit(HilbertMap(grid=tiny_grid()), cloud)
    signed = HilbertMap(grid=tiny_grid()).fit(cloud.points, np.where(cloud.occupied, 1, -1), cloud.weight)
    np.testing.assert_array_equal(signed.predict_proba(cloud.points), plain.predict_proba(cloud.points))
    assert set(signed.predict(cloud.points)) == {-1, 1}


@pytest.mark.parametrize("weights", ["unit", "cluster"])
def test_a_cloud_without_clusters_answers_from_evidence(weights, room):
    """Too few returns for any cluster: no grid, but what was observed is known, and 0.5 elsewhere."""
    cloud = gapped(room)
    few = np.flatnonzero(cloud.occupied)[:2]
    cloud = cloud.select(np.concatenate([few, np.flatnonzero(~cloud.occupied)]))
    mapper = fit(HilbertMap(reconstructor(), weights=weights), cloud)
    assert len(mapper.frames_) == 0
    assert (mapper.predict_proba(cloud.points[cloud.occupied])[:, 1] != 0.5).all()
    np.testing.assert_array_equal(mapper.predict_proba([[90.0, 90.0]]), 0.5)


def test_the_size_of_a_map_is_that_of_its_arrays(room):
    mapper = HilbertMap(grid=tiny_grid()).fit(room.fit.points, room.fit.occupied, room.fit.weight)
    assert mapper.cluster_count() == len(mapper.frames_) > 0
    assert mapper.grids_.nbytes < mapper.stored_bytes() < len(pickle.dumps(mapper)) + 10_000


def test_without_filling_it_knows_what_was_observed_alone(place):
    cloud = gapped(place)
    mapper = fit(HilbertMap(reconstructor(place.dimension), fill=False), cloud)
    whole = fit(HilbertMap(reconstructor(place.dimension)), cloud)
    low, high = cloud.points.min(axis=0) - 1, cloud.points.max(axis=0) + 1
    queries = np.random.default_rng(0).uniform(low, high, (300, place.dimension))
    found, observed = mapper.predict_proba(queries)[:, 1], whole.observed(queries)
    assert mapper.cluster_count() == 0 and 0 < observed.sum() < 300
    np.testing.assert_array_equal(mapper.observed(queries), observed)
    np.testing.assert_array_equal(found[~observed], 0.5)
    assert (found[observed] != 0.5).all()
    np.testing.assert_array_equal(mapper.predict_map(queries), found)
    with pytest.raises(InputError, match="fill: expected a map that fills gaps for partial_fit"):
        mapper.partial_fit(cloud.points, cloud.occupied)
    mapper.set_params(fill=True)  # takes effect with the next fit
    with pytest.raises(InputError, match="fill: expected a map that fills gaps for partial_fit"):
        mapper.partial_fit(cloud.points, cloud.occupied)


def test_what_answers_are_looked_up_with_is_made_once_whatever_the_threads(room, monkeypatch):
    """Queries beyond all boxes, too, which ask how far away returns are: a few of what lies around them, more of all that was seen."""
    mapper = fit(HilbertMap(reconstructor()), room.fit)
    mapper.chunk, made = 50, []
    queries = np.random.default_rng(0).uniform(-3, 13, (2000, 2))
    for module, name in ((growing_mapper, "FrameIndex"), (evidence, "Nearness")):
        slow = getattr(module, name)
        monkeypatch.setattr(module, name, lambda *given, name=name, slow=slow: (time.sleep(0.02), made.append(name), slow(*given))[-1])
    monkeypatch.setattr(cores_module, "cores", lambda: 8)
    mapper.predict_proba(queries)
    assert made.count("FrameIndex") == 1 and made.count("Nearness") <= 4
    made.clear()
    mapper.predict_proba(queries)
    assert not made
