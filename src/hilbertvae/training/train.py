"""`train(settings) -> checkpoint`: one function that sweeps, commands and tests all call."""

from __future__ import annotations

import json
import logging
import os
import re
import shutil
import warnings
from pathlib import Path

import lightning as L
import torch
from lightning.pytorch.callbacks import LearningRateMonitor, TQDMProgressBar
from lightning.pytorch.loggers import TensorBoardLogger
from lightning.pytorch.plugins.environments import LightningEnvironment
from lightning.pytorch.strategies import StrategyRegistry

import hilbertvae
from hilbertvae.checks import InputError
from hilbertvae.files import hash_of, json_object, write_json
from hilbertvae.mappers.mapper import Mapper
from hilbertvae.reconstruction.blocks import convolutions
from hilbertvae.reconstruction.likelihood import LIKELIHOODS
from hilbertvae.reconstruction.networks import NETWORKS, check_kind
from hilbertvae.reconstruction.precision import training_type
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.reports.run_state import CHECKPOINTS, TRAINING, clear
from hilbertvae.reports.tensorboard import FLUSH_S
from hilbertvae.scans.formats import is_scan_path
from hilbertvae.scoring.calibration import check_learnable
from hilbertvae.training.checkpoints import AtomicCheckpoints, MovableCheckpoint, PatienceOnce
from hilbertvae.training.devices import check_accelerator, training_device
from hilbertvae.training.foreign_code import foreign_source
from hilbertvae.training.grids_datamodule import GridsDataModule
from hilbertvae.training.hilbert_map_callback import HilbertMapCallback
from hilbertvae.training.kept_grids import GRID_SOURCES, code_hash
from hilbertvae.training.kept_network import KeptNetwork
from hilbertvae.training.opened_sites import opened_site
from hilbertvae.training.plain_settings import plain_settings
from hilbertvae.training.reconstruction_module import ReconstructionModule
from hilbertvae.training.scoring import Writer, score, use_threads
from hilbertvae.training.settings import Settings
from hilbertvae.training.site_roles import check_unseen
from hilbertvae.training.training_hash import first_differences, trained_by, training_hash

BEST = {"monitor": "val/gap_nll", "mode": "min"}
DISTRIBUTED = ("LOCAL_RANK", "NODE_RANK", "WORLD_SIZE", "MASTER_ADDR", "MASTER_PORT")
"""What Lightning leaves in the environment after a distributed training. The next one in this process, a job of the same multirun, would
take it for the word of a cluster that has started its processes already, and wait for them for ever."""


def kept_name(settings: Settings) -> str:
    """What names a kept network: its settings, and the code that trains it and learns its Hilbert Map's weights.

    An `InputError` for a network or likelihood whose code can't be read: it may be another one the next time.
    """
    code = code_hash((*GRID_SOURCES, "mappers", "reconstruction", "scoring/calibration.py", "scoring/cases.py", "training"))
    check_kind(settings.network)
    network = [type(settings.network), NETWORKS[settings.network.kind][1]]
    own = []
    for what, kinds in (("network", network), ("likelihood", [LIKELIHOODS[settings.likelihood.kind]])):
        own += map(foreign_source, kinds)
        if None in own:
            raise InputError(f"trained: expected none with a {what} whose code is in no file; write it into a module")
    return hash_of([training_hash(settings), hilbertvae.__version__, code, *filter(None, own)])


