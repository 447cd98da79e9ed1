"""Pairs of a shown grid and its target, read from the cache's files batch by batch: what a network learns from may exceed memory."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import Dataset


class GridPairs(Dataset):
    """Pairs (shown, target) of int8 grids of all files, one after the other, fetched a whole batch at a time.

    voted: whether targets have a second channel, the votes of each cell. Shown grids may have channels, too (`bin_detailed`). A file is
    opened for each grid, since a process may hold fewer files open than a training has sites.
    """

    def __init__(self, paths: list[Path], voted: bool):
        self.paths, self.own = paths, 1 + voted
        self.offsets, counts = [], []
        for path in paths:
            file = np.load(path, mmap_mode="r")
            self.shape = file.shape[1:]
            self.offsets.append(file.offset)
            counts.append(len(file))
        self.ends = np.cumsum(counts)

    def __len__(self) -> int:
        return int(self.ends[-1])

    def __getitem__(self, chosen: list[int]) -> tuple[Tensor, Tensor]:
        """shown (n, *cells), or (n, channels, *cells) if there are several, and target alike."""
        grids = np.stack([self._read(number) for number in chosen])
        parts = grids[:, : -self.own], grids[:, -self.own :]
        return tuple(torch.from_numpy(np.ascontiguousarray(part[:, 0] if part.shape[1] == 1 else part)) for part in parts)

    def announce(self, chosen: list[int]) -> None:
        """Say which grids are asked for soon: Linux reads them while the network learns from others."""
        if not hasattr(os, "posix_fadvise"):
            return
        for number in chosen:
            path, offset, size = self._place(number)
            file = os.open(path, os.O_RDONLY)
            try:
                os.posix_fadvise(file, offset, size, os.POSIX_FADV_WILLNEED)
            finally:
                os.close(file)

    def _read(self, number: int) -> np.ndarray:
        path, offset, size = self._place(number)
        return np.fromfile(path, np.int8, size, offset=offset).reshape(self.shape)

    def _place(self, number: int) -> tuple[Path, int, int]:
        """The file of a grid, and where in it how many bytes are the grid's."""
        file = int(np.searchsorted(self.ends, number, side="right"))
        start = number - int(self.ends[file - 1] if file else 0)
        size = int(np.prod(self.shape))
        return self.paths[file], self.offsets[file] + start * size, size
