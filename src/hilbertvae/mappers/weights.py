"""The Hilbert Map's weights: logistic regression on the kernel's features (Eq. 14-16; METHOD 5).

Eq. 14 as printed is p(y = -1), and Eq. 15 has lost its log: here p(y = +1) = 1 / (1 + exp(-w . Phi)) and the loss is
sum log(1 + exp(-y w . Phi)) + R(w).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hilbertvae.checks import InputError, check_positive
from hilbertvae.cloud import READINGS
from hilbertvae.mappers.newton_logistic import LIGHT_RIDGE, logistic_weights

OCCUPIED_WEIGHT = 2.0
"""How many points one that is occupied counts for, in weights learned on points. Those are scored at the cuts (METHOD 7), and F1 is
highest where less than a half is occupied: with 2, the cut of 0.6 lies where 3 of 7 are. Chosen on the validation sites (docs/decisions.md,
"Where the cut of 0.6 lies on points"); 1 is Eq. 15, and a probability then the share of points that is occupied. Voxels count once each."""
NAMES = ("unseen", "seen", "everywhere", "beyond")
KEYS = (*NAMES, "level", "spread", "occupied_weight")
RANKS_ALIKE = 0.03
"""Per query, of the ridge that holds the weights of ranks together. K boxes say nearly the same, so which of them is heard is left to the
accidents of one site, and others pay for it (docs/decisions.md, "Weights that hold on other sites")."""
SOBER = 1e-5
"""Per query, of the ridge in observed voxels. Distances to returns say nearly the same, too: without it their weights reach -24 and +11,
and where another site's voxels were seen once, with no return near, free space became walls (same entry)."""


def check_calibration(calibration: str) -> None:
    """An `InputError` for what no weights are learned for."""
    if calibration not in READINGS:
        raise InputError(f"calibration: expected {' or '.join(READINGS)}, got {calibration!r}")


