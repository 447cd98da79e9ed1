"""The reconstructive model as a LightningModule: the loss of Eq. 6 on augmented batches, and its optimiser."""

from __future__ import annotations

import math
from dataclasses import asdict

import lightning as L
import torch
from torch import Tensor

from hilbertvae.checks import InputError
from hilbertvae.grids.cluster_grids import labels_of
from hilbertvae.reconstruction.augmentation import augment
from hilbertvae.reconstruction.blocks import Reconstruction
from hilbertvae.reconstruction.conditional_network import ConditionalNetwork
from hilbertvae.reconstruction.likelihood import LIKELIHOODS, active_dimensions, free_bits, kl_divergence, kl_weight, known_nll
from hilbertvae.reconstruction.networks import build_network
from hilbertvae.training.initial_network import initial_weights
from hilbertvae.training.optimizers import OPTIMIZERS
from hilbertvae.training.settings import Settings


class ReconstructionModule(L.LightningModule):
    """Trains a network on pairs of grids. All randomness of a step comes from (seed, step), so that a resumed run draws the same."""

    def __init__(self, settings: Settings):
        super().__init__()
        self.settings = settings
        self.save_hyperparameters({"settings": asdict(settings)})  # plain containers: anything else would not load again
        self.network = build_network(settings.network, settings.dimension, settings.grid.cells)
        self.likelihood = LIKELIHOODS[settings.likelihood.kind](settings.likelihood)
        self.total_steps = settings.trainer.epochs * settings.trainer.steps_per_epoch
        self._taken = 0

    def start_from(self, checkpoint: str) -> None:
        """Take the weights of a trained network. An `InputError` names the file if its network is another (`initial_network.py`)."""
        self.network.load_state_dict(initial_weights(checkpoint, self.settings, self.network))

    def training_step(self, batch: tuple[Tensor, Tensor], number: int) -> Tensor:
        trainer = self.settings.trainer
        torch.manual_seed(hash((self.settings.seed, self.global_step, self.global_rank)) % 2**63)
        dimension = self.settings.dimension
        shown, target = augment(*batch, self.settings.augmentation, dimension)
        votes = target[:, 1] if self.settings.likelihood.vote_power > 0 else None
        target = labels_of(target, dimension)
        found = self.network(shown, target) if isinstance(self.network, ConditionalNetwork) else self.network(shown)
        self._check_output(found, target)
        shown = labels_of(shown, dimension)
        fit = self.likelihood(found.output, target, shown, votes).mean()
        loss = fit
        if found.known is not None:
            known = known_nll(found.known, target, shown).mean()
            loss = loss + self.settings.likelihood.known_weight * known
            self.log("train/known_nll_per_grid", known)
        if found.std is not None:
            prior = found.prior and tuple(part.float() for part in found.prior)
            kl = kl_divergence(found.mean.float(), found.std.float(), prior)
            weight = trainer.kl_weight * kl_weight(self.global_step, int(trainer.kl_warmup_share * self.total_steps))
            loss = loss + weight * free_bits(kl, trainer.free_nats)
            self.log("train/kl_nats", kl.sum(dim=1).mean())
            self.log("train/active_latents", active_dimensions(kl).float())
        if not torch.isfinite(loss):
            raise FloatingPointError(
                f"training loss is {loss.item()} at step {self.global_step}: lower trainer.learning_rate, or use precision 32-true"
            )
        self.log("train/nll_per_grid", fit, prog_bar=True)
        self.log("train/loss", loss)
        return loss

    def _check_output(self, found: Reconstruction, target: Tensor) -> None:
        """An `InputError` for a network of somebody's own that gives no `Reconstruction`, or an output of another shape than the target's,
        which a likelihood may take for one by repeating it; and for one that gives a `known` of which its settings say nothing, and which
        maps would not ask for, or none where they do."""
        forward = f"{type(self.network).__name__}.forward"
        if not isinstance(found, Reconstruction):
            raise InputError(f"network: expected {forward} to give a Reconstruction, got {type(found).__name__}")
        for name in ("output", "known"):
            given = getattr(found, name)
            if (given is not None or name == "output") and (shape := getattr(given, "shape", None)) != target.shape:
                got = type(given).__name__ if shape is None else tuple(shape)
                raise InputError(f"network: expected {forward} to give `{name}` of shape {tuple(target.shape)}, as the grids', got {got}")
        asked, given = bool(getattr(self.settings.network, "known", False)), found.known is not None
        if asked != given:
            raise InputError(f"network.known: expected {str(given).lower()}, since {forward} gives {'' if given else 'no '}`known`")

    def validation_step(self, batch: tuple[Tensor, Tensor], number: int) -> None:
        shown, target = batch
        found = self.network(shown)
        shown, target = (labels_of(grids, self.settings.dimension) for grids in (shown, target))
        self._check_output(found, target)
        removed = (shown == 0) & (target != 0)
        fit = self.likelihood(found.output, target, shown).mean()
        self.log("val/nll_per_grid", fit, batch_size=len(shown))
        if found.known is not None:
            self.log("val/known_nll_per_grid", known_nll(found.known, target, shown).mean(), batch_size=len(shown))
        # Early stop and best weights go by this: gaps are what the network is for, and what it overfits on.
        probability = self.likelihood.probability(self.likelihood.kernel_value(found.output))
        if not removed.any():
            return
        # By hand, since torch refuses its own cross-entropy of probabilities on a GPU in bfloat16.
        probability = probability[removed].float().clamp(1e-4, 1 - 1e-4)
        gap = -torch.where(target[removed] > 0, probability, 1 - probability).log().mean()
        self.log("val/gap_nll", gap, prog_bar=True, batch_size=int(removed.sum()))

    def on_before_optimizer_step(self, optimizer: torch.optim.Optimizer) -> None:
        """A step whose gradient is not finite is skipped and counted, not taken."""
        norm = torch.nn.utils.get_total_norm([p.grad for p in self.parameters() if p.grad is not None])
        finite = bool(torch.isfinite(norm))
        self.log("train/skipped_steps", float(not finite), on_step=False, on_epoch=True, reduce_fx="sum")
        self._taken += finite
        if not finite:
            optimizer.zero_grad(set_to_none=True)
            return
        self.log("train/gradient_norm", norm)

    def on_train_epoch_start(self) -> None:
        self._taken = 0

    def on_train_epoch_end(self) -> None:
        """An epoch that learned nothing is an error: its weights would pass for trained ones. In 16 bits a run first finds its scale."""
        if not self._taken and self.trainer.precision != "16-mixed":
            raise FloatingPointError(
                f"no gradient of the epoch that ended at step {self.global_step} is finite: lower trainer.learning_rate, or use "
                "precision 32-true"
            )

    def configure_optimizers(self):
        trainer = self.settings.trainer
        optimizer = OPTIMIZERS[trainer.optimizer](self.network, trainer.learning_rate, trainer.weight_decay)
        warmup = max(1, int(trainer.warmup_share * self.total_steps))

        def rate(step: int) -> float:
            along = min(1.0, step / self.total_steps)
            return min(1.0, (step + 1) / warmup) * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * along)))

        schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, rate)
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": schedule, "interval": "step"}}
