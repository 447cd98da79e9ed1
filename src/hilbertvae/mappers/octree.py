"""OctoMap's octree as plain arrays: its leaves in Morton order, looked up by bisection, and the node streams of its two file formats.

OctoMap's own look-up of a probability takes one point per call, and its readers follow the file's child masks as deep as they go: a
damaged file ends the process. Here a stream is checked and taken apart with numpy, and costs memory in proportion to its own length.

A tree has 16 levels below its root, so 65 536 voxels per axis. The key of a voxel counts them from the lower corner; OctoMap puts the
map's origin at key 32 768. Formats: https://octomap.github.io (OcTreeBaseImpl.hxx, OccupancyOcTreeBase.hxx).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hilbertvae.checks import InputError

DEPTH = 16
SIDE = 1 << DEPTH
"""Voxels per axis."""
NONE = -1
_SPREAD = sum(((np.arange(256) >> bit) & 1) << 3 * bit for bit in range(8))
"""(256,) int64: each byte with its bits three places apart."""
_NODE = np.dtype([("log_odds", "<f4"), ("children", "u1")])
_MOST_OPEN = 7 * DEPTH
"""Siblings that still have to come, at most, at any place of a depth-first stream of 16 levels."""


def morton(keys: np.ndarray) -> np.ndarray:
    """(N,) int64: the place of voxels `keys (N, 3)`, whole numbers from 0 to 65 535, in the order in which an octree visits them."""
    code = np.zeros(len(keys), np.int64)
    for axis in range(3):
        key = keys[:, axis].astype(np.uint16)
        code |= (_SPREAD[key & 255] | _SPREAD[key >> 8] << 24) << axis
    return code


def morton_keys(code: np.ndarray) -> np.ndarray:
    """(N, 3) int64: the keys of voxels `code (N,)`, the inverse of `morton`."""
    keys = np.empty((len(code), 3), np.int64)
    for axis in range(3):
        bits = code >> axis & 0x249249249249
        for shift, mask in ((2, 0x0C30C30C30C3), (4, 0x00F00F00F00F), (8, 0x0000FF0000FF), (16, 0x00000000FFFF)):
            bits = (bits | bits >> shift) & mask
        keys[:, axis] = bits
    return keys


@dataclass(frozen=True)
class Leaves:
    """start: (L,) int64, ascending, Morton code of a leaf's first voxel; depth: (L,) int8, 16 for one voxel; log_odds: (L,) float32.

    A leaf at depth d stands for 8^(16 - d) voxels that follow one another, since OctoMap joins eight equal siblings into one (pruning).
    """

    start: np.ndarray
    depth: np.ndarray
    log_odds: np.ndarray

    def __len__(self) -> int:
        return len(self.start)

    def find(self, code: np.ndarray) -> np.ndarray:
        """(N,) int64: the leaf that holds each voxel `code (N,)`, -1 where none does."""
        if not len(self):
            return np.full(len(code), NONE)
        leaf = np.searchsorted(self.start, code, "right") - 1
        inside = code - self.start[leaf] < _voxels(self.depth[leaf])
        return np.where(inside & (leaf >= 0), leaf, NONE)

    def select(self, chosen: np.ndarray) -> Leaves:
        """The leaves at `chosen (L,)`, a mask."""
        return Leaves(self.start[chosen], self.depth[chosen], self.log_odds[chosen])

    def voxel_count(self) -> int:
        """How many voxels all leaves hold together."""
        sizes = np.bincount(self.depth, minlength=DEPTH + 1).tolist()
        return sum(count << 3 * (DEPTH - depth) for depth, count in enumerate(sizes))

    def voxels(self) -> tuple[np.ndarray, np.ndarray]:
        """Each voxel's Morton code and the leaf that it is in, both (V,) int64: pruned leaves are taken apart. See `voxel_count` first."""
        count = _voxels(self.depth)
        leaf = np.repeat(np.arange(len(self)), count)
        return self.start[leaf] + np.arange(len(leaf)) - (np.cumsum(count) - count)[leaf], leaf


def _voxels(depth: np.ndarray) -> np.ndarray:
    """How many voxels a node at `depth` holds."""
    return np.int64(1) << 3 * (DEPTH - depth.astype(np.int64))


def leaves_of_values(stream: bytes) -> tuple[Leaves, int]:
    """Leaves and number of nodes of a `.ot` stream: every node, depth first, as float32 log-odds and a byte of child bits.

    Raises `InputError` for a stream that is no tree of 16 levels, and for values that are not finite.
    """
    if len(stream) % _NODE.itemsize:
        raise InputError(f"expected whole nodes of {_NODE.itemsize} bytes, got {len(stream)} bytes; is it cut off?")
    nodes = np.frombuffer(stream, _NODE)
    if not np.isfinite(nodes["log_odds"]).all():
        raise InputError("expected finite log-odds, got NaN or inf")
    start, depth = _places(nodes["children"], DEPTH)
    leaf = nodes["children"] == 0
    return Leaves(start[leaf], depth[leaf], nodes["log_odds"][leaf]), len(nodes)


