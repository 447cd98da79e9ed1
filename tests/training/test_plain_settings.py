"""Settings that were made in Python are those that YAML would have given, or are refused by the key."""

import sys
from copy import deepcopy
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from training_toys import tiny_settings

from hilbertvae.checks import InputError
from hilbertvae.training.plain_settings import plain_settings
from hilbertvae.training.settings import DataSettings, Settings, TrainerSettings
from hilbertvae.training.train import train
from hilbertvae.training.training_hash import training_hash


def kinds_in(node):
    if isinstance(node, dict):
        return set().union(*map(kinds_in, node.values()))
    return set().union(set(), *map(kinds_in, node)) if isinstance(node, list) else {type(node)}


def test_paths_and_numbers_of_numpy_become_pythons():
    made = tiny_settings(Path("run"), "cache", resolution_m=np.float64(0.1), seed=np.int64(3))
    data = replace(made.data, train=[Path("a.log")], folder=Path("logs"), simulated_extent_m=(12, 16), simulated_scans=np.int64(20))
    made = replace(made, data=data, trainer=replace(made.trainer, learning_rate=np.logspace(-3, -2, 3)[0], initial=Path("b")))
    found = plain_settings(made)
    assert kinds_in(asdict(found)) <= {str, int, float, bool, type(None)}
    assert (found.output, found.data.train, found.data.folder, found.data.simulated_extent_m) == ("run", ["a.log"], "logs", [12.0, 16.0])
    assert found.trainer.learning_rate == pytest.approx(1e-3) and type(found.network) is type(made.network)
    assert plain_settings(found) == found and isinstance(made.data.folder, Path)


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"trainer": TrainerSettings(epochs=1.5)}, "trainer.epochs"),
        ({"trainer": TrainerSettings(batch_size="many")}, "trainer.batch_size"),
        ({"data": DataSettings(test="simulated:9")}, "data.test"),
        ({"data": DataSettings(validate=["a"])}, "data.validate"),
        ({"network": "gated"}, "network"),
    ],
)
def test_another_type_is_refused_by_its_key_before_anything_is_made(tmp_path, change, key):
    with pytest.raises(InputError, match=f"^{key}: "):
        train(replace(Settings(output=str(tmp_path / "run")), **change))
    assert not (tmp_path / "run").exists()


def test_a_network_that_is_there_is_not_trained(tmp_path):
    with pytest.raises(InputError, match="^checkpoint: expected none in a training"):
        train(tiny_settings(tmp_path / "run", tmp_path / "cache", checkpoint="2d"))


def test_who_made_them_changes_no_hash(tmp_path):
    made = tiny_settings(tmp_path / "run", tmp_path / "cache")
    assert training_hash(made) == training_hash(plain_settings(made)) == training_hash(replace(made, resolution_m=np.float64(0.1)))


def test_what_is_asked_for_again_is_a_copy_of_its_own_and_follows_every_change(tmp_path):
    made = deepcopy(tiny_settings(tmp_path / "run", tmp_path / "cache"))  # its parts are those of other tests, too
    first = plain_settings(made)
    first.data.train.append("another")
    assert plain_settings(made).data.train == made.data.train
    made.data.train.append("another")
    assert plain_settings(made) == first
    made.trainer.learning_rate = 1
    assert type(plain_settings(made).trainer.learning_rate) is float  # 1 == 1.0, and another type
    assert plain_settings(replace(made, trainer=replace(made.trainer, learning_rate=np.float32(1)))) == plain_settings(made)
    with pytest.raises(InputError, match="^mapper"):
        plain_settings(replace(made, mapper={"mine": {"name": lambda: None}}))


def test_a_network_whose_class_was_made_anew_has_the_settings_of_that_class(monkeypatch):
    """As in a notebook, where the cell that has it is mended and run again."""
    for _ in range(2):

        @dataclass
        class MineSettings:
            kind: str = "mine"

        MineSettings.__qualname__ = "MineSettings"
        monkeypatch.setattr(sys.modules[__name__], "MineSettings", MineSettings, raising=False)
        assert type(plain_settings(Settings(network=MineSettings())).network) is MineSettings
