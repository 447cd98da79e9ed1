"""The command on every configuration that is shipped, with `debug=fast`, and its errors."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from composed_settings import settings_of
from hydra.errors import ConfigCompositionException
from narrow_networks import narrowed, shared_grids

from hilbertvae.checks import InputError
from hilbertvae.clusters.starts import STARTS
from hilbertvae.commands.build import build_mappers
from hilbertvae.commands.configuration import CONF
from hilbertvae.commands.run import run
from hilbertvae.commands.train import main
from hilbertvae.files import file_sha256
from hilbertvae.mappers.loading import load_mapper
from hilbertvae.mappers.nearest import NearestMapper
from hilbertvae.reconstruction.networks import build_network
from hilbertvae.reports.result_json import read_result
from hilbertvae.training.given_networks import give_networks
from toy_rooms import carmen_line, tiny_reconstructor, write_log

pytestmark = pytest.mark.filterwarnings("ignore")


def names(group: str) -> list[str]:
    return sorted(path.stem for path in (CONF / group).glob("*.yaml"))


README = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
RUN_ELSEWHERE = {"streets", *re.findall(r"^\.venv/bin/hilbertvae-train .*experiment=(\w+)", README, re.MULTILINE)}
"""Experiments that another test runs: README's commands in `test_readme.py`, and the street that is looked at."""


def fast(tmp_path: Path, *overrides: str):
    """Settings of a run in seconds, in a folder of its own; grids are shared with runs before."""
    folder = [f"output={tmp_path / 'run'}", f"data.cache={shared_grids(tmp_path)}", "trainer.threads=1"]
    return settings_of("debug=fast", *folder, *overrides)


@pytest.fixture(autouse=True)
def _simulator():
    pytest.importorskip("embreex")


