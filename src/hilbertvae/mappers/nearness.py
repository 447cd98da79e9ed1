"""How far returns are from places around what was seen, for queries that no box holds."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from hilbertvae.cores import workers

NEAR_M = 2.5
"""How far returns are told apart: as far as real occlusion is scored (METHOD 7)."""
SEEN_NEAR_M = 4.0
"""How far from a voxel that was seen there is an answer: farther, since what is scored may have been near beams that were held out."""


class Nearness:
    """Trees over voxels that were seen.

    middles: (V, D) of these in metres. returned: (V,) bool, of which there are returns. bricks: (B, D) the middles of cubes with sides of
    `brick_m` metres that hold all of them.
    """

    def __init__(self, middles: np.ndarray, returned: np.ndarray, bricks: np.ndarray, brick_m: float):
        self._brick_reach_m = SEEN_NEAR_M + 0.5 * brick_m
        # Balanced trees take twice as long to make.
        self._bricks, self._seen, self._returned = (cKDTree(part, balanced_tree=False) for part in (bricks, middles, middles[returned]))

    def away(self, queries: np.ndarray) -> np.ndarray:
        """(Q,) metres from each of `queries (Q, D)` to the middle of the nearest voxel with a return, at most `NEAR_M`; infinite where no
        seen voxel's middle lies within `SEEN_NEAR_M`."""
        threads = workers(len(queries))
        # Far from everything, which a brick tells at once, a search among voxels takes longest.
        boxed = self._bricks.query(queries, p=np.inf, distance_upper_bound=self._brick_reach_m, workers=threads)[0]
        near = np.flatnonzero(np.isfinite(boxed))
        near = near[np.isfinite(self._seen.query(queries[near], distance_upper_bound=SEEN_NEAR_M, workers=threads)[0])]
        away = np.full(len(queries), np.inf)
        away[near] = np.minimum(self._returned.query(queries[near], distance_upper_bound=NEAR_M, workers=threads)[0], NEAR_M)
        return away
