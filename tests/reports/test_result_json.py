import json
import os
import subprocess

import pytest
import torch
from reports_toys import result

from hilbertvae.checks import InputError
from hilbertvae.files import hash_of
from hilbertvae.reports.provenance import git_state, named_without_folders, provenance, without_folders
from hilbertvae.reports.result_json import read_result, write_result
from hilbertvae.scoring.result import SCHEMA_VERSION


def changed(tmp_path, change):
    path = write_result(tmp_path / "result.json", result())
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
    return path


def test_round_trip(tmp_path):
    found = result()
    about = provenance(
        {"model": {"lr": 1e-3}, "paths": {"out": "x"}}, identity={"model": {"lr": 1e-3}}, data={"a.log": "00ff"}, seeds={"training": 1}
    )
    path = write_result(tmp_path / "run" / "result.json", found, about)
    again, read = read_result(path)
    assert again == found
    assert read == about
    assert read["config_hash"] == hash_of({"model": {"lr": 1e-3}})
    assert [file.name for file in path.parent.iterdir()] == ["result.json"]
    content = json.loads(path.read_text())
    for key in ("status", "site", "dimension", "gap_diameter_m", "gap_seeds", "ceiling", "scores"):
        assert key in content
    assert content["status"] == "ok"


def test_what_made_it():
    about = provenance({"a": 1}, seconds={"data": 1.5})
    assert about["packages"]["numpy"] and about["packages"]["torch"]
    assert about["host"]["threads"] >= 1 and about["host"]["cpu"]
    assert about["host"]["numbers"] in ("bfloat16", "float32")
    assert 10 < about["peak_memory_mb"] < 1e6
    assert about["command"] and "/" not in about["command"][0]
    assert about["config_hash"] == hash_of({"a": 1}) and about["stage_seconds"] == {"data": 1.5}


def test_what_filled_maps_is_said_where_it_is_no_cpu(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda device: f"a GPU at {device}")
    monkeypatch.setattr("hilbertvae.reconstruction.precision.fast_type", lambda device="cpu": f"torch.numbers-of-{device}")
    host = provenance({}, device="cuda:1")["host"]
    assert (host["numbers"], host["filled_by"]) == ("numbers-of-cuda:1", "a GPU at cuda:1")
    host = provenance({})["host"]
    assert host["numbers"] == "numbers-of-cpu" and "filled_by" not in host


def test_git_state_of_a_clean_a_dirty_and_no_repository(tmp_path):
    def git(*command):
        subprocess.run(["git", "-c", "user.name=t", "-c", "user.email=t@t", *command], cwd=tmp_path, check=True, capture_output=True)

    git("init")
    (tmp_path / "code").mkdir()
    (tmp_path / "code" / "a.py").write_text("1")
    (tmp_path / "installed").mkdir()
    (tmp_path / ".gitignore").write_text("installed\n")
    assert git_state(tmp_path / "code") is None  # tracked by nobody yet
    git("add", ".")
    git("commit", "-m", "one")
    state = git_state(tmp_path / "code")
    assert len(state["commit"]) == 40 and state["dirty"] is False
    index = (tmp_path / ".git" / "index").read_bytes()
    os.utime(tmp_path / "code" / "a.py", (0, 0))  # git's own status would note in the index that it looked at the file again
    assert git_state(tmp_path / "code") == state and (tmp_path / ".git" / "index").read_bytes() == index
    (tmp_path / "code" / "a.py").write_text("2")
    assert git_state(tmp_path / "code")["dirty"] is True
    (tmp_path / "installed" / "b.py").write_text("1")
    assert git_state(tmp_path / "installed") is None
    assert git_state(tmp_path / "nowhere") is None


def test_a_failed_mapper_fails_the_result(tmp_path):
    found = result()
    found.failed["gpom"] = "out of memory"
    path = write_result(tmp_path / "result.json", found)
    assert json.loads(path.read_text())["status"] == "failed"
    assert read_result(path)[0].failed == {"gpom": "out of memory"}


