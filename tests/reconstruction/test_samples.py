"""What is drawn of the latent (Eq. 10) has the mean and the standard deviation that the network says."""

import pytest
import torch

from hilbertvae.reconstruction.conditional_network import ConditionalNetwork
from hilbertvae.reconstruction.gated_network import GatedNetwork
from hilbertvae.reconstruction.settings import ConditionalNetworkSettings, GatedNetworkSettings
from toy_rooms import draw_weights

SMALL = {"stem": 2, "channels": [4, 6, 8], "blocks": [1, 2, 1], "latent": 3}


@pytest.mark.parametrize("kind", ["gated", "posterior", "prior"])
def test_samples_have_the_mean_and_the_spread_that_are_said(kind):
    torch.manual_seed(0)
    seen, grids = [], torch.randint(-1, 2, (2, 1, 16, 16)).to(torch.int8).expand(2, 4000, 16, 16)
    if kind == "gated":
        network = GatedNetwork(GatedNetworkSettings(**SMALL), 2, 16).train()
    else:
        network = ConditionalNetwork(ConditionalNetworkSettings(**SMALL, guess_share=0.0), 2, 16).train()
    draw_weights(network)
    network.expand.register_forward_pre_hook(lambda module, inputs: seen.append(inputs[0].flatten(1)))
    found = network(grids[0]) if kind == "gated" else network(*grids)
    mean, std = found.prior if kind == "prior" else (found.mean, found.std)
    if kind == "prior":
        network.draw(grids[0], torch.Generator().manual_seed(0))
    torch.testing.assert_close(seen[-1].mean(dim=0), mean[0], rtol=0, atol=0.1)
    torch.testing.assert_close(seen[-1].std(dim=0), std[0], rtol=0.1, atol=0.0)
