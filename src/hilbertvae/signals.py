"""What asks a process to stop: Ctrl-C, and the signals that `timeout`, SLURM, containers and closed terminals send."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

STOPS = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))


@contextmanager
def stopped_by_signals() -> Iterator[None]:
    """`STOPS` end what runs as Ctrl-C does: what was half-written is taken away. One that is ignored, as by `nohup`, stays so."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(number, frame):
        raise KeyboardInterrupt

    before = {number: signal.getsignal(number) for number in STOPS}
    before = {number: handler for number, handler in before.items() if handler is not signal.SIG_IGN}
    for number in before:
        signal.signal(number, stop)
    try:
        yield
    finally:
        _restore(before)


@contextmanager
def not_stopped() -> Iterator[None]:
    """Ctrl-C and `STOPS` that come while this runs, which has to be short, are acted on when it is done."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    before = {number: signal.signal(number, lambda number, frame: came.append(number)) for number in (signal.SIGINT, *STOPS)}
    try:
        yield
    finally:
        _restore(before)
        for number in dict.fromkeys(came):
            signal.raise_signal(number)


def comes_of_a_stop(error: BaseException, handled: BaseException | None = None) -> bool:
    """Whether `error` was raised while a `KeyboardInterrupt` was on its way, other than one that the caller had `handled` already.

    One that ends the wait for a lock in a wrong moment leaves the lock to others, and Python says "release unlocked lock" instead.
    """
    while error is not None and error is not handled:
        if isinstance(error, KeyboardInterrupt):
            return True
        error = error.__context__
    return False


def _restore(before: dict) -> None:
    for number, handler in before.items():  # None: one that Python did not set, and can't set again
        signal.signal(number, signal.SIG_DFL if handler is None else handler)
