import pytest
import torch
from torch import nn

from hilbertvae.checks import InputError
from hilbertvae.reconstruction.paper_network import PaperNetwork
from hilbertvae.reconstruction.settings import PaperNetworkSettings
from toy_rooms import draw_weights

SMALL = {"channels": [3, 4], "kernels": [5, 3], "latent": 6, "dropout": 0.2}


def small(dimension=2, cells=8, **settings):
    torch.manual_seed(0)
    network = PaperNetwork(PaperNetworkSettings(**{**SMALL, **settings}), dimension, cells)
    draw_weights(network)
    return network


def codes(dimension=2, cells=8, batch=3):
    return torch.randint(-1, 2, (batch, *(cells,) * dimension), generator=torch.Generator().manual_seed(1)).to(torch.int8)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("tied", [False, True])
@pytest.mark.parametrize("variational", [False, True])
def test_shapes(dimension, tied, variational):
    network = small(dimension, tied=tied, variational=variational).eval()
    found = network(codes(dimension))
    assert found.output.shape == (3, *(8,) * dimension)
    assert found.mean.shape == (3, 6)
    assert (found.std is None) != variational
    assert network.decode(torch.zeros(2, 6)).shape == (2, *(8,) * dimension)


def test_the_baseline_has_the_papers_layers():
    network = PaperNetwork(PaperNetworkSettings(), 2, 64)
    shapes = [tuple(layer.weight.shape) for layer in network.encoder]
    assert shapes == [(64, 1, 9, 9), (128, 64, 7, 7), (256, 128, 5, 5), (256, 256, 5, 5)]
    # Four poolings by 2: 64 cells become 4. Two separate linear heads, and back through the mirror image.
    assert tuple(network.mean.weight.shape) == tuple(network.spread.weight.shape) == (25, 256 * 4 * 4)
    assert [tuple(layer.weight.shape) for layer in reversed(network.decoder)] == [
        (256, 256, 5, 5),
        (128, 256, 5, 5),
        (64, 128, 7, 7),
        (1, 64, 9, 9),
    ]
    assert all(layer.stride == (1, 1) for layer in [*network.encoder, *network.decoder])
    assert network.settings.dropout == 0.8


def test_the_3d_baseline_has_as_many_weights_as_the_method_says():
    with torch.device("meta"):  # counted, not allocated
        network = PaperNetwork(PaperNetworkSettings(latent=100), 3, 64)
    assert sum(p.numel() for p in network.parameters()) / 1e6 == pytest.approx(35.2, abs=0.1)


def test_the_paper_example_with_tied_weights():
    settings = PaperNetworkSettings(channels=[64, 128, 256], kernels=[5, 5, 5], dropout=0.7, tied=True)
    network = PaperNetwork(settings, 2, 32)
    convolutions = [p for p in network.parameters() if p.ndim == 4]
    assert [tuple(p.shape) for p in convolutions] == [(64, 1, 5, 5), (128, 64, 5, 5), (256, 128, 5, 5)]
    assert network.decoder is None


def test_tied_weights_are_one_and_the_same():
    """Eq. 2: a change of an encoder's kernel changes the decoder, and both sides add to its gradient."""
    network, z = small(tied=True).eval(), torch.randn(2, 6)
    before = network.decode(z)
    with torch.no_grad():
        network.encoder[1].weight.add_(0.5)
    assert not torch.equal(network.decode(z), before)
    network.decode(z).sum().backward()
    assert network.encoder[0].weight.grad.abs().sum() > 0 and network.encoder[1].weight.grad.abs().sum() > 0
    free = small(tied=False).eval()
    free.decode(z).sum().backward()
    assert free.encoder[0].weight.grad is None


def test_tied_decoder_is_the_transpose_of_the_encoder():
    """Each level's transposed convolution, in reverse, after a nearest resize."""
    network = small(tied=True)
    torch.manual_seed(2)
    z = torch.randn(2, 6)
    x = torch.relu(network.expand(z)).reshape(2, *network.bottom)
    for level in (1, 0):
        x = x.repeat_interleave(2, dim=2).repeat_interleave(2, dim=3)
        x = nn.functional.conv_transpose2d(x, network.encoder[level].weight, network.decoder_bias[level], padding=(1, 2)[level == 0])
        x = torch.relu(x) if level else x
    torch.testing.assert_close(network.decode(z), x.squeeze(1))


