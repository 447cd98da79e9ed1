"""The default network with a prior that what was observed decides, so that draws of z are different completions of one gap."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from hilbertvae.checks import InputError, check_share
from hilbertvae.reconstruction.blocks import CONVOLUTION, HIT_FREE_CHANNELS, Reconstruction, ResidualBlock, hit_free
from hilbertvae.reconstruction.gated_network import GatedNetwork
from hilbertvae.reconstruction.settings import ConditionalNetworkSettings


class ConditionalNetwork(GatedNetwork):
    """p(z | H) of an input H is learned, and in training q(z | H, H') sees the target H' as well (Sohn et al. 2015).

    A posterior that only saw the input could say nothing that the decoder does not hear from the skips and the bottom already, so its
    KL went to 0. Here z has to tell which of the things that may lie in a gap does, and p(z | H) what may.
    """

    def __init__(self, settings: ConditionalNetworkSettings, dimension: int, cells: int):
        if not settings.variational or settings.bottom != "summary":
            raise InputError("network: a conditional prior needs network.variational=true and network.bottom=summary")
        check_share(settings.guess_share, "network.guess_share")
        super().__init__(settings, dimension, cells)

    def _add_latent(self, inputs: int) -> None:
        settings, dimension, convolution = self.settings, self.dimension, CONVOLUTION[self.dimension]
        channels, last = settings.channels, settings.channels[-1]
        layers = [convolution(inputs + HIT_FREE_CHANNELS, channels[0], settings.stem, stride=settings.stem)]
        for level, wide in enumerate(channels):
            layers.append(ResidualBlock(dimension, wide))
            if level + 1 < len(channels):
                layers.append(convolution(wide, channels[level + 1], 2, stride=2))
        self.target_encoder = nn.Sequential(*layers)
        self.prior = convolution(last, 2 * settings.latent, 1)
        self.posterior = convolution(2 * last, 2 * settings.latent, 1)
        self.expand = convolution(settings.latent, last, 1)

    def forward(self, grids: Tensor, target: Tensor | None = None) -> Reconstruction:
        """`grids` as for the default network; `target (B, n, ..., n)` codes, in training alone. Without it z is the prior's mean."""
        x, kept = self._down(grids)
        prior = mean, std = _gaussian(self.prior(x))
        z = mean
        if target is not None:
            seen = self.target_encoder(torch.cat([self.encode_input(grids), hit_free(target)], dim=1))
            mean, std = _gaussian(self.posterior(torch.cat([x, seen], dim=1)))
            guessed = (torch.rand(len(z), device=z.device) < self.settings.guess_share).reshape(-1, *(1,) * (z.ndim - 1))
            z = torch.where(guessed, z, mean + std * torch.randn_like(std))
        output, known = self._up(x + self.expand(z), kept)
        return Reconstruction(output, mean.flatten(1), std.flatten(1), known, tuple(part.flatten(1) for part in prior))

    def draw(self, grids: Tensor, generator: torch.Generator) -> Tensor:
        """(B, n, ..., n) logits for z drawn from p(z | H): one of the ways in which each grid may go on."""
        x, kept = self._down(grids)
        mean, std = _gaussian(self.prior(x))
        noise = torch.randn(mean.shape, generator=generator).to(mean)
        return self._up(x + self.expand(mean + std * noise), kept)[0]


def _gaussian(parameters: Tensor) -> tuple[Tensor, Tensor]:
    mean, spread = parameters.chunk(2, dim=1)
    return mean, F.softplus(spread) + 1e-3  # a prior of no width has no KL
