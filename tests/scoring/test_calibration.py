from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from hilbertvae.cloud import Cloud
from hilbertvae.gaps import OUTSIDE, random_gaps
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.weights import RankWeights, unit_weights
from hilbertvae.observed_map import map_of
from hilbertvae.scoring import calibration
from hilbertvae.scoring.calibration import learn_rank_weights
from hilbertvae.scoring.cases import occluded_parts, occlusion_case
from toy_rooms import tiny_reconstructor


class Recorder(HilbertMap):
    """A Hilbert Map that keeps what it was fitted on and asked."""

    def fit(self, points, y, sample_weight=None):
        self.given = [*getattr(self, "given", []), (points, y, sample_weight)]
        self.asked = getattr(self, "asked", [])  # one list, whose of two readings' maps is asked
        return super().fit(points, y, sample_weight)

    def features(self, queries):
        self.asked.append(queries)
        return super().features(queries)


@pytest.fixture(scope="module")
def learning(place):
    mapper = Recorder(tiny_reconstructor(place.dimension))
    return mapper, learn_rank_weights(mapper, [place], 1.2, [100, 101], occlusion=False), place


def test_both_readings_are_learned(learning):
    mapper, learned, _ = learning
    assert set(learned) == {"points", "voxels"}
    for plain in learned.values():
        weights = RankWeights.from_plain(plain)
        assert weights.unseen.shape == (mapper.neighbours + 1,)
        assert weights.seen.shape == (mapper.evidence_.feature_count + 2,)
        assert (weights.unseen[:-1] >= 0).all() and weights.seen[0] >= 0 and weights.seen[-2] >= 0
    assert learned["points"] != learned["voxels"]


def test_only_what_was_hidden_teaches(learning):
    """The network is shown gapped clouds without held-out beams, and asked for gaps and held-out beams alone."""
    mapper, _, place = learning
    assert len(mapper.given) == 2 and len(mapper.asked) == 4
    for k, seed in enumerate((100, 101)):
        gaps = random_gaps(place.fit, 1.2, place.resolution_m, seed)
        shown = gaps.cut(place.fit)
        np.testing.assert_array_equal(mapper.given[k][0], shown.points)
        np.testing.assert_array_equal(mapper.given[k][2], shown.weight)
        for queries, cloud, held_out in (
            (mapper.asked[2 * k], place.points, place.points_held_out),
            (mapper.asked[2 * k + 1], place.voxels, place.voxels_held_out),
        ):
            part = gaps.part(cloud.points)
            wanted = {
                tuple(p) for p, where, out in zip(cloud.points, part, held_out, strict=True) if where == 1 or (out and where == OUTSIDE)
            }
            assert {tuple(query) for query in queries} == wanted


def test_occupied_points_count_for_more(learning):
    """Alone of the two readings, points are for the cuts: the odds of what is not seen rise, by as much as an occupied query counts for."""
    _, learned, place = learning
    mapper = HilbertMap(tiny_reconstructor(place.dimension))
    as_shares = learn_rank_weights(mapper, [place], 1.2, [100, 101], occlusion=False, occupied_weight=1.0)
    assert as_shares["voxels"] == learned["voxels"]
    rise = learned["points"]["unseen"][-1] - as_shares["points"]["unseen"][-1]
    assert np.log(1.5) < rise < np.log(3)


@pytest.mark.parametrize("reading", ["points", "voxels"])
def test_what_was_learned_is_better_than_unit_weights(learning, reading):
    """On what it was learned from, in nats."""
    mapper, learned, place = learning
    cloud, held_out = (place.points, place.points_held_out) if reading == "points" else (place.voxels, place.voxels_held_out)
    gaps = random_gaps(place.fit, 1.2, place.resolution_m, 101)  # the mapper was fitted with these last
    part = gaps.part(cloud.points)
    asked = (part != -1) & (held_out | (part != OUTSIDE))
    phi, sign = HilbertMap.features(mapper, cloud.points[asked]), np.where(cloud.occupied[asked], 1, -1)

    def nll(weights):
        return np.logaddexp(0, -sign * weights.logit(*phi)).mean()

    assert nll(RankWeights.from_plain(learned[reading])) < nll(unit_weights(mapper.neighbours, mapper.evidence_.feature_count)) - 0.01


