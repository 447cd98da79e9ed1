"""Arrays that rows are appended to at the cost of what is appended, not of what is there."""

from __future__ import annotations

import numpy as np

SPARE = 0.5
"""Room for so many more rows, as a share of those there, whenever an array has to be copied."""


class GrowingArray:
    """`rows (N, ...)` in a larger buffer. What `rows` gave before an `append` may be out of date after it."""

    def __init__(self, rows: np.ndarray):
        self._buffer, self._count = rows, len(rows)

    def __len__(self) -> int:
        return self._count

    @property
    def rows(self) -> np.ndarray:
        """All rows, without a copy: what is written to them stays."""
        return self._buffer[: self._count]

    def own(self) -> None:
        """Copy rows that can't be written to, as joblib maps those of its workers from a file."""
        if not self._buffer.flags.writeable:
            self._buffer = np.array(self.rows)

    def append(self, rows: np.ndarray) -> None:
        """Add `rows (K, ...)` behind the others."""
        count = self._count + len(rows)
        if count > len(self._buffer):
            # The first rows are not copied to make room for more: most maps are fitted once.
            room = count if not self._count else count + int(SPARE * self._count)
            buffer = np.empty((room, *self._buffer.shape[1:]), self._buffer.dtype)
            buffer[: self._count] = self.rows
            self._buffer = buffer
        self._buffer[self._count : count] = rows
        self._count = count

    def __getstate__(self) -> dict:
        return {"_buffer": self.rows, "_count": self._count}


def own_rows(*holders: object) -> None:
    """`GrowingArray.own` of all arrays that objects hold, alone or in lists."""
    for value in (value for holder in holders for value in vars(holder).values()):
        for rows in value if isinstance(value, list) else [value]:
            if isinstance(rows, GrowingArray):
                rows.own()
