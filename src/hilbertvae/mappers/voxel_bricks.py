"""Numbers of voxels, looked up by bricks: dense blocks of a sparse lattice (as OpenVDB's leaves, Museth 2013), each with a halo.

A brick knows the voxels around it too, so that all neighbours of a voxel are found by adding constants to its place. Bricks are made
where voxels are, so memory follows what was seen, not the extent, and new voxels cost what their own bricks do.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.mappers.growing_array import GrowingArray

BITS = {2: 4, 3: 3}
"""A brick has 2^bits voxels along each axis."""
KEY_BITS = {2: 31, 3: 20}
"""Bits of a brick's key per axis: how many bricks a map may extend over."""
NONE = -1


class VoxelBricks:
    """A number from 1 on for each voxel, in order of arrival, 0 for one that was never added.

    A place (int64) is a voxel's position in `numbers`: `numbers[place + steps]` are those of its block, itself first.
    """

    def __init__(self, dimension: int):
        self.dimension, self.count = dimension, 0
        self.side = 1 << BITS[dimension]
        self.shape = (self.side + 2,) * dimension
        self._size = math.prod(self.shape)
        moves = sorted(itertools.product((-1, 0, 1), repeat=dimension), key=lambda move: sum(map(abs, move)))
        self.moves = np.array(moves)
        """(3^D, D) the way to each voxel of a block."""
        self.steps = self.moves @ self._strides()
        self._numbers = GrowingArray(np.zeros((0, *self.shape), np.int32))
        self._corner = GrowingArray(np.zeros((0, dimension), np.int64))
        self._keys, self._brick = np.empty(0, np.int64), np.empty(0, np.int64)
        self._first: np.ndarray | None = None

    @property
    def numbers(self) -> np.ndarray:
        """Flat int32: what lies at each place."""
        return self._numbers.rows.reshape(-1)

    @property
    def blocks(self) -> np.ndarray:
        """(B, side + 2, ..., side + 2) int32: the numbers of each brick and its halo."""
        return self._numbers.rows

    @property
    def corners(self) -> np.ndarray:
        """(B, D) the position of each brick in the lattice of bricks."""
        return self._corner.rows

    def voxels(self, bricks: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Numbers (V,) and indices (V, D) of the voxels in `bricks`, all unless given: brick after brick, each along its axes."""
        bricks = np.arange(len(self.corners)) if bricks is None else bricks
        block = self.blocks[(slice(None), *self.parts()[0])][bricks]
        brick, *cell = np.nonzero(block)
        return block[(brick, *cell)], self.corners[bricks][brick] * self.side + np.stack(cell, axis=1)

    def parts(self) -> list[tuple[slice, ...]]:
        """For each way to a voxel of a block: the part of a brick with its halo that lies that way from its own voxels."""
        return [tuple(slice(1 + step, 1 + step + self.side) for step in move) for move in self.moves.tolist()]

    def places(self, index: np.ndarray) -> np.ndarray:
        """(N,) the place of each voxel `index (N, D)`, -1 where there is no brick."""
        brick = self.find(index >> BITS[self.dimension])
        return np.where(brick == NONE, NONE, self._place(brick, index))

    def brick_of(self, places: np.ndarray) -> np.ndarray:
        """(N,) the brick of each place."""
        return places // self._size

    def indices(self, places: np.ndarray) -> np.ndarray:
        """(N, D) the voxels at `places (N,)` of bricks' own."""
        brick, inner = np.divmod(places, self._size)
        return self.corners[brick] * self.side + np.stack(np.unravel_index(inner, self.shape), axis=1) - 1

    def add(self, index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(numbers (N,) of the voxels `index (N, D)`, places (K,) of those that are new, in order of their numbers).

        Raises `InputError` where voxels lie too far from the first ones; nothing is added then.
        """
        corner = index >> BITS[self.dimension]
        first = corner[0] if self._first is None else self._first
        keys, known = self._key(corner, first)
        if not known.all():
            raise InputError(f"expected voxels within {1 << KEY_BITS[self.dimension] - 1} bricks of {self.side}")
        self._first = first
        self._make_bricks(_distinct(keys))
        place = self._place(self.find(corner), index)
        fresh = _distinct(place[self.numbers[place] == 0])
        self.numbers[fresh] = np.arange(self.count + 1, self.count + 1 + len(fresh), dtype=np.int32)
        self.count += len(fresh)
        self._copy_halos(_distinct(self.brick_of(fresh)))
        return self.numbers[place], fresh

    def with_voxels(self, places: np.ndarray) -> np.ndarray:
        """The bricks that have a voxel at one of the bricks' own `places (N,)`, or in their halo; ascending."""
        brick, inner = np.divmod(places, self._size)
        cell = np.unravel_index(inner, self.shape)
        found = [brick]
        for move in self.moves[1:].tolist():
            edge = np.ones(len(places), bool)
            for axis, step in zip(cell, move, strict=True):
                if step:
                    edge &= axis == (1 if step < 0 else self.side)
            found.append(self.find(self.corners[_distinct(brick[edge])] + move))
        found = _distinct(np.concatenate(found))
        return found[found != NONE]

    def find(self, corner: np.ndarray) -> np.ndarray:
        """(N,) the brick at each place `corner (N, D)` of the lattice of bricks, -1 where there is none."""
        if not len(self._keys):
            return np.full(len(corner), NONE)
        key, possible = self._key(corner, self._first)
        position = np.minimum(np.searchsorted(self._keys, key), len(self._keys) - 1)
        return np.where((self._keys[position] == key) & possible, self._brick[position], NONE)

    def meeting(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """The bricks with a voxel in one of the boxes from voxel `low (B, D)` to `high (B, D)`, both included; ascending."""
        bits = BITS[self.dimension]
        low, high = low >> bits, high >> bits
        found = [np.empty(0, np.int64)]
        for move in itertools.product(*(range(int(span) + 1) for span in (high - low).max(axis=0, initial=-1))):
            corner = low + np.array(move)
            found.append(self.find(corner[(corner <= high).all(axis=1)]))
        found = _distinct(np.concatenate(found))
        return found[found != NONE]

    def _strides(self) -> np.ndarray:
        return np.append(np.cumprod(self.shape[::-1])[::-1][1:], 1)

    def _place(self, brick: np.ndarray, index: np.ndarray) -> np.ndarray:
        place = brick * self._size
        for axis, stride in zip(index.T, self._strides().tolist(), strict=True):  # numpy is slow where the last axis is short
            place += ((axis & (self.side - 1)) + 1) * stride
        return place

    def _key(self, corner: np.ndarray, first: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(N,) keys of bricks, and whether each is near enough to the first one to have one."""
        bits = KEY_BITS[self.dimension]
        key, possible = np.zeros(len(corner), np.int64), np.ones(len(corner), bool)
        for axis, start in zip(corner.T, first.tolist(), strict=True):
            away = axis - (start - (1 << bits - 1))
            possible &= (away >= 0) & (away < 1 << bits)
            key = key << bits | away & (1 << bits) - 1
        return key, possible

    def _make_bricks(self, keys: np.ndarray) -> None:
        position = np.searchsorted(self._keys, keys)
        there = np.zeros(len(keys), bool)
        there[position < len(self._keys)] = self._keys[position[position < len(self._keys)]] == keys[position < len(self._keys)]
        keys, position = keys[~there], position[~there]
        brick = np.arange(len(self._numbers), len(self._numbers) + len(keys))
        self._keys, self._brick = np.insert(self._keys, position, keys), np.insert(self._brick, position, brick)
        bits = KEY_BITS[self.dimension]
        shifts = np.arange(self.dimension)[::-1] * bits
        self._corner.append((keys[:, None] >> shifts & (1 << bits) - 1) - (1 << bits - 1) + self._first)
        self._numbers.append(np.zeros((len(keys), *self.shape), np.int32))

    def _copy_halos(self, bricks: np.ndarray) -> None:
        """Between the bricks given and all around them, copy what their halos share, both ways."""
        numbers, inner = self._numbers.rows, range(self.dimension)
        for move in self.moves[1:]:
            other = self.find(self.corners[bricks] + move)
            mine, theirs = bricks[other != NONE], other[other != NONE]
            halo = tuple(_HALO[move[axis]] for axis in inner)
            own = tuple(_OWN[-move[axis]] for axis in inner)
            numbers[(mine, *halo)] = numbers[(theirs, *own)]
            halo = tuple(_HALO[-move[axis]] for axis in inner)
            own = tuple(_OWN[move[axis]] for axis in inner)
            numbers[(theirs, *halo)] = numbers[(mine, *own)]


def _distinct(values: np.ndarray) -> np.ndarray:
    """As np.unique, which hashes, and takes several times as long as sorting does."""
    values = np.sort(values)
    return values[np.append(True, values[1:] != values[:-1])] if len(values) else values


_HALO = {-1: slice(0, 1), 0: slice(1, -1), 1: slice(-1, None)}
"""Along an axis, by which way a neighbour lies: the part of a brick that is its copy of the neighbour's voxels."""
_OWN = {-1: slice(1, 2), 0: slice(1, -1), 1: slice(-2, -1)}
"""The part of a brick whose voxels the neighbour has copies of."""
