"""Where the networks of a run compute."""

from __future__ import annotations

import torch

from hilbertvae.checks import InputError
from hilbertvae.reconstruction.precision import device_name
from hilbertvae.training.settings import Settings


def training_device(settings: Settings) -> str:
    """Where Lightning trains: torch's word for what `trainer.accelerator` finds here."""
    accelerator = settings.trainer.accelerator
    if accelerator in ("auto", "gpu", "mps") and torch.backends.mps.is_available():
        return "mps"
    on_gpu = accelerator in ("gpu", "cuda") or (accelerator == "auto" and torch.cuda.is_available())
    return "cuda" if on_gpu else "cpu"


def training_gpu(settings: Settings) -> dict[str, str]:
    """What a network's card says of the GPU that trains it; nothing of a CPU."""
    device = training_device(settings)
    return {} if device == "cpu" else {"trained_by": device_name(device)}


def check_accelerator(settings: Settings) -> None:
    """An `InputError` for a `trainer.accelerator` that is not there."""
    there = {"cuda": torch.cuda.is_available(), "mps": torch.backends.mps.is_available()}
    there["gpu"] = any(there.values())  # Lightning's word for either
    accelerator = settings.trainer.accelerator
    if not there.get(accelerator, True):
        raise InputError(f"trainer.accelerator: expected cpu or auto where torch finds none of this kind, got {accelerator!r}")


def filling_device(settings: Settings) -> str:
    """Where networks fill maps, for their weights and their scores: `device`, or where the run would train; the CPU of an Apple GPU."""
    if settings.device != "auto":
        return settings.device
    return "cuda" if training_device(settings) == "cuda" else "cpu"
