"""How many threads compute at once."""

from __future__ import annotations

import os

FEW = 16_384
"""Points that one thread answers at once, while others answer others beside it (`Mapper.chunk`)."""


def cores() -> int:
    """Cores that this process may use: on a shared machine fewer than there are."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def workers(count: int) -> int:
    """Threads for SciPy to look up `count` points: more than one only where no other thread looks up others beside this one."""
    return cores() if count > FEW else 1
