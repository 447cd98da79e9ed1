import warnings
from dataclasses import replace

import pytest
import torch
from training_toys import TRAINER, module_of, pairs, tiny_settings

from hilbertvae.checks import InputError
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.reconstruction.settings import LikelihoodSettings
from hilbertvae.reconstruction.shipped import checkpoint_path
from hilbertvae.training.training_hash import training_hash
from toy_rooms import tiny_grid, tiny_reconstructor


@pytest.mark.parametrize("known", [False, True])
def test_a_network_starts_from_anothers_weights(tmp_path, known):
    """From an older one too, that does not say what would be known: that output starts afresh."""
    path = tiny_reconstructor(seed=5, stem=2, channels=[4, 8], blocks=[1, 1], latent=3, known=known).save(tmp_path / "model.safetensors")
    module = module_of()
    before = {name: weights.clone() for name, weights in module.network.state_dict().items()}
    module.start_from(str(path))
    found, after = Reconstructor.load(path).network.state_dict(), module.network.state_dict()
    assert all(torch.equal(after[name], found.get(name, before[name])) for name in after)
    assert any(not torch.equal(after[name], before[name]) for name in found)


@pytest.mark.parametrize("cells", [16, 32])
def test_a_network_of_another_shape_is_no_start(tmp_path, cells):
    """The refusal says in what."""
    path = tiny_reconstructor(stem=2, channels=[4, 6], blocks=[1, 1], latent=3).save(tmp_path / "model.safetensors")
    other = r"network.channels \[4, 6\] and not \[4, 8\]" + (", grid.cells 16 and not 32" if cells == 32 else "")
    with pytest.raises(InputError, match=f"trainer.initial: .*model.safetensors has another network than .*: {other}$"):
        module_of(grid=replace(tiny_grid(), cells=cells, cluster_diameter_m=0.1 * cells)).start_from(str(path))


@pytest.mark.parametrize("channels", [[8], [4, 8], [8, 12]])
def test_a_network_of_another_dimension_is_no_start(tmp_path, channels):
    """Also where its settings are those of a narrower one, or one with a coarser stem."""
    path = tiny_reconstructor(3, stem=4, channels=channels, blocks=[1] * len(channels), latent=3).save(tmp_path / "model.safetensors")
    settings = tiny_settings("run", "cache")
    module = module_of(network=replace(settings.network, stem=2, channels=[9, *channels], blocks=[1] * (len(channels) + 1), latent=3))
    with pytest.raises(InputError, match="trainer.initial: .*model.safetensors is a network of 3D, expected 2D"):
        module.start_from(str(path))


def test_a_wider_network_goes_on_from_one_that_was_trained(tmp_path):
    path = tiny_reconstructor(stem=2, channels=[16, 32], blocks=[1, 1], latent=3).save(tmp_path / "model.safetensors")
    settings = tiny_settings("run", "cache")
    module = module_of(network=replace(settings.network, stem=2, channels=[32, 48], blocks=[1, 1], latent=3)).eval()
    module.start_from(str(path))
    shown = pairs()[0]
    with torch.inference_mode():
        said = Reconstructor.load(path).network.eval()(shown).output
        torch.testing.assert_close(module.network(shown).output, said, rtol=1e-4, atol=1e-5)


def test_a_network_with_half_the_stem_goes_on_from_one_that_was_trained(tmp_path, logged):
    path = tiny_reconstructor(stem=4, channels=[8, 12], blocks=[1, 1], latent=3).save(tmp_path / "model.safetensors")
    settings = tiny_settings("run", "cache")
    module = module_of(network=replace(settings.network, stem=2, channels=[9, 8, 12], blocks=[1, 1, 1], latent=3))
    module.start_from(str(path))
    shown, _ = pairs()
    network = Reconstructor.load(path).network.eval()
    torch.testing.assert_close(module.network.eval()._down(shown)[0], network._down(shown)[0], rtol=1e-4, atol=1e-5)


def test_a_detailed_network_starts_from_one_that_was_shown_labels(tmp_path, logged):
    """What else it is shown has no weight yet: it goes on as it was, and learns from all."""
    path = tiny_reconstructor(seed=5, stem=2, channels=[4, 8], blocks=[1, 1], latent=3).save(tmp_path / "model.safetensors")
    settings = tiny_settings("run", "cache")
    module = module_of(network=replace(settings.network, encoding="detailed"))
    module.start_from(str(path))
    labels, _ = pairs()
    shown = torch.cat([labels.unsqueeze(1), (20 * labels.abs()).unsqueeze(1).repeat(1, 4, 1, 1)], dim=1)
    network = Reconstructor.load(path).network.eval()
    torch.testing.assert_close(module.network.eval()(shown).output, network(labels).output)
    module.train().training_step((shown, pairs()[1]), 0).backward()
    assert module.network.stem.weight.grad[:, 2:].any()


def test_a_shipped_network_is_named_as_wherever_one_is_given():
    """And the same training whether its name or its file is given."""
    named, path = (replace(TRAINER, initial=initial) for initial in ("2d-sim", str(checkpoint_path("2d-sim"))))
    named.check()
    settings = tiny_settings("run", "cache", trainer=named)
    assert training_hash(settings) == training_hash(replace(settings, trainer=path))
    shipped = Reconstructor.load("2d-sim")
    module = module_of(network=shipped.network_settings, grid=shipped.grid)
    module.start_from("2d-sim")
    assert all(torch.equal(weights, shipped.network.state_dict()[name]) for name, weights in module.network.state_dict().items())


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"likelihood": LikelihoodSettings(kind="gaussian")}, "was trained with likelihood.kind=bernoulli, expected gaussian"),
        ({"encoding": "shares"}, "was trained with network.encoding=signed, expected shares"),
    ],
)
def test_weights_that_mean_something_else_are_no_start(tmp_path, changes, message):
    """Their shapes are the same."""
    shape = {"stem": 2, "channels": [4, 8], "blocks": [1, 1], "latent": 3}
    made = tiny_reconstructor(**shape, encoding="signed")
    path = made.save(tmp_path / "model.safetensors")
    network = replace(made.network_settings, encoding=changes.pop("encoding", "signed"))
    with pytest.raises(InputError, match=f"trainer.initial: .*model.safetensors {message}"):
        module_of(network=network, **changes).start_from(str(path))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({}, ""),
        ({"grid": tiny_grid(cells=32)}, ""),
        ({"grid": replace(tiny_grid(), cluster_diameter_m=3.2)}, "cells of 0.1 m, and goes on with those of 0.2 m"),
        ({"resolution_m": 0.2}, "voxels of 0.1 m, and goes on with those of 0.2 m"),
    ],
)
def test_cells_of_another_size_are_told_of(tmp_path, changes, message):
    path = tiny_reconstructor(stem=2, channels=[4, 8], blocks=[1, 1], latent=3).save(tmp_path / "model.safetensors")
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        module_of(**changes).start_from(str(path))
    assert [message in str(one.message) for one in told] == [True] * bool(message)