def leaves_of_labels(stream: bytes, free: float, occupied: float) -> tuple[Leaves, int]:
    """Leaves and number of nodes of a `.bt` stream: inner nodes only, two bits per child (1 free, 2 occupied, 3 an inner node).

    free, occupied: the log-odds that leaves get. Raises `InputError` for a stream that is no tree of 16 levels.
    """
    if len(stream) % 2:
        raise InputError(f"expected whole nodes of 2 bytes, got {len(stream)} bytes; is it cut off?")
    kind = np.frombuffer(stream, "<u2")[:, None] >> 2 * np.arange(8, dtype=np.uint16) & 3
    if not kind.any(axis=1).all():
        raise InputError("expected children of each inner node, got one without any")
    start, depth = _places(np.packbits(kind == 3, axis=1, bitorder="little")[:, 0], DEPTH - 1)
    parent, slot = np.nonzero((kind == 1) | (kind == 2))
    place = start[parent] + slot * _voxels(depth[parent] + 1)
    order = np.argsort(place)
    value = np.where(kind[parent, slot] == 2, np.float32(occupied), np.float32(free))
    return Leaves(place[order], depth[parent][order] + np.int8(1), value[order]), len(kind) + len(place)


def _places(children: np.ndarray, deepest: int) -> tuple[np.ndarray, np.ndarray]:
    """Morton codes (N,) int64 and depths (N,) int8 of the nodes of a depth-first stream with child bits `children (N,)`."""
    count = len(children)
    if not count:
        return np.empty(0, np.int64), np.empty(0, np.int8)
    # Nodes that still have to come before each node, but for itself: 0 at the root, -1 behind the last.
    waiting = np.concatenate([[0], np.cumsum(np.bitwise_count(children).astype(np.int64) - 1)])
    if waiting[-1] >= 0 or (waiting[:-1] < 0).any():
        raise InputError(
            f"expected one whole tree, got {count} nodes that are {'too few: is it cut off?' if waiting[-1] >= 0 else 'too many'}"
        )
    if waiting.max() > _MOST_OPEN:
        raise InputError(f"expected at most {DEPTH} levels, got more")
    # A node's branch ends at the first later place with one node less to come. Both lists ascend, so bisection is quick.
    order = np.argsort(waiting.astype(np.int8), kind="stable")
    groups = np.split(order, np.cumsum(np.bincount(waiting + 1))[:-1])
    end = np.empty(count, np.int64)
    for fewer, group in zip(groups, groups[1:], strict=False):
        end[group] = fewer[np.searchsorted(fewer, group)]
    depth = np.arange(count) - np.cumsum(np.bincount(end, minlength=count + 1))[:count]
    if depth.max() > deepest:
        raise InputError(f"expected at most {DEPTH} levels, got more")
    depth, start = depth.astype(np.int8), np.zeros(count, np.int64)
    for level in range(1, depth.max() + 1):
        # The nodes of a level come in the order of their parents, and of their bits in them.
        above = np.flatnonzero(depth == level - 1)
        parent, slot = np.nonzero(np.unpackbits(children[above, None], axis=1, bitorder="little"))
        start[depth == level] = start[above[parent]] + (slot << 3 * (DEPTH - level))
    return start, depth


def stream_of(leaves: Leaves) -> tuple[bytes, int]:
    """The `.ot` stream of `leaves` and its number of nodes; an inner node has the greatest value of its children, as in OctoMap."""
    starts, depths, nodes = [], [], []
    start, part = np.empty(0, np.int64), np.empty(0, _NODE)
    for level in range(DEPTH, -1, -1):
        own = leaves.depth == level
        leaf = np.zeros(np.count_nonzero(own), _NODE)
        leaf["log_odds"] = leaves.log_odds[own]
        start, part = np.concatenate([start, leaves.start[own]]), np.concatenate([part, leaf])
        order = np.argsort(start)
        start, part = start[order], part[order]
        starts.append(start)
        depths.append(np.full(len(start), level, np.int8))
        nodes.append(part)
        if level == 0 or not len(start):
            continue
        bit = np.uint8(1) << (start >> 3 * (DEPTH - level) & 7).astype(np.uint8)
        above = start >> 3 * (DEPTH - level + 1) << 3 * (DEPTH - level + 1)
        first = np.flatnonzero(np.diff(above, prepend=-1))
        start, inner = above[first], np.empty(len(first), _NODE)
        inner["log_odds"] = np.maximum.reduceat(part["log_odds"], first)
        inner["children"] = np.bitwise_or.reduceat(bit, first)
        part = inner
    order = np.lexsort([np.concatenate(depths), np.concatenate(starts)])
    return np.concatenate(nodes)[order].tobytes(), len(order)
