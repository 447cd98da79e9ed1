import numpy as np
import pytest
import torch
from torch.distributions import Normal
from torch.distributions import kl_divergence as torch_kl

from hilbertvae.checks import InputError
from hilbertvae.grids.cluster_grids import GridSettings
from hilbertvae.reconstruction.conditional_network import ConditionalNetwork
from hilbertvae.reconstruction.likelihood import kl_divergence
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.reconstruction.settings import ConditionalNetworkSettings, LikelihoodSettings
from toy_rooms import draw_weights

SMALL = {"stem": 2, "channels": [4, 6, 8], "blocks": [1, 2, 1], "latent": 3}


def small(dimension=2, **settings):
    torch.manual_seed(0)
    network = ConditionalNetwork(ConditionalNetworkSettings(**{**SMALL, **settings}), dimension, 16)
    draw_weights(network)
    return network


def codes(dimension=2, batch=3, seed=1):
    return torch.randint(-1, 2, (batch, *(16,) * dimension), generator=torch.Generator().manual_seed(seed)).to(torch.int8)


@pytest.mark.parametrize("dimension", [2, 3])
def test_shapes(dimension):
    network = small(dimension).eval()
    for target in (None, codes(dimension, seed=2)):
        found = network(codes(dimension), target)
        assert found.output.shape == found.known.shape == (3, *(16,) * dimension)
        for moments in (found.mean, found.std, *found.prior):
            assert moments.shape == (3, 3 * 2**dimension)  # 16 cells, stem 2 and two levels leave 2 along each axis
        assert (found.std > 0).all() and (found.prior[1] > 0).all()


def test_without_a_target_z_is_the_priors_mean():
    network = small().train()
    first, second = network(codes()), network(codes())
    assert torch.equal(first.output, second.output)
    assert torch.equal(first.mean, first.prior[0]) and torch.equal(first.std, first.prior[1])
    assert not kl_divergence(first.mean, first.std, first.prior).abs().max() > 1e-6


def test_the_prior_never_sees_the_target():
    network = small().eval()
    plain = network(codes())
    for seed in (2, 3):
        found = network(codes(), codes(seed=seed))
        for with_target, without in zip(found.prior, plain.prior, strict=True):
            assert torch.equal(with_target, without)
        assert not torch.equal(found.mean, plain.mean)


def test_grids_that_guess_are_decoded_as_the_map_asks_for_them():
    grids, target = codes(batch=200), codes(batch=200, seed=2)
    for share in (0.0, 0.5, 1.0):
        network = small(guess_share=share).eval()
        plain, found = network(grids).output, network(grids, target).output
        guessed = (plain == found).flatten(1).all(dim=1).float().mean()
        assert abs(float(guessed) - share) < (0.12 if 0 < share < 1 else 1e-9)


def test_the_posteriors_encoder_learns_from_the_fit():
    network = small(guess_share=0.0).train()
    network(codes(), codes(seed=2)).output.square().sum().backward()
    assert network.target_encoder[0].weight.grad.abs().max() > 0


def test_draws_differ_and_can_be_drawn_again():
    network = small().eval().to(memory_format=torch.channels_last)  # as a loaded one lies
    reconstructor = Reconstructor(network, network.settings, LikelihoodSettings(), GridSettings(cells=16), 2, 0.1)
    grids = codes().numpy()
    first = reconstructor.draws(grids, 3, seed=5)
    assert first.shape == (3, *grids.shape) and np.isfinite(first).all()
    assert np.abs(first[0] - first[1]).max() > 1e-3
    np.testing.assert_array_equal(first, reconstructor.draws(grids, 3, seed=5))
    assert np.abs(first - reconstructor.draws(grids, 3, seed=6)).max() > 1e-3


def test_a_saved_one_answers_alike(tmp_path):
    network = small().eval().to(memory_format=torch.channels_last)  # as a loaded one lies
    reconstructor = Reconstructor(network, network.settings, LikelihoodSettings(), GridSettings(cells=16), 2, 0.1)
    loaded = Reconstructor.load(reconstructor.save(tmp_path / "model.safetensors"))
    grids = codes().numpy()
    np.testing.assert_array_equal(loaded.reconstruct(grids), reconstructor.reconstruct(grids))
    np.testing.assert_array_equal(loaded.draws(grids, 2), reconstructor.draws(grids, 2))


def test_divergence_from_a_prior_is_that_of_two_gaussians():
    generator = torch.Generator().manual_seed(0)
    mean, other = torch.randn(2, 50, 7, generator=generator)
    std, width = torch.rand(2, 50, 7, generator=generator) + 0.1
    expected = torch_kl(Normal(mean, std), Normal(other, width))
    torch.testing.assert_close(kl_divergence(mean, std, (other, width)), expected, rtol=1e-4, atol=1e-5)
    standard = (torch.zeros_like(mean), torch.ones_like(std))
    torch.testing.assert_close(kl_divergence(mean, std, standard), kl_divergence(mean, std))


@pytest.mark.parametrize(
    ("settings", "named"),
    [({"variational": False}, "variational"), ({"bottom": "flat", "skips": False}, "bottom"), ({"guess_share": 1.5}, "guess_share")],
)
def test_settings_that_have_no_conditional_prior(settings, named):
    with pytest.raises(InputError, match=f"network.*{named}"):
        small(**settings)
