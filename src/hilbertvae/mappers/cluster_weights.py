"""The classic Hilbert Map's own weight per cluster, refitted on the site that is mapped: factors around the `rank` weights."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix

from hilbertvae.cloud import Cloud
from hilbertvae.gaps import OUTSIDE, random_gaps
from hilbertvae.grids.kernel import NONE
from hilbertvae.mappers.newton_logistic import logistic_weights
from hilbertvae.mappers.weights import RankWeights, disagreement, levelled

HIDDEN_GAP_M = 2.5
"""Diameter of the gaps that are hidden from the network while factors are fitted."""
OWN = 1
"""Beside a mapper's seed, what their places are drawn from."""


def hide_gaps(cloud: Cloud, resolution_m: float, seed: int) -> tuple[Cloud, Cloud]:
    """What of a cloud is outside of gaps drawn at random, and what they hide, on a lattice of `resolution_m`.

    A mapper's seed is that of the gaps it is scored in: drawn from it alone, these would tend to lie where those do.
    """
    own = int(np.random.SeedSequence([seed, OWN]).generate_state(1)[0])
    part = random_gaps(cloud, HIDDEN_GAP_M, resolution_m, seed=own).part(cloud.points)
    return cloud.select(part == OUTSIDE), cloud.select(part != OUTSIDE)


def cluster_factors(values, holding, occupied, weights: RankWeights, clusters: int, ridge: float, occupied_weight=1.0) -> np.ndarray:
    """(M,) factors of `clusters` boxes, from kernel `values (Q, K)` of hidden queries in the boxes `holding (Q, K)` them, -1 for none, and
    whether these are `occupied (Q,)`; an occupied one counts for `occupied_weight`. How far boxes disagree stands in the offset as it is
    with all factors 1.
    """
    held = (holding != NONE).sum(axis=1)
    spread = weights.spread * disagreement(values, held)
    if weights.level:
        values = levelled(values, held)
    offset = np.where(held > 0, weights.unseen[-1] + spread, 0.0)
    counts = np.where(occupied, occupied_weight, 1.0)
    return fit_cluster_weights(values, holding, offset, weights.unseen[:-1], occupied, clusters, ridge, counts)


def fit_cluster_weights(values, holding, offset, rank_weights, occupied, clusters: int, ridge: float, counts=1.0) -> np.ndarray:
    """(M,) non-negative factors u_m, with ridge towards 1, of logit = offset + sum_r w_r u_m(r) k_r. A few hundred sparse features, so all
    queries at once.

    values (Q, K): of the kernel, in the boxes `holding (Q, K)`, -1 for none. offset (Q,), rank_weights (K,), occupied (Q,) bool;
    counts (Q,), or one number: what each query counts for. M is `clusters`.
    """
    query, rank = np.nonzero(holding >= 0)
    data = values[query, rank] * rank_weights[rank]
    features = csr_matrix((data, (query, holding[query, rank])), shape=(len(values), clusters))
    everyone = np.arange(clusters)
    return logistic_weights(features, occupied, nonnegative=everyone, ridge=ridge, towards=np.ones(clusters), offset=offset, counts=counts)
