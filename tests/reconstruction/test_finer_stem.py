from dataclasses import replace

import pytest
import torch

from hilbertvae.checks import InputError
from hilbertvae.reconstruction.finer_stem import finer_weights, is_finer
from hilbertvae.reconstruction.networks import build_network
from hilbertvae.reconstruction.settings import ConditionalNetworkSettings
from toy_rooms import draw_weights, tiny_reconstructor


def fine_of(coarse, first, **changes):
    """A network of `first` channels and half the stem, all of its weights drawn but those that end a residual block of its first level."""
    torch.manual_seed(1)
    old = coarse.network_settings
    settings = replace(old, stem=old.stem // 2, channels=[first, *old.channels], blocks=[1, *old.blocks], **changes)
    return settings, build_network(settings, coarse.dimension, coarse.grid.cells)


@pytest.mark.parametrize(("dimension", "first", "encoding"), [(2, 8, "hit_free"), (2, 11, "detailed"), (3, 16, "hit_free")])
def test_inner_levels_hear_what_they_heard(dimension, first, encoding):
    coarse = tiny_reconstructor(dimension, stem=4, channels=[6, 8], blocks=[2, 1])
    settings, network = fine_of(coarse, first, encoding=encoding)
    assert is_finer(settings, coarse.network_settings)
    network.load_state_dict(finer_weights(coarse.network.state_dict(), network))
    grids = torch.randint(-1, 2, (3, *(coarse.grid.cells,) * dimension)).to(torch.int8)
    shown = grids
    if encoding == "detailed":
        shown = torch.cat([grids.unsqueeze(1), torch.randint(0, 9, (3, 2 + dimension, *grids.shape[1:])).to(torch.int8)], dim=1)
    with torch.inference_mode():
        bottom, kept = coarse.network.eval()._down(grids)
        found, kept_now = network.eval()._down(shown)
        torch.testing.assert_close(found, bottom, rtol=1e-4, atol=1e-5)
        torch.testing.assert_close(kept_now[1], kept[0], rtol=1e-4, atol=1e-5)
        assert network(shown).output.shape == grids.shape


def test_what_goes_out_again_keeps_its_trained_levels():
    coarse = tiny_reconstructor(stem=4, channels=[6, 8], blocks=[2, 1])
    _, network = fine_of(coarse, 8)
    fresh = {name: weights.clone() for name, weights in network.state_dict().items()}
    old, new = coarse.network.state_dict(), finer_weights(coarse.network.state_dict(), network)
    assert torch.equal(new["up.1.0.body.2.weight"], old["up.0.0.body.2.weight"])
    assert torch.equal(new["grow.1.weight"], old["grow.0.weight"]) and torch.equal(new["expand.weight"], old["expand.weight"])
    for name in ("grow.0.weight", "join.0.weight", "up.0.0.body.2.weight", "head.2.weight", "known_head.weight"):
        assert torch.equal(new[name], fresh[name])
    assert set(new) == set(fresh)


def test_all_of_it_can_learn():
    """The channels that hand on nothing at first are not cut off for good."""
    coarse = tiny_reconstructor(stem=4, channels=[6, 8], blocks=[2, 1])
    _, network = fine_of(coarse, 11)
    network.load_state_dict(finer_weights(coarse.network.state_dict(), network))
    draw_weights(network)  # a residual block that starts at zero passes nothing back
    network(torch.ones(2, coarse.grid.cells, coarse.grid.cells, dtype=torch.int8)).output.square().sum().backward()
    assert all(parameter.grad is not None for name, parameter in network.named_parameters() if "known" not in name and "spread" not in name)
    assert network.shrink[0].weight.grad[:, 8:].any()


@pytest.mark.parametrize(
    ("before", "now"), [("detailed", "hit_free"), ("signed", "hit_free"), ("hit_free", "signed"), ("signed", "detailed")]
)
def test_inputs_of_another_meaning_are_not_taken_over(before, now):
    coarse = tiny_reconstructor(stem=4, channels=[6, 8], blocks=[2, 1], encoding=before)
    assert not is_finer(fine_of(coarse, 32, encoding=now)[0], coarse.network_settings)


def test_too_few_channels_are_refused():
    coarse = tiny_reconstructor(stem=4, channels=[6, 8], blocks=[2, 1])
    with pytest.raises(InputError, match="network.channels: expected at least 8 in the first level"):
        finer_weights(coarse.network.state_dict(), fine_of(coarse, 7)[1])


@pytest.mark.parametrize(
    "changes", [{"stem": 4}, {"stem": 1}, {"channels": [8, 6, 9]}, {"blocks": [1, 1, 1]}, {"channels": [8, 8]}, {"channels": [6, 8, 8]}]
)
def test_other_networks_are_not_finer(changes):
    coarse = tiny_reconstructor(stem=4, channels=[6, 8], blocks=[2, 1])
    settings, _ = fine_of(coarse, 8)
    assert not is_finer(replace(settings, **changes), coarse.network_settings)
    assert not is_finer(ConditionalNetworkSettings(), coarse.network_settings)


@pytest.mark.parametrize("more", [{"skips": True}, {"variational": True}])
def test_inner_levels_that_would_be_partly_fresh_are_no_start(more):
    """One without skips has no weights for them: inner levels would say something else than they did."""
    less = {name: not value for name, value in more.items()}
    coarse = tiny_reconstructor(stem=4, channels=[6, 8], blocks=[2, 1], **less)
    assert is_finer(fine_of(coarse, 8)[0], coarse.network_settings)
    assert not is_finer(fine_of(coarse, 8, **more)[0], coarse.network_settings)
