"""The numbers that networks run in: bfloat16 where the processor multiplies in it. Where it has to be emulated it takes a CPU three times
as long as float32 (docs/decisions.md)."""

from __future__ import annotations

from collections.abc import Iterable

import torch

from hilbertvae.checks import InputError

CPU_FEATURES = ("amx_bf16", "avx512_bf16", "bf16")
"""As `torch.cpu.get_capabilities` calls them, on x86 and on ARM."""


def check_device(device: str | torch.device) -> None:
    """An `InputError` for a device that torch does not have here, or that computes nothing."""
    if not isinstance(device, (str, torch.device)) or str(device).partition(":")[0] == "meta":
        raise InputError(f"device: expected cpu, or cuda where there is one, got {device!r}")
    try:
        torch.empty(0, device=device)
    except (RuntimeError, AssertionError) as error:
        raise InputError(f"device: expected cpu, or cuda where there is one, got {device!r} ({str(error).splitlines()[0]})") from error


def device_name(device: str) -> str:
    """What computes there: the model of a GPU, else the device itself."""
    on_gpu = torch.device(device).type == "cuda" and torch.cuda.is_available()
    return torch.cuda.get_device_name(device) if on_gpu else device


def fast_type(device: str = "cpu") -> torch.dtype:
    """bfloat16 on a device that multiplies in it, else float32."""
    kind = torch.device(device).type
    if kind == "cuda":
        has = torch.cuda.is_bf16_supported(including_emulation=False)
    else:
        features = getattr(torch.cpu, "get_capabilities", dict)()  # torch before 2.10 does not say
        has = kind == "cpu" and any(features.get(name) for name in CPU_FEATURES)
    return torch.bfloat16 if has else torch.float32


def training_type(device: str, dimension: int, convolutions: Iterable[tuple[int, int]]) -> torch.dtype:
    """`fast_type`, but float32 where a network with these `convolutions` (kernel and cells along an axis) would learn from wrong gradients:
    on CPUs with AVX512_BF16 and no AMX torch 2.13 gets those of 3D convolutions wrong in bfloat16, some of them infinite, where a kernel is
    wider than its level, while the loss stays right."""
    wrong = dimension == 3 and torch.device(device).type == "cpu" and any(cells < kernel for kernel, cells in convolutions)
    return torch.float32 if wrong else fast_type(device)


def fast_autocast(device: str = "cpu", numbers: torch.dtype | None = None) -> torch.autocast:
    """A context in which networks run in `numbers`, `fast_type(device)` unless given."""
    return torch.autocast(torch.device(device).type, torch.bfloat16, enabled=(numbers or fast_type(device)) is torch.bfloat16)


def layer_type(device: torch.device) -> torch.dtype:
    """The numbers that layers take here: those of the autocast that runs, else float32. What is made in them needs no copy."""
    return torch.get_autocast_dtype(device.type) if torch.is_autocast_enabled(device.type) else torch.float32
