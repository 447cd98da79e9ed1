"""The contract of every mapper: a scikit-learn classifier of points into free and occupied.

A new mapper subclasses `Mapper`, takes its settings as keyword arguments of `__init__` (stored unchanged under their own names),
says in `check_settings` which make no map, and implements `_fit` and `_probability`. Everything else (labels, chunks, `predict`) stands
here once.
"""

from __future__ import annotations

import pickle
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import _check_sample_weight, check_is_fitted, validate_data

from hilbertvae.checks import InputError, check_whole, labels_alike, refuse_more_than_numbers
from hilbertvae.cores import FEW, on_all_cores
from hilbertvae.scans.rounded import warn_if_single

OCCUPIED_ABOVE = 0.6
"""Occupied if p > 0.6 (paper, section IV)."""
FREE_BELOW = 0.4 + 1e-6
"""Free if p <= 0.4; the slack takes in OctoMap's single miss, which is 0.4000 in float32 (METHOD 6)."""

ROUNDING = 1e-9
"""By so much may an answer miss 0 or 1."""
FARTHEST_M = 1e100
"""Queries farther out are asked there: the square of a longer distance would be no number, and everything is as far away. Points that a
map is made of may not lie there."""
REFUSED = (ValueError, RuntimeError)
"""What scikit-learn and, of tensors that have a gradient, torch raise for arrays that are no points."""


def answer_in_chunks(answer: Callable[[np.ndarray], np.ndarray], queries: np.ndarray, chunk: int, columns: int | None = None) -> np.ndarray:
    """(Q,) float64, or (Q, columns): what `answer` says of `queries (Q, D)`, at most `chunk` of them at a time, on all cores.

    Queries are taken by place, so that those of a chunk share what is looked up.
    """
    if len(queries) <= chunk:
        return answer(queries)
    order = _by_place(queries)
    answers = np.empty(len(queries) if columns is None else (len(queries), columns))

    def put(start: int) -> None:
        part = order[start : start + chunk]
        answers[part] = answer(queries[part])

    on_all_cores(put, range(0, len(queries), chunk))
    return answers


def _plain(error: ValueError | RuntimeError) -> str:
    """What scikit-learn says of arrays, but of NaN and inf the first line alone: the others advise other estimators."""
    return first if "contains" in (first := str(error).partition("\n")[0]) else str(error)


def _by_place(queries: np.ndarray) -> np.ndarray:
    """(Q,) an order of the queries, cell by cell of a lattice of 256 x 256 cells over their first two axes."""
    plane = queries[:, :2]
    low, high = plane.min(axis=0), plane.max(axis=0)
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        cell = np.nan_to_num((plane - low) * (255 / (high - low)), posinf=0.0).astype(np.uint16)
    # 16 bits, which numpy sorts in one pass.
    return np.argsort(cell[:, 0] * np.uint16(256) + cell[:, -1], kind="stable")


def pickled_bytes(content: object) -> int:
    """The size of `content` as a pickle, without making a copy of its arrays."""
    counted = 0

    class Counter:
        def write(self, part) -> int:
            nonlocal counted
            counted += len(part)
            return len(part)

    def count(buffer: pickle.PickleBuffer) -> None:
        nonlocal counted
        counted += buffer.raw().nbytes

    pickle.Pickler(Counter(), protocol=5, buffer_callback=count).dump(content)
    return counted


