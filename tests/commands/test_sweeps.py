"""Every sweep that is shipped, with `debug=fast`, and what a sweep promises: it survives, it skips, it trains once."""

import json
import os
import re
import signal
import subprocess
import time
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from pathlib import Path

import pytest
from composed_settings import settings_of
from hydra import compose, initialize_config_dir
from narrow_networks import narrowed, shared_grids
from small_sweep import ABLATION, TRAIN, environment, multirun
from warm_start import train

from hilbertvae.clusters.starts import STARTS
from hilbertvae.commands.configuration import CONF, SWEEPS
from hilbertvae.commands.run import run
from hilbertvae.commands.sweep_progress import earlier_jobs, list_jobs, what_failed
from hilbertvae.commands.table import main as table
from hilbertvae.reports.result_json import read_result
from hilbertvae.reports.run_folder import UNFINISHED
from hilbertvae.training.kept_network import kept_name

pytest.importorskip("embreex")
pytestmark = pytest.mark.filterwarnings("ignore")

NAMES = sorted(path.stem for path in (SWEEPS / "sweep").glob("*.yaml"))
README = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
RUN_ELSEWHERE = re.findall(r"^\.venv/bin/hilbertvae-train -m \+sweep=(\w+)", README, re.MULTILINE)
"""Sweeps whose quick cases `test_readme.py` runs."""
CASES = sorted((path.parent.name, path.stem) for path in (SWEEPS / "cases").glob("*/*.yaml"))


def test_the_help_names_the_command_and_every_sweep(tmp_path):
    said = subprocess.run([*TRAIN, "--help"], cwd=tmp_path, capture_output=True, text=True, timeout=120, check=True).stdout
    first, *lines = said.splitlines()
    assert first.startswith("hilbertvae-train: ")
    (named,) = (line for line in lines if "+sweep=" in line)
    assert sorted(re.findall(r"\w+", named.split("+sweep=")[1].replace("also", ""))) == NAMES
    assert not list(tmp_path.iterdir())


def size_of(sweep: str, case: str) -> str:
    return "full" if sweep.startswith("table") and case.endswith("-full") else "quick"


@pytest.fixture(scope="module")
def shared(tmp_path_factory) -> list[str]:
    """Networks that the jobs of this module share, as those of a sweep do, and grids."""
    folder = tmp_path_factory.mktemp("shared")
    return [f"data.cache={shared_grids(folder)}", f"trained={folder / 'trained'}", "trainer.threads=1"]


class TestEveryYaml:
    @pytest.mark.parametrize(("sweep", "case"), [case for case in CASES if case[0] not in RUN_ELSEWHERE or size_of(*case) == "full"])
    def test_case_runs(self, sweep, case, tmp_path, shared):
        chosen = [f"sweep={sweep}", f"cases/{sweep}={case}", f"size={size_of(sweep, case)}", "debug=fast"]
        settings = narrowed(settings_of(*chosen, "evaluation.occlusion=false", f"output={tmp_path / 'run'}", *shared))
        assert run(settings) == 0
        _, about = read_result(tmp_path / "run/result.json")
        assert about["config"]["case"] == settings.case != ""

    @pytest.mark.parametrize("size", ["quick", "full"])
    @pytest.mark.parametrize("sweep", NAMES)
    def test_sweep_is_made_of_runs_that_can_be(self, sweep, size):
        settings = settings_of(f"sweep={sweep}", f"size={size}")
        assert settings.name == f"{sweep}-{size}" and settings.size == size
        assert settings.trained == "outputs/trained"

    def test_the_full_figure_of_latent_dimensions_has_the_paper_s(self):
        cases = {tuple(one for one in overrides if not one.startswith("seed=")) for overrides in jobs_of("fig6", "full")}
        latents = {settings_of("sweep=fig6", "size=full", *overrides).network.latent for overrides in cases}
        assert {25, 100} <= latents and max(latents) > 100

    def test_all_quick_sweeps_together_train_at_most_thirty_networks(self):
        names = set()
        for sweep in NAMES:
            for overrides in jobs_of(sweep):
                settings = settings_of(f"sweep={sweep}", *overrides)
                networks = [mapper.get("reconstructor") for mapper in settings.mapper.values()]
                if settings.task == "maps" and "trained" in networks:
                    names.add(kept_name(settings))
        assert 20 <= len(names) <= 30


