"""Training grids as a LightningDataModule."""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable
from pathlib import Path

import lightning as L
import numpy as np
from torch.utils.data import DataLoader, Sampler, Subset

from hilbertvae.checks import InputError
from hilbertvae.cores import cores
from hilbertvae.grids.cluster_grids import labels_of
from hilbertvae.training.devices import training_device
from hilbertvae.training.grid_pairs import GridPairs
from hilbertvae.training.kept_grids import VALIDATION_SEEDS, build_all, is_voted
from hilbertvae.training.settings import Settings

MOST_READERS = 6
"""Processes that read batches for one GPU: an H200 took nine of 57 MB a second."""
AHEAD = 2
"""How many batches each of them has ready."""
SHARED = Path("/dev/shm")
"""Where Linux keeps what processes hand to each other. A container often has 64 MB of it, and who writes more is killed."""


def _shared_bytes() -> float:
    """Room for batches on their way from those who read them."""
    return shutil.disk_usage(SHARED).free if SHARED.is_dir() else math.inf


class EpochBatches(Sampler):
    """`steps` batches, drawn from (seed, epoch): a checkpoint has no random state, and a resumed epoch must not replay another's.

    announce: is told of each batch but the first one step before it is asked for.
    """

    def __init__(self, count: int, batch_size: int, steps: int, seed: int, rank: int = 0, announce: Callable | None = None):
        self.count, self.batch_size, self.steps, self.seed, self.rank = count, batch_size, steps, seed, rank
        self.announce, self.epoch = announce, 0

    def set_epoch(self, epoch: int) -> None:
        """Called by Lightning's loops at the start of every epoch."""
        self.epoch = epoch

    def __len__(self) -> int:
        return self.steps

    def __iter__(self):
        rng = np.random.default_rng([self.seed, self.epoch, self.rank])
        wanted = self.steps * self.batch_size
        order = np.concatenate([rng.permutation(self.count) for _ in range(-(-wanted // self.count))])
        batches = order[:wanted].reshape(self.steps, self.batch_size).tolist()
        for batch, following in zip(batches, [*batches[1:], []], strict=True):
            if self.announce:
                self.announce(following)
            yield batch


class GridsDataModule(L.LightningDataModule):
    """Grids of all training sites, and of the validation site with fixed gaps."""

    def __init__(self, settings: Settings):
        super().__init__()
        self.settings = settings
        self.train_pairs: GridPairs | None = None
        self.validation_pairs: Subset | None = None

    def prepare_data(self) -> None:
        """On one process of each machine, while the others of a distributed training wait."""
        jobs, validation = self._jobs()
        build_all(jobs + validation, self.settings)

    def setup(self, stage: str | None = None) -> None:
        """Open the files of all grids, which are built first if they are not there."""
        if self.train_pairs is not None:
            return
        settings = self.settings
        jobs, validation = self._jobs()
        paths, voted = build_all(jobs + validation, settings), is_voted(settings)
        self.train_pairs = GridPairs(paths[: len(jobs)], voted)
        validation_pairs = GridPairs(paths[len(jobs) :], voted)
        some = np.random.default_rng(0).permutation(len(validation_pairs))[: settings.trainer.validation_grids]
        self.validation_pairs = Subset(validation_pairs, some.tolist())
        if not len(self.train_pairs) or not len(self.validation_pairs):
            raise InputError("data: expected clusters to train and to validate on, got none; is grid.minimum_points too large?")
        if not any(self._hides(validation_pairs, number) for number in some):  # nothing would say which weights are the best
            raise InputError("validation_gap_m: expected gaps that hide a cell of some validation grid, got none; is it too small?")

    def _hides(self, pairs: GridPairs, number: int) -> bool:
        shown, target = (labels_of(grids, self.settings.dimension) for grids in pairs[[number]])
        return bool(((shown == 0) & (target != 0)).any())

    def _jobs(self) -> tuple[list[tuple[str, int]], list[tuple[str, int]]]:
        """Which clusterings, by site and seed, are trained and which are validated on."""
        settings, data = self.settings, self.settings.data
        jobs = [(name, seed) for name in data.train for seed in range(settings.clustering.clusterings)]
        # From 1 on, since clustering 0 turns nothing: a simulated building stands square, and few real ones do.
        jobs += [(name, seed) for name in settings.simulated_sites() for seed in range(1, data.simulated_clusterings + 1)]
        return jobs, [(data.validate, seed) for seed in VALIDATION_SEEDS]

    def train_dataloader(self) -> DataLoader:
        trainer = self.settings.trainer
        rank = self.trainer.global_rank if self.trainer else 0
        pairs = self.train_pairs
        loading = self._loading()
        announce = None if loading else pairs.announce  # who reads ahead needs no word of it
        batches = EpochBatches(len(pairs), trainer.batch_size, trainer.steps_per_epoch, self.settings.seed, rank, announce)
        return DataLoader(pairs, sampler=batches, batch_size=None, **loading)

    def _loading(self) -> dict:
        """Who reads the files. A GPU would wait for that, so other processes do it ahead, of which training outlives an epoch's end; on a
        CPU they would only take its cores."""
        trainer = self.settings.trainer
        if training_device(self.settings) != "cuda":
            return {}
        held = AHEAD * trainer.batch_size * math.prod(self.train_pairs.shape)
        readers = min(MOST_READERS, (cores() - 1) // trainer.devices, int(_shared_bytes() / 2 / trainer.devices / held))
        return {"num_workers": readers, "persistent_workers": True, "pin_memory": True, "prefetch_factor": AHEAD} if readers > 0 else {}

    def val_dataloader(self) -> DataLoader:
        count = len(self.validation_pairs)
        size = min(self.settings.trainer.batch_size, count)
        batches = [list(range(start, min(start + size, count))) for start in range(0, count, size)]
        return DataLoader(self.validation_pairs, sampler=batches, batch_size=None)
