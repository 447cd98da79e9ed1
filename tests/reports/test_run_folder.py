import json
import math

import pytest
from reports_toys import reconstructor, result

from hilbertvae.checks import InputError
from hilbertvae.reports.provenance import provenance
from hilbertvae.reports.result_json import read_result, write_result
from hilbertvae.reports.run_folder import (
    RUN,
    TRAINING,
    UNFINISHED,
    clear,
    forget,
    forget_other_sites,
    is_finished,
    is_trained,
    site_folder,
    was_scored_alone,
    write_failure,
)

IDENTITY = {"training": "abc"}


@pytest.fixture
def finished(tmp_path):
    found = result()
    write_result(tmp_path / "result.json", found, provenance({}, identity=IDENTITY))
    return tmp_path, found


def test_the_same_settings_are_finished(finished):
    folder, found = finished
    assert is_finished(folder, [found.site], IDENTITY)
    assert not is_finished(folder, [found.site], {"training": "other"})
    assert not is_finished(folder, ["elsewhere"], IDENTITY)
    assert not is_finished(folder, [found.site, "another"], IDENTITY)
    assert not is_finished(folder, [], IDENTITY)


def test_scores_that_are_still_kept_say_that_something_is_to_be_written(finished):
    folder, found = finished
    (folder / UNFINISHED).mkdir()
    assert not is_finished(folder, [found.site], IDENTITY)


def test_all_sites_have_to_be_there(finished):
    folder, found = finished
    other = result()
    other.site = "simulated:5"
    write_result(site_folder(folder, other.site, first=False) / "result.json", other, provenance({}, identity=IDENTITY))
    assert is_finished(folder, [found.site, "simulated:5"], IDENTITY)


def test_pictures_that_are_asked_for_are_part_of_it(finished):
    folder, found = finished
    assert is_finished(folder, [found.site], IDENTITY, pictures=False)
    assert not is_finished(folder, [found.site], IDENTITY, pictures=True)
    (folder / "pictures").mkdir()
    assert is_finished(folder, [found.site], IDENTITY, pictures=True)


def test_a_training_is_done_when_its_network_is_there(tmp_path):
    assert not is_trained(tmp_path)
    network = reconstructor()
    network.card = {"training_hash": "abc"}
    network.save(tmp_path / "model.safetensors")
    assert not is_trained(tmp_path)
    (tmp_path / TRAINING).write_text('{"training_hash": "abc", "kept_name": "x"}')
    assert is_trained(tmp_path) and is_trained(tmp_path, "abc") and not is_trained(tmp_path, "other")
    (tmp_path / TRAINING).write_text('{"training_hash": "another, begun since"}')
    assert not is_trained(tmp_path) and not is_trained(tmp_path, "abc")
    (tmp_path / TRAINING).write_text('{"training_hash": "abc"}')
    network.card = {}
    network.save(tmp_path / "model.safetensors")
    assert not is_trained(tmp_path)


def test_all_results_of_a_folder_are_forgotten_and_nothing_else(finished):
    folder, found = finished
    write_result(folder / "elsewhere/result.json", found, provenance({}, identity=IDENTITY))
    (folder / "elsewhere/scores.md").write_text("")
    (folder / "model.safetensors").write_text("")
    forget(folder)
    assert sorted(path.name for path in folder.rglob("*")) == ["elsewhere", "model.safetensors", "scores.md"]


@pytest.fixture
def elsewhere(finished):
    """Makes a folder, in the run's own, of a result of a site, with all that stands beside it and a note of somebody's own."""
    folder, found = finished

    def make(name, identity, site="simulated:5"):
        other = result()
        other.site = site
        write_result(folder / name / "result.json", other, provenance({}, identity=identity))
        (folder / name / "pictures").mkdir()
        for beside in ("scores.md", "pictures/map.png", "surface.ply", "note.txt"):
            (folder / name / beside).write_text("")
        return folder / name

    return make


def names(folder):
    return sorted(path.name for path in folder.iterdir())


WHOLE = ["note.txt", "pictures", "result.json", "scores.md", "surface.ply"]


def test_sites_that_a_run_has_no_more_are_forgotten_with_what_shows_them(finished, elsewhere):
    folder, _ = finished
    before, now = elsewhere("simulated-5", {"training": "before"}), elsewhere("simulated-6", IDENTITY, "simulated:6")
    forget_other_sites(folder, IDENTITY)
    assert names(before) == ["note.txt"] and names(now) == WHOLE and (folder / "result.json").exists()
    forget(folder)
    assert names(now) == ["note.txt"]


@pytest.mark.parametrize("mark", [".lock", "training.json", "model.safetensors", "checkpoints", "tensorboard"])
def test_folders_of_other_runs_are_left_alone(finished, elsewhere, mark):
    folder, _ = finished
    run, of_another_name = elsewhere("simulated-5", {"training": "before"}), elsewhere("mine", {"training": "before"})
    (run / mark).mkdir()
    (folder / "broken").mkdir()
    (folder / "broken/result.json").write_text("{")
    forget_other_sites(folder, IDENTITY)
    assert names(run) == sorted([mark, *WHOLE]) and names(of_another_name) == WHOLE and names(folder / "broken") == ["result.json"]


def test_a_folder_that_was_scored_into_alone(finished):
    folder, _ = finished
    assert was_scored_alone(folder) and not was_scored_alone(folder / "of-somebody-else")
    (folder / TRAINING).write_text("{}")
    assert not was_scored_alone(folder)


def test_what_shows_an_earlier_scoring_is_cleared(tmp_path):
    clear(tmp_path)
    for name in ("tensorboard/events", "pictures/map.png", "surface.ply", "model.safetensors"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("")
    clear(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["model.safetensors"]


@pytest.mark.parametrize("damage", ["gone", "cut", "failed"])
def test_what_is_damaged_or_failed_is_made_again(finished, damage):
    folder, found = finished
    path = folder / "result.json"
    if damage == "gone":
        path.unlink()
    elif damage == "cut":
        path.write_text(path.read_text()[:100])
    else:
        found.failed = {"hm": "ValueError: no"}
        write_result(path, found, provenance({}, identity=IDENTITY))
    assert not is_finished(folder, [found.site], IDENTITY)


def test_a_broken_run_is_a_result_that_can_be_read(tmp_path):
    config = {"dimension": 2, "data": {"test": ["intel"]}, "evaluation": {"gap_ratio": 0.5, "cluster_size_m": 5.0, "gap_seeds": [0, 1]}}
    path = write_failure(tmp_path, config, FloatingPointError("training loss is nan"))
    assert json.loads(path.read_text())["status"] == "failed"
    found, about = read_result(path)
    assert found.failed == {RUN: "FloatingPointError: training loss is nan"} and found.scores == {} and found.gap_diameter_m == 2.5
    assert about["config"] == config


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_run_that_was_refused_for_a_number_that_is_none_leaves_word(tmp_path, value):
    config = {"trainer": {"learning_rate": value, "all": [value, 1.0]}, "evaluation": {"gap_ratio": value, "cluster_size_m": 5.0}}
    found, about = read_result(write_failure(tmp_path, config, InputError("trainer.learning_rate: expected a positive number")))
    assert found.failed == {RUN: "InputError: trainer.learning_rate: expected a positive number"}
    assert about["config"]["trainer"] == {"learning_rate": str(value), "all": [str(value), 1.0]}


def test_even_a_run_without_settings_leaves_word(tmp_path):
    found, _ = read_result(write_failure(tmp_path, {}, InputError("trainer.epoch: unknown key")))
    assert found.failed == {RUN: "InputError: trainer.epoch: unknown key"}