@dataclass(frozen=True)
class RankWeights:
    """Weights that transfer from one site to another: one per rank among the K nearest boxes, not one per cluster.

    unseen: (K + 1,) where nothing was observed: w_r of the r-th nearest grid's kernel value, and a constant for being in any box.
    spread: there, too, of how far the boxes disagree (`disagreement`).
    seen: (F + 2,) in an observed voxel: the evidence's features, the mean kernel value, and a constant.
    everywhere: (K + 1,), like `unseen` but with a constant of 0, for a map that knows its grids alone, as the paper's does.
    beyond: (2,) of a query that no box holds, though something was seen near it: of `Evidence.away`, per metre, and a constant. What is
    left there is open space, above a street or past a corner, and few cells of it are occupied; of points, which are where something is,
    more are (`scoring/calibration.py`).
    level: whether fewer than K boxes speak as loudly as K (`levelled`). Else a query at the edge of what was seen, which few boxes hold,
    gets an answer near that of the constant alone.
    There is no other intercept outside of all boxes: where nothing is known, p is 0.5.
    """

    unseen: np.ndarray
    seen: np.ndarray
    everywhere: np.ndarray
    level: bool = True
    beyond: np.ndarray = field(default_factory=lambda: np.zeros(2))
    spread: float = 0.0
    occupied_weight: float = OCCUPIED_WEIGHT
    """How many points one that is occupied counted for, where they were learned on points."""

    @property
    def neighbours(self) -> int:
        """K."""
        return len(self.unseen) - 1

    def checked(self, neighbours: int, features: int, key: str) -> RankWeights:
        """Itself; an `InputError` that begins with `key` for weights that are not those of so many neighbours and features."""
        wanted = unit_weights(neighbours, features)  # has the shapes of any
        for name in NAMES:
            found, shape = getattr(self, name), getattr(wanted, name).shape
            if found.shape != shape or not np.isfinite(found).all():
                raise InputError(f"{key}.{name}: expected {shape} finite numbers, got shape {found.shape}")
        if not np.isfinite(self.spread):
            raise InputError(f"{key}.spread: expected a finite number, got {self.spread!r}")
        return self

    def grids_alone(self) -> RankWeights:
        """The weights of a map without evidence: the paper's plain sum."""
        return RankWeights(self.everywhere, self.seen, self.everywhere, level=False, occupied_weight=self.occupied_weight)

    def logit(self, values: np.ndarray, held: np.ndarray, seen: np.ndarray, evidence: np.ndarray, away=np.inf, apart=None) -> np.ndarray:
        """(Q,) w . Phi for kernel `values (Q, K)`, how many boxes `held (Q,)` each, `evidence (S, F)` of those `seen (Q,)`, and how far
        `away (Q,)` returns are from those that no box holds, infinite where nothing was seen near. apart (Q,): how far boxes disagree, if
        not as `values` do, which a map's own factors have changed."""
        # Sums along rows, not a matrix product: BLAS rounds a row differently from batch to batch.
        heard = levelled(values, held) if self.level else values
        inside = (heard * self.unseen[:-1]).sum(axis=1) + self.unseen[-1]
        if self.spread:
            unseen = ~seen & (held > 0)
            inside[unseen] += self.spread * (disagreement(values[unseen], held[unseen]) if apart is None else apart[unseen])
        logit = np.where(held > 0, inside, self._beyond(away))
        logit[seen] = (seen_features(values[seen], held[seen], evidence) * self.seen).sum(axis=1)
        return logit

    def _beyond(self, away):
        near = np.isfinite(away)
        return np.where(near, np.where(near, away, 0.0) * self.beyond[0] + self.beyond[1], 0.0)

    def logits_alone(self, values: np.ndarray, held: np.ndarray, seen: np.ndarray, evidence: np.ndarray) -> np.ndarray:
        """(Q, K) what `logit` would be if all boxes that hold a query said what each one says, and so agreed; of no use where none holds
        it."""
        loudness = np.append(0.0, np.cumsum(self.unseen[:-1]))[held]  # of as many ranks as hold it
        loudness *= self.neighbours / np.maximum(held, 1) if self.level else 1.0
        alone = values * loudness[:, None] + self.unseen[-1]
        observed = seen_features(np.zeros_like(values[seen]), held[seen], evidence) * self.seen
        alone[seen] = observed.sum(axis=1)[:, None] + values[seen] * self.seen[-2]
        return alone

    def plain(self) -> dict:
        """As plain values, for JSON."""
        plain = {name: getattr(self, name).tolist() for name in NAMES}
        return plain | {"level": self.level, "spread": self.spread, "occupied_weight": self.occupied_weight}

    @classmethod
    def from_plain(cls, plain: dict) -> RankWeights:
        """The inverse of `plain`; an `InputError` for weights of another version."""
        if sorted(plain) != sorted(KEYS) or not isinstance(plain["level"], bool):
            got = ", ".join(plain)
            raise InputError(f"checkpoint: expected Hilbert Map's weights {', '.join(KEYS)}, got {got}; learned by another version")
        arrays = {name: np.asarray(plain[name], float) for name in NAMES}
        return cls(**arrays, level=plain["level"], spread=float(plain["spread"]), occupied_weight=float(plain["occupied_weight"]))


def levelled(values: np.ndarray, held: np.ndarray) -> np.ndarray:
    """(Q, K) kernel values, K / held times as large: as if the boxes that do not hold a query had said what the others say on average."""
    return values * (values.shape[1] / np.maximum(held, 1))[:, None]


def disagreement(values: np.ndarray, held: np.ndarray) -> np.ndarray:
    """(Q,) the standard deviation of what the boxes that hold each query say, `values (Q, K)`; 0 where none does."""
    inside, count = np.arange(values.shape[1]) < held[:, None], np.maximum(held, 1)
    values = values.astype(np.float64)
    mean = np.where(inside, values, 0.0).sum(axis=1) / count
    return np.sqrt(np.where(inside, np.square(values - mean[:, None]), 0.0).sum(axis=1) / count)


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


def learned_weights(plain: dict, neighbours: int, features: int, key: str) -> RankWeights:
    """A network's plain weights, for a map of so many neighbours and features; an `InputError` where they were learned for others."""
    weights = RankWeights.from_plain(plain)
    if weights.unseen.shape == weights.everywhere.shape == (weights.unseen.size,) != (neighbours + 1,):
        ways = "any other goes with weights=unit"
        raise InputError(f"neighbours: the weights were learned for {weights.neighbours}, got {neighbours}; {ways}")
    if weights.seen.size != features + 2:
        raise InputError("checkpoint: the Hilbert Map's weights were learned by another version; train again")
    return weights.checked(neighbours, features, key)


