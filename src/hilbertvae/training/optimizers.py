"""What trains a network: Muon (K. Jordan et al. 2024; J. Liu et al. 2025 for the size of its steps), or AdamW alone."""

from __future__ import annotations

import math
from collections.abc import Iterable

import torch
from torch import Tensor, nn

NEWTON_SCHULZ = (3.4445, -4.7750, 2.0315)
"""Coefficients of the quintic that takes all singular values of a matrix to between about 0.7 and 1.2 in five rounds (Jordan 2024)."""
ROUNDS = 5
ADAMW_BETAS = (0.9, 0.95)
MOMENTUM = 0.95
"""Of Muon's steps."""
MATCH = 0.2
"""The root mean square of an AdamW step, in learning rates: with steps of this size one rate serves both (Liu et al. 2025)."""


def orthogonalised(matrices: Tensor) -> Tensor:
    """(..., A, B): U V^T, roughly, of U S V^T = each of `matrices (..., A, B)`, so that no direction drowns another.

    Each round takes X to q(X X^T) X. All that it needs of X is its Gram matrix, which is small, so the rounds are worked out on that one
    and the product of all q is applied to X once: half the time for one nine times as wide as tall.
    """
    a, b, c = NEWTON_SCHULZ
    tall = matrices.shape[-2] > matrices.shape[-1]
    x = matrices.mT if tall else matrices
    x = x / torch.linalg.matrix_norm(x, keepdim=True).clamp_min(1e-7)
    gram = x @ x.mT
    product = torch.eye(x.shape[-2], dtype=x.dtype, device=x.device).expand_as(gram)
    for _ in range(ROUNDS):
        q = b * gram + c * (gram @ gram)
        q.diagonal(dim1=-2, dim2=-1).add_(a)
        product = q @ product
        gram = q @ gram @ q  # all of these are polynomials of one matrix, and commute
    x = product @ x
    return x.mT if tall else x


class Muon(torch.optim.AdamW):
    """Steps of convolutions' weights are their momentum, orthogonalised as a matrix of (channels out, channels in x kernel).

    The other parameters, linear layers' among them, take AdamW's. Weight decay is AdamW's for both, for weights alone.
    """

    def __init__(self, network: nn.Module, lr: float, weight_decay: float):
        super().__init__(parameter_groups(network.parameters(), weight_decay), lr=lr, betas=ADAMW_BETAS)

    @torch.no_grad()
    def step(self, closure=None):
        """One step of all parameters that have a gradient."""
        loss = None
        if closure is not None:
            with torch.enable_grad():
                loss = closure()
        for group in self.param_groups:
            if group["convolutions"]:
                alike: dict[tuple[int, ...], list[Tensor]] = {}
                for weights in group["params"]:
                    if weights.grad is not None:
                        alike.setdefault(weights.flatten(1).shape, []).append(weights)
                for several in alike.values():
                    self._step_convolutions(several, group["lr"], group["weight_decay"])
        super().step()
        return loss

    def _step_convolutions(self, several: list[Tensor], rate: float, decay: float) -> None:
        """Of those whose matrices have one shape, all at once: a GPU would wait for the launch of each of their many small products."""
        directions = []
        for weights in several:
            state, gradient = self.state[weights], weights.grad
            if not state:  # under AdamW's names, which knows how to save and load them
                state["step"], state["exp_avg"] = torch.zeros(()), torch.zeros_like(weights)
            state["step"] += 1
            mean = state["exp_avg"].lerp_(gradient, 1 - MOMENTUM)
            directions.append(gradient.lerp(mean, MOMENTUM).flatten(1))
        steps = orthogonalised(torch.stack(directions))
        for weights, step in zip(several, steps, strict=True):
            weights.mul_(1 - rate * decay)
            weights.add_(step.reshape(weights.shape), alpha=-rate * MATCH * math.sqrt(max(step.shape)))
            weights.grad = None  # AdamW leaves those without one alone


def parameter_groups(parameters: Iterable[nn.Parameter], weight_decay: float) -> list[dict]:
    """Convolutions' weights, other weights, and what is no weight (biases, norms), which does not decay; empty groups are left out."""
    kinds: dict[tuple[bool, float], list[nn.Parameter]] = {}
    for found in parameters:
        kinds.setdefault((found.ndim > 2, weight_decay if found.ndim > 1 else 0.0), []).append(found)
    return [{"params": found, "convolutions": kind, "weight_decay": decay} for (kind, decay), found in kinds.items()]


def adamw(network: nn.Module, lr: float, weight_decay: float) -> torch.optim.AdamW:
    """AdamW for all parameters."""
    return torch.optim.AdamW(parameter_groups(network.parameters(), weight_decay), lr=lr, betas=ADAMW_BETAS)


OPTIMIZERS = {"muon": Muon, "adamw": adamw}
