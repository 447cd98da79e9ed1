"""The network that a training goes on from, `trainer.initial`: what of it may differ from the one that is trained, and its weights."""

from __future__ import annotations

import warnings
from dataclasses import asdict

import torch
from torch import Tensor, nn

from hilbertvae.checks import InputError
from hilbertvae.reconstruction.blocks import HIT_FREE_CHANNELS, shows_no_less
from hilbertvae.reconstruction.finer_stem import finer_weights, is_finer
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.reconstruction.wider_levels import is_wider, wider_weights
from hilbertvae.training.settings import Settings
from hilbertvae.training.training_hash import first_differences


def initial_weights(checkpoint: str, settings: Settings, network: nn.Module) -> dict[str, Tensor]:
    """The state from which `network`, which is fresh and that of `settings`, goes on where that of `checkpoint` has stopped.

    One that was shown labels alone goes on with what else a `detailed` encoding shows at no weight, and so as it was; so does one
    with fewer channels or blocks (`wider_levels.py`). One with twice the stem becomes the inner levels of this one (`finer_stem.py`).
    An `InputError` names the file if its network is another, or if its weights mean something else.
    """
    trained = Reconstructor.load(checkpoint)
    if trained.dimension != settings.dimension:
        raise InputError(f"trainer.initial: {checkpoint} is a network of {trained.dimension}D, expected {settings.dimension}D")
    _check_meaning(checkpoint, trained, settings)
    found = trained.network.state_dict()
    if is_finer(settings.network, trained.network_settings):
        found = finer_weights(found, network)
    elif is_wider(settings.network, trained.network_settings):
        found = wider_weights(found, network)
    own = network.state_dict()
    stem, wanted = found.get("stem.weight"), own.get("stem.weight")
    if stem is not None and wanted is not None and stem.shape[1] == HIT_FREE_CHANNELS < wanted.shape[1]:
        further = stem.new_zeros(len(stem), wanted.shape[1] - HIT_FREE_CHANNELS, *stem.shape[2:])
        found = {**found, "stem.weight": torch.cat([stem, further], dim=1)}
    # What says whether a cell would be known came later than the rest, and older networks don't have it.
    lacking = [name for name in own if name not in found and not name.startswith("known_head.")]
    if lacking or any(name not in own or own[name].shape != weights.shape for name, weights in found.items()):
        other = first_differences(_described(settings.network, settings), _described(trained.network_settings, trained))
        told = f": {other}" if other else ""
        raise InputError(f"trainer.initial: {checkpoint} has another network than `network` and `grid.cells` describe{told}")
    return {**own, **found}


def _check_meaning(checkpoint: str, trained: Reconstructor, settings: Settings) -> None:
    """An `InputError` for a network whose outputs or inputs are others, though its weights may be as many; a warning for one whose cells
    are of another size, which learns that anew."""
    if (kind := trained.likelihood.kind) != settings.likelihood.kind:
        raise InputError(f"trainer.initial: {checkpoint} was trained with likelihood.kind={kind}, expected {settings.likelihood.kind}")
    shown, before = (getattr(network, "encoding", None) for network in (settings.network, trained.network_settings))
    if not shows_no_less(shown, before):
        raise InputError(f"trainer.initial: {checkpoint} was trained with network.encoding={before}, expected {shown}")
    sizes = ((trained.grid.cell_m, settings.grid.cell_m, "cells"), (trained.resolution_m, settings.resolution_m, "voxels"))
    for before, now, what in sizes:
        if abs(before - now) > 1e-6 * now:
            other = f"was trained on {what} of {before:g} m, and goes on with those of {now:g} m, where walls are of another size"
            keys = "`grid.cluster_diameter_m` / `grid.cells` is a cell's side" if what == "cells" else "`resolution_m` is a voxel's side"
            warnings.warn(f"trainer.initial: {checkpoint} {other}; {keys}", stacklevel=2)


def _described(network: object, made: Settings | Reconstructor) -> dict:
    """The keys that decide which weights a network has."""
    return {"network": asdict(network), "grid": {"cells": made.grid.cells}}
