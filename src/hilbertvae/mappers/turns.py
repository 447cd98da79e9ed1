"""Turns that threads take at one map that grows: who asks waits while a scan is added, and the other way round."""

from __future__ import annotations

import os
from threading import Lock, RLock
from weakref import WeakKeyDictionary

_MAKING = Lock()
_TURNS: WeakKeyDictionary = WeakKeyDictionary()
"""Beside the maps and not in them, where copies and pickles would have them, too."""


def turn_of(mapper: object) -> RLock:
    """The lock of a map; whoever has it may take it again."""
    with _MAKING:
        return _TURNS.setdefault(mapper, RLock())


def _forget() -> None:
    """In a process that was forked, where the threads that have turns are not."""
    global _MAKING
    _MAKING = Lock()
    _TURNS.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)
