"""Means and spreads over training seeds against numbers worked out by hand, and runs that can't stand in one table."""

from importlib import import_module
from pathlib import Path

import pytest

from hilbertvae.checks import InputError
from hilbertvae.reports.result_json import write_result
from hilbertvae.scoring.result import Result

METRICS = ("precision", "recall", "f1", "best_f1", "auc")


@pytest.fixture
def compare(monkeypatch):
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / "benchmarks")
    return import_module("compare_runs").compare


def put(folder, name, value, commit="abc", steps=3):
    regions = {region: dict.fromkeys(METRICS, [value, value + 0.2]) for region in ("observed", "gaps")}
    scores = {"cvae-hm": {"points": regions, "voxels": regions}, "nearest": {"points": regions, "voxels": regions}}
    config = {"trainer": {"epochs": 1, "steps_per_epoch": steps, "batch_size": 4}, "data": {}}
    about = {"config": config, "git": {"commit": commit, "dirty": False}, "packages": {"numpy": "2"}}
    write_result(folder / name / "result.json", Result("hall", 2, 2.5, [0, 1], {}, scores), about)


def test_mean_over_gap_seeds_and_then_over_training_seeds(compare, tmp_path):
    put(tmp_path, "gated-seed0", 0.4)
    put(tmp_path, "gated-seed1", 0.6)
    rows = [line for line in compare(tmp_path).splitlines() if line.startswith("| gated")]
    assert len(rows) == 1 and rows[0].startswith("| gated | cvae-hm | 2 |")
    assert rows[0].count("60.0±14.1") == 7  # 0.5 and 0.7


def test_the_committed_table_is_what_the_committed_results_give(compare):
    folder = Path(__file__).parents[2] / "docs" / "results" / "real_2d_quick"
    assert (folder / "comparison.md").read_text() == compare(folder)


def test_runs_of_another_commit_are_refused(compare, tmp_path):
    put(tmp_path, "gated-seed0", 0.4)
    put(tmp_path, "gated-seed1", 0.6, commit="def")
    with pytest.raises(InputError, match="gated-seed1.*its commit differs"):
        compare(tmp_path)


def test_runs_of_another_length_are_refused(compare, tmp_path):
    put(tmp_path, "gated-seed0", 0.4)
    put(tmp_path, "gated-seed1", 0.6, steps=4)
    with pytest.raises(InputError, match="gated-seed1.*its trainer.steps differs"):
        compare(tmp_path)


def test_folders_without_runs_or_of_other_names(compare, tmp_path):
    with pytest.raises(InputError, match="found none"):
        compare(tmp_path)
    put(tmp_path, "run", 0.4)
    with pytest.raises(InputError, match="expected a folder named"):
        compare(tmp_path)
