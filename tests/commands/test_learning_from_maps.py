"""A network that learns from existing maps, and is scored on one: three settings, which go from Hydra to the tables."""

import pytest
from hydra import compose, initialize_config_dir

from hilbertvae.commands.configuration import CONF, to_settings
from hilbertvae.commands.run import run
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.reports.result_json import read_result


def test_what_learns_from_maps_and_is_given_one_says_so(tmp_path):
    pytest.importorskip("embreex")
    given = ["clustering.mapped_share=1", "calibration_given=map", "evaluation.given=map"]
    folder = [f"output={tmp_path / 'run'}", f"data.cache={tmp_path / 'cache'}", "trainer.threads=1"]
    with initialize_config_dir(str(CONF), version_base="1.3"):
        config = compose("config", ["debug=fast", "evaluation.occlusion=false", "mapper=[cvae-hm,nearest]", *given, *folder])
    assert run(to_settings(config)) == 0
    found, _ = read_result(tmp_path / "run/result.json")
    assert set(found.scores) == {"cvae-hm", "nearest"} and found.protocol["given"] == "map"
    assert Reconstructor.load(tmp_path / "run/model.safetensors").card["learned_as"]["calibration_given"] == "map"
    assert "(2D), given a map, gaps of" in (tmp_path / "run/scores.md").read_text()
    assert (tmp_path / "run/pictures/map.png").exists()
