"""The kernel of Eq. 7 and its sparse feature vector of Eq. 8: queries looked up in the K nearest grids whose box holds them.

A reconstructed grid is never resampled: the query is mapped into the frame, and the cell it falls in is read, or those around it.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from scipy.spatial import cKDTree

from hilbertvae.grids.aligned_grid import cell_index
from hilbertvae.grids.frame import Frames

CANDIDATES = {2: 12, 3: 24}
"""Frames near a patch that are tried first for each query in it."""
PATCHES = {2: 16, 3: 4}
"""Patches along the longest reach of a box, at first. In space queries often lie so thinly that smaller ones would hold one each."""
AT_ONCE = 2048
"""Queries whose candidates, or whose cells, are looked at together: what is computed for them stays in a core's cache."""
MOST_PLACES = 2**62
"""Patches of a lattice that are told apart by one number; of a wider one, around sites a thousand kilometres apart, by their rows."""
NONE = -1
SLACK = 1e-9
"""Of a box: what rounding may move a query that lies on a box's side, as those on voxel centres do."""
TIED_M = 1e-6
"""Distances from boxes' centres that differ by less are one: on a lattice many are, and rounding would say which box comes first."""


class FrameIndex:
    """Finds, for any queries, the K nearest frames (by centre) whose box holds each."""

    def __init__(self, frames: Frames):
        self.frames = frames
        self.tree = cKDTree(frames.centre) if len(frames) else None
        self.reach_m = float((frames.scale / 2 * np.sqrt(frames.centre.shape[1])).max(initial=0.0))
        low, high = frames.boxes()
        slack = SLACK * frames.scale[:, None]
        low, high = low - slack, high + slack
        self.low, self.high = low.min(axis=0, initial=np.inf), high.max(axis=0, initial=-np.inf)
        # Of a turn about the vertical most entries are 0: only those that are not, somewhere, are multiplied by.
        own = (frames.rotation == np.eye(frames.centre.shape[1])).all(axis=0).all(axis=0)
        mixed = (frames.rotation != 0).any(axis=0)
        self.alike = bool(len(frames)) and bool((frames.scale == frames.scale[0]).all())
        self.mixed = [None if alone else np.flatnonzero(axes) for alone, axes in zip(own, mixed.T, strict=True)]

    def holding(self, queries: np.ndarray, nearest: int) -> np.ndarray:
        """(Q, nearest) int64: frame numbers, the nearest first (of two at one distance the lower number), `NONE` where fewer boxes hold
        the query.

        Queries are gathered into patches, and each patch asks the tree once: its nearest frames are the candidates of all its
        queries. A frame that is no candidate is farther from the patch's middle than the last candidate, which settles most
        queries; the others are gathered into smaller patches with more candidates. So the answer is exact, and the same for any batch.
        """
        chosen = np.full((len(queries), nearest), NONE, np.int64)
        asked = np.flatnonzero(((queries >= self.low) & (queries <= self.high)).all(axis=1))
        if not len(asked):
            return chosen
        left, count, size = asked, max(CANDIDATES[queries.shape[1]], 2 * nearest), self.reach_m / PATCHES[queries.shape[1]]
        finest = size / 4
        while len(left):
            found, settled = self._holding(queries[left], nearest, min(count, len(self.frames)), size)
            chosen[left[settled]] = found[settled]
            left, count, size = left[~settled], 2 * count, finest
        return chosen

    def _holding(self, queries: np.ndarray, nearest: int, count: int, size: float) -> tuple[np.ndarray, np.ndarray]:
        """What `holding` says of queries in patches of `size` metres, with `count` candidates each, and which of these (Q,) are settled."""
        patch = np.floor((queries - self.low) / size).astype(np.int64)
        lowest = patch.min(axis=0)
        shape = tuple(map(int, patch.max(axis=0) - lowest + 1))
        if (places := math.prod(shape)) <= MOST_PLACES:
            # As few bits as will do: numpy sorts 16 of them in one pass.
            key = np.ravel_multi_index(tuple((patch - lowest).T), shape).astype(np.min_scalar_type(places))
            _, first, member = np.unique(key, return_index=True, return_inverse=True)
        else:
            _, first, member = np.unique(patch, axis=0, return_index=True, return_inverse=True)
        middle = (patch[first] + 0.5) * size + self.low
        candidate, beyond = self._nearest_to(middle, count)
        return self._choose(queries, candidate, member, beyond - size * np.sqrt(queries.shape[1]) / 2, nearest)

    def _nearest_to(self, points: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
        """(P, count) the frames nearest to each of `points (P, D)`, in ascending order of number, and how far all others are at least."""
        distance, index = self.tree.query(points, k=np.arange(1, count + 1))
        beyond = distance[:, -1] if count < len(self.frames) else np.full(len(points), np.inf)
        return np.sort(index, axis=1), beyond

    def _choose(self, queries, candidate, member, beyond, nearest):
        """The `nearest` holding ones (Q, nearest) of the candidates `candidate[member]` of each query, and whether no frame farther than
        `beyond[member]` can be among them."""
        chosen, settled = np.empty((len(queries), nearest), np.int64), np.empty(len(queries), bool)
        for start in range(0, len(queries), AT_ONCE):
            part = slice(start, start + AT_ONCE)
            patch, own = np.unique(member[part], return_inverse=True)  # queries that lie together are in few of all patches
            chosen[part], settled[part] = self._choose_some(queries[part], candidate[patch], own, beyond[patch], nearest)
        return chosen, settled

    def _choose_some(self, queries, candidate, member, beyond, nearest):
        """`_choose` of at most `AT_ONCE` queries."""
        # Patches are fewer than queries, so what can be gathered is gathered for them, and one axis at a time.
        moved, room = [], np.empty((len(queries), candidate.shape[1]))
        for d, centre in enumerate(self.frames.centre.T):
            along = centre[candidate].take(member, axis=0)
            moved.append(np.subtract(queries[:, d, None], along, out=along))
        distance = moved[0] * moved[0]
        for axis in moved[1:]:
            distance += np.multiply(axis, axis, out=room)
        np.sqrt(distance, out=distance)
        distance /= TIED_M
        np.rint(distance, out=distance)
        if self.frames.turned:
            turn = self.frames.rotation[candidate]
            moved = [
                along if axes is None else sum(moved[d] * turn[..., d, e].take(member, axis=0) for d in axes)
                for e, (along, axes) in enumerate(zip(moved, self.mixed, strict=True))
            ]
        scale = self.frames.scale[0] if self.alike else self.frames.scale[candidate].take(member, axis=0)
        inside = np.ones(distance.shape, bool)
        for axis in moved:
            axis /= scale
            # The lower side of a box belongs to it, the upper does not, as cells do.
            inside &= axis >= -0.5 - SLACK
            inside &= axis < 0.5 - SLACK
        distance[~inside] = np.inf
        order, found = _nearest_first(distance, nearest)
        chosen = np.where(np.isfinite(found), candidate.ravel()[order + (member * candidate.shape[1])[:, None]], NONE)
        if chosen.shape[1] < nearest:
            chosen = np.pad(chosen, ((0, 0), (0, nearest - chosen.shape[1])), constant_values=NONE)
            return chosen, np.isinf(beyond[member])
        return chosen, np.minimum(TIED_M * found[:, -1], self.reach_m) < beyond[member] - TIED_M


def _nearest_first(distance: np.ndarray, nearest: int) -> tuple[np.ndarray, np.ndarray]:
    """(Q, nearest) the columns of the least of each row of `distance (Q, C)`, and these; of two equal ones the lower column comes first."""
    order = np.argsort(distance, axis=1)[:, : nearest + 1]
    start = np.arange(0, distance.size, distance.shape[1])[:, None]
    found = distance.ravel()[order + start]
    # A stable sort takes three times as long, and few rows need one.
    tied = np.flatnonzero(((found[:, 1:] == found[:, :-1]) & (found[:, 1:] < np.inf)).any(axis=1))
    order[tied] = np.argsort(distance[tied], axis=1, kind="stable")[:, : nearest + 1]
    return order[:, :nearest], found[:, :nearest]


def kernel(grids: np.ndarray, frames: Frames, queries: np.ndarray, holding: np.ndarray, interpolated: bool = False) -> np.ndarray:
    """Eq. 7 for Eq. 8: (Q, K) values of `grids (M, n, ..., n)` at `queries (Q, D)`, in the grids `holding (Q, K)`; 0 for `NONE`.

    interpolated: between the middles of the 2^D cells around a query, multilinearly; else the cell that it falls in, as in the paper."""
    return kernels([grids], frames, queries, holding, interpolated)[0]


def kernels(
    several: list[np.ndarray], frames: Frames, queries: np.ndarray, holding: np.ndarray, interpolated: bool = False
) -> list[np.ndarray]:
    """`kernel` of each of several grids of one size, whose cells are found once."""
    values = [np.zeros(holding.shape, np.float32) for _ in several]
    for start in range(0, len(queries), AT_ONCE):
        part = slice(start, start + AT_ONCE)
        _put_kernels([kind[part] for kind in values], several, frames, queries[part], holding[part], interpolated)
    return values


def _put_kernels(values, several, frames, queries, holding, interpolated) -> None:
    """`kernels` of some queries, written into `values`, zeros (Q, K) each."""
    cells = several[0].shape[1]
    place = np.flatnonzero(holding != NONE)
    frame = holding.reshape(-1)[place]
    queries = queries.take(place // holding.shape[1], axis=0)
    if interpolated:
        found = _between(several, frames.into(queries, frame), frame)
    else:
        cell = cell_index(frames, queries, frame, cells, held=True)[0] + frame * cells ** queries.shape[1]
        found = [grids.reshape(-1)[cell] for grids in several]
    for kind, read in zip(values, found, strict=True):
        kind.reshape(-1)[place] = read


def _between(several: list[np.ndarray], places: np.ndarray, frame: np.ndarray) -> list[np.ndarray]:
    """float32 (P,) per grids: the value at `places (P, D)`, of each box from -1/2 to 1/2, in the grid of its `frame (P,)`. Beyond the
    middles of a box's outermost cells these count alone."""
    cells = several[0].shape[1]
    start, beside = frame * cells ** places.shape[1], []
    for axis, along in enumerate(places.T):
        place = (along + 0.5) * cells - 0.5
        below = np.floor(place)
        part = (place - below).astype(np.float32)
        lower, step = below.astype(np.int64), cells ** (places.shape[1] - 1 - axis)
        beside.append([(np.clip(lower + side, 0, cells - 1) * step, part if side else 1 - part) for side in (0, 1)])
    found = [np.zeros(len(frame), np.float32) for _ in several]
    flat = [grids.reshape(-1) for grids in several]
    for corner in itertools.product(*beside[:-1]):
        row, beyond = start.copy(), np.float32(1.0)
        for step, share in corner:
            row += step
            beyond = beyond * share
        for step, share in beside[-1]:
            cell, weight = row + step, beyond * share
            for total, grids in zip(found, flat, strict=True):
                total += weight * grids.take(cell)
    return found