class TestEveryConfiguration:
    @pytest.mark.parametrize("network", names("network"))
    def test_network_trains(self, network, tmp_path):
        where = ["experiment=streets"] if "3d" in network else ["grid.cells=64"]
        whole = settings_of(*where, f"network={network}")
        with torch.device("meta"):  # its own width is one that can be
            build_network(whole.network, whole.dimension, whole.grid.cells)
        settings = fast(tmp_path, *where, f"network={network}", "mapper=[cvae-hm]", "pictures=false", "evaluation.occlusion=false")
        assert run(narrowed(settings)) == 0
        found, _ = read_result(tmp_path / "run/result.json")
        assert set(found.scores) == {"cae-hm" if network.endswith("cae") else "cvae-hm"}

    @pytest.mark.parametrize("experiment", [name for name in names("experiment") if name not in RUN_ELSEWHERE])
    def test_experiment_runs(self, experiment, tmp_path):
        settings = fast(tmp_path, f"experiment={experiment}", "mapper=[cvae-hm]", "pictures=false", "evaluation.occlusion=false")
        assert run(narrowed(settings)) == 0

    @pytest.mark.parametrize("start", names("start"))
    def test_start_makes_a_map(self, start, tmp_path):
        settings = fast(tmp_path, f"start={start}", "mapper=[raw-grid-hm]", "pictures=false", "evaluation.occlusion=false")
        mappers = build_mappers(settings.mapper)
        assert give_networks(settings, mappers, None)["raw-grid-hm"].grid.start == start
        assert run(settings) == 0

    def test_a_start_may_be_chosen_by_its_key_and_beside_an_experiment(self):
        assert settings_of().grid.start == "quick_means"
        assert settings_of("grid.start=random").grid.start == "random"
        faithful = settings_of("experiment=faithful", "network=paper_32", "start=ask_means")
        assert (faithful.grid.start, faithful.grid.cluster_diameter_m, faithful.flips) == ("ask_means", 5.0, 1)

    def test_there_is_a_file_for_every_start(self):
        assert names("start") == sorted(STARTS)

    def test_a_run_in_three_dimensions_is_scored_and_looked_at(self, tmp_path):
        settings = fast(tmp_path, "experiment=streets", "mapper=[cvae-hm,octomap,nearest]", "evaluation.occlusion=false")
        assert run(narrowed(settings)) == 0
        found, _ = read_result(tmp_path / "run/result.json")
        assert found.dimension == 3 and set(found.scores) == {"cvae-hm", "octomap", "nearest"}
        assert {"gaps-above-ground", "gaps-near-ground"} <= set(found.scores["octomap"]["voxels"])
        pictures = {path.stem for path in (tmp_path / "run/pictures").glob("*.png")}
        assert pictures >= {"map", "gaps", "slices", "pipeline", "sites", "prior", "precision_recall", "reliability"}
        assert "paper" in (tmp_path / "run/scores.md").read_text()

    def test_a_conditional_prior_shows_several_completions_of_a_gap(self, tmp_path):
        assert run(fast(tmp_path, "network=gated_conditional", "mapper=[cvae-hm]", "evaluation.occlusion=false")) == 0
        pictures = {path.stem for path in (tmp_path / "run/pictures").glob("*.png")}
        assert "completions" in pictures and "prior" not in pictures

    def test_maps_whose_network_learns_from_the_site_are_rows_of_their_own(self, tmp_path):
        rows = ("cvae-hm-adapted", "cvae-hm-points-adapted")
        few = [f"mapper.{row}.adapt_steps=1" for row in rows]
        assert run(fast(tmp_path, f"mapper=[cvae-hm,{','.join(rows)}]", *few, "pictures=false", "evaluation.occlusion=false")) == 0
        found, _ = read_result(tmp_path / "run/result.json")
        assert set(found.scores) == {"cvae-hm", *rows} and not found.failed
        plain, learned = (found.scores[name]["voxels"]["gaps"]["nll"] for name in ("cvae-hm", rows[0]))
        assert plain != learned

    def test_baselines_without_a_network_are_scored_in_three_dimensions(self, tmp_path):
        mappers = "mapper=[gpom,hm-fourier,hm-nystroem]"
        settings = fast(tmp_path, "experiment=streets", mappers, "pictures=false", "evaluation.occlusion=false")
        assert run(narrowed(settings)) == 0
        found, _ = read_result(tmp_path / "run/result.json")
        assert found.dimension == 3 and set(found.scores) == {"gpom", "hm-fourier", "hm-nystroem"} and not found.failed

    def test_mappers_side_by_side_have_the_scores_that_they_have_one_by_one(self, tmp_path):
        found = []
        for processes in (1, 2):
            choice = ["mapper=[nearest,hm,gap-centre]", "pictures=false", f"scoring_processes={processes}"]
            assert run(fast(tmp_path / str(processes), *choice)) == 0
            found.append(read_result(tmp_path / str(processes) / "run/result.json")[0])
        assert {"gaps", "occluded-sparse"} <= set(found[0].scores["hm"]["voxels"])
        assert found[0].scores == found[1].scores and found[0].gaps == found[1].gaps and found[0].ceiling == found[1].ceiling

    def test_a_baseline_has_the_voxels_of_the_run(self, tmp_path):
        settings = fast(tmp_path, "resolution_m=0.2", "mapper=[octomap,nearest]", "pictures=false", "evaluation.occlusion=false")
        mappers = build_mappers(settings.mapper)
        assert give_networks(settings, mappers, None)["octomap"].resolution_m == 0.2

    def test_every_mapper_is_scored_in_one_run_and_the_report_is_whole(self, tmp_path, capsys):
        # Those of 3D have the names of the others; networks that learn from the site have a test of their own.
        flat = [name for name in names("mapper") if not name.endswith(("-3d", "adapted"))]
        settings = narrowed(fast(tmp_path, f"mapper=[{','.join(flat)}]", "evaluation.occlusion=false"))
        assert run(settings) == 0
        found, about = read_result(tmp_path / "run/result.json")
        assert set(found.scores) == set(flat)
        assert found.gap_seeds == [0] and about["config"]["name"] == "run"
        pictures = {path.stem for path in (tmp_path / "run/pictures").glob("*.png")}
        assert pictures >= {"map", "gaps", "pipeline", "sites", "prior", "precision_recall", "reliability"}
        assert list((tmp_path / "run/tensorboard").glob("events*"))
        printed = capsys.readouterr().out
        assert "tensorboard --logdir" in printed and "result.json" in printed
        json.loads((tmp_path / "run/result.json").read_text())

        mapper = load_mapper(tmp_path / "run/model.safetensors", calibration="points")
        assert mapper.reconstructor.card["steps"] == settings.trainer.epochs * settings.trainer.steps_per_epoch == 4

    def test_a_checkpoint_is_scored_without_training(self, tmp_path):
        assert run(fast(tmp_path, "mapper=[cvae-hm]", "pictures=false", "evaluation.occlusion=false")) == 0
        again = fast(
            tmp_path, "mapper=[cvae-hm]", "pictures=false", "evaluation.occlusion=false", f"checkpoint={tmp_path}/run/model.safetensors"
        )
        again.output = str(tmp_path / "again")
        assert run(again) == 0
        assert not (tmp_path / "again/checkpoints").exists()
        first, second = (read_result(tmp_path / folder / "result.json")[0] for folder in ("run", "again"))
        assert first.scores == second.scores
        about = read_result(tmp_path / "again/result.json")[1]
        assert about["data"]["checkpoint"] == file_sha256(tmp_path / "run/model.safetensors")

    def test_what_a_mapper_names_is_what_was_scored(self, tmp_path):
        """And what an earlier scoring in the same folder showed is gone."""
        network = tiny_reconstructor()
        path = network.save(tmp_path / "tiny.safetensors")
        (tmp_path / "run/pictures").mkdir(parents=True)
        for left in ("pictures/old.png", "result.json"):
            (tmp_path / "run" / left).write_text("")
        settings = fast(
            tmp_path, "mapper=[cvae-hm]", "pictures=false", "evaluation.occlusion=false", f"mapper.cvae-hm.reconstructor={path}",
            "+mapper.cvae-hm.weights=unit",
        )  # fmt: skip
        assert run(settings) == 0
        about = read_result(tmp_path / "run/result.json")[1]
        assert about["config"]["network"]["channels"] == network.network_settings.channels
        assert about["config"]["grid"]["cells"] == network.grid.cells
        assert not (tmp_path / "run/pictures").exists() and list((tmp_path / "run/tensorboard").iterdir())

    def test_a_checkpoint_that_is_not_there_is_named(self, tmp_path):
        with pytest.raises(InputError, match="gone.safetensors: no such checkpoint"):
            run(fast(tmp_path, "mapper=[cvae-hm]", f"checkpoint={tmp_path}/gone.safetensors"))


