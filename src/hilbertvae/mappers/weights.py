"""The Hilbert Map's weights: logistic regression on the kernel's features (Eq. 14-16; METHOD 5).

Eq. 14 as printed is p(y = -1), and Eq. 15 has lost its log: here p(y = +1) = 1 / (1 + exp(-w . Phi)) and the loss is
sum log(1 + exp(-y w . Phi)) + R(w).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import minimize
from scipy.sparse import csr_matrix
from scipy.special import expit

from hilbertvae.checks import InputError

NAMES = ("unseen", "seen", "everywhere", "known", "enough")
LATER = ("known", "enough")
"""Weights of before networks said what would be known have none of these."""
FADED_SHARE = 0.02
"""Share of the hidden queries that weights are learned from whose logit fades: all of them are known, so it should be next to none."""


@dataclass(frozen=True)
class RankWeights:
    """Weights that transfer from one site to another: one per rank among the K nearest boxes, not one per cluster.

    unseen: (K + 1,) where nothing was observed: w_r of the r-th nearest grid's kernel value, and a constant for being in any box.
    seen: (F + 2,) in an observed voxel: the evidence's features, the mean kernel value, and a constant.
    everywhere: (K + 1,), like `unseen` but with a constant of 0, for a map that knows its grids alone, as the paper's does.
    known: (2,) where nothing was observed, of how likely it is that a scan would have seen the cell, and of that times the mean kernel
    value: a gap is surer to be known than what lies behind things, and what a network says of it is worth more.
    enough: (1,) the probability of being known below which a cell's logit fades to 0: what a network makes of cells that no scan would see,
    inside walls and below the ground, is arbitrary.
    There is no intercept outside of all boxes: where nothing is known, p is 0.5.
    """

    unseen: np.ndarray
    seen: np.ndarray
    everywhere: np.ndarray
    known: np.ndarray = field(default_factory=lambda: np.zeros(2))
    enough: np.ndarray = field(default_factory=lambda: np.zeros(1))

    def grids_alone(self) -> RankWeights:
        """The weights of a map without evidence."""
        return RankWeights(self.everywhere, self.seen, self.everywhere)

    def logit(self, values: np.ndarray, held: np.ndarray, known: np.ndarray, seen: np.ndarray, evidence: np.ndarray) -> np.ndarray:
        """(Q,) w . Phi for kernel `values (Q, K)`, how many boxes `held (Q,)` each, how likely it would be `known (Q,)`, and `evidence
        (S, F)` of those `seen (Q,)`.
        """
        # Sums along rows, not a matrix product: BLAS rounds a row differently from batch to batch.
        logit = (values * self.unseen[:-1]).sum(axis=1) + self.unseen[-1] + (known_features(values, held, known) * self.known).sum(axis=1)
        logit = np.where(held > 0, logit * np.minimum(known / np.maximum(self.enough, 1e-9), 1.0), 0.0)
        logit[seen] = (seen_features(values[seen], held[seen], evidence) * self.seen).sum(axis=1)
        return logit

    def logits_alone(self, values: np.ndarray, held: np.ndarray, known: np.ndarray, seen: np.ndarray, evidence: np.ndarray) -> np.ndarray:
        """(Q, K) what `logit` would be if all boxes that hold a query said what each one says; of no use where none holds it."""
        one_by_one = []
        for value in values.T:
            same = np.where(np.arange(values.shape[1]) < held[:, None], value[:, None], 0.0)
            one_by_one.append(self.logit(same, held, known, seen, evidence))
        return np.stack(one_by_one, axis=1)

    def plain(self) -> dict:
        """As lists, for JSON."""
        return {name: getattr(self, name).tolist() for name in NAMES}

    @classmethod
    def from_plain(cls, plain: dict) -> RankWeights:
        """The inverse of `plain`; an `InputError` for weights of another version."""
        try:
            return cls(*(np.asarray(plain[name], float) for name in NAMES if name not in LATER or name in plain))
        except KeyError as error:
            raise InputError(f"checkpoint: the Hilbert Map's weights lack {error}; they were learned by another version") from error


def known_features(values: np.ndarray, held: np.ndarray, known: np.ndarray) -> np.ndarray:
    """(Q, 2): how likely a cell would be known, and that times the mean kernel value of the boxes that hold the query."""
    return np.column_stack([known, known * values.sum(axis=1) / np.maximum(held, 1)])


def seen_features(values: np.ndarray, held: np.ndarray, evidence: np.ndarray) -> np.ndarray:
    """(Q, F + 2): evidence, the mean kernel value of the boxes that hold the query, and a constant."""
    mean = values.sum(axis=1) / np.maximum(held, 1)
    return np.column_stack([evidence, mean, np.ones(len(values))])


def unit_weights(nearest: int, evidence_features: int) -> RankWeights:
    """w = 1 for every grid, as in the author's real-time code; in an observed voxel the evidence's own log-odds is added."""
    seen = np.zeros(evidence_features + 2)
    seen[0], seen[-2] = 1.0, 1.0
    grids = np.append(np.ones(nearest), 0.0)
    return RankWeights(grids, seen, grids)


def fit_rank_weights(values, held, known, seen, evidence, occupied) -> RankWeights:
    """Rank weights from queries with known labels: kernel weights non-negative, the rest free, a light ridge for R(w)."""
    unseen, inside = ~seen & (held > 0), held > 0
    if not unseen.any() or not seen.any():
        raise InputError("rank weights: expected queries both in gaps and in observed voxels")
    ranks = values.shape[1]
    features = np.column_stack([values, np.ones(len(values)), known_features(values, held, known)])
    in_gaps = logistic_weights(features[unseen], occupied[unseen], nonnegative=np.append(np.arange(ranks), ranks + 2))
    # No constant here: the paper's grids say 0 where they know nothing, and there p must be 0.5.
    everywhere = np.append(logistic_weights(values[inside], occupied[inside], nonnegative=np.arange(ranks)), 0.0)
    features = seen_features(values[seen], held[seen], evidence)
    observed = logistic_weights(features, occupied[seen], nonnegative=np.array([0, features.shape[1] - 2]))
    enough = np.quantile(known[unseen], [FADED_SHARE])
    return RankWeights(in_gaps[: ranks + 1], observed, everywhere, in_gaps[ranks + 1 :], enough)


def fit_cluster_weights(values, holding, offset, rank_weights: np.ndarray, occupied, clusters: int, ridge: float) -> np.ndarray:
    """(M,) non-negative factors u_m, with ridge towards 1, of logit = offset + sum_r w_r u_m(r) k_r: the classic Hilbert Map's own
    weight per cluster, around the `rank` value. A few hundred sparse features, so all queries at once."""
    query, rank = np.nonzero(holding >= 0)
    data = values[query, rank] * rank_weights[rank]
    features = csr_matrix((data, (query, holding[query, rank])), shape=(len(values), clusters))
    everyone = np.arange(clusters)
    return logistic_weights(features, occupied, nonnegative=everyone, ridge=ridge, towards=np.ones(clusters), offset=offset)


def logistic_weights(features, occupied, nonnegative, ridge: float = 1e-3, towards=None, offset=0.0) -> np.ndarray:
    """w (F,) that minimises the sum over queries of log(1 + exp(-y (offset + w . Phi))) + ridge |w - towards|^2.

    Convex, with few features: L-BFGS reaches the optimum that SGD (Eq. 16) would wander around. Features may be sparse.
    """
    sign = np.where(occupied, 1.0, -1.0)
    count = features.shape[1]
    towards = np.zeros(count) if towards is None else towards

    def loss(weights):
        margin = sign * (features @ weights + offset)
        gradient = features.T @ (-sign * expit(-margin)) + 2 * ridge * (weights - towards)
        return np.logaddexp(0, -margin).sum() + ridge * np.square(weights - towards).sum(), gradient

    start = np.where(np.isin(np.arange(count), nonnegative), np.maximum(towards, 0.1), 0.0)
    bounds = [(0, None) if i in set(nonnegative.tolist()) else (None, None) for i in range(count)]
    return minimize(loss, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 500}).x
