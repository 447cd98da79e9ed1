import json
from dataclasses import replace

import numpy as np
import pytest

from hilbertvae.checks import InputError
from hilbertvae.clusters.ask_means import ask_means
from hilbertvae.clusters.comparison import StudySettings, matching_threshold, study, study_clouds, uniform_squares
from hilbertvae.clusters.lloyd import lloyd
from hilbertvae.clusters.starts import STARTS, quick_means_seeds

TINY = StudySettings(sizes=[300, 600], seeds=[0, 4], inner_radius_m=1.0, lloyd_iterations=3)


@pytest.fixture(scope="module", params=["returns", "uniform"])
def rows(request, room):
    """The rows of every start, by its name."""
    settings = replace(TINY, cloud=request.param)
    return {start: study(start, settings, study_clouds(settings, room.scans.points)) for start in STARTS}


def test_a_row_for_every_size_and_seed_that_json_can_hold(rows):
    for start, found in rows.items():
        assert [(row["start"], row["points"], row["seed"]) for row in found] == [(start, n, s) for n in (300, 600) for s in (0, 4)]
        assert json.loads(json.dumps(found)) == found
        for row in found:
            assert set(row) == {"start", "points", "seed", "seconds", "clusters", "potentials_m2"}
            assert row["seconds"] > 0 and len(row["potentials_m2"]) == 4
            assert row["potentials_m2"] == sorted(row["potentials_m2"], reverse=True)


def test_all_starts_have_as_many_clusters(rows):
    for others in zip(*rows.values(), strict=True):
        assert len({row["clusters"] for row in others}) == 1
        assert len({row["potentials_m2"][0] for row in others}) == len(STARTS)  # and are not the same start five times


def test_all_starts_get_the_same_cloud_and_seeds_that_are_careful_do_better(rows):
    reached = {start: np.sum([row["potentials_m2"][0] for row in found]) for start, found in rows.items()}
    assert max(reached[start] for start in STARTS if start != "random") < 0.8 * reached["random"]


def test_rows_are_what_its_parts_give(room):
    points = np.unique(room.scans.points, axis=0)
    settings = StudySettings(sizes=[len(points)], seeds=[3], lloyd_iterations=2)
    row = study("quick_means", settings, study_clouds(settings, points))[0]
    cloud = points[np.random.default_rng([len(points), 3]).choice(len(points), len(points), replace=False)]
    seeds = quick_means_seeds(cloud, 1.0, 3)
    assert row["clusters"] == len(seeds) and row["potentials_m2"] == lloyd(cloud, seeds, 2)[1]


def test_the_only_difference_between_two_calls_is_the_time(room):
    first, again = (study("ask_means", TINY, study_clouds(TINY, room.scans.points)) for _ in range(2))
    assert [{**row, "seconds": 0} for row in first] == [{**row, "seconds": 0} for row in again]


def test_progress_is_told():
    told = []
    uniform = replace(TINY, cloud="uniform")
    study("random", uniform, study_clouds(uniform), progress=lambda done, total: told.append((done, total)))
    assert told == [(1, 4), (2, 4), (3, 4), (4, 4)]


@pytest.mark.parametrize("seed", range(8))
def test_the_threshold_of_ask_means_gives_hardly_more_seeds_than_quick_means_draws(seed):
    points = uniform_squares(12.5)(3000, seed)
    count = len(quick_means_seeds(points, 1.0, seed))
    found = len(ask_means(points, matching_threshold(points, count, 1.0, seed), seed=seed))
    assert count <= found <= count * 1.05


@pytest.mark.parametrize("seed", range(20))
def test_a_threshold_is_found_where_the_number_of_seeds_falls_by_leaps(seed):
    points = np.random.default_rng(seed).uniform(0, 3, (12, 2))
    count = len(quick_means_seeds(points, 1.0, seed))
    assert len(ask_means(points, matching_threshold(points, count, 1.0, seed), seed=seed)) >= count


def test_a_seed_draws_a_uniform_cloud_of_its_own_at_each_size():
    """And none that is a smaller one, stretched and gone on with: sizes would tell the same thing several times."""
    small, large = (uniform_squares(12.5)(size, 3) for size in (500, 2000))
    within = [points / np.sqrt(len(points) / 12.5) for points in (small, large)]
    assert not np.isin(within[0].round(9), within[1].round(9)).any()
    np.testing.assert_array_equal(small, uniform_squares(12.5)(500, 3))


def test_uniform_clouds_are_as_dense_whatever_their_size():
    for size in (500, 8000):
        points = uniform_squares(12.5)(size, 0)
        assert points.shape == (size, 2) and np.prod(np.ptp(points, axis=0)) == pytest.approx(size / 12.5, rel=0.02)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"cloud": "fog"}, "study.cloud: expected one of returns, uniform, got 'fog'"),
        ({"sizes": []}, "study.sizes: expected at least one"),
        ({"sizes": 1000}, "study.sizes: expected a list of numbers of points, got 1000"),
        ({"sizes": [10, 0]}, "study.sizes: expected a whole number of at least 1, got 0"),
        ({"seeds": []}, "study.seeds: expected one or more different seeds"),
        ({"seeds": [3, 3]}, "study.seeds: expected one or more different seeds"),
        ({"seeds": [-1]}, "study.seeds: expected one or more different seeds from 0 on, got .-1"),
        ({"inner_radius_m": 0.0}, "study.inner_radius_m: expected a positive"),
        ({"lloyd_iterations": 0}, "study.lloyd_iterations: expected a whole number"),
        ({"points_per_m2": -1.0}, "study.points_per_m2: expected a positive"),
    ],
)
def test_settings_that_make_no_study_are_named(change, message):
    StudySettings().check()
    with pytest.raises(InputError, match=message):
        replace(StudySettings(), **change).check()
    with pytest.raises(InputError, match=message):
        study_clouds(replace(StudySettings(), **change), np.ones((20_000, 2)))


def test_what_cannot_be_compared_is_named_at_once():
    with pytest.raises(InputError, match="start: expected one of quick_means.*got 'forgy'"):
        study("forgy", TINY, uniform_squares(12.5))
    with pytest.raises(InputError, match="returns: expected points of a site for study.cloud=returns, got none"):
        study_clouds(StudySettings())
    with pytest.raises(InputError, match="sizes: expected a whole number from 1 to 9, got 20000"):
        study_clouds(StudySettings(), np.ones((9, 2)))
