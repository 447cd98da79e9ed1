"""How sure the votes of a voxel are that it is occupied, or that it is not."""

from __future__ import annotations

import numpy as np

from hilbertvae.cloud import OCCUPIED_SHARE

SURE = (2.0, 0.5)
"""Where distances to the share are cut off, standard deviations: where votes are plain, more of them don't count, and near it they count
most. Others between 1 and 4, and between 0.1 and 1, do the same (docs/decisions.md, "How sure the votes of a voxel are")."""
SHARES = len(SURE) + 1
"""How many features there are."""


def share_features(hits: np.ndarray, frees: np.ndarray) -> np.ndarray:
    """(V, SHARES): by how many standard deviations of a binomial the share of returns among the votes `hits`, `frees (V,)` is above
    `OCCUPIED_SHARE`, with one more vote that is split as this says, cut off at each of `SURE`; and whether no beam ended in the voxel.

    A voxel is called occupied from that share on (METHOD 1), so that where it is far from the share for so many votes a few more change
    nothing. No sum of the logarithms of its odds and of its votes says that (docs/decisions.md, "How sure the votes of a voxel are").
    """
    count = hits + frees + 1
    above = ((hits + OCCUPIED_SHARE) / count - OCCUPIED_SHARE) * np.sqrt(count / (OCCUPIED_SHARE * (1 - OCCUPIED_SHARE)))
    return np.column_stack([*(np.clip(above, -most, most) for most in SURE), hits == 0])