def test_several_sites_teach_one_set_of_weights(place, monkeypatch):
    """From all that was asked of any of them."""
    asked = []
    fit = calibration.fit_rank_weights
    monkeypatch.setattr(calibration, "fit_rank_weights", lambda *inputs: (asked.append(inputs), fit(*inputs))[1])
    other = replace(place, scans=place.scans.select(np.arange(len(place.scans.points)) % 3 > 0))
    mapper = HilbertMap(tiny_reconstructor(place.dimension))
    for sites in ([place], [other], [place, other]):
        learn_rank_weights(mapper, sites, 1.2, [100])
    for one, two, both in zip(asked[:2], asked[2:4], asked[4:], strict=True):  # points, voxels
        # What gaps ask of either comes first, then what is occluded: sorted, since order is of no account.
        for first, second, found in zip(one[:-2], two[:-2], both[:-2], strict=True):
            together = np.concatenate([first, second])
            np.testing.assert_array_equal(np.sort(found, axis=0), np.sort(together, axis=0))
        assert one[-2:] == both[-2:]
        assert both[-1] == (place.dimension == 2)  # whether how far boxes disagree is heard


def test_maps_of_maps_learn_from_maps(place):
    """From the same gaps and the same questions as maps of scans."""
    of_scans, of_map = (Recorder(tiny_reconstructor(place.dimension)) for _ in range(2))
    learned = [learn_rank_weights(mapper, [place], 1.2, [100], given=given) for mapper, given in ((of_scans, "scans"), (of_map, "map"))]
    assert learned[0] != learned[1]
    for scans, given in zip(of_scans.given, of_map.given, strict=True):
        expected = map_of(Cloud(*scans), place.resolution_m, place.resolution_m)
        np.testing.assert_array_equal(given[0], expected.points)
        np.testing.assert_array_equal(given[2], expected.weight)
    for ours, theirs in zip(of_scans.asked, of_map.asked, strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_large_sites_are_thinned(room, monkeypatch):
    monkeypatch.setattr(calibration, "MOST_QUERIES", 400)
    mapper = Recorder(tiny_reconstructor())
    assert set(learn_rank_weights(mapper, [room], 1.2, [100, 101], occlusion=False)) == {"points", "voxels"}
    assert [len(queries) for queries in mapper.asked] == [200] * 4


def test_what_scans_that_were_left_out_saw_teaches_voxels_too(place, learning):
    """Each part that is kept is shown once, without held-out beams, and asked for what the others saw beyond it."""
    mapper = Recorder(tiny_reconstructor(place.dimension))
    learned = learn_rank_weights(mapper, [place], 1.2, [100, 101])
    expected = [
        occlusion_case(place, region, kept)
        for seed in (100, 101)
        for region, kept in occluded_parts(place.scans, seed).items()
        if region == "occluded-sparse" or seed == 100  # the first half is the same for every seed
    ]
    asked = [case.asked["voxels"].points for case in expected if len(case.asked["voxels"].points)]
    assert asked and len(mapper.given) == 2 + len(asked)
    for found, queries in zip(mapper.asked[4:], asked, strict=True):
        np.testing.assert_array_equal(found, queries)
    points = [weights["points"] | {"beyond": None} for weights in (learned, learning[1])]
    assert points[0] == points[1] and learned["voxels"] != learning[1]["voxels"]


@pytest.mark.parametrize("slope", [0.0, -1.0])
def test_points_take_from_voxels_what_is_beyond_all_boxes(room, monkeypatch, slope):
    """With what the log-odds of points are above theirs; where voxels had nothing to learn from, nothing is known, whatever points say."""
    asked, whole = [], calibration.fit_rank_weights

    def fit(*known):
        found = replace(whole(*known), beyond=np.full(2, slope if known[-2] == 1.0 else 7.0))  # the voxels', or the points' own
        asked.append((known, found))
        return found

    monkeypatch.setattr(calibration, "fit_rank_weights", fit)
    learned = learn_rank_weights(HilbertMap(tiny_reconstructor()), [room], 1.2, [100], occlusion=False)
    ((values, held, seen, evidence, away, occupied, weight, _), _), (_, voxels) = asked
    chosen = ~seen & (held > 0)
    logit, sign = voxels.logit(values, held, seen, evidence, away)[chosen], np.where(occupied[chosen], 1, -1)
    loss = minimize_scalar(lambda more: (np.where(sign > 0, weight, 1) * np.logaddexp(0, -sign * (logit + more))).sum())
    assert loss.x > 0.3  # points are where something is, and an occupied one counts twice
    assert learned["voxels"]["beyond"] == [slope, slope]
    assert learned["points"]["beyond"] == pytest.approx([slope, slope + loss.x] if slope else [0.0, 0.0], abs=1e-4)


def test_many_sites_teach_by_as_many_queries_as_one(room, monkeypatch):
    asked, whole = [], calibration.fit_rank_weights
    monkeypatch.setattr(calibration, "MOST_QUERIES", 400)
    monkeypatch.setattr(calibration, "fit_rank_weights", lambda *known: asked.append(len(known[0])) or whole(*known))
    learn_rank_weights(HilbertMap(tiny_reconstructor()), [room, replace(room, name="other")], 1.2, [100, 101], occlusion=False)
    assert asked == [400, 400]
