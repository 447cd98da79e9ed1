"""What is done to a batch of training grids, so that no two epochs show the same: symmetries, and more gaps."""

from __future__ import annotations

import torch
from torch import Tensor

from hilbertvae.grids.aligned_grid import COUNT_STEPS
from hilbertvae.grids.cluster_grids import COUNTS, PLACES, labels_of
from hilbertvae.reconstruction.settings import AugmentationSettings
from hilbertvae.reconstruction.symmetry import apply, apply_channels, symmetries


def augment(shown: Tensor, target: Tensor, settings: AugmentationSettings, dimension: int) -> tuple[Tensor, Tensor]:
    """(shown, target), moved by the same symmetry, grid by grid, and with balls cut from `shown`.

    shown, target: int8 (B, n, ..., n), or with channels, the labels first, as `bin_detailed` and `bin_voted` make them.
    """
    detailed = shown.ndim == dimension + 2
    move_shown, move_target = (apply_channels if grids.ndim == dimension + 2 else apply for grids in (shown, target))
    if settings.symmetric:
        moves = symmetries()
        moves = [moves[k] for k in torch.randperm(len(moves))]  # a batch of fewer grids than moves shall not know the first ones alone
        order = torch.randperm(len(shown)).to(shown.device)  # drawn alike everywhere, and copied to a GPU once
        portions = [order[k :: len(moves)] for k in range(len(moves))]
        moved = [(move_shown(shown[p], move), move_target(target[p], move)) for p, move in zip(portions, moves, strict=True)]
        shown, target = (torch.cat(parts) for parts in zip(*moved, strict=True))
    if detailed and settings.count_factor > 1:
        shown = scale_counts(shown, settings.count_factor)
    if settings.balls:
        inside = random_balls(labels_of(target, dimension), settings.balls, settings.ball_diameter_cells)
        shown = torch.where(inside.unsqueeze(1) if detailed else inside, 0, shown)
    return shown, target


def scale_counts(shown: Tensor, most: float) -> Tensor:
    """`shown (B, 3 + D, n, ..., n)` with all counts of a grid multiplied by one factor, log-uniform from 1 / `most` to `most`; none of what
    was seen becomes unseen."""
    factor = most ** (2 * torch.rand(len(shown), device=shown.device) - 1)
    codes = shown[:, COUNTS]
    votes = torch.expm1(codes.float() / COUNT_STEPS) * factor.reshape(-1, *(1,) * (shown.ndim - 1))
    scaled = torch.round(COUNT_STEPS * torch.log1p(votes)).clamp(1, 127).to(torch.int8)
    return torch.cat([shown[:, :1], torch.where(codes > 0, scaled, 0), shown[:, PLACES:]], dim=1)


def random_balls(target: Tensor, balls: int, diameter_cells: list[float]) -> Tensor:
    """(B, n, ..., n) bool, true in a ball around a random occupied cell of each grid, moved by a uniform offset within its radius; and in
    up to `balls - 1` more of such, each by one chance in two."""
    batch, cells, dimension, device = len(target), target.shape[1], target.ndim - 1, target.device
    low, high = diameter_cells
    seen = (target.flatten(1) > 0).cumsum(dim=1)  # so that each ball costs one draw, not one a cell
    rank = 1 + (torch.rand(batch, balls, device=device) * seen[:, -1:]).floor().to(seen.dtype)
    found = torch.searchsorted(seen, torch.minimum(rank, seen[:, -1:]))  # unravel_index would copy from the CPU to a GPU
    centre = torch.stack([found // cells ** (dimension - 1 - d) % cells for d in range(dimension)], dim=2).float()
    radius = (low + (high - low) * torch.rand(batch, balls, device=device)) / 2
    offset = torch.randn(batch, balls, dimension, device=device)
    offset *= (radius * torch.rand(batch, balls, device=device) ** (1 / dimension) / offset.norm(dim=2)).unsqueeze(2)
    there = torch.rand(batch, balls, device=device) < 0.5
    there[:, 0] = True
    along = (torch.arange(cells, device=device) - (centre + offset).unsqueeze(3)).square()  # (B, balls, D, n)
    inside = torch.zeros_like(target, dtype=torch.bool)
    for ball in range(balls):  # all at once would fill a cache with distances
        squared = sum(along[:, ball, d].reshape(batch, *(cells if axis == d else 1 for axis in range(dimension))) for d in range(dimension))
        inside |= squared < (radius * there)[:, ball].square().reshape(-1, *(1,) * dimension)
    return inside
