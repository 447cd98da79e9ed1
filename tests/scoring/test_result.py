import json

import pytest

from hilbertvae.scoring.result import Result


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
