"""A fitted map as cells of a lattice: what every file of it is written from."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from hilbertvae.checks import InputError, check_points, check_positive
from hilbertvae.drawing.field import REACH_M
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.mapper import FREE_BELOW, OCCUPIED_ABOVE, Mapper
from hilbertvae.voxel_blocks import NearVoxels, lattice_index, longest_reach_m

UNKNOWN_WITHIN = 0.02
"""A cell that was not observed is kept if p is farther than this from 0.5: nearer, it says nothing that a planner would act on, and
faded answers would fill files with cells of 0.500 to the end of the reach."""
QUERIES_AT_ONCE = 1_000_000
MOST_DENSE = 1 << 27
"""Cells of the array that `dense` makes."""


@dataclass(frozen=True)
class MapCells:
    """Cells of which a map says something, each once.

    index: (V, D) int64, D 2 or 3; a cell's centre is (index + 0.5) * resolution_m, metres, map frame.
    probability: (V,) float32, p(occupied). std: (V,) float32, NaN from a mapper that has none. observed: (V,) bool; what is not, is
    predicted.
    """

    index: np.ndarray
    resolution_m: float
    probability: np.ndarray
    std: np.ndarray
    observed: np.ndarray

    def __post_init__(self):
        object.__setattr__(self, "resolution_m", float(check_positive(self.resolution_m, "resolution_m")))
        index = np.asarray(self.index)
        if index.ndim != 2 or index.shape[1] not in (2, 3) or index.dtype.kind not in "iu":
            raise InputError(f"index: expected whole numbers of shape (V, 2) or (V, 3), got {index.dtype} {index.shape}")
        columns = {"index": index.astype(np.int64, copy=False)}
        for name, kind in (("probability", np.float32), ("std", np.float32), ("observed", bool)):
            column = np.asarray(getattr(self, name))
            if column.shape != index.shape[:1] or column.dtype.kind not in ("b" if kind is bool else "fiu"):
                raise InputError(f"{name}: expected shape {index.shape[:1]} of {kind.__name__}, got {column.dtype} {column.shape}")
            columns[name] = column.astype(kind, copy=False)
        if not ((columns["probability"] >= 0) & (columns["probability"] <= 1)).all():
            raise InputError("probability: expected numbers from 0 to 1")
        for name, column in columns.items():
            object.__setattr__(self, name, column)

    @classmethod
    def sample(
        cls,
        mapper: Mapper,
        points: np.ndarray,
        resolution_m: float,
        reach_m: float | None = REACH_M,
        progress: Callable[[int, int], None] | None = None,
    ) -> MapCells:
        """Ask a fitted mapper at every voxel that is at most `reach_m` from a voxel of `points (N, D)` along each axis.

        Kept are the cells that were observed, and those with p off 0.5 (`UNKNOWN_WITHIN`); memory follows them. A mapper that can't tell
        what it observed is taken to have observed the voxels of `points`.
        reach_m: 1.5 m, in 2D too, hold all of a gap of 2.5 m and nine tenths of one of 5 m; farther off, fewer guesses are right.
            None asks at the voxels of `points` alone, the only ones of which a map without grids says anything.
        progress: is told how many blocks are done, of how many.
        Raises `InputError` for bad points, and for a reach of more than 1024 voxels in 2D, 128 in 3D.
        """
        points = check_points(points)
        dimension = points.shape[1]
        near = NearVoxels.of(points, resolution_m, reach_m)
        parts = [(np.empty((0, dimension), np.int64), np.empty(0, np.float32), np.empty(0, np.float32), np.empty(0, bool))]
        for done, portion in near.portions(QUERIES_AT_ONCE):
            index = lattice_index(portion)
            centres = (index + 0.5) * resolution_m
            probability, std, observed = _described(mapper, centres)
            if observed is None:
                observed = np.concatenate([_at(near.seen.get(key), local) for key, local in portion])
            kept = observed | (np.abs(probability - 0.5) > UNKNOWN_WITHIN)
            parts.append((index[kept], probability[kept].astype(np.float32), std[kept].astype(np.float32), observed[kept]))
            if progress:
                progress(done, len(near.keys))
        index, probability, std, observed = _joined(parts)
        return cls(index, float(resolution_m), probability, std, observed)

    def __len__(self) -> int:
        return len(self.index)

    @property
    def dimension(self) -> int:
        return self.index.shape[1]

    @property
    def centres(self) -> np.ndarray:
        """(V, D) float64, metres, map frame."""
        return (self.index + 0.5) * self.resolution_m

    @property
    def occupied(self) -> np.ndarray:
        """(V,) bool: p > 0.6. In float32 on both sides, where the cut itself does not count as above it."""
        return self.probability > np.float32(OCCUPIED_ABOVE)

    @property
    def free(self) -> np.ndarray:
        """(V,) bool: p <= 0.4. Cells between the cuts are neither."""
        return self.probability <= np.float32(FREE_BELOW)

    def select(self, chosen: np.ndarray) -> MapCells:
        """The cells at `chosen`, a mask or indices."""
        return MapCells(self.index[chosen], self.resolution_m, self.probability[chosen], self.std[chosen], self.observed[chosen])

    def joined(self, factor: int) -> MapCells:
        """The cells on a lattice `factor` times as coarse (`coarser`)."""
        return self.coarser(self.resolution_m * factor)

    def fitting(self, most: int) -> tuple[MapCells, MapCells]:
        """All cells, joined until the box has at most so many along each side, and those that were observed, joined by themselves: beside
        these the likeliest cell may be a predicted one."""
        factor = -(-max(self.box()[1]) // most)
        return self.joined(factor), self.select(self.observed).joined(factor)

    def coarser(self, resolution_m: float) -> MapCells:
        """The cells on a lattice of `resolution_m`: of those whose centres fall into one, the likeliest to be occupied, so that thin walls
        stay, predicted ones too. Of two occupied ones, or two that are not, one that was observed wins over one that was predicted.
        """
        if abs(check_positive(resolution_m, "resolution_m") / self.resolution_m - 1) < 1e-9:
            return self
        # In whole numbers: far from the origin rounding would decide on which side of a plane of the lattice a centre lies.
        ratio = Fraction(float(self.resolution_m / resolution_m)).limit_denominator(10**6)
        index = (2 * self.index + 1) * ratio.numerator // (2 * ratio.denominator)
        order = np.lexsort([-self.probability, ~self.observed, ~self.occupied, *index.T])
        new = np.ones(len(order), bool)
        new[1:] = (np.diff(index[order], axis=0) != 0).any(axis=1)
        kept = order[new]
        return MapCells(index[kept], float(resolution_m), self.probability[kept], self.std[kept], self.observed[kept])

    def box(self) -> tuple[np.ndarray, tuple[int, ...]]:
        """The first index (D,) of the smallest box that holds all cells, and how many cells it has along each axis."""
        if not len(self):
            raise InputError("cells: expected at least one, got a map that says nothing")
        low, high = self.index.min(axis=0), self.index.max(axis=0)
        return low, tuple(int(b) - int(a) + 1 for a, b in zip(low, high, strict=True))

    def dense(self, values: np.ndarray, fill) -> np.ndarray:
        """`values (V,)` in an array over `box`, x first, `fill` elsewhere. Raises `InputError` where that takes too much memory."""
        low, shape = self.box()
        if np.prod(np.array(shape, float)) > MOST_DENSE:
            size = f"{' x '.join(map(str, shape))} of {self.resolution_m:g} m"
            raise InputError(f"cells: expected a box of at most {MOST_DENSE} cells, got {size}; is there an outlier?")
        filled = np.full(shape, fill, np.asarray(values).dtype)
        filled[tuple((self.index - low).T)] = values
        return filled


def _described(mapper: Mapper, centres: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """What a mapper tells of `centres (V, D)`; an `InputError` if that is not one answer each."""
    described = mapper.describe(centres)
    for found in described:
        if found is not None and np.shape(found) != (len(centres),):
            raise InputError(f"mapper: expected answers of shape ({len(centres)},), one per query, got {np.shape(found)}")
    return described


def _joined(parts: list[tuple[np.ndarray, ...]]) -> list[np.ndarray]:
    """The columns of `parts`, one after the other. Takes the parts out of their list, so that no cell is in memory twice for long."""
    lengths = [len(part[0]) for part in parts]
    columns = [np.empty((sum(lengths), *column.shape[1:]), column.dtype) for column in parts[0]]
    for end in np.cumsum(lengths)[::-1]:
        part = parts.pop()
        for column, found in zip(columns, part, strict=True):
            column[end - len(found) : end] = found
    return columns


def _at(block: np.ndarray | None, local: np.ndarray) -> np.ndarray:
    """(n,) bool: a block's values at `local (n, D)`, False everywhere in a block that there is not."""
    return np.zeros(len(local), bool) if block is None else block[tuple(local.T)]


def reach_of(mapper: HilbertMap, cell_m: float, dimension: int) -> float | None:
    """How far from what was seen a map is asked in such cells, with a `UserWarning` where that is less than usual. None without grids:
    beside what was seen it says nothing, and asking there would take most of the time."""
    if not mapper.cluster_count():
        return None
    reach_m = min(REACH_M, longest_reach_m(cell_m, dimension))
    if reach_m < REACH_M:
        filled = f"with cells of {cell_m:g} m gaps are filled up to {reach_m:.3g} m from what was seen"
        wide = f"what is wider than {2 * reach_m:.3g} m stays open in its middle"
        warnings.warn(f"{mapper.source}: {filled}; {wide}", stacklevel=3)
    return reach_m
