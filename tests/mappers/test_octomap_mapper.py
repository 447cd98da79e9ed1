"""The OctoMap baseline against sums in plain Python and against octomap's own search."""

import copy
import math
import pickle
from collections import defaultdict

import numpy as np
import octomap
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.base import clone

from hilbertvae.checks import InputError
from hilbertvae.mappers.mapper import FREE_BELOW, OCCUPIED_ABOVE
from hilbertvae.mappers.octomap_mapper import OctoMapMapper
from hilbertvae.voxel_votes import voxel_index


def room(dimension=2, count=600, seed=0, most=12):
    """Points in a room of 6 m, occupied within 0.2 m of its west and south walls, with counts up to `most`."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(0, 6, (count, dimension)) - 1.3
    return points, (points[:, :2] < -1.1).any(axis=1), rng.integers(1, most + 1, count).astype(float)


def logit(probability):
    return math.log(probability / (1 - probability))


def answers_of_twin(mapper, points, occupied, weight, queries, resolution_m):
    """Every sample on its own, frees first and then hits; sums clamped after each."""
    low, high = logit(mapper.clamp_min), logit(mapper.clamp_max)
    sums = defaultdict(float)
    for hit, step in ((False, logit(mapper.prob_miss)), (True, logit(mapper.prob_hit))):
        for point, label, samples in zip(points, occupied, weight, strict=True):
            voxel = tuple(math.floor(x / resolution_m) for x in point)
            for _ in range(int(samples) if label == hit else 0):
                sums[voxel] = min(max(sums[voxel] + step, low), high)
    voxels = [tuple(math.floor(x / resolution_m) for x in query) for query in queries]
    return np.array([1 / (1 + math.exp(-sums[voxel])) if voxel in sums else 0.5 for voxel in voxels])


@settings(max_examples=20)
@given(
    seed=st.integers(0, 2**32 - 1),
    dimension=st.integers(2, 3),
    resolution_m=st.sampled_from([None, 0.3, 1.1]),
    offset_m=st.sampled_from([0.0, -1234.5, 5.3e6]),
    given=st.sampled_from([{}, {"prob_hit": 0.6, "prob_miss": 0.45}, {"clamp_min": 0.3, "clamp_max": 0.9}]),
)
def test_answers_by_brute_force(seed, dimension, resolution_m, offset_m, given):
    rng = np.random.default_rng(seed)
    points, occupied = rng.uniform(-2, 2, (120, dimension)) + offset_m, rng.random(120) < 0.4
    occupied[:2] = False, True
    weight = rng.integers(1, 15, 120).astype(float)
    queries = np.concatenate([points, rng.uniform(-3, 3, (100, dimension)) + offset_m])
    mapper = OctoMapMapper(resolution_m, **given).fit(points, occupied, weight)
    expected = answers_of_twin(mapper, points, occupied, weight, queries, resolution_m or {2: 0.1, 3: 0.2}[dimension])
    np.testing.assert_allclose(mapper.predict_proba(queries)[:, 1], expected, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(mapper.observed(points), True)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("offset_m", [0.0, 6.1e5])
def test_answers_equal_octomaps_search(dimension, offset_m):
    points, occupied, weight = room(dimension, 3000)
    mapper = OctoMapMapper().fit(points + offset_m, occupied, weight)
    tree = mapper.tree()
    queries = np.random.default_rng(1).uniform(-2, 6, (2000, dimension)) + offset_m
    keys = voxel_index(queries, mapper.resolution_) - mapper.shift_.astype(int) + 32768
    keys = np.column_stack([keys, np.full((len(keys), 3 - dimension), 32768)])
    expected = np.full(len(queries), 0.5)
    key = octomap.OcTreeKey()
    for number, words in enumerate(keys.tolist()):
        for axis, word in enumerate(words):
            key[axis] = word
        try:
            expected[number] = tree.search(key).getOccupancy()
        except octomap.NullPointerException:
            continue
    answers = mapper.predict_proba(queries)[:, 1]
    np.testing.assert_allclose(answers, expected, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(mapper.observed(queries), expected != 0.5)
    assert 0.02 < (answers != 0.5).mean() < 0.95


def test_a_map_of_two_axes_is_one_layer():
    points, occupied, weight = room()
    flat = OctoMapMapper(0.2).fit(points, occupied, weight)
    middle = np.full((len(points), 1), 0.1)
    deep = OctoMapMapper(0.2).fit(np.hstack([points, middle]), occupied, weight)
    queries = np.random.default_rng(1).uniform(-2, 6, (500, 2))
    for height, found in ((0.0, flat.predict_proba(queries)), (0.199, flat.predict_proba(queries)), (-0.001, 0.5), (0.201, 0.5)):
        np.testing.assert_array_equal(deep.predict_proba(np.column_stack([queries, np.full(500, height)])), found)
    tree = flat.tree()  # octomap's iterators do not keep their tree
    assert [leaf.getZ() for leaf in tree.begin_leafs()] == pytest.approx([0.1] * len(flat.leaves_))


def test_one_miss_is_free_one_hit_is_occupied_and_nothing_is_unknown():
    mapper = OctoMapMapper().fit([[0.05, 0.05], [0.55, 0.05]], [False, True])
    miss, hit, nothing = mapper.predict_proba([[0.01, 0.09], [0.59, 0.01], [0.3, 0.05]])[:, 1]
    assert 0.4 <= miss <= FREE_BELOW and hit == pytest.approx(0.7, abs=1e-7) and hit > OCCUPIED_ABOVE and nothing == 0.5


@pytest.mark.parametrize(("frees", "hits", "p"), [(1000, 0, 0.1192), (0.01, 1e9, 0.971), (1e300, 1e-3, 0.11929), (1e6, 3, 0.6323)])
def test_sums_are_clamped_frees_before_hits(frees, hits, p):
    points, labels = np.array([[0.05, 0.05], [0.05, 0.05], [3.0, 3.0]]), [False, True, True]
    mapper = OctoMapMapper().fit(points, labels, [frees, hits, 1])
    assert mapper.predict_proba(points)[0, 1] == pytest.approx(p, abs=1e-4)


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_weight_counts_like_as_many_samples_in_any_order(dimension):
    points, occupied, weight = room(dimension)
    whole = OctoMapMapper().fit(points, occupied, weight)
    copies = np.random.default_rng(2).permutation(np.repeat(np.arange(len(points)), weight.astype(int)))
    repeated = OctoMapMapper().fit(points[copies], occupied[copies])
    np.testing.assert_array_equal(repeated.predict_proba(points), whole.predict_proba(points))
    half = OctoMapMapper().fit(np.repeat(points, 2, axis=0), np.repeat(occupied, 2), np.repeat(weight / 2, 2))
    np.testing.assert_allclose(half.predict_proba(points), whole.predict_proba(points), rtol=0, atol=1e-6)


@settings(max_examples=15)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 70), pieces=st.integers(1, 5))
def test_each_query_is_answered_alone(seed, count, pieces):
    rng = np.random.default_rng(seed)
    for dimension in (2, 3):
        mapper = OctoMapMapper().fit(*room(dimension))
        mapper.chunk = int(rng.integers(5, 100))
        queries = rng.uniform(-2, 6, (count, dimension))
        order, cuts = rng.permutation(count), np.sort(rng.integers(0, count + 1, pieces))
        whole = mapper.predict_proba(queries)
        np.testing.assert_array_equal(mapper.predict_proba(queries[order]), whole[order])
        np.testing.assert_array_equal(np.concatenate([mapper.predict_proba(part) for part in np.split(queries, cuts)]), whole)


def test_far_clouds_are_shifted_by_whole_voxels_and_others_are_not():
    points, occupied, weight = room()
    near = OctoMapMapper(0.125).fit(points, occupied, weight)
    assert not near.shift_.any()
    # Offsets that are exact in float64, so that each voxel keeps its points.
    points = np.round(points * 4096) / 4096
    near = near.fit(points, occupied, weight).predict_proba(points)
    offset_m = np.array([500_000.0, 5_300_000.0])
    far = OctoMapMapper(0.125).fit(points + offset_m, occupied, weight)
    np.testing.assert_array_equal(far.predict_proba(points + offset_m), near)
    assert (far.shift_ == np.rint(far.shift_)).all() and (np.abs(far.shift_ * 0.125 - offset_m) < 10).all()
    one_axis = OctoMapMapper(0.125).fit(points + [0, 5_300_000.0], occupied, weight)
    assert one_axis.shift_[0] == 0 and one_axis.shift_[1] > 0


@pytest.mark.parametrize("first", [-32768, -32767, -40000, 0, 1, 10**7])
def test_as_many_voxels_as_a_tree_has(first):
    points = (np.array([[first, 0.0], [first + 65535, 0.0], [first + 20000, 3.0]]) + 0.5) * 0.25
    mapper = OctoMapMapper(0.25).fit(points, [True, False, True])
    np.testing.assert_allclose(mapper.predict_proba(points)[:, 1], [0.7, 0.4, 0.7], atol=1e-6)
    np.testing.assert_array_equal(mapper.predict_proba(points + [65536 * 0.25, 0.0])[:, 1], 0.5)
    points[1, 0] += 0.25
    with pytest.raises(InputError, match="65536 voxels of 0.25 m per axis.*outlier"):
        mapper.fit(points, [True, False, True])


def test_bad_settings_and_clouds_are_refused():
    points, occupied, weight = room(count=50)
    for name, value in [
        ("resolution_m", 0.0),
        ("resolution_m", "fine"),
        ("prob_hit", 0.5),
        ("prob_hit", 1),
        ("prob_miss", 0.6),
        ("prob_miss", True),
        ("clamp_min", 0.5),
        ("clamp_min", -0.1),
        ("clamp_max", 1.0),
        ("clamp_max", float("nan")),
    ]:
        with pytest.raises(InputError, match=f"{name}: expected a"):
            OctoMapMapper(**{name: value}).fit(points, occupied, weight)
    with pytest.raises(InputError, match="one class only"):
        OctoMapMapper().fit(points, np.ones(50, bool))
    for dimension in (1, 4):
        with pytest.raises(InputError, match=r"shape \(N, 2\) or \(N, 3\)"):
            OctoMapMapper().fit(np.ones((4, dimension)), [0, 1, 0, 1])
    for far in (1e12, 1e300, 1e308):
        with pytest.raises(InputError, match="outlier"):
            OctoMapMapper().fit([[0.0, 0.0], [far, 0.0]], [0, 1])


@pytest.mark.parametrize("dimension", [2, 3])
def test_no_queries_and_far_queries(dimension):
    mapper = OctoMapMapper().fit(*room(dimension))
    assert mapper.predict_proba(np.empty((0, dimension))).shape == (0, 2)
    for far in (3276.8, -3276.9, 6553.5, 1e12, -1e300, 1.7e308):
        np.testing.assert_array_equal(mapper.predict_proba(np.full((1, dimension), far)), 0.5)


def test_copies_are_their_own_and_plain():
    points, occupied, weight = room(3)
    mapper = OctoMapMapper(prob_hit=0.8).fit(points, occupied, weight)
    expected = mapper.predict_proba(points)
    for twin in (pickle.loads(pickle.dumps(mapper)), copy.deepcopy(mapper)):
        np.testing.assert_array_equal(twin.predict_proba(points), expected)
        twin.leaves_.log_odds[:] = 0
        np.testing.assert_array_equal(mapper.predict_proba(points), expected)
        assert twin.get_params() == mapper.get_params() and twin.tree().getProbHit() == pytest.approx(0.8)
    assert not hasattr(clone(mapper), "leaves_") and clone(mapper).prob_hit == 0.8


@pytest.mark.parametrize("resolution_m", [0.05, 0.1, 0.2])
def test_a_place_in_decimals_on_the_side_of_two_voxels_is_in_the_upper_one(resolution_m):
    mapper = OctoMapMapper(resolution_m=resolution_m).fit(*room(dimension=3, count=4000))
    voxel = np.random.default_rng(1).integers(-13, 47, (2000, 3)) * max(1, round(0.1 / resolution_m))
    sides = np.array([[float(f"{x:.2f}") for x in row] for row in voxel * resolution_m])
    answers = mapper.predict_proba(sides)
    np.testing.assert_array_equal(answers, mapper.predict_proba((voxel + 0.5) * resolution_m))
    assert len(np.unique(answers)) > 5
