import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hilbertvae.checks import InputError
from hilbertvae.cloud import fit_cloud
from hilbertvae.mappers import evidence as evidence_module
from hilbertvae.mappers.evidence import NONE, Evidence
from hilbertvae.voxel_votes import voxel_index


def random_cloud(seed, count, dimension, offset_m=0.0):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.5, 0.5, (count, dimension)) + offset_m
    return points, rng.random(count) < 0.3, rng.integers(1, 20, count).astype(float)


def voxel_of(point, resolution_m):
    return tuple(int(np.floor(x / resolution_m)) for x in point)


class Twin:
    """Evidence by dictionaries of points."""

    def __init__(self, points, occupied, weight, resolution_m):
        self.resolution_m, self.voxels = resolution_m, {}
        for point, label, count in zip(points, occupied, weight, strict=True):
            self.voxels.setdefault(voxel_of(point, resolution_m), ([], []))[int(label)].append((point, count))

    def votes(self, voxel, label):
        return sum(count for _, count in self.voxels.get(voxel, ([], []))[label])

    def mean(self, voxel, label):
        found = self.voxels.get(voxel, ([], []))[label]
        return np.average([point for point, _ in found], axis=0, weights=[count for _, count in found]) if found else None

    def features(self, query):
        own = voxel_of(query, self.resolution_m)
        block = [tuple(np.add(own, step)) for step in itertools.product((-1, 0, 1), repeat=len(own))]
        around = [voxel for voxel in block if voxel != own]
        distances = []
        for label in (0, 1):
            means = [self.mean(voxel, label) for voxel in block]
            distances.append(sorted([np.linalg.norm(query - m) / self.resolution_m for m in means if m is not None] + [2.0] * 3))
        hit, free = [min(d, 2.0) for d in distances[1][:3]], min(distances[0][0], 2.0)
        hits, frees = self.votes(own, 1), self.votes(own, 0)
        hits_around, frees_around = (sum(self.votes(voxel, label) for voxel in around) for label in (1, 0))
        return [
            math.log((hits + 0.5) / (frees + 0.5)),
            math.log((hits_around + 0.5) / (frees_around + 0.5)),
            math.log1p(hits + frees),
            math.log1p(hits_around + frees_around),
            *hit,
            *(min(d, 1.0) for d in hit),
            free,
            hit[0] ** 2,
            free**2,
            *(max(-most, min(most, self.above_share(hits, frees))) for most in (2.0, 0.5)),
            float(hits == 0),
        ]

    def above_share(self, hits, frees):
        """Standard deviations of how many of all votes, and one more, would be returns if 15 % were."""
        count = hits + frees + 1
        return (hits + 0.15 - 0.15 * count) / math.sqrt(count * 0.15 * 0.85)


@settings(max_examples=20)
@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(1, 60),
    dimension=st.integers(2, 3),
    resolution_m=st.sampled_from([0.1, 0.2, 0.45]),
    offset_m=st.sampled_from([0.0, -1234.5]),
)
def test_evidence_equals_brute_force(seed, count, dimension, resolution_m, offset_m):
    cloud = random_cloud(seed, count, dimension, offset_m)
    evidence, twin = Evidence(*cloud, resolution_m), Twin(*cloud, resolution_m)
    queries = np.random.default_rng(seed + 1).uniform(-0.9, 0.9, (40, dimension)) + offset_m
    found = evidence.find(queries)
    assert [number != NONE for number in found] == [voxel_of(query, resolution_m) in twin.voxels for query in queries]
    seen = found != NONE
    features = evidence.features(queries[seen], found[seen])
    assert features.shape == (seen.sum(), evidence.feature_count)
    for row, query in zip(features, queries[seen], strict=True):
        np.testing.assert_allclose(row, twin.features(query), rtol=0, atol=2e-4)


