"""OctoMap, over the plane as one layer of its voxels: fed labelled points, not rays, which would carve the gaps (METHOD 6)."""

from __future__ import annotations

import numpy as np
import octomap


class OctoMapLayer:
    """An `octomap.OcTree` of 2D or 3D points, with its own defaults."""

    def __init__(self, points: np.ndarray, occupied: np.ndarray, resolution_m: float):
        self.tree = octomap.OcTree(resolution_m)
        self.height_m = resolution_m / 2
        for hit in (False, True):
            self.tree.updateNodes(self._lifted(points[occupied == hit]), hit)

    def labels(self, queries: np.ndarray) -> np.ndarray:
        """(Q,) 1 occupied, 0 free, -1 unknown: OctoMap's own look-up of a batch."""
        return self.tree.getLabels(self._lifted(queries))

    def _lifted(self, points: np.ndarray) -> np.ndarray:
        if points.shape[1] == 3:
            return points
        return np.column_stack([points, np.full(len(points), self.height_m)])
