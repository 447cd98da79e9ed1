"""A sweep's folder: what is read, and what is refused with the file's name and the key."""

import json

import pytest

from hilbertvae.checks import InputError
from hilbertvae.reports.run_folder import write_refusal
from hilbertvae.tables.layouts import read_page
from hilbertvae.tables.sweep import case_of, grouped, read_sweep
from toy_sweeps import change, declare, put, put_failed


def test_case_and_seed_come_from_the_configuration_else_from_the_folder(tmp_path):
    put(tmp_path, "4m-gap0.5-seed7", {"nearest": [0.1, 0.2]}, case="small", seed=3)
    path = put(tmp_path, "gated-seed2", {"nearest": [0.1, 0.2]})
    change(path, lambda content: [content["config"].pop(key) for key in ("case", "seed")])
    assert {(run.case, run.seed) for run in read_sweep(tmp_path, "table1").runs} == {("small", 3), ("gated", 2)}
    assert case_of("cvae-hm-seed10") == "cvae-hm" and case_of("other") == "other"


def test_what_a_run_knows(tmp_path):
    put(tmp_path, "a-seed0", {"cvae-hm": [0.1, 0.2]}, config={"mapper.cvae-hm.neighbours": 3}, maps={"cvae-hm": {"bytes": [5, 7]}})
    (run,) = read_sweep(tmp_path, "table1").runs
    assert run.config("mapper.cvae-hm.neighbours") == 3 and run.config("mapper.cvae-hm.no.such", 9) == 9
    assert run.map("cvae-hm", "bytes") == [5.0, 7.0] and run.map("cvae-hm", "clusters") == [] and run.map("hm", "bytes") == []
    assert run.stage_seconds("train") == [90.0] and run.stage_seconds("tea") == []
    assert run.champion("points") == run.champion("voxels") == "cvae-hm"
    with pytest.raises(InputError, match="a-seed0/result.json: config.network.depth: missing"):
        run.setting("network.depth")


def test_jobs_that_are_missing_failed_or_strangers(tmp_path):
    declare(tmp_path, "table1", ["a-seed0", "a-seed1", "b-seed0", "c-seed0"])
    put(tmp_path, "a-seed0", {"nearest": [0.1, 0.2]})
    put(tmp_path, "a-seed0/annex", {"nearest": [0.1, 0.2]}, site="annex")
    put_failed(tmp_path, "b-seed0")
    put(tmp_path, "old-seed0", {"nearest": [0.1, 0.2]}, protocol={"gap_ratio": 9})
    sweep = read_sweep(tmp_path)
    assert (sweep.kind, sweep.size, sweep.missing, sweep.strangers) == ("table1", "quick", ["a-seed1", "c-seed0"], ["old-seed0"])
    assert sweep.absent() == {"b": "failed", "c": "missing"} and sweep.gone("a") == ["missing: a-seed1"]
    assert sweep.sites() == ["hall", "annex"]


def test_a_job_that_was_refused_at_its_last_launch_is_named_beside_its_row(tmp_path):
    put(tmp_path, "a-seed0", {"nearest": [0.1, 0.2]})
    put(tmp_path, "a-seed1", {"nearest": [0.1, 0.2]})
    write_refusal(tmp_path / "a-seed1", InputError("b.npz: no such file"))
    sweep = read_sweep(tmp_path, "table1")
    assert sweep.refused == {"a-seed1": "b.npz: no such file"}
    (line,) = sweep.troubles()
    assert line == "- refused at its last launch, so that its row is of an earlier one: a-seed1, b.npz: no such file"


def test_a_job_with_only_a_further_site_is_missing(tmp_path):
    declare(tmp_path, "table1", ["a-seed0"])
    put(tmp_path, "a-seed0/annex", {"nearest": [0.1, 0.2]}, site="annex")
    assert read_sweep(tmp_path).missing == ["a-seed0"]


def test_a_single_run_is_no_sweep(tmp_path):
    (tmp_path / "result.json").touch()
    with pytest.raises(InputError, match="one run and no sweep of several; its table is .*scores.md"):
        read_page(tmp_path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "sweep.json: can't be read, or is damaged"),
        ("[]", "sweep.json: expected an object"),
        ('{"size": "quick", "jobs": []}', "sweep.json: sweep: expected text"),
        ('{"sweep": "table1", "size": "huge", "jobs": []}', "sweep.json: size: expected quick or full, got 'huge'"),
        ('{"sweep": "table1", "size": "full", "jobs": [1]}', "sweep.json: jobs: expected names of folders"),
        ('{"sweep": "table9", "size": "full", "jobs": []}', "sweep.json: sweep: expected one of table1"),
        ('{"sweep": "table2", "size": "full", "jobs": []}', "sweep.json: sweep: expected table1, as --sweep says, got table2"),
    ],
)
def test_a_bad_sweep_file(tmp_path, content, message):
    put(tmp_path, "a-seed0", {"nearest": [0.1, 0.2]})
    (tmp_path / "sweep.json").write_text(content)
    with pytest.raises(InputError, match=message):
        read_page(tmp_path, "table1" if "table2" in message else None)


