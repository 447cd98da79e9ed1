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


def orthogonalised(matrix: Tensor) -> Tensor:
    """(A, B): U V^T, roughly, of U S V^T = `matrix (A, B)`, so that no direction drowns another.

    Each round takes X to q(X X^T) X. All that it needs of X is its Gram matrix, which is small, so the rounds are worked out on that one
    and the product of all q is applied to `matrix` once: half the time for one nine times as wide as tall.
    """
    a, b, c = NEWTON_SCHULZ
    x = matrix.T if matrix.shape[0] > matrix.shape[1] else matrix
    x = x / x.norm().clamp_min(1e-7)
    gram, product = x @ x.T, torch.eye(len(x), dtype=x.dtype, device=x.device)
    for _ in range(ROUNDS):
        q = torch.addmm(gram, gram, gram, beta=b, alpha=c)
        q.diagonal().add_(a)
        product = q @ product
        gram = q @ gram @ q  # all of these are polynomials of one matrix, and commute
    x = product @ x
    return x.T if matrix.shape[0] > matrix.shape[1] else x


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
                for weights in group["params"]:
                    if weights.grad is not None:
                        self._step_convolution(weights, group["lr"], group["weight_decay"])
        super().step()
        return loss

    def _step_convolution(self, weights: Tensor, rate: float, decay: float) -> None:
        state, gradient = self.state[weights], weights.grad
        if not state:  # under AdamW's names, which knows how to save and load them
            state["step"], state["exp_avg"] = torch.zeros(()), torch.zeros_like(weights)
        state["step"] += 1
        mean = state["exp_avg"].lerp_(gradient, 1 - MOMENTUM)
        step = orthogonalised(gradient.lerp(mean, MOMENTUM).flatten(1))
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
