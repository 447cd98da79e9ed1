"""Weights at a quarter of their size: each output channel of a convolution or matrix as int8 with one scale."""

from __future__ import annotations

import torch
from torch import Tensor

from hilbertvae.checks import InputError

SCALE = ".scale"
MOST = 127


def pack(tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    """`tensors` with each floating-point one of at least two axes as int8, and beside it, as `<name>.scale`, float32 (channels,).

    Rounding moves a weight by at most 1/254 of the largest of its channel, about what bfloat16, in which networks run, does to that one.
    """
    packed = {}
    for name, tensor in tensors.items():
        if tensor.ndim < 2 or not tensor.is_floating_point():
            packed[name] = tensor
            continue
        scale = tensor.float().abs().flatten(1).amax(dim=1) / MOST
        safe = torch.where(scale > 0, scale, 1.0)
        packed[name] = torch.round(tensor.float() / _along(safe, tensor)).to(torch.int8)
        packed[name + SCALE] = scale
    return packed


def unpack(tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    """The inverse of `pack`, in float32; tensors that were never packed pass as they are. An `InputError` for scales of another shape."""
    scales = {
        name for name in tensors if name.endswith(SCALE) and tensors.get(name.removesuffix(SCALE), torch.empty(0)).dtype == torch.int8
    }
    for name in scales:
        wanted = tuple(tensors[name.removesuffix(SCALE)].shape[:1])
        if tuple(tensors[name].shape) != wanted:
            raise InputError(f"{name}: expected shape {wanted}, a scale per channel, got {tuple(tensors[name].shape)}")
    return {
        name: tensor.float() * _along(tensors[name + SCALE], tensor) if name + SCALE in scales else tensor
        for name, tensor in tensors.items()
        if name not in scales
    }


def _along(scale: Tensor, tensor: Tensor) -> Tensor:
    return scale.reshape(-1, *(1,) * (tensor.ndim - 1))