def test_nothing_is_written_that_json_can_t_hold(tmp_path):
    found = result()
    found.scores["nearest"]["points"]["gaps"]["auc"][0] = float("nan")
    with pytest.raises(ValueError):
        write_result(tmp_path / "result.json", found)
    assert not list(tmp_path.iterdir())
    with pytest.raises(ValueError, match="scores"):
        write_result(tmp_path / "result.json", result(), {"scores": {}})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c.pop("schema_version"), "not a result file of hilbertvae: schema_version is missing"),
        (lambda c: c.update(schema_version=99), f"schema_version 99, expected {SCHEMA_VERSION}"),
        (lambda c: c.pop("ceiling"), "ceiling is missing"),
        (lambda c: c.update(site=3), "site: expected text, got 3"),
        (lambda c: c.update(dimension=True), "dimension: expected a whole number, got True"),
        (lambda c: c.update(status="done"), "status: expected ok or failed, got 'done'"),
        (lambda c: c["scores"].update(nearest=[]), "scores.nearest: expected an object"),
        (
            lambda c: c["scores"]["nearest"]["points"]["gaps"]["f1"].pop(),
            "scores.nearest.points.gaps.f1: expected 3 numbers, one per gap seed",
        ),
        (lambda c: c["scores"]["nearest"]["points"]["gaps"].update(f1=[1, 2, "x"]), "scores.nearest.points.gaps.f1: expected 3 numbers"),
        (lambda c: c["scores"]["nearest"]["points"]["gaps"].update(f1=[1, 2, float("nan")]), "scores.nearest.points.gaps.f1"),
        (lambda c: c.update(gap_seeds=[0, 1, "x"]), "gap_seeds: expected whole numbers, got [0, 1, 'x']"),
        (lambda c: c.update(seconds={"nearest": 3}), "seconds.nearest: expected an object, got 3"),
        (lambda c: c.update(seconds={"nearest": {"fit": ["long"]}}), "seconds.nearest.fit: expected a list of numbers, got ['long']"),
        (lambda c: c.update(maps=[1]), "maps: expected an object, got [1]"),
        (lambda c: c.pop("maps"), "maps is missing"),
        (lambda c: c.update(ceiling={"points": {}}), "ceiling.points: expected precision and recall, got {}"),
        (lambda c: c.update(failed={"hm": 3}), "failed.hm: expected text, got 3"),
    ],
)
def test_a_bad_file_names_itself_and_the_key(tmp_path, change, message):
    path = changed(tmp_path, change)
    with pytest.raises(InputError) as error:
        read_result(path)
    assert str(path) in str(error.value) and message in str(error.value)


@pytest.mark.parametrize(
    ("text", "message"), [(None, "no such result file"), ("{", "not a result file, or damaged"), ("[1]", "not a result file of")]
)
def test_a_missing_a_cut_and_a_foreign_file(tmp_path, text, message):
    path = tmp_path / "result.json"
    if text is not None:
        path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_result(path)


def test_places_on_one_machine_are_left_out():
    given = {"checkpoint": "/somewhere/best.safetensors", "test": ["intel", "/drives/monday"], "rate": 0.5, "output": "outputs/run"}
    assert without_folders(given) == {"checkpoint": "best.safetensors", "test": ["intel", "monday"], "rate": 0.5, "output": "outputs/run"}
    assert without_folders(["checkpoint=/somewhere/best.safetensors", "--site"]) == ["checkpoint=best.safetensors", "--site"]


def test_two_places_with_one_name_are_told_apart():
    found = {"/a/attic.log": "1", "/b/attic.log": "2", "/c/attic.log": "3", "/d/attic.log": "1", "near/attic.log": "4", "cellar": "5"}
    named = {"attic.log": "1", "attic.log (2)": "2", "attic.log (3)": "3", "near/attic.log": "4", "cellar": "5"}
    assert named_without_folders(found) == named
