import itertools
import json
from dataclasses import replace

import numpy as np
import pytest
from protocol_toys import Spy, voxels
from scipy.spatial import cKDTree

from hilbertvae.checks import InputError
from hilbertvae.cloud import Cloud, fit_cloud
from hilbertvae.gaps import INSIDE
from hilbertvae.mappers.constant import ConstantMapper, GapCentreMapper
from hilbertvae.mappers.mapper import Mapper
from hilbertvae.mappers.nearest import NearestMapper
from hilbertvae.observed_map import map_of
from hilbertvae.scans.scan import Scans
from hilbertvae.scoring import cases
from hilbertvae.scoring.cases import gap_case
from hilbertvae.scoring.metrics import ERROR_METRICS, METRICS, error_ranking, score
from hilbertvae.scoring.protocol import Protocol, cut_site, evaluate, evaluate_all
from hilbertvae.scoring.protocol_settings import GIVEN
from hilbertvae.site import Site

QUICK = Protocol(gap_seeds=[0, 3], gap_ratio=0.5, cluster_size_m=3.0, occlusion=False)


class Broken(Mapper):
    """Fails as it is fitted, or as it is asked."""

    def __init__(self, early=True):
        self.early = early

    def _fit(self, points, occupied, weight):
        self.fitted_ = True
        if self.early:
            raise MemoryError("too many centres")

    def _probability(self, queries):
        raise ZeroDivisionError("no neighbours")


def test_removed_points_and_held_out_beams_are_never_shown(place):
    spy = Spy()
    evaluate(spy, place, QUICK, "spy")
    assert len(spy.fits_) == len(QUICK.gap_seeds)
    kept = fit_cloud(place.scans.select(~place.scans.held_out()), place.resolution_m)
    by_held_out_alone = voxels(place.whole.points, place.resolution_m) - voxels(kept.points, place.resolution_m)
    assert by_held_out_alone
    for (points, occupied, weight, given), seed in zip(spy.fits_, QUICK.gap_seeds, strict=True):
        gaps = cut_site(place, QUICK, seed)
        assert given == seed  # a mapper that takes a seed gets the gap's
        for centre, radius in zip(gaps.centres, gaps.radius_m, strict=True):
            assert (np.linalg.norm(points - centre, axis=1) >= radius).all()
        assert not voxels(points, place.resolution_m) & by_held_out_alone
        # And all the rest is shown, as it is.
        expected = gaps.cut(kept)
        np.testing.assert_array_equal(points, expected.points)
        np.testing.assert_array_equal(occupied, expected.occupied)
        np.testing.assert_array_equal(weight, expected.weight)


def test_mappers_may_be_given_what_a_map_says(place):
    """Of the same gaps, and asked the same, with cells as large as voxels or half as large."""
    spies = {given: Spy() for given in GIVEN}
    found = [evaluate(spy, place, replace(QUICK, given=given, occlusion=True)) for given, spy in spies.items()]
    assert [result.protocol["given"] for result in found] == [*GIVEN] and found[0].gaps == found[1].gaps == found[2].gaps
    for (*shown, _), (*given, _) in zip(spies["scans"].fits_, spies["map"].fits_, strict=True):
        expected = map_of(Cloud(*shown), place.resolution_m, place.resolution_m)
        for ours, theirs in zip(given, (expected.points, expected.occupied, expected.weight), strict=True):
            np.testing.assert_array_equal(ours, theirs)
    for queries in zip(*(spy.asked_ for spy in spies.values()), strict=True):
        assert all(np.array_equal(asked, queries[0]) for asked in queries)


