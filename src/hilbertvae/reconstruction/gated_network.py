"""Our network: a residual auto-encoder that leaves full resolution early, with skips gated by what was observed."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from hilbertvae.checks import InputError, check_count, check_whole
from hilbertvae.grids.cluster_grids import labels_of
from hilbertvae.reconstruction.blocks import (
    CONVOLUTION,
    MEAN_POOL,
    Reconstruction,
    ResidualBlock,
    check_network_numbers,
    find_encoding,
    group_norm,
    spread_channels,
)
from hilbertvae.reconstruction.settings import KERNEL, GatedNetworkSettings

BOTTOMS = ("summary", "flat")


class GatedNetwork(nn.Module):
    """Stem, residual levels down, a latent at the bottom, residual levels up, pixel shuffle to logits.

    A skip carries detail of what was observed past the bottom. Its gate is the share of cells observed there, so inside a gap the
    decoder hears nothing from the skip and has to complete from below. The latent is a summary of the whole grid (one vector), added
    to every cell of the bottom. With a `flat` bottom the latent holds all cells of the bottom instead, as in the paper's networks, and
    nothing else reaches the decoder.
    """

    def __init__(self, settings: GatedNetworkSettings, dimension: int, cells: int):
        super().__init__()
        channels, levels = settings.channels, len(settings.channels)
        check_network_numbers(settings)
        if not settings.channels:
            raise InputError("network.channels: expected at least one level, got none")
        check_count(settings.stem, "network.stem")
        reduction = settings.stem * 2 ** (levels - 1)
        if len(settings.blocks) != levels:
            raise InputError(f"network.blocks: expected {levels}, one per level, got {len(settings.blocks)}")
        for place, blocks in enumerate(settings.blocks):
            check_whole(blocks, f"network.blocks[{place}]")
        if cells % reduction:
            raise InputError(f"grid.cells: expected a multiple of {reduction} (stem and {levels} levels), got {cells}")
        if settings.bottom not in BOTTOMS:
            raise InputError(f"network.bottom: expected one of {', '.join(BOTTOMS)}, got {settings.bottom!r}")
        if settings.bottom == "flat" and settings.skips:
            raise InputError("network.bottom: flat needs network.skips=false, else detail goes past the latent")
        self.settings, self.dimension, self.cells = settings, dimension, cells
        self.bottom = (channels[-1], *(cells // reduction,) * dimension)
        convolution = CONVOLUTION[dimension]
        self.encode_input, inputs = find_encoding(settings.encoding, dimension)
        self.stem = convolution(inputs, channels[0], settings.stem, stride=settings.stem)
        self.down = nn.ModuleList(self._level(i) for i in range(levels))
        self.shrink = nn.ModuleList(convolution(channels[i], channels[i + 1], 2, stride=2) for i in range(levels - 1))
        self._add_latent(inputs)
        self.grow = nn.ModuleList(convolution(channels[i + 1], channels[i] * 2**dimension, 1) for i in range(levels - 1))
        self.join = nn.ModuleList(convolution(2 * channels[i], channels[i], 1) for i in range(levels - 1)) if settings.skips else None
        self.up = nn.ModuleList(self._level(i) for i in range(levels - 1))
        self.head = nn.Sequential(
            group_norm(channels[0]), nn.SiLU(), convolution(channels[0], settings.stem**dimension, KERNEL, padding=KERNEL // 2)
        )
        self.known_head = convolution(channels[0], settings.stem**dimension, KERNEL, padding=KERNEL // 2) if settings.known else None

    def _add_latent(self, inputs: int) -> None:
        settings = self.settings
        features = math.prod(self.bottom) if settings.bottom == "flat" else self.bottom[0]
        self.mean = nn.Linear(features, settings.latent)
        self.spread = nn.Linear(features, settings.latent) if settings.variational else None
        self.expand = nn.Linear(settings.latent, features)

    def _level(self, level: int) -> nn.Sequential:
        settings = self.settings
        return nn.Sequential(
            *(ResidualBlock(self.dimension, settings.channels[level], settings.dropout) for _ in range(settings.blocks[level]))
        )

    def forward(self, grids: Tensor) -> Reconstruction:
        """`grids (B, n, ..., n)` int8 codes; with a `detailed` encoding (B, 3 + D, n, ..., n)."""
        x, kept = self._down(grids)
        summary = x.flatten(1) if self.settings.bottom == "flat" else x.flatten(2).mean(dim=2)
        mean = self.mean(summary)
        std = F.softplus(self.spread(summary)) + 1e-6 if self.spread is not None else None
        z = mean + std * torch.randn_like(std) if std is not None and self.training else mean
        output, known = self._up(self._bottom(z, x), kept)
        return Reconstruction(output, mean, std, known)

    def _down(self, grids: Tensor) -> tuple[Tensor, list[Tensor]]:
        """The bottom's cells, and what the skips keep of the levels above."""
        x = self.stem(self.encode_input(grids))
        gate = MEAN_POOL[self.dimension]((labels_of(grids, self.dimension) != 0).unsqueeze(1).to(x.dtype), self.settings.stem)
        kept = []
        for level, blocks in enumerate(self.down):
            x = blocks(x)
            if level < len(self.shrink):
                kept.append(x * gate.to(x.dtype))  # autocast pools in float32, and would go on in it
                gate = MEAN_POOL[self.dimension](gate, 2)
                x = self.shrink[level](x)
        return x, kept

    def _bottom(self, z: Tensor, x: Tensor) -> Tensor:
        """What the decoder starts from."""
        expanded = self.expand(z)
        flat = self.settings.bottom == "flat"
        return expanded.reshape(len(z), *self.bottom) if flat else x + expanded.reshape(len(z), -1, *(1,) * self.dimension)

    def _up(self, x: Tensor, kept: list[Tensor]) -> tuple[Tensor, Tensor | None]:
        """Logits of the bottom `x`, and of whether each cell would be known."""
        for level in reversed(range(len(self.grow))):
            x = spread_channels(self.grow[level](x), 2)
            if self.join is not None:
                x = self.join[level](torch.cat([x, kept[level] if kept else torch.zeros_like(x)], dim=1))
            x = self.up[level](x)
        features = self.head[:-1](x)
        heads = (self.head[-1], self.known_head)
        return tuple(spread_channels(head(features), self.settings.stem).squeeze(1) if head else None for head in heads)

    def decode(self, z: Tensor) -> Tensor:
        """(B, n, ..., n) logits of `z (B, latent)` alone, as if nothing had been observed."""
        empty = torch.zeros(len(z), *self.bottom, dtype=z.dtype, device=z.device)
        return self._up(self._bottom(z, empty), [])[0]
