"""Pairs of a shown grid and its target, read from the cache's files batch by batch: what a network learns from may exceed memory."""

from __future__ import annotations

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
        files = [np.load(path, mmap_mode="r") for path in paths]
        self.paths, self.own = paths, 1 + voted
        self.offsets = [file.offset for file in files]
        self.shape = files[0].shape[1:]
        self.ends = np.cumsum([len(file) for file in files])

    def __len__(self) -> int:
        return int(self.ends[-1])

    def __getitem__(self, chosen: list[int]) -> tuple[Tensor, Tensor]:
        """shown (n, *cells), or (n, channels, *cells) if there are several, and target alike."""
        grids = np.stack([self._read(number) for number in chosen])
        parts = grids[:, : -self.own], grids[:, -self.own :]
        return tuple(torch.from_numpy(np.ascontiguousarray(part[:, 0] if part.shape[1] == 1 else part)) for part in parts)

    def _read(self, number: int) -> np.ndarray:
        file = int(np.searchsorted(self.ends, number, side="right"))
        start = number - (self.ends[file - 1] if file else 0)
        size = int(np.prod(self.shape))
        return np.fromfile(self.paths[file], np.int8, size, offset=int(self.offsets[file] + start * size)).reshape(self.shape)