def test_every_fitted_point_is_found_and_votes_are_kept(place):
    cloud = place.fit
    evidence = Evidence(cloud.points, cloud.occupied, cloud.weight, place.resolution_m)
    found = evidence.find(cloud.points)
    assert (found != NONE).all()
    assert evidence.hits.sum() == cloud.weight[cloud.occupied].sum()
    assert evidence.frees.sum() == cloud.weight[~cloud.occupied].sum()


@pytest.mark.parametrize("dimension", [2, 3])
def test_away_is_the_distance_to_a_return_where_something_was_seen_near(dimension):
    points, occupied, weight = random_cloud(3, 40, dimension)
    evidence = Evidence(points, occupied, weight, 0.1)
    queries = np.random.default_rng(0).uniform(-6, 6, (2000, dimension))
    middles = (np.floor(points / 0.1) + 0.5) * 0.1
    distance = np.linalg.norm(queries[:, None] - middles, axis=2)
    near, exact = distance.min(axis=1) < 4.0, distance[:, occupied].min(axis=1)
    np.testing.assert_allclose(evidence.away(queries), np.where(near, np.minimum(exact, 2.5), np.inf))
    assert near[np.linalg.norm(queries[:, None] - points, axis=2).min(axis=1) < 2.5].all() and 0.1 < near.mean() < 0.9
    assert np.isinf(evidence.away(queries + 100)).all() and evidence.away(queries[:0]).shape == (0,)
    evidence.add(points + 100, occupied, weight)  # the trees are made anew
    assert np.isfinite(evidence.away(points + 101)).all()
    nothing = Evidence(points[:0], occupied[:0], weight[:0], 0.1)
    assert np.isinf(nothing.away(queries)).all()
    free = Evidence(points, np.zeros(len(points), bool), weight, 0.1)
    assert set(free.away(queries[near])) == {2.5}


@pytest.mark.parametrize("dimension", [2, 3])
def test_how_far_few_queries_are_is_looked_up_around_them(dimension, monkeypatch):
    """Not in all of a large map that has changed; after many, in all of it, once."""
    rng, made = np.random.default_rng(0), []
    points = np.column_stack([np.linspace(0, 200, 4000), *rng.uniform(-1, 1, (dimension - 1, 4000))])
    queries = np.column_stack([rng.uniform(-5, 205, 300), *rng.uniform(-5, 5, (dimension - 1, 300))])
    evidence = Evidence(points, np.arange(4000) % 3 == 0, np.ones(4000), 0.1)
    whole = Evidence(points, np.arange(4000) % 3 == 0, np.ones(4000), 0.1)
    usual = evidence_module.Nearness
    monkeypatch.setattr(evidence_module, "Nearness", lambda middles, *rest: (made.append(len(middles)), usual(middles, *rest))[1])
    expected = whole.away(queries)
    assert made == [len(whole)]
    made.clear()
    np.testing.assert_array_equal([evidence.away(query[None])[0] for query in queries], expected)
    assert max(made[:-1]) < 0.1 * len(evidence) and made[-1] == len(evidence) and sum(made[:-1]) < 0.7 * len(evidence)
    made.clear()
    for again in (points[:5], points[:5] + 1e-6):
        evidence.add(again, np.arange(5) % 3 == 0, np.ones(5))  # nothing new
    evidence.away(queries)
    assert not made
    evidence.add(points[1:2], np.ones(1, bool), np.ones(1))  # the first return in what was free
    evidence.away(queries[:1])
    assert len(made) == 1
    assert np.isinf(evidence.away(np.full((1, dimension), 1e100))).all()


def test_weights_that_leave_no_digits_are_refused():
    evidence, one = Evidence(np.zeros((1, 2)), np.ones(1, bool), np.ones(1), 0.1), np.full((1, 2), 3.0)
    with pytest.raises(InputError, match=r"sample_weight: expected at most 1e\+12, got 1e\+300"):
        evidence.add(one, np.ones(1, bool), np.full(1, 1e300))
    assert len(evidence) == 1


