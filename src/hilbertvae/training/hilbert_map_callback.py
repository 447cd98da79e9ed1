"""After the last epoch: the best weights, the Hilbert Map's weights, the checkpoint, and the scores of every chosen mapper."""

from __future__ import annotations

import time
from dataclasses import asdict
from pathlib import Path

import lightning as L
import torch

from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.mapper import Mapper
from hilbertvae.reports.hparams import write_hparams
from hilbertvae.reports.provenance import made_by
from hilbertvae.reports.run_folder import NETWORK
from hilbertvae.scoring.calibration import learn_rank_weights
from hilbertvae.training.checkpoints import best_reconstructor
from hilbertvae.training.devices import filling_device, training_gpu
from hilbertvae.training.initial_gap import gaps
from hilbertvae.training.kept_network import KeptNetwork
from hilbertvae.training.kept_weights import KeptWeights
from hilbertvae.training.opened_sites import opened_site
from hilbertvae.training.scoring import Writer, score
from hilbertvae.training.settings import Settings


class HilbertMapCallback(L.Callback):
    """Lightning allows no `self.log` here, and the weights in memory are the last: so the best are loaded, and writers get a `Result`."""

    def __init__(self, settings: Settings, mappers: dict[str, Mapper], write: Writer | None, kept: KeptNetwork | None = None):
        self.settings, self.mappers, self.write, self.kept = settings, mappers, write, kept
        self.checkpoint = Path(settings.output) / NETWORK
        self.seconds, self.before = {}, {}
        self.began = made_by() | training_gpu(settings)  # now: the tree may change while the network trains
        self.scoring = False
        self.since = time.perf_counter()

    def on_fit_start(self, trainer: L.Trainer, module: L.LightningModule) -> None:
        self._lap("grids")
        if trainer.is_global_zero and trainer.logger:
            write_hparams(trainer.logger.experiment, asdict(self.settings))

    def on_fit_end(self, trainer: L.Trainer, module: L.LightningModule) -> None:
        if trainer.interrupted:
            return
        self._lap("train")
        if torch.distributed.is_initialized():  # the others would wait for what follows, and time out
            torch.distributed.destroy_process_group()
        if not trainer.is_global_zero:
            return
        settings = self.settings
        reconstructor = best_reconstructor(settings, module.network, trainer.checkpoint_callback.best_model_path)
        reconstructor.card.update(self.began | gaps(trainer))
        if torch.cuda.is_available():
            torch.cuda.empty_cache()  # else what the training held is kept from the processes that fill maps
            torch.backends.cudnn.benchmark = False  # maps come in batches of many sizes, and each would be searched for anew
        mapper = HilbertMap(reconstructor, flips=settings.flips, device=filling_device(settings))
        kept = None if self.kept else KeptWeights(settings, mapper)  # a kept network has its weights with it
        learned, self.before["weights"] = (kept and kept.take()) or (None, 0.0)
        if not learned:
            sites = [opened_site(reference, settings) for reference in settings.calibration_sites()]
            learned = learn_rank_weights(mapper, sites, **settings.calibration())
            if kept:
                kept.keep(learned, self._until_now("weights"))
        self._lap("weights")
        reconstructor.map_weights, reconstructor.seconds = learned, self.seconds
        reconstructor.save(self.checkpoint)
        if self.kept:
            self.kept.keep(self.checkpoint, self.seconds)
        self.scoring = True
        score(settings, self.mappers, reconstructor, self.write)

    def state_dict(self) -> dict:
        """Of a checkpoint: the seconds of what it holds, so that a run which goes on from it, or is repeated, has all of them; and what its
        training began with: a run that only scores anew, by other code or on another machine, has trained nothing."""
        return {**self.seconds, "train": self._until_now("train"), "began": self.began}

    def load_state_dict(self, state_dict: dict) -> None:
        self.before = dict(state_dict)
        self.began = self.before.pop("began", self.began)  # older checkpoints have none

    def _lap(self, stage: str) -> None:
        self.seconds[stage], self.since = self._until_now(stage), time.perf_counter()

    def _until_now(self, stage: str) -> float:
        """Wall time of a stage, of which earlier starts of a run had done a part."""
        return round(self.before.get(stage, 0.0) + time.perf_counter() - self.since, 1)
