"""The kernel of Eq. 7 and its sparse feature vector of Eq. 8: queries looked up in the K nearest grids whose box holds them.

A reconstructed grid is never resampled: the query is mapped into the frame and the cell it falls in is read.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from hilbertvae.grids.aligned_grid import cell_index
from hilbertvae.grids.frame import Frames

CANDIDATES = 12
"""Frames near a patch that are tried for each query in it; a query that they can't settle is searched alone."""
NONE = -1


class FrameIndex:
    """Finds, for any queries, the K nearest frames (by centre) whose box holds each."""

    def __init__(self, frames: Frames):
        self.frames = frames
        self.tree = cKDTree(frames.centre) if len(frames) else None
        self.half = frames.scale / 2
        self.reach_m = float((self.half * np.sqrt(frames.centre.shape[1])).max(initial=0.0))

    def holding(self, queries: np.ndarray, nearest: int) -> np.ndarray:
        """(Q, nearest) int64: frame numbers, the nearest first, `NONE` where fewer boxes hold the query.

        Queries are gathered into patches, and each patch asks the tree once: its nearest frames are the candidates of all its
        queries. A frame that is no candidate is farther from the patch's middle than the last candidate, which settles most
        queries; the others widen the search. So the answer is exact, and the same for any batch.
        """
        if self.tree is None or not len(queries):
            return np.full((len(queries), nearest), NONE, np.int64)
        size = self.reach_m / 16
        patch = np.floor(queries / size).astype(np.int64)
        low = patch.min(axis=0)
        key = np.ravel_multi_index(tuple((patch - low).T), tuple(patch.max(axis=0) - low + 1))
        _, first, member = np.unique(key, return_index=True, return_inverse=True)
        middle = (patch[first] + 0.5) * size
        slack = size * np.sqrt(queries.shape[1]) / 2

        count = min(max(CANDIDATES, 2 * nearest), len(self.frames))
        distance, candidate = self._nearest_to(middle, count)
        chosen, settled = self._choose(queries, candidate[member], distance[member, -1] - slack, nearest)
        while not settled.all():
            count = min(4 * count, len(self.frames))
            left = np.flatnonzero(~settled)
            distance, candidate = self._nearest_to(queries[left], count)
            chosen[left], settled[left] = self._choose(queries[left], candidate, distance[:, -1], nearest)
        return chosen

    def _nearest_to(self, points: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
        distance, index = self.tree.query(points, k=np.arange(1, count + 1), workers=-1)
        if count == len(self.frames):
            distance[:, -1] = np.inf  # there is no other frame
        return distance, index

    def _choose(self, queries, candidate, beyond, nearest):
        """The `nearest` holding candidates (C, nearest) of each query, and whether no frame farther than `beyond` can be among them."""
        moved = queries[:, None, :] - self.frames.centre[candidate]
        distance = np.sqrt(np.einsum("qkd,qkd->qk", moved, moved))
        if self.frames.turned:
            moved = np.einsum("qkd,qkde->qke", moved, self.frames.rotation[candidate])
        # The lower side of a box belongs to it, the upper does not, as cells do.
        scaled = moved / self.frames.scale[candidate][..., None]
        holds = ((scaled >= -0.5 - 1e-12) & (scaled < 0.5 - 1e-12)).all(axis=2)
        distance[~holds] = np.inf
        order = np.argsort(distance, axis=1, kind="stable")[:, :nearest]
        found = np.take_along_axis(distance, order, axis=1)
        chosen = np.where(np.isfinite(found), np.take_along_axis(candidate, order, axis=1), NONE)
        if chosen.shape[1] < nearest:
            chosen = np.pad(chosen, ((0, 0), (0, nearest - chosen.shape[1])), constant_values=NONE)
            return chosen, np.isinf(beyond)
        return chosen, np.minimum(found[:, -1], self.reach_m) < beyond


def kernel(grids: np.ndarray, frames: Frames, queries: np.ndarray, holding: np.ndarray) -> np.ndarray:
    """Eq. 7 for Eq. 8: (Q, K) values of `grids (M, n, ..., n)` at `queries (Q, D)`, in the grids `holding (Q, K)`; 0 for `NONE`."""
    cells = grids.shape[1]
    values = np.zeros(holding.shape, np.float32)
    query, rank = np.nonzero(holding != NONE)
    frame = holding[query, rank]
    cell, inside = cell_index(frames, queries[query], frame, cells)
    flat = grids.reshape(len(grids), -1)
    values[query[inside], rank[inside]] = flat[frame[inside], cell[inside]]
    return values