def test_rows_do_not_wrap_into_one_another():
    """Voxels at the two ends of a row are no neighbours, and queries just outside of the extent are in no voxel."""
    points = np.array([[0.05, 0.05], [0.15, 0.95], [0.95, 0.05]])
    evidence = Evidence(points, np.array([True, True, False]), np.ones(3), 0.1)
    features = evidence.features(points, evidence.find(points))
    np.testing.assert_allclose(features[:, 3], 0)  # nothing around any of them
    outside = np.array([[0.05, 1.05], [0.05, -0.05], [-0.05, 0.05], [1.05, 0.05], [0.25, -0.05], [0.05, 1.15], [0.05, -0.15]])
    assert (evidence.find(outside) == NONE).all()


@pytest.mark.parametrize("dimension", [2, 3])
def test_queries_very_far_away_and_none(dimension):
    evidence = Evidence(*random_cloud(0, 30, dimension), 0.1)
    far = np.full((3, dimension), [[1e15], [-1e15], [1e9]])
    assert (evidence.find(far) == NONE).all()
    empty = np.empty((0, dimension))
    assert evidence.features(empty, evidence.find(empty)).shape == (0, evidence.feature_count)


@pytest.mark.parametrize("dimension", [2, 3])
def test_each_query_is_answered_alone(dimension):
    cloud = random_cloud(0, 200, dimension)
    evidence = Evidence(*cloud, 0.2)
    queries = cloud[0]
    found = evidence.find(queries)
    whole = evidence.features(queries, found)
    order = np.random.default_rng(1).permutation(len(queries))
    np.testing.assert_array_equal(evidence.features(queries[order], found[order]), whole[order])
    one_by_one = [evidence.features(queries[k : k + 1], found[k : k + 1])[0] for k in range(30)]
    np.testing.assert_array_equal(one_by_one, whole[:30])


@settings(max_examples=25)
@given(
    seed=st.integers(0, 2**32 - 1),
    dimension=st.integers(2, 3),
    offset_m=st.sampled_from([0.0, -1234.5, 5e6]),
    portions=st.integers(1, 6),
)
def test_portions_add_up_to_the_whole(seed, dimension, offset_m, portions):
    """Whatever the order in which they come: counts to the bit, mean positions to float32's rounding of a voxel."""
    cloud, rng = random_cloud(seed, 120, dimension, offset_m), np.random.default_rng(seed + 1)
    whole, grown = Evidence(*cloud, 0.2), Evidence(*(part[:0] for part in cloud), 0.2)
    for chosen in np.array_split(rng.permutation(120), portions):
        touched, hits, frees = grown.add(*(part[chosen] for part in cloud))
        voxels = {voxel_of(point, 0.2) for point in cloud[0][chosen]}
        assert {tuple(voxel) for voxel in grown.bricks.indices(grown.places[touched]).tolist()} == voxels
        added = grown.hits[touched] - hits, grown.frees[touched] - frees
        assert [votes.sum() for votes in added] == [cloud[2][chosen][cloud[1][chosen] == label].sum() for label in (True, False)]
    assert len(grown) == len(whole) == len({voxel_of(point, 0.2) for point in cloud[0]})
    queries = cloud[0] + rng.normal(0, 0.1, cloud[0].shape)
    voxel, other = whole.find(queries), grown.find(queries)
    np.testing.assert_array_equal(voxel == NONE, other == NONE)
    ours, theirs = (evidence.features(queries[rows != NONE], rows[rows != NONE]) for evidence, rows in ((grown, other), (whole, voxel)))
    np.testing.assert_array_equal(ours[:, :4], theirs[:, :4])
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-5)


