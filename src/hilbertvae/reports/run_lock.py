"""One run at a time in a folder: of two, one would end with the other's weights, or have them removed under its feet."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from hilbertvae.checks import InputError
from hilbertvae.files import clear_temporary
from hilbertvae.reports.run_folder import CHECKPOINTS, LOCK, PICTURES, UNFINISHED


@contextmanager
def alone_in(folder: str | Path, waits: bool) -> Iterator[None]:
    """The right to work in a run's folder, which is lost with the process. While another run has it, `waits` for its end, as a job of a
    multirun does that was launched again while workers of the first launch are still at it; else an `InputError`.

    What runs that were killed had half written there goes."""
    lock = FileLock(Path(folder) / LOCK)
    try:
        lock.acquire(blocking=False)
    except Timeout:
        if not waits:
            raise InputError(f"output: another run is at work in {folder}; wait for its end, or choose another `name`") from None
        print(f"{folder}: another run is at work there, and is waited for", flush=True)
        lock.acquire()
    except (NotImplementedError, OSError):  # some network file systems have no locks
        pass
    if lock.is_locked:
        for part in (".", CHECKPOINTS, UNFINISHED, PICTURES):
            clear_temporary(Path(folder) / part)
    try:
        yield
    finally:
        with suppress(OSError):
            lock.release()
