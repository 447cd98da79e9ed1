"""The Hilbert Map's weights: logistic regression on the kernel's features (Eq. 14-16; METHOD 5).

Eq. 14 as printed is p(y = -1), and Eq. 15 has lost its log: here p(y = +1) = 1 / (1 + exp(-w . Phi)) and the loss is
sum log(1 + exp(-y w . Phi)) + R(w).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import csr_matrix, issparse
from scipy.special import expit

from hilbertvae.checks import InputError, check_positive

READINGS = ("voxels", "points")
"""What weights can be fitted on."""
OCCUPIED_WEIGHT = 2.0
"""How many points one that is occupied counts for, in weights learned on points. Those are scored at the cuts (METHOD 5: these weights
calibrate them), and F1 is highest where less than a half is occupied: with 2, the cut of 0.6 lies where 3 of 7 are. Chosen on the
validation sites (docs/decisions.md, "Where the cut of 0.6 lies on points"); 1 is Eq. 15, and a probability then the share of points that
is occupied. Voxels count once each."""
NAMES = ("unseen", "seen", "everywhere", "beyond")
MOST_STEPS, SMALLEST_PACE = 100, 1e-12
NEAR_ZERO = 1e-2
"""A weight that shall not be negative may count as 0 from here on, if a plain gradient step would take some weight as far."""


def check_calibration(calibration: str) -> None:
    """An `InputError` for what no weights are learned for."""
    if calibration not in READINGS:
        raise InputError(f"calibration: expected {' or '.join(READINGS)}, got {calibration!r}")


@dataclass(frozen=True)
class RankWeights:
    """Weights that transfer from one site to another: one per rank among the K nearest boxes, not one per cluster.

    unseen: (K + 1,) where nothing was observed: w_r of the r-th nearest grid's kernel value, and a constant for being in any box.
    seen: (F + 2,) in an observed voxel: the evidence's features, the mean kernel value, and a constant.
    everywhere: (K + 1,), like `unseen` but with a constant of 0, for a map that knows its grids alone, as the paper's does.
    beyond: (2,) of a query that no box holds, though something was seen near it: of `Evidence.away`, per metre, and a constant. What is
    left there is open space, above a street or past a corner, and few cells of it are occupied.
    level: whether fewer than K boxes speak as loudly as K (`levelled`). Else a query at the edge of what was seen, which few boxes hold,
    gets an answer near that of the constant alone.
    There is no other intercept outside of all boxes: where nothing is known, p is 0.5.
    """

    unseen: np.ndarray
    seen: np.ndarray
    everywhere: np.ndarray
    level: bool = True
    beyond: np.ndarray = field(default_factory=lambda: np.zeros(2))
    occupied_weight: float = OCCUPIED_WEIGHT
    """How many points one that is occupied counted for, where they were learned on points."""

    @property
    def neighbours(self) -> int:
        """K."""
        return len(self.unseen) - 1

    def grids_alone(self) -> RankWeights:
        """The weights of a map without evidence: the paper's plain sum."""
        return RankWeights(self.everywhere, self.seen, self.everywhere, level=False, occupied_weight=self.occupied_weight)

    def logit(self, values: np.ndarray, held: np.ndarray, seen: np.ndarray, evidence: np.ndarray, away=np.inf) -> np.ndarray:
        """(Q,) w . Phi for kernel `values (Q, K)`, how many boxes `held (Q,)` each, `evidence (S, F)` of those `seen (Q,)`, and how far
        `away (Q,)` returns are from those that no box holds, infinite where nothing was seen near."""
        # Sums along rows, not a matrix product: BLAS rounds a row differently from batch to batch.
        heard = levelled(values, held) if self.level else values
        logit = np.where(held > 0, (heard * self.unseen[:-1]).sum(axis=1) + self.unseen[-1], self._beyond(away))
        logit[seen] = (seen_features(values[seen], held[seen], evidence) * self.seen).sum(axis=1)
        return logit

    def _beyond(self, away):
        near = np.isfinite(away)
        return np.where(near, np.where(near, away, 0.0) * self.beyond[0] + self.beyond[1], 0.0)

    def logits_alone(self, values: np.ndarray, held: np.ndarray, seen: np.ndarray, evidence: np.ndarray) -> np.ndarray:
        """(Q, K) what `logit` would be if all boxes that hold a query said what each one says; of no use where none holds it."""
        one_by_one = []
        for value in values.T:
            same = np.where(np.arange(values.shape[1]) < held[:, None], value[:, None], 0.0)
            one_by_one.append(self.logit(same, held, seen, evidence))
        return np.stack(one_by_one, axis=1)

    def plain(self) -> dict:
        """As plain values, for JSON."""
        return {name: getattr(self, name).tolist() for name in NAMES} | {"level": self.level, "occupied_weight": self.occupied_weight}

    @classmethod
    def from_plain(cls, plain: dict) -> RankWeights:
        """The inverse of `plain`; an `InputError` for weights of another version. Those that were learned before `beyond` was have 0, and
        those of before `occupied_weight` had `OCCUPIED_WEIGHT`."""
        plain = {"beyond": [0.0, 0.0], "occupied_weight": OCCUPIED_WEIGHT} | plain
        if sorted(plain) != sorted((*NAMES, "level", "occupied_weight")) or not isinstance(plain["level"], bool):
            wanted = ", ".join((*NAMES, "level"))
            raise InputError(f"checkpoint: expected Hilbert Map's weights {wanted}, got {', '.join(plain)}; learned by another version")
        return cls(
            **{name: np.asarray(plain[name], float) for name in NAMES},
            level=plain["level"],
            occupied_weight=float(plain["occupied_weight"]),
        )


