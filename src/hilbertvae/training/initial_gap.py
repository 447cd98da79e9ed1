"""What a network that goes on from another one's weights had at first: a training may end with a worse one than it began with."""

from __future__ import annotations

import warnings

import lightning as L

MONITORED = "val/gap_nll"
"""The loss by which the best weights are chosen."""


class InitialGap(L.Callback):
    """Says the loss before the first step, which Lightning's check of the validation finds without a draw of the training's, beside that
    of the best epoch. A run that goes on from its last epoch has it from its checkpoint."""

    def __init__(self):
        self.before: float | None = None

    def on_sanity_check_end(self, trainer: L.Trainer, module: L.LightningModule) -> None:
        self.before = float(trainer.callback_metrics[MONITORED])
        if trainer.is_global_zero:
            print(f"{MONITORED} is {self.before:.4f} with the weights of trainer.initial, before the first step")

    def on_fit_end(self, trainer: L.Trainer, module: L.LightningModule) -> None:
        found = gaps(trainer)
        if trainer.interrupted or not trainer.is_global_zero or not found:
            return
        best, before = found["gap_nll"], found["initial_gap_nll"]
        print(f"{MONITORED} is {best:.4f} after the best epoch, and was {before:.4f} before the first step")
        if best >= before:
            worse = f"no epoch has a better {MONITORED} than the {before:.4f} of the weights that it began with; the best has {best:.4f}"
            warnings.warn(f"trainer.initial: {worse}. Keep that network, or try a lower trainer.learning_rate", stacklevel=2)

    def state_dict(self) -> dict:
        return {"before": self.before}

    def load_state_dict(self, state_dict: dict) -> None:
        self.before = state_dict["before"]


def gaps(trainer: L.Trainer) -> dict[str, float]:
    """For a network's card: the loss before the first step, and after the best epoch; nothing of a training with fresh weights."""
    before = next((callback.before for callback in trainer.callbacks if isinstance(callback, InitialGap)), None)
    if before is None:
        return {}
    return {"initial_gap_nll": round(before, 6), "gap_nll": round(float(trainer.checkpoint_callback.best_model_score), 6)}
