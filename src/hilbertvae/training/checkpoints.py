"""Checkpoints that survive what happens to runs: killed while one is written, moved to another folder, asked again after they stopped."""

from __future__ import annotations

import os
from pathlib import Path
from pickle import UnpicklingError

import torch
from lightning.pytorch.callbacks import EarlyStopping, ModelCheckpoint
from lightning.pytorch.callbacks.early_stopping import EarlyStoppingReason
from lightning.pytorch.plugins.io import TorchCheckpointIO

from hilbertvae.checks import InputError
from hilbertvae.files import atomic
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.reconstruction.training_card import many_simulated
from hilbertvae.simulate.street_variety import VARIETIES
from hilbertvae.training.learned_as import KEY, learned_as
from hilbertvae.training.settings import Settings
from hilbertvae.training.site_roles import own_sites
from hilbertvae.training.training_hash import recipe_hash, training_hash


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


def read_checkpoint(path: str | os.PathLike) -> dict:
    """What a checkpoint of a training holds; an `InputError` for one that is missing or damaged, without which a run can't go on."""
    try:
        saved = torch.load(path, map_location="cpu", weights_only=True)
        if not (isinstance(saved, dict) and isinstance(saved.get("state_dict"), dict) and {"epoch", "global_step"} <= saved.keys()):
            raise EOFError  # of another program's
        return saved
    except (OSError, EOFError, RuntimeError, UnpicklingError) as error:
        # Not in torch's words, which advise to trust the file, or are of a seek before its start.
        why = error.strerror if getattr(error, "filename", None) else "cut off, or of something else"
        ways = f"remove {Path(path).parent} to train anew, or, where its network is finished, to score that"
        raise InputError(f"{path}: expected a whole checkpoint for the run to go on from, got none ({why}); {ways}") from error


def best_reconstructor(settings: Settings, network: torch.nn.Module, path: str) -> Reconstructor:
    """The network of a run with the weights of the checkpoint at `path`, and a card that says what it was trained on."""
    saved = read_checkpoint(path)
    weights = {key.removeprefix("network."): value for key, value in saved["state_dict"].items() if key.startswith("network.")}
    network = network.to("cpu")
    network.load_state_dict(weights)
    before = Reconstructor.load(settings.trainer.initial).card if settings.trainer.initial else None
    kind = VARIETIES[settings.data.street.variety].kind if settings.dimension == 3 else "buildings"
    card = {
        "trained_on": [*settings.data.train, many_simulated(kind, settings.data.simulated, settings.data.simulated_first)],
        "validated_on": settings.data.validate,
        "calibrated_on": settings.calibration_sites(),
        KEY: learned_as(settings),
        "epoch": saved["epoch"],
        "steps": saved["global_step"],
        "seed": settings.seed,
        "training_hash": training_hash(settings),
        "recipe_hash": recipe_hash(settings, before),
        **({"trained_on_sha256": contents} if (contents := own_sites(settings.data.train)) else {}),
        **({"started_from": before} if before else {}),
    }
    return Reconstructor(
        network, settings.network, settings.likelihood, settings.grid, settings.dimension, settings.resolution_m, card=card
    )
