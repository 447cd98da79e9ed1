"""Lloyd's iterations of k-means, and the potential that they lower (the paper's Fig. 2b)."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from hilbertvae.checks import check_points, check_whole
from hilbertvae.sums import sums_by


def lloyd(points: np.ndarray, seeds: np.ndarray, iterations: int) -> tuple[np.ndarray, list[float]]:
    """Centres (M, D) after some iterations from `seeds (M, D)`, and the potential before the first and after each of them.

    The potential is the sum of squared distances (m^2) of `points (N, D)` to their nearest centre. An iteration moves each centre to the
    mean of the points nearest to it; one to which none is nearest stays.
    """
    points = check_points(points, "points")
    centres = check_points(seeds, "seeds", dimension=points.shape[1])
    check_whole(iterations, "iterations")
    away, nearest = cKDTree(centres).query(points)
    potentials = [float(np.square(away).sum())]
    for _ in range(iterations):
        centres = _means(points, nearest, centres)
        away, nearest = cKDTree(centres).query(points)
        potentials.append(float(np.square(away).sum()))
    return centres, potentials


def _means(points: np.ndarray, nearest: np.ndarray, centres: np.ndarray) -> np.ndarray:
    """(M, D) means of the points of each centre, or the centre itself for one without."""
    size = np.bincount(nearest, minlength=len(centres))
    moved = points - centres[nearest]  # from the centre, so that large coordinates cost no digits
    away = sums_by(nearest, moved, len(centres))
    return centres + away / np.maximum(size, 1)[:, None]