def train(settings: Settings, mappers: dict[str, Mapper] | None = None, write: Writer | None = None) -> Path:
    """Train a network, learn its Hilbert Map's weights on sites it has not seen, and return the path of `model.safetensors`.

    mappers: by name, what is scored on the test sites afterwards; `write(result, site, fitted)` is handed each `Result`. A run that
    was interrupted goes on from its last epoch, if its settings are the same; one whose network is kept in `settings.trained` takes
    that. Raises `InputError` for bad settings, and `FloatingPointError` for a loss that is not finite.
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
    checkpoint = output / "model.safetensors"
    reconstructor = kept.take(checkpoint) if kept else None
    if reconstructor:
        print(f"{output}: its network was trained before and is kept as {kept.path}")
        if not _is_of(output, settings):
            _begin_anew(output, settings)
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
    resume = _last_epoch(output, settings)
    best = MovableCheckpoint(output / CHECKPOINTS, "best", enable_version_counter=False, **BEST)
    # One of its own: `save_last` writes only where an epoch was the best so far, and a resumed run would go back to that.
    last = MovableCheckpoint(output / CHECKPOINTS, "last", enable_version_counter=False)
    callbacks = [best, last, after_fit, LearningRateMonitor("step"), TQDMProgressBar(refresh_rate=10)]
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
            num_sanity_val_steps=0,
            use_distributed_sampler=False,
            enable_model_summary=False,
        )
        if settings.trainer.initial and not resume:
            module.start_from(settings.trainer.initial)
        before = {name: os.environ.get(name) for name in DISTRIBUTED}
        try:
            trainer.fit(module, GridsDataModule(settings), ckpt_path=resume, weights_only=True)
        except SystemExit:  # Lightning's answer to Ctrl-C
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
        try:
            check_learnable(opened_site(reference, settings), settings.grid, settings.validation_gap_m, settings.calibration_seeds)
        except InputError as error:
            raise InputError(f"data.calibrate: {reference}: {error}") from error


def _precision(settings: Settings) -> str:
    """Lightning's word for `trainer.precision`."""
    if settings.trainer.precision != "auto":
        return settings.trainer.precision
    convolved = convolutions(settings.network, settings.grid.cells)
    numbers = training_type(training_device(settings), settings.dimension, convolved)
    return "bf16-mixed" if numbers is torch.bfloat16 else "32-true"


def _steps_done(resume: Path | None) -> int | None:
    """How many steps a checkpoint has behind it. What was logged after it is taken again, and its curves would double back."""
    return torch.load(resume, map_location="cpu", weights_only=True)["global_step"] if resume else None


def _last_epoch(output: Path, settings: Settings) -> Path | None:
    """The checkpoint to go on from, if the folder holds one.

    A job whose network is kept is made anew instead, also after a change of the code: what it left is filed under the hash of both, and
    whoever changes a sweep's settings asks for other networks. A single run goes on over a change of the code, as a long one may have to.
    """
    last = output / CHECKPOINTS / "last.ckpt"
    if last.exists():
        if _is_of(output, settings):
            return last
        print(f"{output}: was trained with other settings, or by other code; trained anew")
    _begin_anew(output, settings)
    return None


def check_folder(settings: Settings) -> None:
    """An `InputError` if the folder of the run holds the training of another one, which it would go on from or write over. One that is
    kept may be written over by one that is to be kept, too."""
    output = Path(settings.output)
    found = json_object(output / TRAINING) if (output / CHECKPOINTS / "last.ckpt").exists() else None
    if found is None or (settings.trained and "kept_name" in found):
        return
    same = found.get("training_hash") == training_hash(settings)
    if settings.trained and same:
        ways = "leave it out to go on, choose another `name`, or remove the folder"
        raise InputError(f"trained: {output} holds a training that was begun without it; {ways}")
    if not same:
        before = found.get("settings")
        other = first_differences(_as_read(settings), before) if isinstance(before, dict) else ""
        told = f" ({other})" if other else ""
        raise InputError(f"output: {output} holds a run with other settings{told}; choose another `name`, or remove the folder")


def _is_of(output: Path, settings: Settings) -> bool:
    found = json_object(output / TRAINING)
    return all(found.get(key) == value for key, value in _made_of(settings).items())


def _made_of(settings: Settings) -> dict[str, str]:
    return {"training_hash": training_hash(settings)} | ({"kept_name": kept_name(settings)} if settings.trained else {})


def _begin_anew(output: Path, settings: Settings) -> None:
    """What lies there of another network goes: its last epoch would be gone on from, and its curves be shown as this one's."""
    if settings.trained or (output / TRAINING).exists():
        shutil.rmtree(output / CHECKPOINTS, ignore_errors=True)
        clear(output)
    write_json(output / TRAINING, {**_made_of(settings), "settings": _as_read(settings)})


def _as_read(settings: Settings) -> dict:
    """All that decides a network, as JSON has it."""
    return json.loads(json.dumps(trained_by(settings), default=str))