def test_standard_deviations_are_positive():
    network = small()
    with torch.no_grad():
        network.spread.bias.fill_(-200.0)  # softplus underflows to 0
    std = network(codes()).std
    assert (std > 0).all() and torch.isfinite(torch.log(std)).all()


def test_z_is_the_mean_at_test_and_a_sample_in_training():
    network, grids = small(dropout=0.0), codes()
    network.eval()
    found = network(grids)
    assert torch.equal(found.output, network(grids).output)
    torch.testing.assert_close(found.output, network.decode(found.mean))
    network.train()
    torch.manual_seed(0)
    first, second = network(grids), network(grids)
    torch.testing.assert_close(first.mean, second.mean)
    assert not torch.allclose(first.output, second.output)


def test_samples_have_the_spread_that_the_head_gives():
    network, seen = small(dropout=0.0).train(), []
    network.decode = lambda z: seen.append(z) or z
    grids = codes(batch=1).expand(4000, 8, 8)
    found = network(grids)
    torch.testing.assert_close(seen[0].mean(dim=0), found.mean[0], rtol=0, atol=0.1)
    torch.testing.assert_close(seen[0].std(dim=0), found.std[0], rtol=0.1, atol=0.0)


def test_an_auto_encoder_draws_nothing():
    network = small(variational=False, dropout=0.0).train()
    first, second = network(codes()), network(codes())
    assert first.std is None and torch.equal(first.output, second.output)


def test_dropout_only_in_training():
    network = small(variational=False, dropout=0.7)
    network.train()
    assert not torch.equal(network(codes()).mean, network(codes()).mean)
    network.eval()
    assert torch.equal(network(codes()).mean, network(codes()).mean)


@pytest.mark.parametrize(
    ("settings", "cells", "message"),
    [
        ({"kernels": [5]}, 8, "network.kernels: expected 2"),
        ({"kernels": [5, 4]}, 8, "network.kernels: expected odd"),
        ({"kernels": [0, 3]}, 8, "network.kernels: expected odd"),
        ({"kernels": [], "channels": []}, 8, "network.kernels: expected odd numbers of cells, at least one"),
        ({"encoding": "colour"}, 8, "network.encoding: expected one of signed, shares, hit_free, detailed, got 'colour'"),
        ({}, 10, "grid.cells: expected a multiple of 4"),
        ({"tied": True, "encoding": "hit_free"}, 8, "network.tied: .*encoding: signed"),
    ],
)
def test_settings_that_make_no_network(settings, cells, message):
    with pytest.raises(InputError, match=message):
        small(cells=cells, **settings)


def test_the_encoder_is_convolution_relu_and_the_largest_of_four():
    network = small().eval()
    found, x = network(codes()), codes()[:, None].float()
    for convolve, padding in zip(network.encoder, (2, 1), strict=True):
        x = nn.functional.conv2d(x, convolve.weight, convolve.bias, padding=padding).clamp_min(0)
        x = x.unfold(2, 2, 2).unfold(3, 2, 2).amax(dim=(-1, -2))
    x = x.flatten(1)
    torch.testing.assert_close(found.mean, x @ network.mean.weight.T + network.mean.bias)
    torch.testing.assert_close(found.std, torch.log1p(torch.exp(x @ network.spread.weight.T + network.spread.bias)) + 1e-6)


def test_dropout_is_the_share_that_is_dropped():
    network, seen = small(dropout=0.8), []
    network.mean.register_forward_pre_hook(lambda module, inputs: seen.append(inputs[0]))
    network.eval()(codes(batch=300))
    network.train()(codes(batch=300))
    assert (seen[1][seen[0] > 0] == 0).float().mean().item() == pytest.approx(0.8, abs=0.02)
