from dataclasses import replace

import pytest
import torch

from hilbertvae.reconstruction.networks import build_network
from hilbertvae.reconstruction.settings import ConditionalNetworkSettings
from hilbertvae.reconstruction.wider_levels import is_wider, wider_weights
from toy_rooms import draw_weights, tiny_reconstructor


def widened(narrow, channels, **changes):
    """A wider network of `narrow`'s settings, with weights that were all drawn and then taken from it."""
    torch.manual_seed(1)
    settings = replace(narrow.network_settings, channels=channels, **changes)
    network = build_network(settings, narrow.dimension, narrow.grid.cells)
    draw_weights(network)
    assert is_wider(settings, narrow.network_settings)
    network.load_state_dict(network.state_dict() | wider_weights(narrow.network.state_dict(), network))
    return network.eval()


@pytest.mark.parametrize("skips", [True, False])
@pytest.mark.parametrize(("dimension", "channels"), [(2, [32, 48]), (2, [16, 80]), (2, [48, 32]), (3, [32, 48])])
def test_it_says_at_first_what_the_narrow_one_said(dimension, channels, skips):
    narrow = tiny_reconstructor(dimension, channels=[16, 32], blocks=[1, 2], skips=skips)
    network = widened(narrow, channels)
    grids = torch.randint(-1, 2, (3, *(narrow.grid.cells,) * dimension)).to(torch.int8)
    with torch.inference_mode():
        found, said = network(grids), narrow.network.eval()(grids)
    for part in ("output", "mean", "std", "known"):
        torch.testing.assert_close(getattr(found, part), getattr(said, part), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("channels", [[16, 32], [32, 48]])
def test_new_blocks_say_nothing_at_first(channels):
    narrow = tiny_reconstructor(channels=[16, 32])
    settings = replace(narrow.network_settings, channels=channels, blocks=[2, 3])
    network = build_network(settings, 2, narrow.grid.cells)
    assert is_wider(settings, narrow.network_settings)
    network.load_state_dict(wider_weights(narrow.network.state_dict(), network))
    grids = torch.randint(-1, 2, (3, 16, 16)).to(torch.int8)
    found = network.eval()(grids).output
    torch.testing.assert_close(found, narrow.network.eval()(grids).output, rtol=1e-4, atol=1e-5)
    found.square().mean().backward()
    assert network.up[0][1].body[-1].weight.grad.any()


def test_it_hears_details_that_the_narrow_one_was_not_shown():
    narrow = tiny_reconstructor(channels=[16, 32])
    network = widened(narrow, [32, 32], encoding="detailed")
    labels = torch.randint(-1, 2, (3, 1, 16, 16)).to(torch.int8)
    with torch.inference_mode():
        shown = torch.cat([labels, torch.randint(0, 9, (3, 4, 16, 16)).to(torch.int8)], dim=1)
        torch.testing.assert_close(network(shown).output, narrow.network.eval()(labels[:, 0]).output, rtol=1e-4, atol=1e-5)


def test_new_channels_learn_to_speak_and_to_listen():
    narrow = tiny_reconstructor(channels=[16, 32])
    network = widened(narrow, [32, 48])
    optimizer, grids = torch.optim.SGD(network.parameters(), 0.1), torch.randint(-1, 2, (3, 16, 16)).to(torch.int8)
    for step in range(2):
        optimizer.zero_grad()
        network(grids).output.square().mean().backward()
        assert network.head[2].weight.grad[:, 16:].any()  # old outputs begin to hear new channels
        assert step == 0 or network.stem.weight.grad[16:].any()  # and from then on these learn what to say
        optimizer.step()


def test_an_older_network_without_known_cells_can_be_widened():
    narrow = tiny_reconstructor(channels=[16, 32], known=False)
    found = wider_weights(
        narrow.network.state_dict(), build_network(replace(narrow.network_settings, channels=[32, 32], known=True), 2, 16)
    )
    assert "head.2.weight" in found and "known_head.weight" not in found


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"channels": [24, 32]},  # 24 are one group of 24, 16 one of 16
        {"channels": [16, 16]},
        {"channels": [32, 32, 32], "blocks": [1, 1, 1]},
        {"channels": [32, 32], "stem": 4},
        {"channels": [32, 32], "blocks": [1, 0]},
        {"channels": [32, 32], "blocks": [1]},
        {"channels": [32, 32], "latent": 4},
        {"channels": [32, 32], "skips": False},
        {"channels": [32, 32], "variational": False},
        {"channels": [32, 32], "known": False},
        {"channels": [32, 32], "encoding": "signed"},
    ],
)
def test_other_networks_are_not_wider(changes):
    narrow = tiny_reconstructor(channels=[16, 32]).network_settings
    assert not is_wider(replace(narrow, **changes), narrow)
    assert not is_wider(ConditionalNetworkSettings(channels=[32, 64], stem=2, blocks=[1, 1], latent=3), narrow)


def test_what_was_shown_can_become_more_and_not_other():
    settings = tiny_reconstructor(channels=[16, 32]).network_settings
    pairs = [("hit_free", "detailed"), ("detailed", "hit_free"), ("signed", "hit_free"), ("signed", "detailed"), ("signed", "signed")]
    found = [is_wider(replace(settings, channels=[32, 32], encoding=wide), replace(settings, encoding=narrow)) for narrow, wide in pairs]
    assert found == [True, False, False, False, True]


def test_a_flat_bottom_is_not_widened():
    """Its latent lists channels cell by cell, so the first of it are not those of the narrow network."""
    narrow = tiny_reconstructor(channels=[16, 32], skips=False, bottom="flat").network_settings
    assert not is_wider(replace(narrow, channels=[16, 48]), narrow)
