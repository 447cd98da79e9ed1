import pytest
import torch

from hilbertvae.checks import InputError
from hilbertvae.reconstruction.blocks import CHANNELS_LAST
from hilbertvae.reconstruction.gated_network import GatedNetwork
from hilbertvae.reconstruction.precision import fast_type
from hilbertvae.reconstruction.settings import GatedNetworkSettings
from toy_rooms import draw_weights

SMALL = {"stem": 2, "channels": [4, 6, 8], "blocks": [1, 2, 1], "latent": 5}


def small(dimension=2, cells=16, **settings):
    torch.manual_seed(0)
    network = GatedNetwork(GatedNetworkSettings(**{**SMALL, **settings}), dimension, cells)
    draw_weights(network)
    return network


def codes(dimension=2, cells=16, batch=3):
    return torch.randint(-1, 2, (batch, *(cells,) * dimension), generator=torch.Generator().manual_seed(1)).to(torch.int8)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("skips", [False, True])
@pytest.mark.parametrize("variational", [False, True])
def test_shapes(dimension, skips, variational):
    network = small(dimension, skips=skips, variational=variational).eval()
    found = network(codes(dimension))
    assert found.output.shape == (3, *(16,) * dimension)
    assert found.mean.shape == (3, 5)
    assert (found.std is None) != variational
    assert network.decode(torch.zeros(2, 5)).shape == (2, *(16,) * dimension)


@pytest.mark.parametrize("dimension", [2, 3])
def test_behind_a_flat_bottom_the_latent_is_all_that_the_decoder_knows(dimension):
    network = small(dimension, bottom="flat", skips=False).eval()
    found = network(codes(dimension))
    assert found.output.shape == (3, *(16,) * dimension)
    assert torch.equal(network.decode(found.mean), found.output)
    assert network.mean.in_features == 8 * 2**dimension  # 16 cells, stem 2 and two levels leave 2 along each axis


def test_a_flat_bottom_refuses_skips_and_an_unknown_one_is_named():
    with pytest.raises(InputError, match="network.bottom: flat needs network.skips=false"):
        small(bottom="flat")
    with pytest.raises(InputError, match="network.bottom: expected one of summary, flat, got 'round'"):
        small(bottom="round")


def test_the_default_network_takes_the_default_grid():
    network = GatedNetwork(GatedNetworkSettings(), 2, 64).eval()
    with torch.inference_mode():
        assert network(codes(cells=64, batch=1)).output.shape == (1, 64, 64)
    # The stem leaves full resolution at once: no convolution but it and the head sees more than 16 x 16 cells.
    assert network.stem.stride == (4, 4)


@pytest.mark.parametrize("dimension", [2, 3])
def test_skips_carry_nothing_of_what_was_not_observed(dimension):
    """Features of an unobserved region are changed on their way into the skip alone: not a bit of the output follows."""
    network, grids = small(dimension).eval(), codes(dimension)
    grids[:, 4:12] = 0
    plain = network(grids).output

    def disturbed(where):
        kept = {}

        def disturb(module, inputs, output):
            kept["clean"] = output
            noise = torch.zeros_like(output)
            noise[:, :, where] = 1e3
            return output + noise

        hooks = [network.down[0].register_forward_hook(disturb)]
        hooks.append(network.shrink[0].register_forward_pre_hook(lambda module, inputs: (kept["clean"],)))
        output = network(grids).output
        for hook in hooks:
            hook.remove()
        return output

    assert torch.equal(disturbed(slice(2, 6)), plain)  # cells 4 to 11 at a stem of 2
    assert not torch.equal(disturbed(slice(0, 2)), plain)  # what was observed does pass


def test_the_gate_is_the_share_of_cells_observed():
    network, grids = small().eval(), codes()
    caught = []
    up = network._up
    network._up = lambda x, kept: caught.extend(kept) or up(x, kept)
    features = []
    for level in network.down[:2]:
        level.register_forward_hook(lambda module, inputs, output: features.append(output))
    network(grids)
    for level, side in enumerate((2, 4)):
        for b in range(3):
            for i in range(16 // side):
                for j in range(16 // side):
                    block = grids[b, i * side : (i + 1) * side, j * side : (j + 1) * side]
                    share = (block != 0).float().mean()
                    torch.testing.assert_close(caught[level][b, :, i, j], features[level][b, :, i, j] * share)


def test_the_latent_is_used_everywhere():
    network = small().eval()
    z = torch.randn(1, 5, requires_grad=True)
    output = network.decode(z)
    for cell in (output[0, 0, 0], output[0, 15, 3], output[0, 8, 8]):
        (slope,) = torch.autograd.grad(cell, z, retain_graph=True)
        assert slope.abs().min() > 0


def test_z_is_the_mean_at_test_and_a_sample_in_training():
    network, grids = small(), codes()
    network.eval()
    assert torch.equal(network(grids).output, network(grids).output)
    network.train()
    first, second = network(grids), network(grids)
    torch.testing.assert_close(first.mean, second.mean)
    assert not torch.allclose(first.output, second.output)
    plain = small(variational=False).train()
    assert torch.equal(plain(grids).output, plain(grids).output)


def test_standard_deviations_are_positive():
    network = small()
    with torch.no_grad():
        network.spread.bias.fill_(-200.0)
    std = network(codes()).std
    assert (std > 0).all() and torch.isfinite(torch.log(std)).all()


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_grid_is_answered_alone(dimension):
    network, grids = small(dimension).eval(), codes(dimension, batch=6)
    whole = network(grids).output
    for k in range(6):
        torch.testing.assert_close(network(grids[k : k + 1]).output[0], whole[k])


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("numbers", dict.fromkeys([torch.float32, fast_type()]))  # bfloat16 that is emulated lies in other orders, unused
def test_convolutions_are_given_what_they_need_not_copy(dimension, numbers):
    """A skip in float32 takes the level above it there as well, and one that lies otherwise is copied."""
    network = small(dimension).eval().to(memory_format=CHANNELS_LAST[dimension])
    given = []
    for layer in (network.join[0], network.join[1], network.up[0], network.up[1]):
        layer.register_forward_pre_hook(lambda layer, inputs: given.append(inputs[0]))
    with torch.inference_mode(), torch.autocast("cpu", torch.bfloat16, enabled=numbers is torch.bfloat16):
        network(codes(dimension, batch=16))  # one thread convolves fewer, by kernels of one cell, in another order of its own
    assert len(given) == 4
    assert all(x.dtype == numbers and x.is_contiguous(memory_format=CHANNELS_LAST[dimension]) for x in given)


def test_every_weight_is_trained():
    network = small().train()
    found = network(codes())
    (found.output.square() + found.known.square()).sum().backward()
    assert [name for name, p in network.named_parameters() if p.grad is None or not p.grad.any()] == []


@pytest.mark.parametrize(
    ("settings", "cells", "message"),
    [
        ({"blocks": [1, 1]}, 16, "network.blocks: expected 3"),
        ({"blocks": [1, -1, 1]}, 16, r"network.blocks\[1\]: expected a whole number of at least 0, got -1"),
        ({"blocks": [], "channels": []}, 16, "network.channels: expected at least one level"),
        ({"stem": 0}, 16, "network.stem: expected a whole number of at least 1"),
        ({"encoding": "colour"}, 16, "network.encoding: expected one of signed, shares, hit_free, detailed, got 'colour'"),
        ({}, 12, r"grid.cells: expected a multiple of 8 \(stem and 3 levels\), got 12"),
    ],
)
def test_settings_that_make_no_network(settings, cells, message):
    with pytest.raises(InputError, match=message):
        small(cells=cells, **settings)
