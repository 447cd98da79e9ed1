"""What a reconstruction is trained on: -log P(H | z) of Eq. 6, and the KL divergence that joins it.

Both are sums, over cells and over latent dimensions: averaging one and summing the other collapses the posterior.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from hilbertvae.grids.aligned_grid import COUNT_STEPS
from hilbertvae.reconstruction.settings import LikelihoodSettings


class Bernoulli:
    """Cells known in the target, as coin flips with the output as logit; unknown cells say nothing, if they are masked."""

    def __init__(self, settings: LikelihoodSettings):
        self.observed_weight, self.masked, self.vote_power = settings.observed_weight, settings.masked, settings.vote_power

    def __call__(self, output: Tensor, target: Tensor, shown: Tensor, votes: Tensor | None = None) -> Tensor:
        """(B,) negative log-likelihood: output (B, n, ..., n); target, shown int8 codes of the same shape.

        votes: codes of counts (`count_code`) by which known cells are weighed, 1 on average over the batch."""
        loss = F.binary_cross_entropy_with_logits(output.float(), (target.float() + 1) / 2, reduction="none")
        weight = torch.where(shown != 0, self.observed_weight, 1.0)
        if self.masked:
            weight = weight * (target != 0)
        if votes is not None:
            heard = torch.expm1(votes.float() / COUNT_STEPS).pow(self.vote_power)
            known = target != 0
            weight = weight * torch.where(known, heard / heard[known].mean().clamp_min(1e-6), 1.0)
        return (loss * weight).flatten(1).sum(dim=1)

    @staticmethod
    def kernel_value(output: Tensor) -> Tensor:
        """The output as a kernel value of Eq. 7: the logit, clipped where a sigmoid has no more to say."""
        return output.float().clamp(-8.0, 8.0)

    @staticmethod
    def probability(value: Tensor) -> Tensor:
        """p(occupied) of a kernel value: a logit's sigmoid."""
        return torch.sigmoid(value)


class Gaussian:
    """The paper's: tanh and unit variance over all cells of {-1, 0, 1}, unknown ones included."""

    def __init__(self, settings: LikelihoodSettings):
        pass

    def __call__(self, output: Tensor, target: Tensor, shown: Tensor, votes: Tensor | None = None) -> Tensor:
        """(B,) negative log-likelihood without its constant: half the squared error."""
        return 0.5 * (torch.tanh(output.float()) - target.float()).square().flatten(1).sum(dim=1)

    @staticmethod
    def kernel_value(output: Tensor) -> Tensor:
        """The tanh output itself, in (-1, 1)."""
        return torch.tanh(output.float())

    @staticmethod
    def probability(value: Tensor) -> Tensor:
        """p(occupied) of a kernel value in (-1, 1): (k + 1) / 2."""
        return (value + 1) / 2


LIKELIHOODS = {"bernoulli": Bernoulli, "gaussian": Gaussian}


def known_nll(known: Tensor, target: Tensor, shown: Tensor) -> Tensor:
    """(B,) negative log-likelihood of which cells the target knows, summed over those that the input does not show."""
    loss = F.binary_cross_entropy_with_logits(known.float(), (target != 0).float(), reduction="none")
    return (loss * (shown == 0)).flatten(1).sum(dim=1)


def kl_divergence(mean: Tensor, std: Tensor, prior: tuple[Tensor, Tensor] | None = None) -> Tensor:
    """(B, latent) KL[N(mean, std^2) || p(z)] of each latent dimension (Eq. 6), p(z) = N(0, 1) unless `prior` has another mean and std."""
    if prior is not None:
        mean, std = (mean - prior[0]) / prior[1], std / prior[1]  # no other measure of z changes it
    return 0.5 * (mean.square() + std.square() - 1.0) - torch.log(std)


def free_bits(kl: Tensor, nats: float) -> Tensor:
    """The KL that is paid for: the batch's mean in each dimension, where it exceeds `nats` (Kingma et al. 2016). Scalar."""
    return kl.mean(dim=0).clamp_min(nats).sum()


def active_dimensions(kl: Tensor) -> Tensor:
    """How many latent dimensions carry more than 0.01 nats on average over the batch. Scalar."""
    return (kl.mean(dim=0) > 0.01).sum()


def kl_weight(step: int, warmup_steps: int) -> float:
    """A linear warm-up from 0 to 1, so that the decoder learns to use z before it is charged for."""
    return 1.0 if warmup_steps <= 0 else min(1.0, step / warmup_steps)