def levelled(values: np.ndarray, held: np.ndarray) -> np.ndarray:
    """(Q, K) kernel values, K / held times as large: as if the boxes that do not hold a query had said what the others say on average."""
    return values * (values.shape[1] / np.maximum(held, 1))[:, None]


def seen_features(values: np.ndarray, held: np.ndarray, evidence: np.ndarray) -> np.ndarray:
    """(Q, F + 2): evidence, the mean kernel value of the boxes that hold the query, and a constant."""
    mean = values.sum(axis=1) / np.maximum(held, 1)
    return np.column_stack([evidence, mean, np.ones(len(values))])


def unit_weights(nearest: int, evidence_features: int) -> RankWeights:
    """w = 1 for every grid, as in the author's real-time code; in an observed voxel the evidence's own log-odds is added."""
    seen = np.zeros(evidence_features + 2)
    seen[0], seen[-2] = 1.0, 1.0
    grids = np.append(np.ones(nearest), 0.0)
    return RankWeights(grids, seen, grids, level=False)


def check_occupied_weight(value: float, name: str) -> float:
    """`value` as what an occupied point may count for; an `InputError` for what would leave points of one kind alone."""
    if not 1e-3 <= check_positive(value, name) <= 1e3:
        raise InputError(f"{name}: expected from 0.001 to 1000, got {value!r}")
    return float(value)


def occupied_weight_of(learned: dict[str, dict]) -> float:
    """What an occupied point counted for where a network's plain weights were `learned`; `OCCUPIED_WEIGHT` without any for points."""
    return RankWeights.from_plain(learned["points"]).occupied_weight if "points" in learned else OCCUPIED_WEIGHT


def fit_rank_weights(values, held, seen, evidence, away, occupied, occupied_weight: float = 1.0) -> RankWeights:
    """Rank weights from Q queries with known labels `occupied (Q,)`: kernel weights non-negative, the rest free, a light ridge for R(w).

    values (Q, K), held (Q,), seen (Q,), evidence (S, F), away (Q,): as `HilbertMap.features` has them. Without queries beyond all boxes,
    `beyond` stays 0. An occupied query counts for `occupied_weight` of them. Raises `InputError` without queries both seen and unseen.
    """
    unseen, inside = ~seen & (held > 0), held > 0
    if not unseen.any() or not seen.any():
        raise InputError("rank weights: expected queries both in gaps and in observed voxels")
    ranks = np.arange(values.shape[1])
    counts = np.where(occupied, occupied_weight, 1.0)
    features = np.column_stack([levelled(values, held), np.ones(len(values))])
    in_gaps = logistic_weights(features[unseen], occupied[unseen], nonnegative=ranks, counts=counts[unseen])
    # No constant here: the paper's grids say 0 where they know nothing, and there p must be 0.5.
    everywhere = np.append(logistic_weights(values[inside], occupied[inside], nonnegative=ranks, counts=counts[inside]), 0.0)
    features = seen_features(values[seen], held[seen], evidence)
    observed = logistic_weights(features, occupied[seen], nonnegative=np.array([0, features.shape[1] - 2]), counts=counts[seen])
    alone = ~seen & ~inside & np.isfinite(away)
    # With a ridge that a few free queries don't outweigh: they make nothing certain.
    features = np.column_stack([away[alone], np.ones(np.count_nonzero(alone))])
    beyond = logistic_weights(features, occupied[alone], nonnegative=[], ridge=1.0, counts=counts[alone])
    return RankWeights(in_gaps, observed, everywhere, beyond=beyond, occupied_weight=float(occupied_weight))


