"""What a study of clusterings leaves of itself."""

import pytest

from hilbertvae.checks import InputError
from hilbertvae.commands.clustering_study import write_clustering_failure
from hilbertvae.reports.run_folder import write_refusal
from hilbertvae.tables.clustering import read_starts


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_a_study_that_is_refused_for_a_number_that_json_lacks_says_why(tmp_path, value):
    error = InputError(f"resolution_m: expected a finite number, got {value}")
    write_clustering_failure(tmp_path / "random-seed0", {"resolution_m": value, "study": {"sizes": [value]}}, error)
    assert read_starts(tmp_path, "fig2").troubles() == [f"- failed: random-seed0, run: InputError: {error}"]


def test_a_study_that_was_refused_at_its_last_launch_is_named_beside_its_row(tmp_path):
    write_clustering_failure(tmp_path / "random-seed0", {}, InputError("old"))
    write_refusal(tmp_path / "random-seed0", InputError("study.sizes: too many"))
    line = "- refused at its last launch, so that its row is of an earlier one: random-seed0, study.sizes: too many"
    assert line in read_starts(tmp_path, "fig2").troubles()
