"""The symmetries of a grid: flips of its axes, and swaps of its horizontal ones."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

from hilbertvae.checks import InputError
from hilbertvae.grids.cluster_grids import PLACES

if TYPE_CHECKING:  # who only checks settings does not wait for torch
    from torch import Tensor

Symmetry = tuple[bool, tuple[int, ...]]
"""Whether the two horizontal axes are swapped, and which spatial axes (0-based) are flipped after that."""


def symmetries() -> list[Symmetry]:
    """The 8 symmetries of the horizontal square, the identity first. In 3D up stays up: streets are not seen upside down."""
    flips = [axes for count in range(3) for axes in itertools.combinations(range(2), count)]
    return [(swap, axes) for swap in (False, True) for axes in flips]


def check_flips(flips: int | None) -> None:
    """An `InputError` unless `flips` is None or how many of `symmetries` make a group."""
    if flips not in (None, 1, 2, 4, 8):
        raise InputError(f"flips: expected 1, 2, 4 or 8, got {flips!r}")


def apply(grids: Tensor, symmetry: Symmetry) -> Tensor:
    """`grids (B, n, ..., n)`, moved by the symmetry."""
    swap, axes = symmetry
    if swap:
        grids = grids.transpose(1, 2)
    return grids.flip([axis + 1 for axis in axes]) if axes else grids


def apply_channels(grids: Tensor, symmetry: Symmetry) -> Tensor:
    """`grids (B, C, n, ..., n)`, moved by the symmetry: of those of `bin_detailed`, places in cells are mirrored with the cells."""
    swap, axes = symmetry
    placed = grids.shape[1] > PLACES
    if swap:
        channels = list(range(grids.shape[1]))
        if placed:
            channels[PLACES : PLACES + 2] = PLACES + 1, PLACES
        grids = grids[:, channels].transpose(2, 3)
    if axes:
        grids = grids.flip([axis + 2 for axis in axes])
        for axis in axes if placed else ():
            grids[:, PLACES + axis] *= -1  # a flip is a copy
    return grids


def undo(grids: Tensor, symmetry: Symmetry) -> Tensor:
    """The inverse of `apply`."""
    swap, axes = symmetry
    if axes:
        grids = grids.flip([axis + 1 for axis in axes])
    return grids.transpose(1, 2) if swap else grids
