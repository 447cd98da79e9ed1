"""Runs that train nothing: what they say of the networks that their mappers name, or of none, and what they leave of a training."""

import json

import pytest
from composed_settings import settings_of

from hilbertvae.checks import InputError
from hilbertvae.commands.overrides import refuse_idle
from hilbertvae.commands.run import run
from hilbertvae.reports.result_json import read_result
from hilbertvae.tables.measure import network_of
from hilbertvae.tables.sweep import Run
from toy_rooms import tiny_reconstructor

pytest.importorskip("embreex")


def fast(folder, *overrides):
    small = ["debug=fast", "pictures=false", "evaluation.occlusion=false", "trainer.threads=1"]
    return settings_of(*small, f"output={folder / 'run'}", f"data.cache={folder / 'cache'}", *overrides)


def test_a_run_of_several_networks_says_which_each_mapper_has(tmp_path):
    one, other = (tiny_reconstructor(seed=seed).save(tmp_path / f"{seed}.safetensors") for seed in range(2))
    named = [f"+mapper.cvae-hm.{key}" for key in ("reconstructor", "flips")]
    settings = fast(tmp_path, "mapper=[cvae-hm,nearest]", f"{named[0].lstrip('+')}={one}")
    settings.mapper["cvae-hm-b"] = {**settings.mapper["cvae-hm"], "reconstructor": str(other)}
    assert run(settings) == 0
    result, about = read_result(tmp_path / "run/result.json")
    assert {"cvae-hm", "cvae-hm-b"} <= result.scores.keys() and about["seeds"] == {"gaps": [0]}
    assert not {"network", "likelihood"} & about["config"].keys() and about["config"]["networks"].keys() == {"cvae-hm", "cvae-hm-b"}
    made = Run("job", "case", 0, tmp_path, result, about)
    channels = "/".join(map(str, about["config"]["networks"]["cvae-hm-b"]["network"]["channels"]))
    assert network_of(made, "cvae-hm-b").startswith(f"gated {channels}, ") and network_of(made, "nearest") == ""


def test_a_run_of_baselines_says_nothing_of_networks_and_takes_no_training_away(tmp_path):
    settings = fast(tmp_path, "mapper=[nearest]")
    assert run(settings) == 0
    about = json.loads((tmp_path / "run/result.json").read_text(encoding="utf-8"))
    assert not {"network", "likelihood", "networks"} & about["config"].keys() and about["seeds"] == {"gaps": [0]}
    trained = fast(tmp_path, "mapper=[cvae-hm]", f"output={tmp_path / 'trained'}")
    assert run(trained) == 0
    before = (tmp_path / "trained/result.json").read_bytes()
    settings.output = trained.output
    with pytest.raises(InputError, match="^output: .*trained holds a training, whose results would be replaced"):
        run(settings)
    assert (tmp_path / "trained/result.json").read_bytes() == before


@pytest.mark.parametrize(
    "word", ["network=paper_32", "network.dropout=0.2", "trainer.epochs=7", "augmentation.balls=5", "data.simulated=9"]
)
def test_settings_of_networks_are_not_typed_where_there_is_none(word):
    with pytest.raises(InputError, match="^[a-z_.]+: expected none where no mapper has a network$"):
        refuse_idle(settings_of("mapper=[hm,nearest]"), [word])
    refuse_idle(settings_of("mapper=[hm,cvae-hm]"), [word])
    refuse_idle(settings_of("mapper=[hm,raw-grid-hm]"), ["grid.cells=32", "start=random", "trainer.threads=1", "trainer.accelerator=cpu"])