def test_the_folder_follows_the_name_that_is_chosen():
    assert settings_of("name=mine").output == "outputs/mine"
    assert settings_of("name=mine", "output=elsewhere").output == "elsewhere"


class TestNoNetwork:
    def test_mappers_without_a_network_start_no_trainer(self, tmp_path):
        settings = fast(tmp_path, "mapper=[nearest,all-occupied]", "pictures=false")
        assert run(settings) == 0
        assert not (tmp_path / "run/checkpoints").exists()


def test_own_scans_are_known_by_what_lies_there(tmp_path):
    log = write_log(tmp_path / "attic.log", [carmen_line(np.full(180, 3.0), (x, 0, 0)) for x in np.arange(0, 5, 0.5)])
    run(fast(tmp_path, "mapper=[nearest]", "pictures=false", "evaluation.occlusion=false", f"data.test=[{log}]"))
    assert read_result(tmp_path / "run/result.json")[1]["data"] == {"attic.log": file_sha256(log)}


class TestErrors:
    @pytest.mark.parametrize("override", ["trainer.epochs=many", "grid.cells=[1]", "seed=x"])
    def test_a_wrong_type_is_refused(self, override):
        with pytest.raises(Exception, match=override.split("=")[0].split(".")[-1] + "|could not be converted|not a valid"):
            settings_of(override)

    @pytest.mark.parametrize("override", ["trainer.epoch=3", "+trainer.epoch=3", "network.latents=3", "+network.latents=3"])
    def test_an_unknown_key_is_refused(self, override):
        with pytest.raises((ConfigCompositionException, Exception), match="epoch|latents"):
            settings_of(override)

    @pytest.mark.parametrize(
        ("overrides", "key"),
        [
            (["data.simulated=0"], "data.train"),
            (["data.simulated=1", "data.test=[simulated:900001]"], "data.test"),
            (["data.simulated=1", "grid.inner_radius_m=9"], "grid.inner_radius_m"),
            (["data.simulated=1", "grid.start=forgy"], "grid.start"),
            (["data.simulated=1", "evaluation.gap_seeds=[]"], "evaluation.gap_seeds"),
            (["data.simulated=1", "trainer.kl_warmup_share=0.1"], "trainer.kl_warmup_share"),
            (["data.simulated=1", "dimension=4"], "dimension"),
            (["data.simulated=1", "seed=-1"], "seed"),
            (["data.simulated=1", "name="], "^name: expected a name"),
            (["data.simulated=1", "data.processes=-1"], "data.processes"),
            (["data.simulated=1", "data.simulated_scans=0"], "data.simulated_scans"),
            (["data.street.scans=0"], "^data.street.scans"),
        ],
    )
    def test_a_value_that_makes_no_run_names_its_key(self, overrides, key):
        with pytest.raises(InputError, match=key):
            settings_of(*overrides)

    def test_a_class_from_elsewhere_is_not_built(self):
        with pytest.raises(InputError, match="mapper.evil._target_"):
            build_mappers({"evil": {"_target_": "os.system", "command": "true"}})

    def test_nor_is_one_below_a_setting(self, tmp_path):
        inner = {"_target_": "os.system", "command": f"touch {tmp_path / 'made'}"}
        with pytest.raises(InputError, match="mapper.evil.neighbours: expected a whole number of at least 1, got {'_target_'"):
            build_mappers({"evil": {"_target_": f"{NearestMapper.__module__}.NearestMapper", "neighbours": inner}})
        assert not (tmp_path / "made").exists()

    @pytest.mark.parametrize(
        "target, setting, value, said",
        [
            ("nearest.NearestMapper", "neighbours", 0, "a whole number of at least 1"),
            ("fixed_grid.FixedGridMapper", "gamma_per_m2", -1.0, "a positive number"),
            ("fixed_grid.FixedGridMapper", "epochs", 1.5, "a whole number of at least 1"),
            ("lard.LardMapper", "inner_radius_m", 9.0, "at most outer_radius_m"),
            ("gpom.GpomMapper", "kernel", "cubic", "one of matern, neural-network"),
            ("fourier_features.FourierMapper", "components", "many", "a whole number of at least 1"),
            ("nystroem_features.NystroemMapper", "gamma_per_m2", 0, "a positive number"),
            ("octomap_mapper.OctoMapMapper", "prob_hit", 0.3, "a probability between 0.5 and 1"),
            ("octomap_mapper.OctoMapMapper", "resolution_m", 0, "a positive number"),
            ("constant.ConstantMapper", "probability", 1.5, "a share in"),
            ("hilbert_map.HilbertMap", "evidence", "maybe", "True or False"),
            ("hilbert_map.HilbertMap", "adapt_steps", -1, "a whole number of at least 0"),
        ],
    )
    def test_a_setting_that_makes_no_map_is_refused_before_a_network_is_trained_for_it(self, target, setting, value, said):
        with pytest.raises(InputError, match=f"^mapper.mine.{setting}: expected {said}"):
            build_mappers({"mine": {"_target_": f"hilbertvae.mappers.{target}", setting: value}})

    def test_a_mapper_s_seed_is_the_gap_seed(self):
        with pytest.raises(InputError, match="mapper.nearest.seed: expected none"):
            build_mappers({"nearest": {"_target_": f"{NearestMapper.__module__}.NearestMapper", "seed": 3}})

    def test_a_mapper_with_an_unknown_setting_is_named(self):
        with pytest.raises(InputError, match="mapper.nearest: (?!.*neighbors.*neighbors).*neighbors"):
            build_mappers({"nearest": {"_target_": f"{NearestMapper.__module__}.NearestMapper", "neighbors": 3}})

    @pytest.mark.parametrize(("launcher", "extra"), [("submitit", "slurm"), ("ray", "ray")])
    def test_a_launcher_whose_extra_is_missing_says_so(self, launcher, extra, monkeypatch, capsys):
        monkeypatch.setattr(sys, "argv", ["hilbertvae-train", "-m", f"launcher={launcher}"])
        monkeypatch.setattr("hilbertvae.commands.train.find_spec", lambda name: None)
        with pytest.raises(SystemExit) as stopped:
            main()
        assert stopped.value.code == 2
        assert capsys.readouterr().err.startswith(f"hilbertvae-train: launcher={launcher}: needs the extra '{extra}': pip install")

    def test_the_command_exits_with_2_and_one_message(self, tmp_path):
        command = [sys.executable, "-m", "hilbertvae.train", "debug=fast", "data.test=[atlantis]", "mapper=[nearest]"]
        done = subprocess.run([*command, f"output={tmp_path / 'run'}"], capture_output=True, text=True, check=False)
        assert done.returncode == 2
        assert "hilbertvae-train: site 'atlantis'" in done.stderr and "Traceback" not in done.stderr
        assert not (tmp_path / "run/result.json").exists()

    def test_a_terminal_that_lacks_the_table_s_signs_gets_others(self, tmp_path):
        command = [sys.executable, "-m", "hilbertvae.train", "debug=fast", "mapper=[nearest]", "pictures=false"]
        ascii_alone = {**os.environ, "PYTHONIOENCODING": "ascii"}
        done = subprocess.run([*command, f"output={tmp_path / 'run'}"], capture_output=True, text=True, check=False, env=ascii_alone)
        assert done.returncode == 0, done.stderr
        assert "mean?sd" in done.stdout and json.loads((tmp_path / "run/result.json").read_text())["status"] == "ok"