def jobs_of(sweep: str, size: str = "quick") -> list[list[str]]:
    """The overrides of each job of a sweep, from its own parameters."""
    with initialize_config_dir(str(CONF), version_base="1.3"):
        config = compose("config", overrides=[f"sweep={sweep}", f"size={size}"], return_hydra_config=True)
    parameters = {key: str(value).replace("${size}", size).split(",") for key, value in config.hydra.sweeper.params.items()}
    return [[f"{key}={value}" for key, value in zip(parameters, chosen, strict=True)] for chosen in product(*parameters.values())]


def test_starts_of_a_clustering_are_compared_and_tabled(tmp_path):
    """Figure 2 trains nothing: its jobs leave files of another kind."""
    for _ in range(2):
        done = train(tmp_path, "-m", "+sweep=fig2", "debug=fast", "study.cloud=uniform")
        assert done.returncode == 0 and "5 of 5 jobs have results" in done.stdout, done.stderr
    assert done.stdout.count("finished before") == 5
    folder = tmp_path / "outputs/debug/fig2-quick"
    assert {path.parent.name for path in folder.glob("*/clustering.json")} == {f"{start}-seed0" for start in STARTS}
    assert table([str(folder)]) == 0
    assert "| k-means++ | 400 |" in (folder / "table.md").read_text()


def test_a_study_that_is_refused_leaves_word_and_what_an_earlier_one_found(tmp_path):
    def launch(*words):
        return train(tmp_path, "-m", "+sweep=fig2", "debug=fast", "start=random", *words)

    path = tmp_path / "outputs/debug/fig2-quick/random-seed0/clustering.json"
    done = launch("study.sizes=[10000000]")
    assert done.returncode == 1 and "FAILED random-seed0: InputError: sizes" in done.stdout and not json.loads(path.read_text())["rows"]
    assert launch().returncode == 0
    before = path.read_bytes()
    done = launch("study.sizes=[10000000]")
    assert done.returncode == 1 and "FAILED random-seed0: sizes: " in done.stdout and path.read_bytes() == before


@pytest.mark.parametrize("damaged", ["{", "[]", '{"failed": 3}'])
def test_a_damaged_study_is_named_as_failed(tmp_path, damaged):
    (tmp_path / "clustering.json").write_text(damaged)
    assert f"{tmp_path / 'clustering.json'}" in what_failed(tmp_path, scored=False)


def test_jobs_of_earlier_launches_stay_listed(tmp_path):
    """Of the same sweep in the same size; whoever runs one case again would else find a table of that case alone."""
    path = tmp_path / "sweep.json"
    assert earlier_jobs(path, "table1", "quick") == []
    path.write_text('{"sweep": "table1", "size": "quick", "jobs": ["a-seed0", "b-seed0"]}')
    assert earlier_jobs(path, "table1", "quick") == ["a-seed0", "b-seed0"]
    assert earlier_jobs(path, "table1", "full") == earlier_jobs(path, "table2", "quick") == []
    for damaged in ("{", "[]", '{"sweep": "table1", "size": "quick", "jobs": 3}'):
        path.write_text(damaged)
        assert earlier_jobs(path, "table1", "quick") == []


def test_launches_at_the_same_time_list_each_other_s_jobs(tmp_path):
    names = [f"a-seed{seed}" for seed in range(8)]
    with ThreadPoolExecutor(len(names)) as launches:
        list(launches.map(lambda name: list_jobs(tmp_path / "new", "table1", "quick", [name]), names))
    assert sorted(earlier_jobs(tmp_path / "new/sweep.json", "table1", "quick")) == names


