"""Pairwise and occlusion tables against numbers worked out by hand."""

from dataclasses import replace

import pytest

from hilbertvae.reports.comparison import error_table, occlusion_table, pairwise_table
from hilbertvae.scoring.result import Result


def result_of(scores):
    return Result("hall", 2, 2.5, [0, 1], {}, scores)


def gaps(f1, auc, best_f1):
    return {"gaps": {"f1": f1, "auc": auc, "best_f1": best_f1}}


def test_pairwise_counts_the_seeds_won_and_averages_the_differences_in_points():
    ours = {"points": gaps([0.8, 0.7], [0.9, 0.9], [0.8, 0.8]), "voxels": gaps([0.5, 0.5], [0.8, 0.7], [0.6, 0.5])}
    theirs = {"points": gaps([0.7, 0.74], [0.8, 0.7], [0.7, 0.7]), "voxels": gaps([0.4, 0.4], [0.9, 0.8], [0.5, 0.3])}
    table = pairwise_table(result_of({"cvae-hm": ours, "cvae-hm-points": ours, "nearest": theirs, "gap-centre": theirs}))
    row = next(line for line in table.splitlines() if "nearest" in line)
    assert "1 of 2, +3.0" in row  # F1 at the cut, points: +0.10 and -0.04
    assert "2 of 2, +15.0" in row  # AUC, points: +0.1 and +0.2
    assert "0 of 2, -10.0" in row  # AUC, voxels: -0.1 and -0.1
    assert "gap-centre" not in table


def test_pairwise_in_another_region():
    points, voxels = gaps([0.8] * 2, [0.9] * 2, [0.8] * 2)["gaps"], gaps([0.5] * 2, [0.8] * 2, [0.6] * 2)["gaps"]
    ours = {"points": {"gaps-above-ground": points}, "voxels": {"gaps-above-ground": voxels}}
    theirs = {reading: {"gaps-above-ground": gaps([0.6] * 2, [0.95] * 2, [0.5] * 2)["gaps"]} for reading in ("points", "voxels")}
    result = result_of({"cvae-hm": ours, "cvae-hm-points": ours, "nearest": theirs})
    table = pairwise_table(result, "gaps-above-ground")
    assert "in gaps-above-ground, against" in table and "2 of 2, +20.0" in table and "0 of 2, -5.0" in table
    assert pairwise_table(result) == ""


def test_pairwise_is_empty_without_a_network_or_without_rivals():
    only = {"points": gaps([0.8], [0.9], [0.8]), "voxels": gaps([0.5], [0.8], [0.6])}
    assert pairwise_table(result_of({"nearest": only})) == ""
    assert pairwise_table(result_of({"cvae-hm": only})) == ""


def test_a_network_s_map_with_settings_of_its_own_is_no_rival():
    maps = {reading: gaps([0.8, 0.7], [0.9, 0.9], [0.8, 0.8]) for reading in ("points", "voxels")}
    table = pairwise_table(result_of(dict.fromkeys(("cvae-hm", "cvae-hm-k3", "cae-hm-paper", "lard-hm"), maps)))
    assert "lard-hm" in table and "k3" not in table and len(table.splitlines()) == 3


def test_occlusion_shows_auc_and_nll_beside_the_base_rates():
    region = {"auc": [0.6, 0.8], "nll": [0.3, 0.5], "base_rate_nll": [0.25, 0.35], "count": [9.0, 7.0]}
    empty = {key: [0.0, 0.0] for key in region}
    table = occlusion_table(result_of({"nearest": {"voxels": {"occluded-half-0.5-1": region, "occluded-half-1-2.5": empty}}}))
    assert "occluded-half-0.5-1" in table and "70.0" in table and "0.400" in table
    assert "constant base rate" in table and "0.300" in table and "1-2.5" not in table
    assert "The 2 gap seeds are 2 different choices of scans for occluded-sparse, and one choice for occluded-half." in table


