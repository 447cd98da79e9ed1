"""What was made for the last few keys that were asked for."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from threading import Lock
from typing import Any


class LastFew:
    """At most `count` things by key; the one that was asked for longest ago is let go. Threads wait for what another one makes."""

    def __init__(self, count: int):
        self.count = count
        self._kept: dict[Hashable, Any] = {}
        self._lock = Lock()

    def __len__(self) -> int:
        return len(self._kept)

    def get(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """What `make()` gave when `key` was last asked for, if it is still here."""
        with self._lock:
            found = self._kept.pop(key) if key in self._kept else make()
            self._kept[key] = found
            while len(self._kept) > self.count:
                del self._kept[next(iter(self._kept))]
            return found
