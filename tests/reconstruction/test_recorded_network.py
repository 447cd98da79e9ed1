import copy
import pickle
from pathlib import Path

import numpy as np
import pytest
import torch

from hilbertvae.checks import InputError
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.reconstruction.recorded_network import RecordedNetwork
from hilbertvae.reconstruction.shipped import SHIPPED
from toy_rooms import tiny_reconstructor


def test_it_stands_for_the_network_of_a_checkpoint(tmp_path):
    made = tiny_reconstructor()
    made.map_weights = {"voxels": {"unseen": [1.0]}}
    path = made.save(tmp_path / "model.safetensors")
    found = RecordedNetwork(made.fingerprint(), path)
    assert (found.dimension, found.grid, found.resolution_m, found.map_weights) == (2, made.grid, 0.1, made.map_weights)
    grids = np.random.default_rng(0).integers(-1, 2, (3, 16, 16)).astype(np.int8)
    loaded = Reconstructor.load(path).complete(grids, 2)
    np.testing.assert_array_equal(found.complete(grids, 2).value, loaded.value)
    np.testing.assert_array_equal(found.complete(grids, 2).known, loaded.known)
    for again in (copy.deepcopy(found), pickle.loads(pickle.dumps(RecordedNetwork(made.fingerprint(), path)))):
        assert again.fingerprint() == made.fingerprint() and again.dimension == 2


@pytest.mark.parametrize("is_given", [True, False])
def test_it_is_found_after_a_change_of_the_working_folder(tmp_path, monkeypatch, is_given):
    made = tiny_reconstructor()
    path = made.save(tmp_path / "model.safetensors")
    monkeypatch.chdir(tmp_path)
    found = RecordedNetwork(made.fingerprint(), *([path.name] if is_given else [None, Path(path.name)]))
    monkeypatch.chdir(tmp_path.parent)
    assert found.dimension == 2


def test_nothing_is_read_before_it_is_needed(monkeypatch):
    monkeypatch.setattr(Reconstructor, "load", None)
    assert RecordedNetwork("abc").fingerprint() == "abc"


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_network_is_found_again(name):
    network = Reconstructor.load(name)
    found = RecordedNetwork(network.fingerprint())
    assert found.dimension == network.dimension and found.grid == network.grid and found.map_weights == network.map_weights


def test_another_network_is_refused(tmp_path):
    path = tiny_reconstructor(seed=1).save(tmp_path / "other.safetensors")
    with pytest.raises(InputError, match="other.safetensors: expected the network that the map was made with, got another one"):
        _ = RecordedNetwork(tiny_reconstructor().fingerprint(), path).dimension
    with pytest.raises(InputError, match="does not come with this version of hilbertvae; .*load_map\\(path, checkpoint=...\\)"):
        RecordedNetwork(tiny_reconstructor().fingerprint()).complete(np.zeros((1, 16, 16), np.int8))


def test_a_fingerprint_is_that_of_what_it_answers(tmp_path):
    made = tiny_reconstructor()
    loaded = Reconstructor.load(made.save(tmp_path / "model.safetensors"))
    loaded.map_weights, loaded.card = {"voxels": {}}, {"epoch": 7}
    assert loaded.fingerprint() == made.fingerprint()  # what its answers don't depend on
    with torch.no_grad():
        next(loaded.network.parameters()).mul_(1.001)
    others = [loaded, tiny_reconstructor(seed=1), tiny_reconstructor(latent=4), tiny_reconstructor(3)]
    assert len({other.fingerprint() for other in [made, *others]}) == 5
