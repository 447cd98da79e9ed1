"""Parts that networks of 2 and 3 dimensions share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from hilbertvae.checks import InputError, check_count
from hilbertvae.grids.aligned_grid import COUNT_STEPS, PLACE_STEPS
from hilbertvae.grids.cluster_grids import COUNTS
from hilbertvae.reconstruction.precision import layer_type
from hilbertvae.reconstruction.settings import COUNTED, KERNEL

CONVOLUTION = {2: nn.Conv2d, 3: nn.Conv3d}
CHANNELS_LAST = {2: torch.channels_last, 3: torch.channels_last_3d}
MAX_POOL = {2: F.max_pool2d, 3: F.max_pool3d}
MEAN_POOL = {2: F.avg_pool2d, 3: F.avg_pool3d}
CONVOLVE_TRANSPOSED = {2: F.conv_transpose2d, 3: F.conv_transpose3d}


@dataclass(frozen=True)
class Reconstruction:
    """output: (B, n, ..., n), what the likelihood takes; mean, std: (B, latent) of Q(z|H), Eq. 10; std is None without sampling.

    known: (B, n, ..., n) logits of whether the whole site's scans saw a cell at all; None for a network that does not say.
    prior: mean and std of p(z), as mean and std are, where that is not N(0, I).
    """

    output: Tensor
    mean: Tensor | None
    std: Tensor | None
    known: Tensor | None = None
    prior: tuple[Tensor, Tensor] | None = None


def check_network_numbers(settings) -> None:
    """An `InputError` for numbers, of those that every kind of network has, that make none."""
    for place, width in enumerate(settings.channels):
        check_count(width, f"network.channels[{place}]")
    check_count(settings.latent, "network.latent")
    if not 0 <= settings.dropout < 1:
        raise InputError(f"network.dropout: expected a share from 0 on and below 1, got {settings.dropout}")


def signed(grids: Tensor) -> Tensor:
    """The paper's input: (B, n, ..., n) int8 codes as one float channel of -1, 0, 1."""
    return grids.unsqueeze(1).float()


HIT_FREE_CHANNELS = 2


def hit_free(grids: Tensor) -> Tensor:
    """Two channels, hit and free; both 0 where unknown, so that unknown is no value between the two."""
    return torch.stack([grids > 0, grids < 0], dim=1).to(layer_type(grids.device))


def detailed(grids: Tensor) -> Tensor:
    """`hit_free` of the labels of (B, 3 + D, n, ..., n) int8 grids, as `bin_detailed` makes them, and their counts and places, each
    about 1 where it is large."""
    label, details = grids[:, :1], grids[:, 1:]
    scale = [1.0] * HIT_FREE_CHANNELS + [4.0 * COUNT_STEPS] * 2 + [PLACE_STEPS / 2] * (details.shape[1] - 2)
    scale = torch.tensor(scale, dtype=layer_type(grids.device), device=grids.device).reshape(-1, *(1,) * (grids.ndim - 2))
    return torch.cat([label > 0, label < 0, details], dim=1) / scale


def shares(grids: Tensor) -> Tensor:
    """Occupancy probabilities instead of labels (the paper's footnote 1), as its other input is: one channel, from -1 where no vote of a
    cell of (B, 3 + D, n, ..., n) int8 grids, as `bin_detailed` makes them, is a hit to 1 where all are; 0 where there are none."""
    hits, frees = (torch.expm1(code.float() / COUNT_STEPS) for code in grids[:, COUNTS].split(1, dim=1))
    return torch.where(grids[:, :1] != 0, (hits - frees) / (hits + frees).clamp_min(1e-6), 0.0)


ENCODINGS = {
    "signed": (signed, (1, 1)),
    "shares": (shares, (1, 1)),
    "hit_free": (hit_free, (HIT_FREE_CHANNELS,) * 2),
    "detailed": (detailed, (6, 7)),
}
"""What makes the input, and how many channels that has in 2 and in 3 dimensions."""


def find_encoding(name: str, dimension: int) -> tuple[Callable[[Tensor], Tensor], int]:
    """What makes a network's input of int8 grids, and how many channels that has; an `InputError` for an unknown name."""
    if name not in ENCODINGS:
        raise InputError(f"network.encoding: expected one of {', '.join(ENCODINGS)}, got {name!r}")
    encode, channels = ENCODINGS[name]
    return encode, channels[dimension - 2]


def shows_no_less(encoding: str, before: str) -> bool:
    """Whether the first inputs of an encoding are those of the one `before` it."""
    return encoding == before or (encoding, before) == ("detailed", "hit_free")


def is_detailed(network: object) -> bool:
    """Whether a network of these settings takes grids as `bin_detailed` makes them; one that has no encodings takes labels alone."""
    return getattr(network, "encoding", None) in COUNTED


def convolutions(network: object, cells: int) -> list[tuple[int, int]]:
    """Kernel and cells, along an axis, of what a network of these settings convolves in grids of `cells`; none if it does not say."""
    return getattr(network, "convolutions", lambda cells: [])(cells)


def group_norm(channels: int) -> nn.GroupNorm:
    """GroupNorm of about 16 channels a group: the same at training and at test, whatever the batch."""
    return nn.GroupNorm(channels // channels_a_group(channels), channels)


def channels_a_group(channels: int) -> int:
    """Of so many, how many share one mean and variance."""
    groups = max(1, channels // 16)
    return channels // groups if channels % groups == 0 else channels


class ResidualBlock(nn.Module):
    """x + conv(act(norm(conv(act(norm(x)))))), 3-cell kernels (He et al. 2016, pre-activation)."""

    def __init__(self, dimension: int, channels: int, dropout: float = 0.0):
        super().__init__()
        convolution = CONVOLUTION[dimension]
        self.body = nn.Sequential(
            group_norm(channels),
            nn.SiLU(),
            convolution(channels, channels, KERNEL, padding=KERNEL // 2),
            group_norm(channels),
            nn.SiLU(),
            nn.Dropout(dropout),
            convolution(channels, channels, KERNEL, padding=KERNEL // 2),
        )
        nn.init.zeros_(self.body[-1].weight)
        nn.init.zeros_(self.body[-1].bias)

    def forward(self, x: Tensor) -> Tensor:
        return x + self.body(x)


def spread_channels(x: Tensor, stride: int) -> Tensor:
    """Pixel shuffle in D dimensions: (B, C stride^D, m, ..., m) to (B, C, m stride, ..., m stride), channels last in memory, as networks
    lie, so that what follows copies nothing."""
    batch, channels, *size = x.shape
    dimension = len(size)
    x = x.movedim(1, -1).reshape(batch, *size, channels // stride**dimension, *(stride,) * dimension)
    order = [0]
    for d in range(dimension):
        order += [1 + d, 2 + dimension + d]
    x = x.permute(*order, 1 + dimension).reshape(batch, *(length * stride for length in size), channels // stride**dimension)
    return x.movedim(-1, 1)
