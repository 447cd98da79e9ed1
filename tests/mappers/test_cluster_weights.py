"""The `cluster` rule: a Hilbert Map's own weight for each cluster, refitted on the site that it maps."""

import numpy as np
import pytest
from hilbert_map_toys import FEATURES, fit, gapped, reconstructor
from scipy.optimize import minimize

from hilbertvae.cloud import labelled_voxels
from hilbertvae.gaps import OUTSIDE, random_gaps
from hilbertvae.grids.cluster_grids import bin_grids
from hilbertvae.grids.kernel import FrameIndex, kernel
from hilbertvae.mappers import cluster_weights
from hilbertvae.mappers.cluster_weights import fit_cluster_weights, hide_gaps
from hilbertvae.mappers.hilbert_map import HilbertMap


def test_cluster_weights_are_fitted_without_what_is_to_be_scored(room, monkeypatch):
    """The gaps hidden for that fit are cut from the given cloud, and the network never sees them while it answers for them."""
    shown = []
    made = reconstructor()
    original = type(made).complete
    monkeypatch.setattr(
        type(made), "complete", lambda self, grids, *rest, **named: shown.append(grids) or original(self, grids, *rest, **named)
    )
    cloud = gapped(room)
    mapper = fit(HilbertMap(made, weights="cluster"), cloud)
    hidden, whole = shown
    removed = (hidden == 0) & (whole != 0)
    assert removed.any() and (hidden[~removed] == whole[~removed]).all()
    assert mapper.factors_.shape == (len(mapper.frames_),) and (mapper.factors_ >= 0).all()
    assert (mapper.factors_ != 1).any()


@pytest.mark.parametrize(("calibration", "share"), [("voxels", 1), ("points", 2)])
def test_cluster_weights_for_points_count_occupied_points_twice(room, monkeypatch, calibration, share):
    given = []
    monkeypatch.setattr(
        cluster_weights, "fit_cluster_weights", lambda *known: given.append((known[4], known[-1])) or fit_cluster_weights(*known)
    )
    fit(HilbertMap(reconstructor(), weights="cluster", calibration=calibration), gapped(room))
    ((occupied, counts),) = given
    assert set(counts[occupied]) == {share} and set(counts[~occupied]) == {1}


def test_what_is_hidden_for_factors_does_not_lie_where_gaps_are_scored(room):
    """A mapper's seed is that of the evaluation's gaps."""
    cloud = gapped(room)
    scored = random_gaps(cloud, 2.5, 0.1, seed=3).part(cloud.points) == OUTSIDE
    shown, hidden = hide_gaps(cloud, 0.1, seed=3)
    assert len(shown) + len(hidden) == len(cloud) and 0 < len(hidden) < len(shown)
    assert set(map(tuple, hidden.points)) != set(map(tuple, cloud.points[~scored]))


@pytest.mark.parametrize("level", [True, False])
def test_factors_are_learned_from_what_was_hidden_alone(room, monkeypatch, level):
    """With all factors 1 what they are fitted to is the map's own logit, by grids that never saw a point of it."""
    given, made, cloud = [], reconstructor(), gapped(room)
    monkeypatch.setattr(cluster_weights, "fit_cluster_weights", lambda *known: given.append(known) or fit_cluster_weights(*known))
    made.map_weights["voxels"]["level"] = level
    mapper = fit(HilbertMap(made, weights="cluster", ridge=7.0), cloud)
    ((values, _, offset, rank_weights, occupied, clusters, ridge, _),) = given
    shown, hidden = hide_gaps(cloud, 0.1, seed=0)
    hidden = labelled_voxels(hidden, 0.1)
    grids = made.complete(bin_grids(shown, mapper.frames_, mapper.grid_), mapper.flips_).value
    holding = FrameIndex(mapper.frames_).holding(hidden.points, 5)
    unseen = np.zeros(len(hidden), bool), np.empty((0, FEATURES))
    expected = mapper.rank_weights_.logit(kernel(grids, mapper.frames_, hidden.points, holding), (holding >= 0).sum(axis=1), *unseen)
    np.testing.assert_array_equal(occupied, hidden.occupied)
    np.testing.assert_allclose(offset + (values * rank_weights).sum(axis=1), expected, rtol=0, atol=1e-5)
    assert (clusters, ridge) == (len(mapper.frames_), 7.0)


def test_a_map_answers_by_what_its_factors_were_fitted_to(room):
    """How far boxes disagree is that of the boxes themselves, whatever their factors."""
    made = reconstructor()
    made.map_weights["voxels"]["spread"] = -0.7
    mapper = fit(HilbertMap(made, weights="cluster", ridge=1.0), gapped(room))
    assert np.ptp(mapper.factors_) > 0.1
    queries = np.random.default_rng(0).uniform(*mapper.evidence_.bounds(), (3000, 2))
    queries = queries[~mapper.observed(queries)]
    holding = mapper.index_.holding(queries, 5)
    queries, holding = queries[(holding >= 0).any(axis=1)], holding[(holding >= 0).any(axis=1)]
    values, held = kernel(mapper.grids_, mapper.frames_, queries, holding), (holding >= 0).sum(axis=1)
    weights = mapper.rank_weights_
    loud = 5 / held if weights.level else np.ones(len(held))
    each = np.where(holding >= 0, mapper.factors_[holding] * weights.unseen[:-1] * values, 0.0).sum(axis=1) * loud
    apart = np.array([np.std(row[:count]) for row, count in zip(values, held, strict=True)])
    logit = each + weights.unseen[-1] + weights.spread * apart
    np.testing.assert_allclose(mapper.predict_proba(queries)[:, 1], 1 / (1 + np.exp(-logit)), rtol=0, atol=1e-6)


def test_factors_by_an_explicit_sum():
    """Each query's logit is put together cluster by cluster, and the same optimum is searched."""
    rng = np.random.default_rng(0)
    clusters, ranks, count, ridge = 3, 2, 80, 5.0
    holding = np.array([rng.permutation(clusters)[:ranks] for _ in range(count)])
    holding[rng.random(count) < 0.2, 1] = -1
    values, offset, rank_weights = rng.normal(size=(count, ranks)), rng.normal(size=count), np.array([0.8, 0.4])
    occupied = rng.random(count) < 0.5

    def loss(factor):
        total = ridge * ((factor - 1) ** 2).sum()
        for q in range(count):
            logit = offset[q] + sum(rank_weights[r] * factor[m] * values[q, r] for r, m in enumerate(holding[q]) if m >= 0)
            total += np.log1p(np.exp(-logit if occupied[q] else logit))
        return total

    expected = minimize(loss, np.ones(clusters), method="L-BFGS-B", bounds=[(0, None)] * clusters)
    found = fit_cluster_weights(values, holding, offset, rank_weights, occupied, clusters, ridge)
    np.testing.assert_allclose(found, expected.x, atol=1e-3)


def test_a_query_that_counts_for_three_is_there_three_times():
    rng = np.random.default_rng(0)
    values, offset, holding = rng.normal(size=(80, 2)), rng.normal(size=80), np.array([rng.permutation(3)[:2] for _ in range(80)])
    occupied, rank_weights = rng.random(80) < 0.5, np.array([0.8, 0.4])
    counts = np.where(occupied, 3, 1)
    found = fit_cluster_weights(values, holding, offset, rank_weights, occupied, 3, 5.0, counts)
    many = (np.repeat(each, counts, axis=0) for each in (values, holding, offset))
    expected = fit_cluster_weights(*many, rank_weights, np.repeat(occupied, counts), 3, 5.0)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)
