"""What asks a process to stop: Ctrl-C, and the signals that `timeout`, SLURM, containers and closed terminals send."""

from __future__ import annotations

import _thread
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

T = TypeVar("T")
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


def to_its_end(work: Callable[[], T]) -> T:
    """What `work` returns, which has to be short: what a signal's handler raises meanwhile, as Ctrl-C does, is raised when it is done.

    Handlers raise in the main thread, so another one works while that waits. They stay as they are: those of somebody's program may be
    of C, as a robot's middleware has them, and Python could neither see them nor set them again.
    """
    if threading.current_thread() is not threading.main_thread():
        return work()
    begun, done, outcome = threading.Lock(), threading.Lock(), []

    def run() -> None:
        if begun.acquire(blocking=False):
            try:
                outcome.append((work(), None))
            except BaseException as error:
                outcome.append((None, error))
        done.release()

    done.acquire()
    stop = None
    try:
        try:
            _thread.start_new_thread(run, ())  # in one step; `Thread.start` waits in Python, where a stop leaves locks astray
        except RuntimeError:  # there are no more, as at the interpreter's end
            return work()
        done.acquire()
    except BaseException as error:
        if begun.acquire(blocking=False):  # before it began; then it never will
            raise
        stop = error
        while not outcome:
            try:
                done.acquire(timeout=0.1)
            except BaseException as again:
                stop = again
    if stop is not None:
        raise stop
    result, failed = outcome[0]
    if failed is not None:
        raise failed
    return result


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
