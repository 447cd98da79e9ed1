"""A network that goes on learning from the site it maps: gaps are cut from what was seen there, and it is asked to fill them.

Where nobody saw anything it is held to what it said before (learning without forgetting; Li & Hoiem 2016): gaps teach nothing of what lies
behind things, and would undo what it knows of that.
"""

from __future__ import annotations

import copy
import math
from dataclasses import replace
from threading import Lock

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F

from hilbertvae.checks import InputError
from hilbertvae.grids.cluster_grids import GridSettings, labels_of
from hilbertvae.progress import track
from hilbertvae.reconstruction.augmentation import augment
from hilbertvae.reconstruction.blocks import Reconstruction, convolutions
from hilbertvae.reconstruction.likelihood import LIKELIHOODS
from hilbertvae.reconstruction.precision import fast_autocast, training_type
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.reconstruction.settings import AugmentationSettings, LikelihoodSettings

GAP_DIAMETER_M = (1.0, 3.5)
"""Of the balls that are cut from each batch."""
BALLS_AREA_M2 = 20.0
"""One ball for so much of a box, as in training."""
BATCH_CELLS = 2**16
"""A quarter of training's: what one site teaches is soon learned (docs/decisions.md)."""
LEARNING_RATE = 5e-4
WARMUP_STEPS = 10
MOST_GRADIENT = 1000.0


def batch_size(grid: GridSettings, dimension: int) -> int:
    """Grids that a step sees: 16 of 64 x 64 cells, 4 of 128 x 128, 2 of 192 x 192 or 32 x 32 x 32."""
    return max(1, round(BATCH_CELLS / grid.cells**dimension))


def check_adaptable(likelihood: LikelihoodSettings, network: object) -> None:
    """An `InputError` for a network that does not say how likely a cell is to be occupied or known (the paper's)."""
    if likelihood.kind != "bernoulli" or not getattr(network, "known", False):
        raise InputError("adapt_steps: expected a network that answers with logits and says which cells would be known, got another kind")


_ONE_AT_A_TIME = Lock()


@torch.inference_mode(False)  # whoever maps may have said that nothing is to be learned
@torch.enable_grad()
def adapted(
    reconstructor: Reconstructor,
    shown: np.ndarray,
    target: np.ndarray,
    grid: GridSettings,
    steps: int,
    seed: int,
    device: str = "cpu",
) -> Reconstructor:
    """`reconstructor`, trained for `steps` more on pairs of grids of one site (`gapped_grids`); the one given is left as it is. `grid`:
    what those pairs are of, which a map may have otherwise than its network. Raises as `check_adaptable`."""
    check_adaptable(reconstructor.likelihood, reconstructor.network_settings)
    before, network = reconstructor.network.eval().to(device), copy.deepcopy(reconstructor.network).to(device)
    likelihood = LIKELIHOODS["bernoulli"](reconstructor.likelihood)
    optimizer = torch.optim.AdamW(network.parameters(), lr=LEARNING_RATE, betas=(0.9, 0.95), weight_decay=0.0)
    schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, lambda step: _rate(step, steps))
    augmentation, dimension = _augmentation(grid), reconstructor.dimension
    numbers = training_type(device, dimension, convolutions(reconstructor.network_settings, grid.cells))
    at_once = min(batch_size(grid, dimension), len(shown))
    rng, grids = np.random.default_rng(seed), [torch.from_numpy(part) for part in (shown, target)]
    used = [torch.device(device)] if torch.device(device).type == "cuda" else []
    # One at a time: what is drawn comes from the generator of the whole process, which is as it was afterwards.
    with _ONE_AT_A_TIME, torch.random.fork_rng(used):
        torch.manual_seed(seed % (2**63 - 1))
        network.train()
        for _ in track(range(steps), "Learning from the site", transient=True):
            drawn = np.sort(rng.choice(len(shown), at_once, replace=False))
            batch = augment(*(part[drawn].to(device) for part in grids), augmentation, dimension)
            with fast_autocast(device, numbers):
                with torch.no_grad():
                    said = before(batch[0])
                found = network(batch[0])
            hidden, told = (labels_of(part, dimension) for part in batch)
            fit = likelihood(found.output, told, hidden) + _kept(found, said, told == 0, reconstructor.likelihood.known_weight)
            fit.mean().backward()
            norm = torch.nn.utils.clip_grad_norm_(network.parameters(), MOST_GRADIENT)
            if torch.isfinite(norm):
                optimizer.step()
            optimizer.zero_grad(set_to_none=True)
            schedule.step()
    return replace(reconstructor, network=network.eval())


def _kept(found: Reconstruction, said: Reconstruction, unknown: Tensor, known_weight: float) -> Tensor:
    """(B,) how far the network has come from what it `said` of cells that nobody saw, by how likely they are to be seen; and of which
    cells would be."""
    likely = torch.sigmoid(said.known.float())
    apart = _divergence(found.output, said.output) * likely * unknown + known_weight * _divergence(found.known, said.known)
    return apart.flatten(1).sum(dim=1)


def _divergence(logit: Tensor, before: Tensor) -> Tensor:
    """The KL divergence of coins with these logits from those `before`, cell by cell."""
    share = torch.sigmoid(before.float())
    entropy = F.binary_cross_entropy_with_logits(before.float(), share, reduction="none")
    return F.binary_cross_entropy_with_logits(logit.float(), share, reduction="none") - entropy


def _augmentation(grid: GridSettings) -> AugmentationSettings:
    balls = max(1, round(grid.cluster_diameter_m**2 / BALLS_AREA_M2))
    return AugmentationSettings(balls=balls, ball_diameter_cells=[length / grid.cell_m for length in GAP_DIAMETER_M])


def _rate(step: int, steps: int) -> float:
    return min(1.0, (step + 1) / WARMUP_STEPS) * 0.5 * (1 + math.cos(math.pi * step / steps))
