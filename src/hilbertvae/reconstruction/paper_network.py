"""The paper's networks: a convolutional auto-encoder, plain (CAE, Eq. 1-3) or variational (CVAE, Eq. 10-12), in 2D and 3D."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from hilbertvae.checks import InputError
from hilbertvae.reconstruction.blocks import (
    CONVOLUTION,
    CONVOLVE_TRANSPOSED,
    MAX_POOL,
    Reconstruction,
    check_network_numbers,
    find_encoding,
)
from hilbertvae.reconstruction.settings import PaperNetworkSettings


class PaperNetwork(nn.Module):
    """Convolutions of stride 1, ReLU and max-pool 2; two linear heads; resize and convolution back. z = mu outside training."""

    def __init__(self, settings: PaperNetworkSettings, dimension: int, cells: int):
        super().__init__()
        depth = len(settings.channels)
        check_network_numbers(settings)
        if len(settings.kernels) != depth:
            raise InputError(f"network.kernels: expected {depth}, one per channel count, got {len(settings.kernels)}")
        if not depth or any(kernel < 1 or kernel % 2 == 0 for kernel in settings.kernels):
            raise InputError(f"network.kernels: expected odd numbers of cells, at least one, got {list(settings.kernels)}")
        if cells % 2**depth:
            raise InputError(f"grid.cells: expected a multiple of {2**depth} for {depth} poolings, got {cells}")
        self.settings, self.dimension = settings, dimension
        self.encode_input, inputs = find_encoding(settings.encoding, dimension)
        if settings.tied and inputs != 1:
            raise InputError("network.tied: tied weights need encoding: signed or shares, so that input and output have one channel each")
        convolution = CONVOLUTION[dimension]
        wide = [inputs, *settings.channels]
        self.encoder = nn.ModuleList(
            convolution(wide[i], wide[i + 1], kernel, padding=kernel // 2) for i, kernel in enumerate(settings.kernels)
        )
        self.bottom = (settings.channels[-1], *(cells // 2**depth,) * dimension)
        features = math.prod(self.bottom)
        self.mean = nn.Linear(features, settings.latent)
        self.spread = nn.Linear(features, settings.latent) if settings.variational else None
        self.expand = nn.Linear(settings.latent, features)
        back = [1, *settings.channels]
        if settings.tied:
            self.decoder = None
            self.decoder_bias = nn.ParameterList(nn.Parameter(torch.zeros(count)) for count in back[:-1])
        else:
            self.decoder = nn.ModuleList(
                convolution(back[i + 1], back[i], kernel, padding=kernel // 2) for i, kernel in enumerate(settings.kernels)
            )

    def forward(self, grids: Tensor) -> Reconstruction:
        """`grids (B, n, ..., n)` int8 codes; with encodings that show counts (B, 3 + D, n, ..., n)."""
        x = self.encode_input(grids)
        for convolve in self.encoder:
            x = MAX_POOL[self.dimension](F.relu(convolve(x)), 2)
        x = F.dropout(x, self.settings.dropout, self.training).flatten(1)
        mean = self.mean(x)
        if self.spread is None:
            return Reconstruction(self.decode(mean), mean, None)
        std = F.softplus(self.spread(x)) + 1e-6
        z = mean + std * torch.randn_like(std) if self.training else mean
        return Reconstruction(self.decode(z), mean, std)

    def decode(self, z: Tensor) -> Tensor:
        """(B, n, ..., n) outputs, before the likelihood's own squashing, of `z (B, latent)`."""
        x = F.relu(self.expand(z)).reshape(len(z), *self.bottom)
        for level in reversed(range(len(self.encoder))):
            x = F.interpolate(x, scale_factor=2, mode="nearest")
            if self.decoder is None:
                weight = self.encoder[level].weight
                padding = self.settings.kernels[level] // 2
                x = CONVOLVE_TRANSPOSED[self.dimension](x, weight, self.decoder_bias[level], padding=padding)
            else:
                x = self.decoder[level](x)
            if level:
                x = F.relu(x)
        return x.squeeze(1)
