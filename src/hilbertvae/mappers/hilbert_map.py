"""The Hilbert Map over aligned grids: CVAE-HM, CAE-HM, and the raw-grid HM without a reconstruction (paper II-A and III-C).

fit: cloud -> clusters -> aligned grids -> reconstruction -> kernel values; predict: the K nearest grids that hold a query, and what
was observed in its voxel, weighed by logistic regression.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.special import expit
from sklearn.utils.validation import check_is_fitted

from hilbertvae.checks import InputError
from hilbertvae.cloud import RESOLUTION_M, Cloud, labelled_voxels
from hilbertvae.grids.cluster_grids import GridSettings, cloud_clusters, frames_of
from hilbertvae.grids.kernel import NONE, kernels
from hilbertvae.mappers.cluster_weights import cluster_factors, hide_gaps
from hilbertvae.mappers.evidence import Evidence
from hilbertvae.mappers.growing_mapper import GrowingMapper
from hilbertvae.mappers.map_arrays import map_arrays
from hilbertvae.mappers.mapper import Mapper
from hilbertvae.mappers.turns import turn_of
from hilbertvae.mappers.weights import RankWeights, disagreement, learned_weights, unit_weights

if TYPE_CHECKING:  # late: a saved map answers without torch
    from hilbertvae.reconstruction.reconstructor import Reconstructor

FLIPS = {2: 4, 3: 1}
"""Each takes as long as the first, and four bring about 0.001 of AUC over two in 2D, over one in 3D; there a fit takes four times as long
to begin with."""
SHOWN_FROM = {2: 0.5, 3: 0.1}
"""How likely a cell has to be known to be shown in full. In 3D beams are far apart, and few cells are that likely to be met by one."""


class HilbertMap(GrowingMapper):
    """A Hilbert Map whose features are grids, reconstructed by a network if there is one.

    Parameters
    ----------
    reconstructor: a `Reconstructor`, or None for the raw grids (the paper's "naive approach").
    weights: `rank` (learned on the validation site, kept with the network), `unit`, or `cluster` (refitted on this site). Raw grids, and
        a network without learned weights, have `unit` ones in the place of `rank`, and no calibration.
    calibration: the reading that `rank` weights were fitted on: `voxels`, for probabilities, or `points`, for the cut of 0.6.
    neighbours: K, how many grids answer a query. `rank` weights belong to one K: only trainings and scorings learn them for another.
    inner_radius_m: how far clusters stand apart; as in training unless given.
    flips: symmetries over which a reconstruction is averaged, 1, 2, 4 or 8; `FLIPS` of the dimension unless given.
    fill: without, there are no grids, and the map has what was observed alone.
    evidence: whether what was observed in a query's voxel is added; the paper's own map knows only its grids.
    ridge: of the `cluster` rule, towards the `rank` weights.
    grid, resolution_m: as the network was trained, unless given; without one, boxes of some 6.4 m and cells that are voxels. Clouds have to
        be made in cells of the same size: `cloud_from_scans(..., resolution_m=...)`.
    adapt_steps: for how many steps the network goes on learning from the site itself in `fit`, from gaps cut for that (`adaptation.py`).
        50 bring most of what there is to gain, in seconds to half a minute in 2D, by processor; 0, the default, leaves it as it is.
    seed: of where clusters are, which in `fit` follows the order of points, too. device: where the network computes, `cpu` or `cuda`.
    All take effect with the next `fit`; `seed` and `device` also where a map grows.
    """

    def __init__(
        self,
        reconstructor: Reconstructor | None = None,
        weights: str = "rank",
        calibration: str = "voxels",
        neighbours: int = 5,
        inner_radius_m: float | None = None,
        flips: int | None = None,
        evidence: bool = True,
        fill: bool = True,
        ridge: float = 30.0,
        grid: GridSettings | None = None,
        resolution_m: float | None = None,
        seed: int = 0,
        device: str = "cpu",
        adapt_steps: int = 0,
    ):
        self.reconstructor = reconstructor
        self.weights = weights
        self.calibration = calibration
        self.neighbours = neighbours
        self.inner_radius_m = inner_radius_m
        self.flips = flips
        self.evidence = evidence
        self.fill = fill
        self.ridge = ridge
        self.grid = grid
        self.resolution_m = resolution_m
        self.seed = seed
        self.device = device
        self.adapt_steps = adapt_steps

    def _fit(self, points, occupied, weight):
        cloud = Cloud(points, occupied, weight)
        if not self.fill:
            self._start_without_clusters(cloud)
            return
        self._start(cloud)
        cloud = self._as_kept(cloud)
        if self.adapt_steps:
            self.adapted_ = self._adapt(cloud)
        clusters = cloud_clusters(cloud, self.grid_, self.seed)
        self.seeds_, self.frames_ = clusters.seeds, frames_of(clusters, cloud, self.grid_)
        if not len(self.frames_):
            self._warn_without_grids()
        self.factors_ = self._cluster_factors(cloud) if self.weights == "cluster" and len(self.frames_) else None
        completed = self._complete_boxes(cloud, self.frames_)
        self.grids_, self.known_ = completed.value, completed.known

    def _start(self, cloud: Cloud) -> None:
        """Check the settings for clouds like this one, and begin a map with what it observed."""
        network = self.reconstructor
        dimension = cloud.points.shape[1]
        if dimension not in (2, 3):
            raise InputError(f"points: expected 2 or 3 coordinates, got {dimension}")
        self._check_network(dimension)
        self.flips_ = FLIPS[dimension] if self.flips is None else self.flips
        resolution_m = float(self.resolution_m or (network.resolution_m if network else RESOLUTION_M[dimension]))
        self.grid_ = self._own_grid(resolution_m)
        self.evidence_ = Evidence(cloud.points, cloud.occupied, cloud.weight, resolution_m)
        self.evidence_joins_, self.fills_ = bool(self.evidence), bool(self.fill)
        self.rank_weights_ = self._rank_weights()
        self.completes_, self.adapted_, self.small_seeds_, self._growing = network, None, None, None

    def _rank_weights(self) -> RankWeights:
        learned = self.reconstructor.map_weights if self.reconstructor else {}
        features = self.evidence_.feature_count
        if self.weights == "unit" or self.calibration not in learned:  # never learned, or raw grids
            return unit_weights(self.neighbours, features)
        weights = learned_weights(learned[self.calibration], self.neighbours, features, f"the network's weights.{self.calibration}")
        return weights if self.evidence_joins_ else weights.grids_alone()

    def _cluster_factors(self, cloud: Cloud) -> np.ndarray:
        """The `cluster` rule's factors, from gaps hidden from the network for this fit alone: else copying would look like skill."""
        resolution_m = self.evidence_.resolution_m
        kept, hidden = hide_gaps(cloud, resolution_m, self.seed)
        # A cloud to fit has a point per label, and a wall's voxel that beams graze would be asked for both.
        hidden = labelled_voxels(hidden, resolution_m) if self.calibration == "voxels" else hidden
        holding, values = self._look_up(hidden.points, self._complete_boxes(kept, self.frames_).value)
        counted = self.rank_weights_.occupied_weight if self.calibration == "points" else 1.0
        return cluster_factors(values, holding, hidden.occupied, self.rank_weights_, len(self.frames_), self.ridge, counted)

    def features(self, queries: np.ndarray) -> tuple[np.ndarray, ...]:
        """Phi of `queries (Q, D)`: kernel values (Q, K), boxes that hold each (Q,), whether its voxel was seen (Q,) bool, the evidence
        (S, F) of those whose was, and how far away (Q,) returns are from those that no box holds (`Evidence.away`)."""
        with turn_of(self):
            return self._phi(self._checked(queries))[:5]

    def _phi(self, queries: np.ndarray) -> tuple[np.ndarray, ...]:
        *phi, apart = self._features(queries, *self._look_up(queries, self.grids_), self.evidence_.find(queries))
        away, beyond = np.full(len(queries), np.inf), (phi[1] == 0) & ~phi[2] & (self.evidence_joins_ and self.fills_)
        away[beyond] = self.evidence_.away(queries[beyond])
        return *phi, away, apart

    def _look_up(self, queries, *grids):
        """The boxes that hold each query (Q, K), and the kernel values (Q, K) of each of `grids` there."""
        holding = self.index_.holding(queries, self.rank_weights_.neighbours)
        return holding, *kernels(list(grids), self.frames_, queries, holding, self.grid_.interpolated)

    def _features(self, queries, holding, values, voxel):
        held, apart = (holding != NONE).sum(axis=1), None
        if self.factors_ is not None:
            apart = disagreement(values, held)  # of the boxes themselves, as factors are fitted
            values *= np.where(holding != NONE, self.factors_[holding], 0.0)
        seen = (voxel != NONE) & self.evidence_joins_
        return values, held, seen, self.evidence_.features(queries[seen], voxel[seen]), apart

    def _probability(self, queries):
        return expit(self.rank_weights_.logit(*self._phi(queries)))

    def predict_map(self, queries) -> np.ndarray:
        """(Q,) p(occupied), faded to 0.5 where it is less likely than `SHOWN_FROM` that scans would see the cell at all.

        `predict_proba` is p if the cell is known, which is what can be scored; inside walls and below the ground that is an idle guess.
        """
        return self._answer(lambda part: self._shown(part)[0], queries)

    def _shown(self, queries):
        """What `predict_map` says, of which features, and where the evidence has each query."""
        grids = [self.grids_] if self.known_ is None else [self.grids_, self.known_]
        holding, values, *said = self._look_up(queries, *grids)  # in one pass, since both are read at the same cells
        voxel = self.evidence_.find(queries)
        *features, apart = self._features(queries, holding, values, voxel)
        plain = expit(self.rank_weights_.logit(*features, apart=apart))
        fade = np.minimum(self._known_or_seen(voxel, holding, said) / SHOWN_FROM[queries.shape[1]], 1.0)
        return np.where(fade < 1.0, 0.5 + (plain - 0.5) * fade, plain), features, voxel

    def predict_std(self, queries) -> np.ndarray:
        """(Q,) how far the grids that answer each query disagree: the standard deviation of what p(occupied) each alone would give.

        It ranks what the map does not know well from here to there; 0.5, a coin's, where no grid and no evidence answers.
        """
        return self._answer(self._spread, queries)

    def _spread(self, queries):
        return self._spread_of(*self._features(queries, *self._look_up(queries, self.grids_), self.evidence_.find(queries))[:4])

    def _spread_of(self, values, held, seen, evidence):
        alone = expit(self.rank_weights_.logits_alone(values, held, seen, evidence))
        return np.where((held > 0) | seen, disagreement(alone, held), 0.5)

    def describe(self, queries) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As every mapper's; here each query is looked up once."""
        said = self._answer(self._described, queries, columns=3)
        return said[:, 0], said[:, 1], said[:, 2] > 0

    def _described(self, queries):
        shown, features, voxel = self._shown(queries)
        return np.column_stack([shown, self._spread_of(*features), voxel != NONE])

    def cluster_count(self) -> int:
        """How many grids the fitted map has."""
        check_is_fitted(self)
        return len(self.frames_)

    def stored_bytes(self) -> int:
        """Of the arrays that its file has, before they are packed."""
        check_is_fitted(self)
        return sum(array.nbytes for array in map_arrays(self).values())

    def known(self, queries) -> np.ndarray:
        """(Q,) how likely it is that scans of this place would see the cell of each query at all: 1 where they did, 0 far from all that
        they saw, little inside walls and below the ground. A network that was not taught this says 1 wherever a grid of it reaches."""
        return self._answer(self._known, queries)

    def _known(self, queries):
        holding = self.index_.holding(queries, self.rank_weights_.neighbours)
        said = [] if self.known_ is None else kernels([self.known_], self.frames_, queries, holding, self.grid_.interpolated)
        return self._known_or_seen(self.evidence_.find(queries), holding, said)

    def _known_or_seen(self, voxel, holding, said):
        """The mean over the boxes that hold a query; 1 in any box of a network that does not say, and 0 outside of all."""
        held = (holding != NONE).sum(axis=1)
        known = np.minimum(said[0].sum(axis=1) / (255 * np.maximum(held, 1)), 1.0) if said else (held > 0).astype(np.float32)
        return np.where(voxel != NONE, 1.0, known)

    def observed(self, queries) -> np.ndarray:
        """(Q,) bool: whether the voxel of each query was observed."""
        with turn_of(self):
            check_is_fitted(self)
            return self.evidence_.find(Mapper._checked(self, queries)) != NONE  # no grid is asked
