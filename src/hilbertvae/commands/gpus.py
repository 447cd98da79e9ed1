"""GPUs dealt out among jobs that run at a time on one machine."""

from __future__ import annotations

import os
import tempfile
import warnings
from pathlib import Path

from filelock import FileLock, Timeout

SEEN, ALL = "HILBERTVAE_GPUS_SEEN", "all"
"""Where a multirun tells its jobs which GPUs it sees itself."""
_held: list[FileLock] = []
"""Locks on the GPUs of this process, which end with it."""


def remember_gpus() -> None:
    """Keep which GPUs this process sees, for jobs that it launches."""
    os.environ[SEEN] = os.environ.get("CUDA_VISIBLE_DEVICES", ALL)


def see_remembered_gpus() -> None:
    """See the GPUs of the process that launched this one: submitit shows each of its local jobs none, or the first ones."""
    seen = os.environ.get(SEEN)
    if seen == ALL:
        os.environ.pop("CUDA_VISIBLE_DEVICES", None)
    elif seen is not None:
        os.environ["CUDA_VISIBLE_DEVICES"] = seen


def give_gpus(wanted: int) -> None:
    """Let this process see `wanted` of the machine's GPUs that no other process was given; where too few are left, some that others use.

    For launchers that don't deal themselves: SLURM and Ray do. To be called before anything is put on a GPU, else it warns; a process that
    is reused for another job keeps what it was given, since CUDA looks only once.
    """
    if "HILBERTVAE_GPUS_GIVEN" in os.environ:
        return
    import torch  # late: a sweep's parent deals nothing out, and does not wait for it

    seen = os.environ.get("CUDA_VISIBLE_DEVICES")
    every = seen.split(",") if seen else [str(number) for number in range(torch.cuda.device_count())]
    if not 0 < wanted < len(every):
        return
    if torch.cuda.is_initialized():
        warnings.warn("a GPU was used before they were dealt out among jobs, which may all compute on the same one", stacklevel=2)
        return
    free = [name for name in every if len(_held) < wanted and _take(name)]
    shared = [name for name in every if name not in free]
    turn = os.getpid() % max(len(shared), 1)
    given = [*free, *shared[turn:], *shared[:turn]][:wanted]
    os.environ["CUDA_VISIBLE_DEVICES"] = ",".join(given)
    os.environ["HILBERTVAE_GPUS_GIVEN"] = "1"


def _take(name: str) -> bool:
    """Whether a GPU was free, and is this process's from now on."""
    folder = Path(tempfile.gettempdir()) / f"hilbertvae-gpus-{getattr(os, 'getuid', int)()}"
    folder.mkdir(exist_ok=True)
    lock = FileLock(folder / f"{name}.lock")
    try:
        lock.acquire(blocking=False)
    except Timeout:
        return False
    _held.append(lock)
    return True
