"""How many threads compute at once."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar

FEW = 16_384
"""Points that one thread answers at once, while others answer others beside it (`Mapper.chunk`)."""

_side_by_side: ContextVar[int] = ContextVar("side_by_side", default=1)


def cores() -> int:
    """Cores that this process may use: on a shared machine fewer than there are, and beside others of its kind its part of them."""
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(allowed, allowed // _side_by_side.get() + 1)  # one more than its part, since the others wait at times


@contextmanager
def shared_by(processes: int) -> Iterator[None]:
    """While as many processes, this one among them, have long work of one kind to do: with a thread for every core in each they would hold
    each other up (of two processes on 2 cores, 16 threads each build grids in 25.6 s, two in 20.5, one in 21.9). It holds in this thread.
    """
    token = _side_by_side.set(processes)
    try:
        yield
    finally:
        _side_by_side.reset(token)


def workers(count: int) -> int:
    """Threads for SciPy to look up `count` points: more than one only where no other thread looks up others beside this one."""
    return cores() if count > FEW else 1


def on_all_cores(task: Callable[[object], object], items: Iterable) -> None:
    """Call `task` with each item, as many at a time as there are cores. Threads are enough for numpy, which lets the others run while it
    computes. What a task raises is raised here."""
    with ThreadPoolExecutor(cores()) as pool:
        for _ in pool.map(task, items):
            pass