def test_the_cloud_of_scans_is_that_of_them_together(place):
    """At most one point per voxel and label, at the mean of all scans' samples, as `thinned_cloud` of merged votes has it."""
    scans, resolution_m = place.scans, place.resolution_m
    parts = [fit_cloud(scans.select(scans.scan == k), resolution_m) for k in np.unique(scans.scan)]
    evidence = Evidence(parts[0].points, parts[0].occupied, parts[0].weight, resolution_m)
    for part in parts[1:]:
        evidence.add(part.points, part.occupied, part.weight)
    found, expected = evidence.cloud(), fit_cloud(scans, resolution_m)

    def rows(cloud):
        index = voxel_index(cloud.points, resolution_m)
        order = np.lexsort([*index.T, cloud.occupied])
        return index[order], cloud.occupied[order], cloud.weight[order], cloud.points[order]

    for ours, theirs in zip(rows(found)[:3], rows(expected)[:3], strict=True):
        np.testing.assert_array_equal(ours, theirs)
    np.testing.assert_allclose(rows(found)[3], rows(expected)[3], rtol=0, atol=1e-7)


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_cloud_of_boxes_has_all_that_is_in_them(dimension):
    points, occupied, weight = random_cloud(0, 400, dimension)
    evidence = Evidence(3 * points, occupied, weight, 0.05)
    whole = evidence.cloud()
    low = np.random.default_rng(1).uniform(-1.6, 1, (3, dimension))
    high = low + [[0.3], [0.0], [1.0]]
    some = evidence.cloud(low, high)
    inside = np.array([((point >= low) & (point <= high)).all(axis=1).any() for point in whole.points])
    found = {(*point, label) for point, label in zip(some.points.tolist(), some.occupied.tolist(), strict=True)}
    everything = [(*point, label) for point, label in zip(whole.points.tolist(), whole.occupied.tolist(), strict=True)]
    assert {row for row, within in zip(everything, inside, strict=True) if within} <= found <= set(everything)
    assert len(found) < len(whole)


def test_what_was_seen_far_away_is_refused_and_changes_nothing():
    cloud = random_cloud(0, 50, 2)
    evidence = Evidence(*cloud, 0.1)
    before = evidence.cloud()
    for far in ([[0.0, 0.0], [1e12, 0.0]], [[1e12, 0.0]]):
        with pytest.raises(InputError, match=r"points: extent \[100000000000\d\..*\] m is too large for voxels of 0.1 m"):
            evidence.add(np.array(far), np.ones(len(far), bool), np.ones(len(far)))
    np.testing.assert_array_equal(evidence.cloud().points, before.points)
    assert len(evidence) == len(evidence.places) - 1


def test_large_coordinates_cost_no_digits():
    """At UTM's 5 000 km, distances are those at the origin to a thousandth of a voxel."""
    points, occupied, weight = random_cloud(0, 100, 2)
    shift = np.array([4_000_000.0, 5_000_000.0])
    near, far = Evidence(points, occupied, weight, 0.1), Evidence(points + shift, occupied, weight, 0.1)
    same = voxel_index(points, 0.1) == voxel_index(points + shift, 0.1) - np.rint(shift / 0.1).astype(int)
    queries = points[same.all(axis=1)]
    ours = far.features(queries + shift, far.find(queries + shift))
    theirs = near.features(queries, near.find(queries))
    alike = np.abs(ours[:, :4] - theirs[:, :4]).max(axis=1) == 0  # no neighbour changed its voxel by rounding
    assert alike.mean() > 0.9
    np.testing.assert_allclose(ours[alike], theirs[alike], rtol=0, atol=1e-3)


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_grid_in_decimals_has_a_voxel_for_each_point(dimension):
    """As a map's cells are, made points by their corners; each is asked where it lies."""
    cells = np.stack(np.meshgrid(*[np.arange(-20, 30)] * dimension), axis=-1).reshape(-1, dimension)
    points, occupied = np.round(cells * 0.1 + 0.7, 1), np.random.default_rng(0).random(len(cells)) < 0.3
    evidence = Evidence(points, occupied, np.ones(len(cells)), 0.1)
    assert len(evidence) == len(cells)
    voxel = evidence.find(points)
    np.testing.assert_array_equal(evidence.hits[voxel] > 0, occupied)
    nearest = evidence.features(points, voxel)[:, 4]
    assert (nearest[occupied] < 1e-4).all() and (nearest[~occupied] > 0.9).all()
