"""Some of many things at a time, such that what belongs to them fits into memory."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np


def portions(offsets: np.ndarray, most: int, most_parts: int) -> Iterator[slice]:
    """Slices of M things that follow each other, of at most `most` things with at most `most_parts` parts together, or of one thing alone.
    offsets: (M + 1,) where the parts of each thing start, and where the last one's end."""
    start, count = 0, len(offsets) - 1
    while start < count:
        fit = int(np.searchsorted(offsets, offsets[start] + most_parts, "right")) - 1
        stop = min(max(fit, start + 1), start + most)
        yield slice(start, stop)
        start = stop
