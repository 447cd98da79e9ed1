"""The examples of docs/extending.md, executed."""

import re
from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf

from hilbertvae.mappers.nearest import NearestMapper
from hilbertvae.reconstruction.networks import NETWORKS
from hilbertvae.scoring.protocol import Protocol, evaluate

TEXT = (Path(__file__).parents[2] / "docs/extending.md").read_text(encoding="utf-8")
PYTHON = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)


@pytest.fixture(scope="module")
def executed(tmp_path_factory):
    """What the blocks left, all in one namespace and a folder of their own."""
    pytest.importorskip("embreex")
    known: dict = {"__name__": "extending"}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("extending"))
        patch.setitem(NETWORKS, "plain", None)
        results = []
        for block in PYTHON:
            exec(block, known)
            if "result = " in block:
                results.append(known["result"])
        yield known | {"results": results, "there": Path(known["checkpoint"]).is_file()}


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


def test_the_yaml_builds_what_the_page_says():
    (text,) = re.findall(r"```yaml\n(.*?)```", TEXT, re.DOTALL)
    assert text.startswith("# @package mapper\n")
    content = OmegaConf.create(text)
    assert content.share._target_ == "hilbertvae.mappers.share.ShareMapper" and "src/hilbertvae/mappers/share.py" in TEXT
