"""Turns that threads take at one map that may grow: who asks waits while a scan is added, and the other way round."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock, RLock, local
from weakref import WeakKeyDictionary

_MAKING = Lock()
_TURNS: WeakKeyDictionary = WeakKeyDictionary()
"""Beside the maps and not in them, where copies and pickles would have them, too."""


class Turn:
    """A lock, which whoever has it may take again, and lend to threads that work for it."""

    def __init__(self):
        self._lock, self._mine = RLock(), local()

    def __enter__(self) -> None:
        if not self._is_lent():
            self._lock.acquire()

    def __exit__(self, *_) -> None:
        if not self._is_lent():
            self._lock.release()

    @contextmanager
    def lent(self) -> Iterator[None]:
        """In a thread that works for the one that has the turn, and waits for it."""
        before = self._is_lent()
        self._mine.lent = True
        try:
            yield
        finally:
            self._mine.lent = before

    def _is_lent(self) -> bool:
        return getattr(self._mine, "lent", False)


def turn_of(mapper: object) -> Turn:
    """That of a map."""
    with _MAKING:
        return _TURNS.setdefault(mapper, Turn())


def _forget() -> None:
    """In a process that was forked, where the threads that have turns are not."""
    global _MAKING
    _MAKING = Lock()
    _TURNS.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)
