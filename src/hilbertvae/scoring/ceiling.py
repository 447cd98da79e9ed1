"""What a map of labelled cells says at best that has seen everything (METHOD 7)."""

from __future__ import annotations

import numpy as np

from hilbertvae.scoring.cases import voxel_keys
from hilbertvae.scoring.metrics import score
from hilbertvae.site import Site


def ceiling(site: Site) -> dict[str, dict[str, float]]:
    """Precision and recall on held-out beams, by reading, of the best vote of all beams at the map's own cell size. A reading in which
    they met nothing has none."""
    found = {}
    for reading, cloud, held_out in (("points", site.points, site.points_held_out), ("voxels", site.voxels, site.voxels_held_out)):
        if not cloud.occupied[held_out].any():
            continue  # 0 / 0 would say that nobody can do better
        _, cell = np.unique(voxel_keys(cloud.points, site), return_inverse=True)
        hits = np.bincount(cell, weights=cloud.occupied)
        best = (2 * hits >= np.bincount(cell))[cell]
        scores = score(cloud.occupied[held_out], best[held_out].astype(float))
        found[reading] = {"precision": scores["precision"], "recall": scores["recall"]}
    return found