def fit_cluster_weights(values, holding, offset, rank_weights, occupied, clusters: int, ridge: float, counts=1.0) -> np.ndarray:
    """(M,) non-negative factors u_m, with ridge towards 1, of logit = offset + sum_r w_r u_m(r) k_r: the classic Hilbert Map's own
    weight per cluster, around the `rank` value. A few hundred sparse features, so all queries at once.

    values (Q, K): of the kernel, in the boxes `holding (Q, K)`, -1 for none. offset (Q,), rank_weights (K,), occupied (Q,) bool;
    counts (Q,), or one number: what each query counts for. M is `clusters`.
    """
    query, rank = np.nonzero(holding >= 0)
    data = values[query, rank] * rank_weights[rank]
    features = csr_matrix((data, (query, holding[query, rank])), shape=(len(values), clusters))
    everyone = np.arange(clusters)
    return logistic_weights(features, occupied, nonnegative=everyone, ridge=ridge, towards=np.ones(clusters), offset=offset, counts=counts)


def logistic_weights(features, occupied, nonnegative, ridge: float = 1e-3, towards=None, offset=0.0, counts=1.0) -> np.ndarray:
    """w (F,) that minimises the sum over queries of `counts (N,)` log(1 + exp(-y (offset + w . Phi))) + ridge |w - towards|^2.

    Convex, with few features, which say nearly the same: Newton's method reaches in ten steps the optimum that SGD (Eq. 16) would wander
    around. Weights that shall not be negative are projected (Bertsekas 1982): one at 0, or about to be, that its gradient presses there
    is left out of the system of equations, and takes a plain gradient step. Features may be sparse.
    """
    sign, features = np.where(occupied, 1.0, -1.0), features.astype(np.float64)
    count = features.shape[1]
    towards = np.zeros(count) if towards is None else towards
    bounded = np.isin(np.arange(count), nonnegative)

    def loss(weights):
        margin = sign * (features @ weights + offset)
        return (counts * np.logaddexp(0, -margin)).sum() + ridge * np.square(weights - towards).sum(), margin

    weights = np.where(bounded, np.maximum(towards, 0.1), 0.0)
    value, margin = loss(weights)
    for _ in range(MOST_STEPS):
        wrong = expit(-margin)
        gradient = features.T @ (-sign * counts * wrong) + 2 * ridge * (weights - towards)
        bend = (counts * wrong * (1 - wrong))[:, None]
        hessian = (features.T @ features.multiply(bend)).toarray() if issparse(features) else features.T @ (features * bend)
        hessian += 2 * ridge * np.eye(count)
        step = gradient / np.diag(hessian)
        plain = np.where(bounded, np.minimum(step, weights), step)
        # The margin shrinks as the optimum nears. Without one, a weight just above 0 stops every step that would take it below.
        free = ~(bounded & (weights <= min(NEAR_ZERO, np.abs(plain).max())) & (gradient > 0))
        step[free] = np.linalg.solve(hessian[np.ix_(free, free)], gradient[free])
        pace, before = 1.0, value
        while pace > SMALLEST_PACE:
            tried = np.where(bounded, np.maximum(weights - pace * step, 0.0), weights - pace * step)
            value, margin = loss(tried)
            if value <= before - 1e-4 * gradient @ (weights - tried):
                break
            pace /= 2
        else:  # no step is small enough to help: the optimum, to rounding
            return weights
        moved, weights = np.abs(tried - weights).max(), tried
        if moved <= 1e-10 * (1 + np.abs(weights).max()):
            break
    return weights
