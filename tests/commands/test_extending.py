"""The examples of docs/extending.md, executed."""

import re
import shlex
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from hilbertvae.commands.configuration import CONF, to_settings
from hilbertvae.commands.overrides import refuse_ignored
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.nearest import NearestMapper
from hilbertvae.reconstruction.likelihood import LIKELIHOODS
from hilbertvae.reconstruction.networks import NETWORKS
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.reconstruction.settings import LikelihoodSettings
from hilbertvae.reports.report import Report
from hilbertvae.reports.result_json import read_result
from hilbertvae.scoring.protocol import Protocol, evaluate
from hilbertvae.training.reconstruction_module import ReconstructionModule
from hilbertvae.training.scoring import score
from hilbertvae.training.trainer_settings import TrainerSettings
from toy_rooms import room_log

TEXT = (Path(__file__).parents[2] / "docs/extending.md").read_text(encoding="utf-8")
PYTHON = [block for block in re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL) if "__main__.py" not in block]


@pytest.fixture(scope="module")
def executed(tmp_path_factory):
    """What the blocks left, all in one namespace and a folder of their own."""
    pytest.importorskip("embreex")
    known: dict = {"__name__": "extending"}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("extending"))
        patch.setitem(NETWORKS, "plain", None)
        patch.setitem(LIKELIHOODS, "smooth", None)
        results = []
        for block in PYTHON:
            exec(block, known)
            if "result = " in block:
                results.append(known["result"])
        yield (
            known | {"checkpoint": Path(known["checkpoint"]).resolve()} | {"results": results, "there": Path(known["checkpoint"]).is_file()}
        )


def test_the_mapper_is_scored(executed, room):
    """It knows more than nothing, and is one of the mappers in earnest."""
    first, _, _ = executed["results"]
    assert first.scores["share"]["points"]["observed"]["auc"][0] > 0.8
    protocol = Protocol(gap_seeds=[0], cluster_size_m=2.0, occlusion=False)
    found = evaluate(executed["ShareMapper"](), room, protocol, name="share")
    assert found.scores["share"].keys() == evaluate(NearestMapper(), room, protocol, name="nearest").scores["nearest"].keys()


def test_the_site_is_a_room(executed):
    assert executed["site"].name == "my corridor"
    np.testing.assert_allclose(np.abs(executed["points"] - executed["origins"]).max(axis=0), [4, 3])
    assert executed["results"][1].site == "my corridor"


def test_the_network_is_trained_and_maps(executed):
    assert executed["there"]
    assert 0 <= executed["results"][2].scores["plain"]["voxels"]["gaps"]["auc"][0] <= 1


def test_the_likelihood_trains_a_network(executed):
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(LIKELIHOODS, "smooth", executed["Smooth"])
        loss = executed["Smooth"](LikelihoodSettings(kind="smooth"))
        target = torch.tensor([[[1, -1], [0, 1]]], dtype=torch.int8)
        sure = loss(20.0 * target.float(), target, target)
        assert sure.shape == (1,) and sure > loss(3.9 * target.float(), target, target) > 0  # log(0.98 / 0.02)


def test_the_program_of_a_package_of_ones_own_trains_its_network(executed, tmp_path):
    (wrapper,) = re.findall(r"```python\n(# mine/__main__.py.*?)```", TEXT, re.DOTALL)
    (plain,) = [block for block in PYTHON if "class PlainSettings" in block]
    for name, text in (("__main__", wrapper), ("plain", plain), ("__init__", "")):
        (tmp_path / "mine").mkdir(exist_ok=True)
        (tmp_path / f"mine/{name}.py").write_text(text)
    (tmp_path / "conf/network").mkdir(parents=True)
    (tmp_path / "conf/network/plain.yaml").write_text("defaults: [plain_schema]\n")
    words = "--config-dir conf network=plain debug=fast mapper=[cvae-hm] pictures=false evaluation.occlusion=false trainer.threads=1"
    done = subprocess.run([sys.executable, "-m", "mine", *words.split()], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert read_result(tmp_path / "outputs/debug/run/result.json")[1]["config"]["network"]["kind"] == "plain"


def test_the_yaml_builds_what_the_page_says():
    (text,) = re.findall(r"```yaml\n(.*?)```", TEXT, re.DOTALL)
    assert text.startswith("# @package mapper\n")
    content = OmegaConf.create(text)
    assert content.share._target_ == "hilbertvae.mappers.share.ShareMapper" and "src/hilbertvae/mappers/share.py" in TEXT


def test_the_network_is_scored_with_pictures_as_the_package_s_own_are(executed, tmp_path):
    """By the whole run, whose reports know of latents, levels and priors that this one has not."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(NETWORKS, "plain", (executed["PlainSettings"], executed["PlainNetwork"]))
        reconstructor = Reconstructor.load(executed["checkpoint"])
    settings = replace(executed["settings"], output=str(tmp_path), evaluation=Protocol(gap_seeds=[0], occlusion=False))
    settings = replace(settings, data=replace(settings.data, test=["simulated:7"]))
    report = Report(tmp_path, {"name": "plain"})
    score(settings, {"cvae-hm": HilbertMap("trained")}, reconstructor, report)
    assert report.close() == 0
    assert list(read_result(tmp_path / "result.json")[0].scores) == ["cae-hm"]  # nothing is sampled
    pictures = {path.stem for path in (tmp_path / "pictures").glob("*.png")}
    assert {"map", "pipeline", "reconstructions"} <= pictures and "prior" not in pictures


def test_a_training_goes_on_from_a_network_by_the_command_of_the_page(tmp_path, monkeypatch, recwarn):
    """Up to its first step: the network and the boxes fit, at the rate that the page tells."""
    monkeypatch.chdir(tmp_path)
    for seed, day in enumerate(("monday", "tuesday", "friday", "sunday")):
        room_log(tmp_path / f"{day}.log", seed=seed)
    (command,) = re.findall(r"^hilbertvae-train .*trainer.initial=.*$", TEXT, re.MULTILINE)
    words = shlex.split(re.sub(r"drives/(\w+)", r"\1.log", command))[1:]
    with initialize_config_dir(str(CONF), version_base="1.3"):
        settings = to_settings(compose("config", overrides=words))
        rate = to_settings(compose("config", overrides=["experiment=shipped_3d"])).trainer.learning_rate
    refuse_ignored(settings, words)
    settings.check()
    module = ReconstructionModule(settings)
    module.start_from(settings.trainer.initial)
    given = Reconstructor.load("2d")
    assert all(torch.equal(given.network.state_dict()[name], weights) for name, weights in module.network.state_dict().items())
    assert (settings.grid, settings.likelihood) == (given.grid, given.likelihood) and not recwarn
    assert f"trainer.learning_rate={settings.trainer.learning_rate:.0e}`".replace("e-04", "e-4") in TEXT
    assert (rate, TrainerSettings().learning_rate) == (1e-3, 4e-3) and "the default, 4e-3" in TEXT and "at 1e-3" in TEXT
