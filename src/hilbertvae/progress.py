"""How far long work has come: a bar on a terminal, and a line now and then where there is none, as in the log of a batch job."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator
from typing import TypeVar

from rich import get_console
from rich.progress import track as bar

T = TypeVar("T")
BETWEEN_LINES_S = 30.0
"""Work that takes less says nothing."""


def track(items: Iterable[T], what: str, total: int | None = None, transient: bool = False) -> Iterator[T]:
    """The items, one after the other, with progress. `total`: how many there are, if they can't be counted; transient: no bar stays."""
    console = get_console()
    if console.is_terminal or console.is_jupyter:
        yield from bar(items, what, total=total, transient=transient)
        return
    total = len(items) if total is None else total
    start = said = time.monotonic()
    for done, item in enumerate(items):
        now = time.monotonic()
        if now - said >= BETWEEN_LINES_S:
            said = now
            print(f"{what}: {done} of {total}, {now - start:.0f} s", file=sys.stderr, flush=True)
        yield item
