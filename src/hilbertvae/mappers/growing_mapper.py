"""A map of grids that is fitted scan by scan: the part of the Hilbert Map that knows how it grows."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from threading import Lock
from weakref import WeakKeyDictionary

import numpy as np
from sklearn.utils.validation import check_is_fitted

from hilbertvae.checks import InputError
from hilbertvae.cloud import Cloud
from hilbertvae.grids.frame import Frames
from hilbertvae.grids.kernel import FrameIndex
from hilbertvae.mappers.completing_mapper import CompletingMapper
from hilbertvae.mappers.growing_clusters import GrowingClusters
from hilbertvae.mappers.mapper import answer_in_chunks
from hilbertvae.mappers.turns import turn_of
from hilbertvae.reconstruction.completion import Completion
from hilbertvae.signals import to_its_end

GROWN = ("seeds_", "small_seeds_", "frames_", "grids_", "known_")
"""What a map shows of its growing clusters."""
_ONE_AT_A_TIME = Lock()
_INDEXES: WeakKeyDictionary[GrowingMapper, FrameIndex] = WeakKeyDictionary()
"""What finds a map's boxes, beside it: to ask a map changes nothing in it."""


class GrowingMapper(CompletingMapper):
    """Base of `HilbertMap`, which has `_start`; `fit` and `load_map` set the same attributes as this."""

    _growing: GrowingClusters | None = None

    @property
    def index_(self) -> FrameIndex:
        """Finds the boxes that hold a query; made when first asked for, since scans alter the boxes, by one of the threads that ask."""
        with _ONE_AT_A_TIME:
            if (found := _INDEXES.get(self)) is None or found.frames is not self.frames_:
                found = _INDEXES[self] = FrameIndex(self.frames_)
            return found

    def partial_fit(self, points, y, sample_weight=None, reconstruct=True, classes=None):
        """Add a scan to the map, or begin one, and reconstruct the clusters that it touches. Arguments as of `fit`; one class is enough.

        Give each scan as `cloud_from_scans` makes it, in the map's own cells (`resolution_m`): a voxel's points count as one at their mean,
        so that scans add up to the `fit` cloud of all of them, and grids to those that `fit` would make in the same boxes. A return
        farther than the inner radius from every seed becomes a seed, whatever `grid.start` says.

        With `reconstruct=False` queries reconstruct what they need of it: the boxes that answer them, for all scans since. Threads take
        turns: one that asks, copies (`copy.deepcopy`) or saves the map waits until a scan is added and reconstructed, or adds after it.

        `classes`, the two labels that there are, the lesser, which is free, first (scikit-learn has them so), are for a first scan with one
        label alone; False and True need none. Raises `InputError` as `fit` does, for labels that the map does not know, and for a map with
        `weights="cluster"`, which are fitted on a whole site.

        Stopped while it reconstructs (Ctrl-C), a first scan is taken back, but a later one stays in the map: don't give it again; what is
        left of its clusters is reconstructed by the next query, or by `settle`.
        """
        with turn_of(self):  # whether there is a map yet, too, is known to one that waited
            first = not hasattr(self, "grids_")
            if self.weights == "cluster" if first else self.factors_ is not None:
                wanted = "expected unit or rank for partial_fit, got 'cluster', which are fitted on a whole site"
                raise InputError(f"weights: {wanted}" + ("" if first else "; fit the map anew with others"))
            if not getattr(self, "fills_", self.fill):  # a setting changed since takes effect with the next fit
                raise InputError("fill: expected a map that fills gaps for partial_fit; fit one without grids on all scans")
            if not first and self.reconstructor is not self.completes_:
                raise InputError(
                    "reconstructor: expected the one that the map's grids are of for partial_fit; fit the map anew with another"
                )
            if first and self.adapt_steps:
                raise InputError("adapt_steps: expected 0 to begin a map with partial_fit; only fit has a site to learn from")
            with self._restored_on_failure() if first else nullcontext():  # later scans are refused before anything is altered
                self._add(points, y, sample_weight, classes, first)
                return self.settle() if reconstruct else self

    def _add(self, points, y, sample_weight, classes, first) -> None:
        points, y, weight = self._checked_cloud(points, y, sample_weight, first)
        self._check_whole()
        self._check_network(points.shape[1])  # a loaded map's is looked for now, before anything is altered
        if first:
            occupied = self._learn_labels(y, both=False, stacklevel=4) if classes is None else self._named_labels(y, classes)
            cloud = Cloud(points, occupied, weight)
            self._start_without_clusters(cloud.select(slice(0)))
        else:
            if classes is not None and not np.array_equal(np.unique(classes), self.classes_):
                raise InputError(f"classes: expected {self.classes_.tolist()}, as before, got {np.unique(classes).tolist()}")
            cloud = Cloud(points, self._known_labels(y), weight)
        if self._growing is None:
            completed = Completion(self.grids_, self.known_)
            settings = self.grid_, self.detailed_, self.seed
            self._growing = GrowingClusters(self.evidence_, *settings, self.seeds_, self.frames_, completed, self.small_seeds_)
        growing = self._growing
        growing.draw = self.seed  # as it is set now, and in the map's file
        to_its_end(lambda: self._grow(cloud))  # half a scan's votes can't be taken back

    def _grow(self, cloud: Cloud) -> None:
        self._growing.add(cloud)
        self._show_grown()

    def _show_grown(self) -> None:
        """The clusters and grids as they have grown, without a copy."""
        growing = self._growing
        self.seeds_, self.small_seeds_, self.frames_ = growing.seeds, growing.small_seeds, growing.frames
        self.grids_, self.known_ = growing.completed.value, growing.completed.known

    def __getstate__(self) -> dict:
        """What has grown once, and not also as it is shown."""
        state = super().__getstate__()
        return state if self._growing is None else {name: value for name, value in state.items() if name not in GROWN}

    def __setstate__(self, state: dict) -> None:
        super().__setstate__(state)
        if self._growing is not None and not hasattr(self, "grids_"):  # older pickles have both
            self._show_grown()

    def _check_whole(self) -> None:
        """An `InputError` after a scan was added in part, for want of memory."""
        if self._growing is not None and not self._growing.is_whole:
            raise InputError("partial_fit: a scan was added in part, and the map is damaged; load it again, or fit it anew")

    def settle(self, queries: np.ndarray | None = None):
        """Reconstruct what scans have changed; given `queries (Q, D)`, only the boxes that answer them, as each query does by itself."""
        with turn_of(self):
            check_is_fitted(self)
            self._settle(queries)
        return self

    def _settle(self, queries: np.ndarray | None) -> None:
        self._check_whole()
        if self._growing is None or not self._growing.stale.any():
            return
        wanted = None
        if queries is not None:
            asked = np.zeros(len(self.frames_) + 1, bool)  # the last for queries that fewer boxes hold
            for start in range(0, len(queries), self.chunk):
                asked[self.index_.holding(queries[start : start + self.chunk], self.rank_weights_.neighbours)] = True
            wanted = asked[:-1]
        self._growing.settle(self._completed_as_sampled, wanted)
        self.grids_, self.known_ = self._growing.completed.value, self._growing.completed.known  # a pickle's are copies

    def predict_proba(self, queries) -> np.ndarray:
        with turn_of(self):
            return super().predict_proba(queries)

    def _one_each(self, queries: np.ndarray) -> np.ndarray:
        with turn_of(self).lent():  # a map of somebody's own may ask for `features`
            return super()._one_each(queries)

    def _answer(self, answer: Callable[[np.ndarray], np.ndarray], queries, columns: int | None = None) -> np.ndarray:
        """(Q,) or (Q, columns) what `answer` says of `queries (Q, D)`, of a map that nothing is added to meanwhile."""
        turn = turn_of(self)

        def lent(part: np.ndarray) -> np.ndarray:
            with turn.lent():
                return answer(part)

        with turn:
            check_is_fitted(self)
            return answer_in_chunks(lent, self._checked(queries), self.chunk, columns)

    def __deepcopy__(self, memo: dict) -> GrowingMapper:
        with turn_of(self):  # half a scan can't be copied
            copied = memo[id(self)] = type(self).__new__(type(self))
            copied.__setstate__(copy.deepcopy(self.__getstate__(), memo))
        return copied

    def _completed_as_sampled(self, cloud_in: Callable[[Frames], Cloud], frames: Frames) -> Iterator[tuple[slice, Completion]]:
        """`_completed_parts` of the evidence's own clouds."""
        return self._completed_parts(lambda boxes: self._as_sampled(cloud_in(boxes)), frames)

    def _start_without_clusters(self, cloud: Cloud) -> None:
        """A map of what the cloud observed, without any grid."""
        self._start(cloud)
        dimension = cloud.points.shape[1]
        nothing, nowhere = cloud.select(slice(0)), Frames(*(np.empty((0, *(dimension,) * axes)) for axes in (1, 2, 0)))
        completed = self._complete_boxes(nothing, nowhere)
        self.seeds_, self.factors_, self.frames_ = np.empty((0, dimension)), None, nowhere
        self.grids_, self.known_ = completed.value, completed.known

    def _checked(self, queries):
        queries = super()._checked(queries)
        self.settle(queries)
        return queries
