"""`train(settings) -> checkpoint`: one function that sweeps, commands and tests all call."""

from __future__ import annotations

import logging
import os
import re
import sys
import warnings
from pathlib import Path

import lightning as L
import torch
from lightning.pytorch.callbacks import LearningRateMonitor, TQDMProgressBar
from lightning.pytorch.loggers import TensorBoardLogger
from lightning.pytorch.plugins.environments import LightningEnvironment
from lightning.pytorch.strategies import StrategyRegistry

from hilbertvae.checks import InputError, named
from hilbertvae.mappers.mapper import Mapper
from hilbertvae.reconstruction.blocks import convolutions
from hilbertvae.reconstruction.precision import training_type
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.reports.run_folder import CHECKPOINTS, NETWORK
from hilbertvae.reports.tensorboard import FLUSH_S
from hilbertvae.scans.formats import is_scan_path
from hilbertvae.scoring.calibration import check_learnable
from hilbertvae.signals import comes_of_a_stop
from hilbertvae.training.checkpoints import AtomicCheckpoints, MovableCheckpoint, PatienceOnce, read_checkpoint
from hilbertvae.training.devices import check_accelerator, training_device
from hilbertvae.training.grids_datamodule import GridsDataModule
from hilbertvae.training.hilbert_map_callback import HilbertMapCallback
from hilbertvae.training.initial_gap import MONITORED, InitialGap
from hilbertvae.training.kept_network import KeptNetwork, kept_name
from hilbertvae.training.opened_sites import opened_site
from hilbertvae.training.plain_settings import plain_settings
from hilbertvae.training.reconstruction_module import ReconstructionModule
from hilbertvae.training.scoring import Writer, score, use_threads
from hilbertvae.training.settings import Settings
from hilbertvae.training.site_roles import check_unseen
from hilbertvae.training.training_folder import begin_anew, check_folder, finished_network, is_of, last_epoch

BEST = {"monitor": MONITORED, "mode": "min"}
DISTRIBUTED = ("LOCAL_RANK", "NODE_RANK", "WORLD_SIZE", "MASTER_ADDR", "MASTER_PORT")
"""What Lightning leaves in the environment after a distributed training. The next one in this process, a job of the same multirun, would
take it for the word of a cluster that has started its processes already, and wait for them for ever."""


def train(settings: Settings, mappers: dict[str, Mapper] | None = None, write: Writer | None = None) -> Path:
    """Train a network, learn its Hilbert Map's weights on sites it has not seen, and return the path of `model.safetensors`.

    mappers: by name, what is scored on the test sites afterwards; `write(result, site, fitted)` is handed each `Result`. A run that
    was interrupted goes on from its last epoch, if its settings are the same; one whose network is kept in `settings.trained` takes
    that, and one that had ended before its checkpoints were removed its own. Raises `InputError` for bad settings, and
    `FloatingPointError` for a loss that is not finite.
    """
    settings = plain_settings(settings)
    settings.check()
    if settings.checkpoint:
        raise InputError(
            "checkpoint: expected none in a training; `evaluate` scores a network that is there, `trainer.initial` goes on from it"
        )
    check_accelerator(settings)
    # Others would send a run's open files to their processes, or cut a network, which is none too large, into parts.
    started_anew = [name for name in StrategyRegistry.available_strategies() if re.match("ddp(?!.*(spawn|fork|notebook))", name)]
    if settings.trainer.strategy not in (known := ["auto", *started_anew]):
        raise InputError(f"trainer.strategy: expected one of {', '.join(known)}, got {settings.trainer.strategy!r}")
    output = Path(settings.output)
    use_threads(settings)
    if settings.trainer.initial:
        card, data = Reconstructor.load(settings.trainer.initial).card, settings.data
        for key, sites in (("data.validate", [data.validate]), ("data.calibrate", data.calibrate), ("data.test", data.test)):
            check_unseen(sites, card, key, "trainer.initial")
    check_folder(settings)
    kept = KeptNetwork(settings.trained, kept_name(settings)) if settings.trained and first_rank() else None
    checkpoint = output / NETWORK
    reconstructor = kept.take(checkpoint) if kept else None
    if reconstructor:
        curves = f"; the curves of its training are in {kept.trained_in}" if kept.trained_in not in ("", str(output)) else ""
        print(f"{output}: its network was trained before and is kept as {kept.path}{curves}")
        if not is_of(output, settings):
            begin_anew(output, settings)
    elif not settings.trained and (reconstructor := finished_network(output, settings)):
        print(f"{output}: its network was trained before, and its checkpoints are gone")
    if reconstructor:
        score(settings, mappers or {}, reconstructor, write)
        return checkpoint
    try:
        return _fit(settings, HilbertMapCallback(settings, mappers or {}, write, kept))
    finally:
        if kept:
            kept.release()