def check_learned(learned: dict[str, dict]) -> None:
    """An `InputError` for plain weights, by reading, that are no map's: else a map fails, or answers nonsense, when it is made."""
    for reading, plain in learned.items():
        key = f"weights.{reading}"
        try:
            weights = RankWeights.from_plain(plain)
        except (TypeError, ValueError) as error:
            raise InputError(f"{key}: {error}") from error
        weights.checked(max(weights.unseen.size - 1, 0), max(weights.seen.size - 2, 0), key)


def occupied_weight_of(learned: dict[str, dict]) -> float:
    """What an occupied point counted for where a network's plain weights were `learned`; `OCCUPIED_WEIGHT` without any for points."""
    return RankWeights.from_plain(learned["points"]).occupied_weight if "points" in learned else OCCUPIED_WEIGHT


def fit_rank_weights(values, held, seen, evidence, away, occupied, occupied_weight: float = 1.0, spread: bool = False) -> RankWeights:
    """Rank weights from Q queries with known labels `occupied (Q,)`: kernel weights non-negative, the rest free; R(w) is a light ridge,
    one more that holds the weights of ranks together (`RANKS_ALIKE`), and one more in observed voxels (`SOBER`).

    values (Q, K), held (Q,), seen (Q,), evidence (S, F), away (Q,): as `HilbertMap.features` has them. Without queries beyond all boxes,
    `beyond` stays 0, and so does `spread` unless it is asked for. An occupied query counts for `occupied_weight` of them. Raises
    `InputError` without queries both seen and unseen.
    """
    unseen, inside = ~seen & (held > 0), held > 0
    if not unseen.any() or not seen.any():
        raise InputError("rank weights: expected queries both in gaps and in observed voxels")
    ranks = np.arange(values.shape[1])
    counts = np.where(occupied, occupied_weight, 1.0)
    features = [levelled(values, held), np.ones(len(values)), *([disagreement(values, held)] if spread else [])]
    features = np.column_stack(features)[unseen]
    alike = _ranks_alike(len(ranks), features.shape[1], counts[unseen].sum())
    in_gaps = logistic_weights(features, occupied[unseen], nonnegative=ranks, ridge=alike, counts=counts[unseen])
    # No constant here: the paper's grids say 0 where they know nothing, and there p must be 0.5.
    alike = _ranks_alike(len(ranks), len(ranks), counts[inside].sum())
    everywhere = logistic_weights(values[inside], occupied[inside], nonnegative=ranks, ridge=alike, counts=counts[inside])
    features = seen_features(values[seen], held[seen], evidence)
    sober, kernels = LIGHT_RIDGE + SOBER * counts[seen].sum(), np.array([0, features.shape[1] - 2])
    observed = logistic_weights(features, occupied[seen], nonnegative=kernels, ridge=sober, counts=counts[seen])
    alone = ~seen & ~inside & np.isfinite(away)
    # With a ridge that a few free queries don't outweigh: they make nothing certain.
    features = np.column_stack([away[alone], np.ones(np.count_nonzero(alone))])
    beyond = logistic_weights(features, occupied[alone], nonnegative=[], ridge=1.0, counts=counts[alone])
    return RankWeights(
        in_gaps[: len(ranks) + 1],
        observed,
        np.append(everywhere, 0.0),
        beyond=beyond,
        spread=float(in_gaps[-1]) if spread else 0.0,
        occupied_weight=float(occupied_weight),
    )


def _ranks_alike(ranks: int, features: int, queries: float) -> np.ndarray:
    """(F, F) the ridge for the first `ranks` of the features: a light one, and `RANKS_ALIKE` on the squares of what is not their mean."""
    ridge = np.eye(features) * LIGHT_RIDGE
    ridge[:ranks, :ranks] += RANKS_ALIKE * queries * (np.eye(ranks) - 1.0 / ranks)
    return ridge