class TestASweepSurvives:
    def test_killed_it_goes_on_where_it_was(self, tmp_path):
        chosen = ["cases/ablation=default,weights-unit,dropout-0.2"]
        command = [*TRAIN, *ABLATION, *chosen]
        folder = tmp_path / "outputs/debug/ablation-quick"
        with open(tmp_path / "log", "w") as log:
            started = subprocess.Popen(command, cwd=tmp_path, stdout=log, stderr=log, env=environment(), start_new_session=True)
            until = time.monotonic() + 120
            # Its result stands before its pictures and TensorBoard do; a job that is killed between them is not finished.
            while not (folder / "default-seed0/result.json").exists() or (folder / "default-seed0" / UNFINISHED).exists():
                assert started.poll() is None and time.monotonic() < until, (tmp_path / "log").read_text()
                time.sleep(0.05)
            os.killpg(started.pid, signal.SIGKILL)
            started.wait()
        whole = (folder / "default-seed0/result.json").read_bytes()
        assert not (folder / "dropout-0.2-seed0/result.json").exists()
        assert json.loads((folder / "sweep.json").read_text()) == {
            "sweep": "ablation", "size": "quick", "jobs": ["default-seed0", "weights-unit-seed0", "dropout-0.2-seed0"],
        }  # fmt: skip

        done = multirun(tmp_path, *chosen)
        assert done.returncode == 0, done.stderr
        assert (folder / "default-seed0/result.json").read_bytes() == whole
        assert "finished dropout-0.2-seed0 in " in done.stdout and "default-seed0: finished before" in done.stdout
        assert "3 of 3 jobs have results" in done.stdout
        assert "weights-unit-seed0: its network was trained before" in done.stdout

        again = multirun(tmp_path, "cases/ablation=default,weights-unit")
        assert again.stdout.count("finished before") == 2 and "trained before" not in again.stdout
        assert len(json.loads((folder / "sweep.json").read_text())["jobs"]) == 3

    def test_a_failed_job_is_written_down_and_the_others_are_kept(self, tmp_path):
        done = multirun(tmp_path, "cases/ablation=default", "seed=-1,0")
        folder = tmp_path / "outputs/debug/ablation-quick"
        assert done.returncode == 1 and "1 of 2 jobs have results" in done.stdout
        assert "FAILED default-seed-1: run: InputError: seed" in done.stdout
        assert read_result(folder / "default-seed-1/result.json")[0].failed.keys() == {"run"}
        assert not read_result(folder / "default-seed0/result.json")[0].failed

    def test_a_refused_job_leaves_what_an_earlier_one_scored(self, tmp_path):
        chosen, folder = ["cases/ablation=default", "pictures=false"], tmp_path / "outputs/debug/ablation-quick/default-seed0"
        assert multirun(tmp_path, *chosen).returncode == 0
        before = (folder / "result.json").read_bytes()
        done = multirun(tmp_path, *chosen, "evaluation.gap_ratio=-1")
        assert done.returncode == 1 and "0 of 1 jobs have results" in done.stdout
        assert "FAILED default-seed0: evaluation.gap_ratio: " in done.stdout and "what lies there is of an earlier run" in done.stdout
        assert (folder / "result.json").read_bytes() == before
        done = multirun(tmp_path, *chosen)
        assert done.returncode == 0 and "default-seed0: finished before" in done.stdout and "1 of 1 jobs have results" in done.stdout

    def test_a_setting_that_no_mapper_knows_fails_the_job(self, tmp_path):
        done = multirun(tmp_path, "cases/ablation=default", "+mapper.cvae-hm.neighbors=1")
        assert done.returncode == 1
        assert "FAILED default-seed0: run: InputError: mapper.cvae-hm" in done.stdout

    def test_a_loss_that_is_not_finite_fails_the_job(self, tmp_path):
        done = multirun(tmp_path, "cases/ablation=default", "trainer.learning_rate=1e30")
        result, about = read_result(tmp_path / "outputs/debug/ablation-quick/default-seed0/result.json")
        assert done.returncode == 1 and result.failed.keys() == {"run"} and "training loss is nan" in result.failed["run"]
        assert about["config"]["case"] == "default"

    def test_a_multirun_that_is_no_sweep_says_what_failed(self, tmp_path):
        done = train(tmp_path, "-m", "debug=fast", "mapper=[nearest]", "pictures=false", "seed=-1,0")
        assert done.returncode == 1 and "1 of 2 jobs have results" in done.stdout
        assert "FAILED gated_small-seed-1: run: InputError: seed" in done.stdout

    def test_a_multirun_that_only_trains_is_finished_with_its_networks(self, tmp_path):
        words = ["-m", "debug=fast", "trainer.threads=1", "mapper=[]", "data.test=[]"]
        done = train(tmp_path, *words, "seed=0,1")
        assert done.returncode == 0 and "2 of 2 jobs have results" in done.stdout and "FAILED" not in done.stdout
        assert "gated_small-seed1: trained, nothing scored" in done.stdout
        again = train(tmp_path, *words, "seed=1,-1")
        assert "seed1: finished before" in again.stdout and "1 of 2 jobs have results" in again.stdout
        assert "FAILED gated_small-seed-1: run: InputError: seed" in again.stdout

    def test_jobs_that_would_share_a_folder_are_refused(self, tmp_path):
        done = multirun(tmp_path, "cases/ablation=default", "validation_gap_m=1.5,2.5")
        assert done.returncode == 2 and "a folder for each job, got several in default-seed0" in done.stderr
        assert not list(tmp_path.glob("**/result.json"))
        assert "start one sweep for each value of validation_gap_m, each with a `name` of its own" in done.stderr
        one_place = ["cases/ablation=default,adamw", "hydra.sweep.subdir=x"]
        assert "got several in x; leave hydra.sweep.subdir out" in multirun(tmp_path, *one_place).stderr

    @pytest.mark.parametrize("output", ["mine", "mine,yours"])
    def test_a_folder_for_all_jobs_is_no_output(self, tmp_path, output):
        done = multirun(tmp_path, "cases/ablation=default", f"output={output}")
        assert done.returncode == 2 and "output: expected none with -m" in done.stderr and "hydra.sweep.dir" in done.stderr
        assert not list(tmp_path.glob("**/result.json")) and not list(tmp_path.glob("**/sweep.json"))

    @pytest.mark.parametrize(
        ("varied", "name", "expected"),
        [
            (["start=random,quick_means"], "start-${hydra:runtime.choices.start}", {"start-random", "start-quick_means"}),
            (["mapper=[all-occupied],[all-occupied,nearest]"], "job-${hydra:job.num}", {"job-0", "job-1"}),
            (["data.test=[simulated:900002],[simulated:900003]", "flips=1,2"], "flips-${flips}_job-${hydra:job.num}",
             {"flips-1_job-0", "flips-2_job-1", "flips-1_job-2", "flips-2_job-3"}),
        ],
    )  # fmt: skip
    def test_the_name_that_is_proposed_for_folders_tells_jobs_apart(self, tmp_path, varied, name, expected):
        words = ["-m", "debug=fast", "mapper=[all-occupied]", "evaluation.occlusion=false", "pictures=false", *varied]
        refused = train(tmp_path, *words)
        named = re.search(r"add '(hydra.sweep.subdir=.*)'", refused.stderr)[1]
        assert named == f"hydra.sweep.subdir={name}-seed${{seed}}"  # as a table tells seeds
        assert train(tmp_path, *words, named).returncode == 0
        assert {path.parent.name for path in tmp_path.glob("outputs/debug/run/*/result.json")} == {f"{job}-seed0" for job in expected}

    def test_stopped_half_way_a_job_has_no_result_of_other_settings(self, tmp_path, monkeypatch):
        settings = settings_of("debug=fast", "mapper=[nearest]")
        settings.output = str(tmp_path)
        assert run(settings, again=False) == 0
        (found,) = tmp_path.glob("**/result.json")

        def stopped(*_):
            raise KeyboardInterrupt

        monkeypatch.setattr("hilbertvae.training.scoring.score", stopped)
        assert run(settings, again=False) == 0 and found.exists()
        settings.evaluation.gap_seeds = [7]
        with pytest.raises(KeyboardInterrupt):
            run(settings, again=False)
        assert not found.exists()