@pytest.mark.parametrize("size", ["quick", ""])
def test_a_sweep_of_ones_own_has_the_table_that_is_asked_for(tmp_path, size):
    put(tmp_path, "a-seed0", {"nearest": [0.1, 0.2]})
    (tmp_path / "sweep.json").write_text(json.dumps({"sweep": "mine", "size": size, "jobs": ["a-seed0", "b-seed0"]}))
    with pytest.raises(InputError, match="got 'mine'; say with --sweep which of these tables it is to have"):
        read_page(tmp_path)
    text = read_page(tmp_path, "table1").markdown()
    assert f"(table1{', size quick' if size else ''})" in text and "missing: b-seed0" in text


def test_no_folder_no_results_and_no_kind(tmp_path):
    with pytest.raises(InputError, match="nowhere: no such folder"):
        read_page(tmp_path / "nowhere")
    with pytest.raises(InputError, match="say which sweep this is with --sweep"):
        read_page(tmp_path)
    with pytest.raises(InputError, match="expected <job>/result.json, found none"):
        read_page(tmp_path, "table1")


@pytest.mark.parametrize(
    ("how", "message"),
    [
        (lambda c: c.pop("scores"), "scores is missing"),
        (lambda c: c.pop("config"), "config: expected an object"),
        (lambda c: c.pop("packages"), "packages: expected an object"),
        (lambda c: c["packages"].pop("hilbertvae"), "packages.hilbertvae: missing"),
        (lambda c: c.update(git="abc"), "git: expected an object, got 'abc'"),
        (lambda c: c.update(host="x"), "host: expected an object, got 'x'"),
        (lambda c: c.update(data=[1]), "data: expected an object, got [1]"),
        (lambda c: c.update(stage_seconds=[1]), "stage_seconds: expected an object, got [1]"),
        (lambda c: c.update(stage_seconds={"train": "long"}), "stage_seconds.train: expected a number, got 'long'"),
        (lambda c: c["config"].update(case=3), "config.case: expected text, got 3"),
        (lambda c: c["config"].update(seed="x"), "config.seed: expected a whole number, got 'x'"),
    ],
)
def test_a_bad_result_names_itself_and_the_key(tmp_path, how, message):
    path = put(tmp_path, "a-seed0", {"nearest": [0.1, 0.2]})
    change(path, how)
    with pytest.raises(InputError) as error:
        read_page(tmp_path, "table1")
    assert str(path) in str(error.value) and message in str(error.value)


def test_a_job_that_broke_before_its_settings_were_known_is_a_failure_and_no_refusal(tmp_path):
    change(put_failed(tmp_path, "a-seed0"), lambda content: content["config"].update(seed="???", case=None))
    (run,) = read_sweep(tmp_path, "table1").runs
    assert run.case == "a" and "- failed: a-seed0, run: ValueError: no" in read_page(tmp_path, "table1").markdown()


def test_a_site_that_a_jobs_last_run_did_not_score_is_no_row(tmp_path):
    put(tmp_path, "a-seed0", {"nearest": [0.1, 0.2]}, about={"config_hash": "new"})
    put(tmp_path, "a-seed0/annex", {"nearest": [0.3, 0.4]}, site="annex", about={"config_hash": "old"})
    put(tmp_path, "a-seed0/hall", {"nearest": [0.3, 0.4]}, site="stairs", about={"config_hash": "new"})
    sweep = read_sweep(tmp_path, "table1")
    assert sweep.older == ["a-seed0/annex"] and sweep.sites() == ["hall", "stairs"]
    assert "- left out: a-seed0/annex, which is of another run than its job" in sweep.troubles()


@pytest.mark.parametrize(
    ("config", "about"),
    [({"checkpoint": "a.safetensors"}, {}), ({"mapper": {"cvae-hm": {"reconstructor": "a.safetensors"}}}, {"card": {"epoch": 3}})],
)
def test_one_network_is_one_training_however_often_it_is_scored(tmp_path, config, about):
    """`checkpoint=... seed=0,1,2`, or a network that mappers name, scores one training three times, and networks of three trainings may all
    be scored with `seed=0`."""
    given = {"config": config, "case": "a"}
    for seed in (0, 1):
        put(tmp_path / "once", f"a-seed{seed}", {"nearest": [0.1, 0.2]}, seed=seed, about=about | {"seeds": {"training": 7}}, **given)
        put(tmp_path / "twice", f"a-seed{seed}", {"nearest": [0.1, 0.2]}, seed=0, about=about | {"seeds": {"training": seed}}, **given)
    with pytest.raises(InputError, match="a-seed1/result.json: seeds.training: 7 of the same row is also in .*a-seed0"):
        grouped(read_sweep(tmp_path / "once", "table1").runs, lambda run: run.case)
    assert grouped(read_sweep(tmp_path / "twice", "table1").runs, lambda run: run.case)["a"].keys() == {0, 1}


def test_two_runs_of_one_cell(tmp_path):
    for job in ("a-seed0", "b-seed0"):
        put(tmp_path, job, {"nearest": [0.1, 0.2]}, case="a", seed=0)
    with pytest.raises(InputError, match="b-seed0/result.json: config.seed: 0 of the same row is also in .*a-seed0"):
        grouped(read_sweep(tmp_path, "table1").runs, lambda run: run.case)