def test_all_mappers_are_given_and_asked_the_same(room):
    first, second = Spy(), Spy()
    found = evaluate_all({"first": first, "second": second}, room, QUICK)
    for ours, theirs in zip(first.fits_, second.fits_, strict=True):
        np.testing.assert_array_equal(ours[0], theirs[0])
    for ours, theirs in zip(first.asked_, second.asked_, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert found.scores["first"] == found.scores["second"]
    assert evaluate(Spy(), room, QUICK).gaps == evaluate(ConstantMapper(), room, QUICK).gaps == found.gaps


def test_regions_by_brute_force(place):
    spy = Spy()
    found = evaluate(spy, place, QUICK, "spy")
    for k, seed in enumerate(QUICK.gap_seeds):
        gaps = cut_site(place, QUICK, seed)
        shown = cKDTree(spy.fits_[k][0])
        for reading, cloud, held_out, fitted in (
            ("points", place.points, place.points_held_out, ~place.points_held_out),
            ("voxels", place.voxels, place.voxels_held_out, place.voxels_fitted),
        ):
            part = gaps.part(cloud.points)
            distance, index = shown.query(cloud.points)
            answer = np.where(distance < 0.15, spy.fits_[k][1][index], 0.5)
            for region, chosen in (("gaps", part == 1), ("observed", (part == 0) & held_out), ("fitted", (part == 0) & fitted)):
                assert chosen.any()
                for metric, value in score(cloud.occupied[chosen], answer[chosen]).items():
                    assert found.scores["spy"][reading][region][metric][k] == pytest.approx(value, abs=1e-12), (region, metric)


def test_the_rim_is_scored_nowhere(room):
    found = evaluate(Spy(), room, QUICK, "spy").scores["spy"]
    for k, seed in enumerate(QUICK.gap_seeds):
        rim = (cut_site(room, QUICK, seed).part(room.points.points) == -1).sum()
        total = sum(found["points"][region]["count"][k] for region in ("observed", "fitted", "gaps"))
        assert rim > 0 and total == len(room.points) - rim


def test_the_contract(place):
    names = {"nearest": NearestMapper(), "all-occupied": ConstantMapper(), "gap-centre": GapCentreMapper()}
    every = Protocol(gap_seeds=[0, 1], gap_ratio=0.5, cluster_size_m=3.0)
    found = evaluate_all(names, place, every)
    plain = json.loads(json.dumps(found.plain(), allow_nan=False))
    assert (plain["status"], plain["site"], plain["dimension"]) == ("ok", place.name, place.dimension)
    assert (plain["gap_diameter_m"], plain["gap_seeds"]) == (1.5, [0, 1])
    assert set(plain["scores"]) == set(names)
    for name, readings in plain["scores"].items():
        assert set(readings) == {"points", "voxels"}
        for reading, regions in readings.items():
            assert {"observed", "fitted", "gaps"} <= set(regions)
            # The leak check knows nothing but the gaps, so occlusion, which has none, is not asked of it.
            occluded = {"occluded-sparse", "occluded-half"} <= set(regions)
            assert occluded == (reading == "voxels" and name != "gap-centre")
            for metrics in regions.values():
                assert set(metrics) == set(METRICS)
                assert all(len(values) == 2 and all(isinstance(value, float) for value in values) for values in metrics.values())
    for reading in ("points", "voxels"):
        assert set(plain["ceiling"][reading]) == {"precision", "recall"}
    assert [one["seed"] for one in plain["gaps"]] == [0, 1]
    assert plain["protocol"]["cluster_size_m"] == 3.0


def test_a_mapper_that_says_how_unsure_it_is_is_asked_in_gaps(place):
    """On voxels alone, of the very places that its answers there are scored on."""

    spread_at = []

    class Unsure(NearestMapper):
        def predict_std(self, queries):
            spread_at.append(queries)
            return np.linalg.norm(queries, axis=1)

    protocol = replace(QUICK, gap_seeds=[3])
    found = evaluate(Unsure(), place, protocol, "unsure").scores["unsure"]
    case = gap_case(place, cut_site(place, protocol, 3))
    asked = case.asked["voxels"]
    chosen = asked.regions["gaps"]
    np.testing.assert_array_equal(spread_at, [asked.points[chosen]])
    mapper = NearestMapper().fit(case.shown.points, case.shown.occupied, case.shown.weight)
    probability = mapper.predict_proba(asked.points[chosen])[:, 1]
    expected = error_ranking(asked.occupied[chosen], probability, np.linalg.norm(asked.points[chosen], axis=1))
    assert {metric: found["voxels"]["gaps"][metric] for metric in expected} == {key: [value] for key, value in expected.items()}
    assert not set(ERROR_METRICS) & {*found["points"]["gaps"], *found["voxels"]["observed"]}


def test_all_occupied_has_the_base_rate_as_precision(place):
    found = evaluate(ConstantMapper(1.0), place, QUICK, "all").scores["all"]
    for reading, region in itertools.product(("points", "voxels"), ("observed", "fitted", "gaps")):
        rows = found[reading][region]
        assert rows["precision"] == rows["base_rate"] and rows["recall"] == [1.0, 1.0] and rows["auc"] == [0.5, 0.5]


def test_the_leak_check_is_told_the_centres_and_scores_their_distance(room):
    mapper = GapCentreMapper()
    found = evaluate(mapper, room, QUICK, "gap-centre").scores["gap-centre"]
    for k, seed in enumerate(QUICK.gap_seeds):
        gaps, cloud = cut_site(room, QUICK, seed), room.voxels
        inside = gaps.part(cloud.points) == 1
        distance = np.linalg.norm(cloud.points[inside][:, None] - gaps.centres, axis=2).min(axis=1)
        hit, free = distance[cloud.occupied[inside]], distance[~cloud.occupied[inside]]
        wins = (hit[:, None] < free).sum() + 0.5 * (hit[:, None] == free).sum()
        assert found["voxels"]["gaps"]["auc"][k] == pytest.approx(wins / (len(hit) * len(free)), abs=1e-9)


class WithCentres(NearestMapper):
    """A parameter of this name is its own business, as of one with radial bases."""

    def __init__(self, centres=((9.0, 9.0),)):
        super().__init__()
        self.centres = centres


def test_no_other_mapper_is_told_where_gaps_are(room):
    mapper = WithCentres()
    found = evaluate(mapper, room, Protocol(gap_seeds=[0], gap_ratio=0.5, cluster_size_m=3.0), "mine").scores["mine"]
    assert mapper.centres == ((9.0, 9.0),) and "occluded-half" in found["voxels"]


def test_precision_recall_curves(room):
    found = evaluate(Spy(), room, QUICK, "spy")
    gaps = cut_site(room, QUICK, 0)
    inside = gaps.part(room.voxels.points) == 1
    spy = Spy().fit(*(lambda cloud: (cloud.points, cloud.occupied, cloud.weight))(gaps.cut(room.fit)))
    probability, occupied = spy.predict_proba(room.voxels.points[inside])[:, 1], room.voxels.occupied[inside]
    curve = found.curves["spy"]["voxels"][0]
    assert len(curve) == 101
    for recall, precision in zip(np.linspace(0, 1, 101), curve, strict=True):
        best = 0.0
        for cut in set(probability):
            called = probability >= cut
            if (called & occupied).sum() / occupied.sum() >= recall - 1e-12:
                best = max(best, (called & occupied).sum() / called.sum())
        assert precision == pytest.approx(best, abs=1e-5)


def test_a_failing_mapper_is_named_and_the_others_are_scored(room):
    lines = []
    mappers = {"early": Broken(), "nearest": NearestMapper(), "late": Broken(early=False), "all": ConstantMapper()}
    found = evaluate_all(mappers, room, QUICK, progress=lines.append)
    assert found.failed == {"early": "MemoryError: too many centres", "late": "ZeroDivisionError: no neighbours"}
    assert set(found.scores) == {"nearest", "all"} and found.plain()["status"] == "failed"
    assert sum("failed" in line for line in lines) == 2
    assert sum(line.startswith("nearest on room, gap seed") for line in lines) == 2


def test_every_mapper_failing_leaves_a_result(room):
    found = evaluate_all({"hm": Broken()}, room, QUICK)
    assert found.plain()["status"] == "failed" and found.scores == {} and set(found.ceiling) == {"points", "voxels"}


def test_centred_gaps_are_rows_of_their_own(room):
    centred = Protocol(gap_seeds=[0], gap_ratio=0.5, cluster_size_m=3.0, centred=True)
    for centre in cut_site(room, centred, 0).centres:
        assert (np.abs(room.fit.points[room.fit.occupied] - centre).max(axis=1) == 0).any()
    with pytest.raises(ValueError, match="differ in"):
        evaluate(ConstantMapper(), room, QUICK).add(evaluate(ConstantMapper(), room, centred))


def test_without_a_rim_every_voxel_is_shown_or_asked(room):
    """And rows of such gaps are their own."""
    found = {}
    for rim in (True, False):
        protocol = Protocol(gap_seeds=[0], gap_ratio=0.5, cluster_size_m=3.0, occlusion=False, rim=rim)
        gaps = cut_site(room, protocol, 0)
        shown, hidden = gaps.cut(room.voxels), gaps.part(room.voxels.points) == INSIDE
        assert (len(shown) + hidden.sum() == len(room.voxels)) == (not rim)
        found[rim] = evaluate(ConstantMapper(), room, protocol)
        assert found[rim].scores["mapper"]["voxels"]["gaps"]["count"] == [hidden.sum()]
    with pytest.raises(ValueError, match="differ in"):
        found[True].add(found[False])


def test_a_site_without_room_for_enough_gaps_says_so():
    """A round yard: small balls on its wall that lie apart take little of what is free within."""
    angle = np.linspace(0, 2 * np.pi, 3000, endpoint=False)
    beam = np.arange(len(angle))
    scans = Scans(10 * np.stack([np.cos(angle), np.sin(angle)], axis=1), np.zeros((len(angle), 2)), beam % 4, beam)
    with pytest.warns(UserWarning, match="gaps of 0.4 m take .* of its points, and not 10%"):
        found = evaluate(ConstantMapper(), Site("yard", scans), Protocol(gap_seeds=[0], gap_ratio=0.2, cluster_size_m=2.0, occlusion=False))
    assert 0 < found.gaps[0]["share"] < 0.1


def test_times_are_kept(room):
    found = evaluate(ConstantMapper(), room, QUICK, "all").seconds["all"]
    assert {stage: len(seconds) for stage, seconds in found.items()} == dict.fromkeys(("fit", "query_per_million"), len(QUICK.gap_seeds))
    assert len(found["fit"]) == 2 and all(value >= 0 for stage in found.values() for value in stage)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"gap_seeds": []}, "evaluation.gap_seeds: expected one or more different seeds"),
        ({"gap_seeds": [1, 1]}, "evaluation.gap_seeds: expected one or more different seeds"),
        ({"gap_ratio": 0.0}, "evaluation.gap_ratio: expected a positive number"),
        ({"cluster_size_m": -5.0}, "evaluation.cluster_size_m: expected a positive number"),
        ({"given": "maps"}, "evaluation.given: expected one of scans, map, fine-map, got 'maps'"),
        ({"gap_ratio": 20.0, "centred": True}, "none fits into this site"),
    ],
)
def test_protocols_that_score_nothing_are_named(room, change, message):
    with pytest.raises(InputError, match=message):
        evaluate(ConstantMapper(), room, Protocol(**change))


