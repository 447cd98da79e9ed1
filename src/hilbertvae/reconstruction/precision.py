"""The numbers that networks run in: bfloat16 where the processor multiplies in it. Where it has to be emulated it takes a CPU three times
as long as float32 (docs/decisions.md)."""

from __future__ import annotations

import torch

CPU_FEATURES = ("amx_bf16", "avx512_bf16", "bf16")
"""As `torch.cpu.get_capabilities` calls them, on x86 and on ARM."""


def fast_type(device: str = "cpu") -> torch.dtype:
    """bfloat16 on a device that multiplies in it, else float32."""
    kind = torch.device(device).type
    if kind == "cuda":
        has = torch.cuda.is_bf16_supported(including_emulation=False)
    else:
        features = getattr(torch.cpu, "get_capabilities", dict)()  # torch before 2.10 does not say
        has = kind == "cpu" and any(features.get(name) for name in CPU_FEATURES)
    return torch.bfloat16 if has else torch.float32


def fast_autocast(device: str = "cpu") -> torch.autocast:
    """A context in which networks run in `fast_type(device)`."""
    return torch.autocast(torch.device(device).type, torch.bfloat16, enabled=fast_type(device) is torch.bfloat16)
