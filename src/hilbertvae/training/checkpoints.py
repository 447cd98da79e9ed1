"""Checkpoints that survive what happens to runs: killed while one is written, moved to another folder, asked again after they stopped."""

from __future__ import annotations

import os

from lightning.pytorch.callbacks import EarlyStopping, ModelCheckpoint
from lightning.pytorch.callbacks.early_stopping import EarlyStoppingReason
from lightning.pytorch.plugins.io import TorchCheckpointIO

from hilbertvae.files import atomic


class AtomicCheckpoints(TorchCheckpointIO):
    """A run that is killed while it saves still has the epoch before."""

    def save_checkpoint(self, checkpoint, path, storage_options=None) -> None:
        with atomic(path) as temporary:
            super().save_checkpoint(checkpoint, temporary, storage_options)


class MovableCheckpoint(ModelCheckpoint):
    """A run whose folder was moved or copied goes on with the files that lie in it. Lightning keeps the whole paths, and would forget which
    epoch was the best so far, or read it from the old place."""

    def load_state_dict(self, state_dict) -> None:
        def here(path: str) -> str:
            return os.path.join(self.dirpath, os.path.basename(path)) if path else path

        moved = {key: here(path) for key, path in state_dict.items() if key.endswith("_model_path")}
        best = {here(path): score for path, score in state_dict["best_k_models"].items()}
        super().load_state_dict({**state_dict, **moved, "best_k_models": best, "dirpath": self.dirpath})


class PatienceOnce(EarlyStopping):
    """A run whose patience ended is over, also when it is asked again: Lightning would train on from its last epoch."""

    def on_train_start(self, trainer, pl_module) -> None:
        if self.stopping_reason != EarlyStoppingReason.NOT_STOPPED:
            trainer.should_stop = True