def test_seeds_in_which_a_region_is_empty_count_for_nothing():
    """Of these `score` says 0, AUC 0.5."""
    region = {"auc": [0.5, 0.2], "nll": [0.0, 0.4], "base_rate_nll": [0.0, 0.3], "count": [0.0, 7.0]}
    table = occlusion_table(result_of({"nearest": {"voxels": {"occluded-half-0.5-1": region}}}))
    assert "| nearest | 20.0; 0.400 |" in table and "| constant base rate | 50.0; 0.300 |" in table
    counts = {"count": [0.0, 7.0]}
    ours, theirs = ({"points": {"gaps": gaps([0.0, f1], [0.5, f1], [0.0, f1])["gaps"] | counts}} for f1 in (0.6, 0.5))
    assert "| nearest | 1 of 1, +10.0 | 1 of 1, +10.0 |" in pairwise_table(result_of({"cvae-hm-points": ours, "nearest": theirs}))


def test_a_rival_that_was_not_asked_in_a_region_has_no_row_there():
    """Whoever is told where gaps are is scored in gaps alone, whatever its name."""
    asked = {reading: gaps([0.8] * 2, [0.9] * 2, [0.8] * 2) for reading in ("points", "voxels")}
    ours = {reading: {"occluded-half": found["gaps"]} | found for reading, found in asked.items()}
    result = result_of({"cvae-hm": ours, "leak": asked, "nearest": ours})
    table = pairwise_table(result, "occluded-half")
    assert "nearest" in table and "leak" not in table and "leak" in pairwise_table(result)
    assert pairwise_table(result_of({"cvae-hm": ours, "leak": asked}), "occluded-half") == ""


@pytest.mark.parametrize(
    ("seeds", "said"), [([0, 1, 2], "3 different choices"), ([0, 10, 20], "one choice"), ([3, 4, 13], "2 different choices")]
)
def test_seeds_that_keep_the_same_scans_are_one_choice(seeds, said):
    region = {key: [0.5] * 3 for key in ("auc", "nll", "base_rate_nll", "count")}
    result = replace(result_of({"nearest": {"voxels": {"occluded-sparse-0.5-1": region}}}), gap_seeds=seeds)
    assert f"The 3 gap seeds are {said} of scans for occluded-sparse, and one choice for occluded-half." in occlusion_table(result)
    asked = {reading: gaps([0.8] * 3, [0.9] * 3, [0.8] * 3)["gaps"] for reading in ("points", "voxels")}
    both = {reading: {"occluded-sparse": found, "occluded-half": found, "gaps": found} for reading, found in asked.items()}
    result = replace(result_of({"cvae-hm": both, "cvae-hm-points": both, "nearest": both}), gap_seeds=seeds)
    assert pairwise_table(result, "occluded-sparse").startswith(f"| in occluded-sparse ({said} of scans), against |")
    assert pairwise_table(result, "occluded-half").startswith("| in occluded-half (one choice of scans), against |")
    assert pairwise_table(result).startswith("| in gaps, against |")


def test_errors_are_ranked_seed_by_seed():
    sure = {"voxels": {"gaps": {"error_auc_spread": [0.8, 0.6], "error_auc_doubt": [0.7, 0.7], "count": [9.0, 9.0]}}}
    table = error_table(result_of({"cvae-hm": sure, "nearest": {"voxels": gaps([0.4] * 2, [0.9] * 2, [0.5] * 2)}}))
    assert "| cvae-hm | 70.0±14.1 | 70.0±0.0 | 1 of 2 |" in table and "nearest" not in table
    assert error_table(result_of({"nearest": {"voxels": {}}})) == ""


def test_a_seed_without_errors_says_nothing_of_how_they_are_ranked():
    sure = {"error_auc_spread": [0.9, 0.5, 0.7], "error_auc_doubt": [0.8, 0.5, 0.8], "errors": [0.1, 0.0, 0.3], "count": [9.0] * 3}
    assert "| cvae-hm | 80.0±14.1 | 80.0±0.0 | 1 of 2 |" in error_table(result_of({"cvae-hm": {"voxels": {"gaps": sure}}}))
    assert error_table(result_of({"cvae-hm": {"voxels": {"gaps": sure | {"errors": [0.0, 1.0, 0.0]}}}})) == ""


def test_occlusion_is_empty_where_it_was_not_scored():
    assert occlusion_table(result_of({"nearest": {"voxels": {}}})) == ""