def first_rank() -> bool:
    """Whether this process is the one that writes; the others of a distributed training only compute."""
    return int(os.environ.get("LOCAL_RANK", 0)) == 0


def _fit(settings: Settings, after_fit: HilbertMapCallback) -> Path:
    output = Path(settings.output)
    L.seed_everything(settings.seed, verbose=False)
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)  # its tips and device lists, twice under Hydra
    if not (output / CHECKPOINTS / "last.ckpt").exists():
        _check_calibration_sites(settings)
    resume = last_epoch(output, settings)
    if (_steps_done(resume) or 0) >= settings.trainer.epochs * settings.trainer.steps_per_epoch and first_rank():
        print(f"{output}: its network was trained before")
    best = MovableCheckpoint(output / CHECKPOINTS, "best", enable_version_counter=False, **BEST)
    # One of its own: `save_last` writes only where an epoch was the best so far, and a resumed run would go back to that.
    last = MovableCheckpoint(output / CHECKPOINTS, "last", enable_version_counter=False)
    callbacks = [best, last, after_fit, LearningRateMonitor("step"), TQDMProgressBar(refresh_rate=10)]
    if settings.trainer.initial:
        callbacks.insert(0, InitialGap())  # before the scoring, which may take longer than the training
    if settings.trainer.patience_epochs:
        callbacks.append(PatienceOnce(patience=settings.trainer.patience_epochs, check_finite=True, **BEST))
    module = ReconstructionModule(settings)  # names the key that makes no network, before anything is asked of it
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*does not have many workers.*")
        warnings.filterwarnings("ignore", message=".*`isinstance.treespec, LeafSpec.`.*")
        warnings.filterwarnings("ignore", message=".*exists and is not empty.*")
        trainer = L.Trainer(
            accelerator=settings.trainer.accelerator,
            devices=settings.trainer.devices,
            strategy=settings.trainer.strategy,
            precision=_precision(settings),
            max_epochs=settings.trainer.epochs,
            gradient_clip_val=settings.trainer.gradient_clip,
            plugins=[AtomicCheckpoints(), LightningEnvironment()],  # a SLURM job is one task, which starts its other processes itself
            logger=TensorBoardLogger(
                output, name="", version="tensorboard", default_hp_metric=False, purge_step=_steps_done(resume), flush_secs=FLUSH_S
            ),
            callbacks=callbacks,
            benchmark=training_device(settings) == "cuda",  # all batches have one shape, for which cuDNN looks for its fastest kernels
            log_every_n_steps=min(10, settings.trainer.steps_per_epoch),
            num_sanity_val_steps=-1 if settings.trainer.initial and not resume else 0,
            use_distributed_sampler=False,
            enable_model_summary=False,
        )
        if settings.trainer.initial and not resume:
            module.start_from(settings.trainer.initial)
        before, handled = {name: os.environ.get(name) for name in DISTRIBUTED}, sys.exception()
        try:
            trainer.fit(module, GridsDataModule(settings), ckpt_path=resume, weights_only=True)
        except BaseException as error:
            if not isinstance(error, SystemExit) and not comes_of_a_stop(error, handled):  # the first is Lightning's answer to Ctrl-C
                raise
            on = "after the last mapper and gap seed that were done" if after_fit.scoring else "from the last epoch"
            what = "scoring" if after_fit.scoring else "training"
            raise KeyboardInterrupt(f"{what} was interrupted; the same command goes on {on} in {output}") from None
        finally:
            for name, value in before.items():
                os.environ.pop(name, None)
                os.environ.update({name: value} if value is not None else {})
    return after_fit.checkpoint


def _check_calibration_sites(settings: Settings) -> None:
    """An `InputError` for a site of somebody's own from which no map's weights can be learned; those of the catalogue are large enough, as
    are simulated ones, and the one to validate on is asked by its grids."""
    for reference in filter(is_scan_path, settings.data.calibrate):
        with named(f"data.calibrate: {reference}"):
            check_learnable(opened_site(reference, settings), settings.grid, settings.validation_gap_m, settings.calibration_seeds)


def _precision(settings: Settings) -> str:
    """Lightning's word for `trainer.precision`."""
    if settings.trainer.precision != "auto":
        return settings.trainer.precision
    convolved = convolutions(settings.network, settings.grid.cells)
    numbers = training_type(training_device(settings), settings.dimension, convolved)
    return "bf16-mixed" if numbers is torch.bfloat16 else "32-true"


def _steps_done(resume: Path | None) -> int | None:
    """How many steps a checkpoint has behind it. What was logged after it is taken again, and its curves would double back."""
    return read_checkpoint(resume)["global_step"] if resume else None
