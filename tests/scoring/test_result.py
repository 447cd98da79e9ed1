import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hilbertvae.scoring.metrics import score
from hilbertvae.scoring.result import Result, asked


def result(**changes):
    values = {"site": "room", "dimension": 2, "gap_diameter_m": 2.5, "gap_seeds": [0, 1], "ceiling": {}, "protocol": {"centred": False}}
    return Result(**{**values, **changes})


def test_results_of_one_site_join():
    first = result(scores={"hm": {}}, seconds={"hm": {"fit": [1.0]}}, curves={"hm": {}})
    first.add(result(scores={"nearest": {}}, seconds={"nearest": {}}, failed={"gpom": "MemoryError: too large"}))
    assert set(first.scores) == {"hm", "nearest"} and set(first.seconds) == {"hm", "nearest"}
    assert first.failed == {"gpom": "MemoryError: too large"} and set(first.curves) == {"hm"}


def test_what_was_not_scored_has_no_values():
    found = result(scores={"hm": {"points": {"gaps": {"f1": [0.1, 0.2]}}}})
    assert found.values("hm", "points", "gaps", "f1") == [0.1, 0.2] and found.regions("hm", "points") == {"gaps": {"f1": [0.1, 0.2]}}
    for where in (("gpom", "points", "gaps", "f1"), ("hm", "voxels", "gaps", "f1"), ("hm", "points", "fitted", "f1")):
        assert found.values(*where) == []
    assert found.values("hm", "points", "gaps", "auc") == [] and found.regions("gpom", "points") == {}


@pytest.mark.parametrize("change", [{"site": "attic"}, {"gap_seeds": [0, 2]}, {"protocol": {"centred": True}}])
def test_results_that_can_not_be_compared_do_not_join(change):
    with pytest.raises(ValueError, match=f"results differ in {next(iter(change))}"):
        result().add(result(**change))


def test_the_contract_at_top_level():
    plain = result(scores={"hm": {"points": {"gaps": {"f1": [0.1, 0.2]}}}}).plain(commit="abc")
    assert plain["status"] == "ok" and plain["commit"] == "abc"
    assert {"status", "site", "dimension", "gap_diameter_m", "gap_seeds", "ceiling", "scores"} <= set(plain)
    assert plain["scores"]["hm"]["points"]["gaps"]["f1"] == [0.1, 0.2]
    assert json.loads(json.dumps(plain)) == plain
    assert result(failed={"hm": "ValueError: no"}).plain()["status"] == "failed"


OCCUPIED = np.arange(20) < 5
SURE, SILENT, WRONG = np.where(OCCUPIED, 0.9, 0.1), np.full(20, 0.2), np.where(OCCUPIED, 0.1, 0.9)


def metrics_of(*seeds):
    found = [score(occupied, probability) for occupied, probability in seeds]
    return {name: [one[name] for one in found] for name in found[0]}


def test_a_seed_in_which_nothing_was_called_occupied_has_no_precision():
    found = metrics_of((OCCUPIED, SURE), (OCCUPIED, SILENT), (OCCUPIED, WRONG), (OCCUPIED, np.full(20, 0.5)))
    assert asked(found, "precision") == [1.0, 0.0]  # what was called wrongly counts
    assert asked(found, "recall") == [1.0, 0.0, 0.0, 0.0] and asked(found, "f1") == [1.0, 0.0, 0.0, 0.0]
    assert asked(metrics_of((OCCUPIED, SILENT), (OCCUPIED, SILENT)), "precision") == [0.0, 0.0]


def test_a_seed_whose_region_is_all_free_or_all_occupied_ranks_nothing():
    free, full = np.zeros(20, bool), np.ones(20, bool)
    found = metrics_of((OCCUPIED, SURE), (free, SILENT), (full, WRONG))
    assert asked(found, "auc") == [1.0] and asked(found, "nll") == found["nll"]
    assert asked(found, "best_f1") == [1.0, 1.0] and asked(found, "recall") == [1.0, *found["recall"][2:]]


def test_shares_of_free_space_and_iou_leave_out_the_seeds_that_say_nothing_of_them():
    free, full = np.zeros(20, bool), np.ones(20, bool)
    found = metrics_of((OCCUPIED, SURE), (free, SILENT), (full, WRONG), (OCCUPIED, np.full(20, 0.9)))
    assert asked(found, "iou") == [1.0, 0.75, 0.25]  # nothing is occupied in the second
    assert asked(found, "free_recall") == [1.0, 1.0, 0.0]  # nothing is free in the third
    assert asked(found, "free_precision") == [1.0, 1.0, 0.0]  # nothing was called free in the fourth
    assert asked(metrics_of((OCCUPIED, np.full(20, 0.9)), (OCCUPIED, np.full(20, 0.5))), "free_precision") == [0.0, 0.0]


@given(st.lists(st.tuples(st.booleans(), st.sampled_from([0.1, 0.5, 0.9])), min_size=1, max_size=40))
def test_whether_anything_was_called_follows_from_the_shares(cells):
    """Found from what is kept of a seed; here by counting. Where all that was called, or freed, was wrong, shares can't tell."""
    occupied, probability = map(np.array, zip(*cells, strict=True))
    called, right_free = probability > 0.6, (probability <= 0.4) & ~occupied
    freed, right = probability <= 0.4, called & occupied
    kept = metrics_of((occupied, probability), (OCCUPIED, SURE))
    if called.any() or right_free.any() or not freed.any():
        assert len(asked(kept, "precision")) == 1 + called.any()
    if freed.any() or right.any() or not called.any():
        assert len(asked(kept, "free_precision")) == 1 + freed.any()


def gaps_of(*places):
    return [{"seed": seed, "centres": [place], "radius_m": [1.25], "share": 0.1} for seed, place in enumerate(places)]


def test_two_sites_of_one_name_and_two_mappers_of_one_name_do_not_join():
    first = result(scores={"mapper": {}}, gaps=gaps_of([0.0, 0.0], [1.0, 1.0]))
    with pytest.raises(ValueError, match="results differ in gaps"):
        first.add(result(scores={"other": {}}, gaps=gaps_of([0.0, 0.0], [1.0, 2.0])))
    with pytest.raises(ValueError, match="results have both mapper; give `evaluate` a `name` for each"):
        first.add(result(failed={"mapper": "MemoryError"}, gaps=first.gaps))
    with pytest.raises(ValueError, match="results differ in ceiling"):
        first.add(result(ceiling={"points": {"precision": 1.0, "recall": 1.0}}))
    assert first.add(result(scores={"other": {}})).mappers() == ["mapper", "other"]
