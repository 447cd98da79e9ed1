"""How many threads compute at once."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor

FEW = 16_384
"""Points that one thread answers at once, while others answer others beside it (`Mapper.chunk`)."""


def cores() -> int:
    """Cores that this process may use: on a shared machine fewer than there are."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def workers(count: int) -> int:
    """Threads for SciPy to look up `count` points: more than one only where no other thread looks up others beside this one."""
    return cores() if count > FEW else 1


def on_all_cores(task: Callable[[object], object], items: Iterable) -> None:
    """Call `task` with each item, as many at a time as there are cores. Threads are enough for numpy, which lets the others run while it
    computes. What a task raises is raised here."""
    with ThreadPoolExecutor(cores()) as pool:
        for _ in pool.map(task, items):
            pass