@pytest.mark.parametrize("change", [{"gap_seeds": []}, {"gap_seeds": [1, 1]}, {"gap_ratio": 0.0}])
def test_several_mappers_are_scored_by_no_other_protocols_than_one_is(room, change):
    """Of a seed that is there twice the deviation would be 0."""
    with pytest.raises(InputError, match=f"evaluation.{next(iter(change))}: expected"):
        evaluate_all({"all": ConstantMapper()}, room, replace(QUICK, **change))


def test_the_default_gap_is_half_the_papers_cluster():
    assert Protocol().gap_diameter_m == 2.5 and len(Protocol().gap_seeds) == 5
    assert cases.OCCLUSION_STEP == {2: 10, 3: 3}


@pytest.mark.parametrize("seeds", [range(2), (0, 1), np.arange(2), list(np.arange(2))])
def test_seeds_of_any_kind_are_whole_numbers(room, seeds):
    found = evaluate(ConstantMapper(), room, replace(QUICK, gap_seeds=seeds)).plain()
    assert json.loads(json.dumps(found))["gap_seeds"] == [0, 1]


def test_a_number_alone_is_no_list_of_seeds(room):
    with pytest.raises(InputError, match="^evaluation.gap_seeds: expected a list of seeds, got 0"):
        evaluate(ConstantMapper(), room, Protocol(gap_seeds=0))