class Mapper(ClassifierMixin, BaseEstimator):
    """Base of the mappers. `fit(points (N, D), y (N,), sample_weight=None)`, `predict_proba(queries (Q, D)) -> (Q, 2)`."""

    chunk = FEW
    """Queries answered at once by one core: few enough that what is computed for them stays in its cache. Changes no answer."""
    needs_both_classes = True
    """Whether a cloud with one label only is refused. A mapper of hits alone overrides this."""
    told_gaps = False
    """Whether `evaluate` sets a parameter `centres` to where gaps are: the leak check alone, which knows nothing else."""

    def fit(self, points, y, sample_weight=None):
        """Fit on `points (N, D)` in metres with labels `y (N,)`, the greater of which means occupied (False/True, 0/1, -1/+1).

        sample_weight: (N,) how many samples each point stands for; one each unless given. Points of weight 0 are left out.
        Raises `InputError` (a ValueError) for an empty cloud, NaN, a wrong shape, or one class only; a `UserWarning` says where single
        precision has moved far points, as it does of queries.
        """
        with self._restored_on_failure():
            points, y, weight = self._checked_cloud(points, y, sample_weight)
            self._fit(points, self._learn_labels(y, self.needs_both_classes), weight)
        return self

    @contextmanager
    def _restored_on_failure(self) -> Iterator[None]:
        """What is refused, or stopped half-way, leaves the mapper as it was: fitted on another site, or not at all."""
        before = dict(vars(self))
        try:
            yield
        except BaseException:
            vars(self).clear()
            vars(self).update(before)
            raise

    def fits_like(self, other: Mapper) -> bool:
        """Whether `fit` finds the same for both, so that `fit_as` may take what the other found; not unless a mapper says so."""
        return False

    def fit_as(self, other: Mapper) -> Mapper:
        """Take what `other`, which `fits_like` this one, found in its `fit`; the arrays are shared, not copied."""
        settings = self.get_params(deep=False)
        vars(self).update({name: value for name, value in vars(other).items() if name not in settings})
        return self

    def _learn_labels(self, y: np.ndarray, both: bool, stacklevel: int = 3) -> np.ndarray:
        """(N,) bool: whether each label `y (N,)` is the greater of the two that there are, kept as `classes_`. One alone is enough unless
        `both` are needed, but only False or True says by itself which of them it is."""
        classes, label = np.unique(y, return_inverse=True)
        if len(classes) > 2:
            raise InputError(f"y: Only binary classification is supported, got {len(classes)} labels; expected free and occupied")
        if len(classes) < 2:
            if both or classes.dtype != bool:
                raise InputError(f"y: expected both free and occupied points, got one class only: {classes.tolist()}")
            classes, label = np.array([False, True]), classes[label]
        if classes.dtype.kind not in "biuf":
            free, hit = classes.tolist()
            words = f"{hit!r}, the later of the two by its letters, for occupied and {free!r} for free"
            warnings.warn(f"y: takes {words}; give True where a point is occupied if that is wrong", stacklevel=stacklevel)
        self.classes_ = classes
        return label.astype(bool)

    def _known_labels(self, y: np.ndarray) -> np.ndarray:
        """(N,) bool: which of `classes_` each label `y (N,)` is; an `InputError` for any other."""
        strange = np.unique(y[~np.isin(y, self.classes_)])
        if len(strange):
            raise InputError(f"y: expected labels {self.classes_.tolist()}, as before, got {strange[:4].tolist()}")
        return y == self.classes_[1]

    def _named_labels(self, y: np.ndarray, classes) -> np.ndarray:
        """`_learn_labels` of `y (N,)` where the two labels that there are, `classes`, are given; an `InputError` for others, and for the
        greater one first, which whoever says so takes for the free one."""
        self._learn_labels(np.asarray(classes), both=True, stacklevel=5)
        if list(classes)[0] != self.classes_[0]:
            raise InputError(f"classes: expected the lesser label first, which is free; the greater means occupied; got {list(classes)}")
        return self._known_labels(y)

    def predict_proba(self, queries) -> np.ndarray:
        """(Q, 2) float64: the probabilities of free and of occupied at `queries (Q, D)`, each answered alone."""
        check_is_fitted(self)
        queries = self._checked(queries)
        occupied = answer_in_chunks(self._one_each, queries, self.chunk) if len(queries) else np.empty(0)
        return np.column_stack([1.0 - occupied, occupied])

    def _one_each(self, queries: np.ndarray) -> np.ndarray:
        """`_probability` of some queries, checked: a mapper of somebody's own may say something else."""
        occupied, name = np.asarray(self._probability(queries), np.float64), type(self).__name__
        if occupied.shape != (len(queries),):
            raise ValueError(f"{name}._probability: expected shape {(len(queries),)}, p(occupied) of each query, got {occupied.shape}")
        if (wrong := ~((occupied >= -ROUNDING) & (occupied <= 1 + ROUNDING))).any():  # NaN, too
            raise ValueError(f"{name}._probability: expected numbers from 0 to 1, got {occupied[wrong][0]}")
        return np.clip(occupied, 0.0, 1.0)  # whoever scores it takes no more for a probability than from 0 to 1

    def predict_map(self, queries) -> np.ndarray:
        """(Q,) p(occupied) as a map shows it; a mapper that can tell where no scan would ever see says 0.5 there."""
        return self.predict_proba(queries)[:, 1]

    def describe(self, queries) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """What files of a map keep of `queries (Q, D)`: (Q,) `predict_map`, (Q,) `predict_std`, NaN from a mapper that has none, and (Q,)
        bool `observed`, None from one that can't tell."""
        std = self.predict_std(queries) if hasattr(self, "predict_std") else np.full(len(queries), np.nan)
        return self.predict_map(queries), std, self.observed(queries) if hasattr(self, "observed") else None

    def predict(self, queries) -> np.ndarray:
        """(Q,) the likelier class of each query; unknown (0.5) counts as free."""
        occupied = self.predict_proba(queries)[:, 1] > 0.5
        return self.classes_[occupied.astype(int)]

    def stored_bytes(self) -> int:
        """How many bytes the fitted map takes: all that it would have to keep to give the same answers, but for a network."""
        check_is_fitted(self)
        return pickled_bytes({name: value for name, value in vars(self).items() if name.endswith("_")})

    def cluster_count(self) -> int | None:
        """Of how many clusters, or centres of features, the fitted map is made; None for one that has no such thing."""
        return None

    def check_settings(self) -> None:
        """An `InputError` that names a setting that makes no map; `fit` asks, and who trains a network for it does first."""
        check_whole(getattr(self, "seed", 0), "seed")

    def _checked_cloud(self, points, y, sample_weight, first: bool = True):
        self.check_settings()
        for name, values in (("points", points), ("y", y), ("sample_weight", sample_weight)):
            refuse_more_than_numbers(values, name)
        try:
            placed, y = validate_data(self, points, labels_alike(y), dtype=np.float64, reset=first)
            check_classification_targets(y)
            weight = _check_sample_weight(sample_weight, placed, dtype=np.float64, ensure_non_negative=True)
        except REFUSED as error:
            raise InputError(f"points, y, sample_weight: {_plain(error)}") from error
        warn_if_single(points, placed, "points")
        points, counts = placed, weight > 0
        if not counts.any():
            raise InputError("sample_weight: expected positive weights, got zeros only")
        if not counts.all():
            points, y, weight = points[counts], y[counts], weight[counts]
        points, weight = points.view(), weight.view()
        points.flags.writeable = weight.flags.writeable = False  # they are the caller's, and those of the mappers that come next
        if (farthest := np.abs(points).max()) > FARTHEST_M:
            raise InputError(f"points: expected coordinates up to {FARTHEST_M:g} m, got {farthest:g}; is there an outlier?")
        return points, y, weight

    def _checked(self, queries):
        refuse_more_than_numbers(queries, "queries")
        try:
            asked = validate_data(self, queries, reset=False, dtype=np.float64, ensure_min_samples=0)
        except REFUSED as error:
            raise InputError(f"queries: {_plain(error)}") from error
        warn_if_single(queries, asked, "queries")
        return np.clip(asked, -FARTHEST_M, FARTHEST_M)

    def _fit(self, points: np.ndarray, occupied: np.ndarray, weight: np.ndarray) -> None:
        """Fit on checked arrays: (N, D) float64, (N,) bool, (N,) float64. Sets attributes that end in `_`."""
        raise NotImplementedError

    def _probability(self, queries: np.ndarray) -> np.ndarray:
        """(Q,) p(occupied) of checked (Q, D) queries; called from several threads at once."""
        raise NotImplementedError

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.classifier_tags.multi_class = False
        return tags
