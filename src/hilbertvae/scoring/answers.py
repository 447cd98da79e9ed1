"""What a mapper answers, checked: one of somebody's own may answer anything, and would be scored for it."""

from __future__ import annotations

import time
import warnings

import numpy as np

from hilbertvae.mappers.mapper import Mapper
from hilbertvae.site import Site


def answers(mapper: Mapper, queries: np.ndarray) -> tuple[np.ndarray, float]:
    """The mapper's answers, and the seconds that they took."""
    start = time.perf_counter()
    both = mapper.predict_proba(queries)
    taken = time.perf_counter() - start
    probability = _checked(both, mapper, "probability", (len(queries), 2))[:, 1]
    if wrong := np.count_nonzero((probability < 0) | (probability > 1)):
        raise ValueError(f"{type(mapper).__name__} answered {wrong} of {len(queries)} queries with no probability from 0 to 1")
    return probability, taken


def spreads(mapper: Mapper, queries: np.ndarray) -> np.ndarray:
    """(Q,) how unsure the mapper says it is."""
    return _checked(mapper.predict_std(queries), mapper, "spread", (len(queries),))


def _checked(found: np.ndarray, mapper: Mapper, what: str, shape: tuple[int, ...]) -> np.ndarray:
    """The answers; a `ValueError` for others than one of a query, and for NaN, which would be ranked as if it were a number."""
    if np.shape(found) != shape:
        raise ValueError(f"{type(mapper).__name__} answered {what} of shape {np.shape(found)}, expected {shape}")
    if wrong := np.count_nonzero(~np.isfinite(found)):
        raise ValueError(f"{type(mapper).__name__} answered {what} with {wrong} of {np.size(found)} numbers NaN or infinite")
    return np.asarray(found)


def warn_of_voxels(mapper: Mapper, name: str, site: Site) -> None:
    """A map of coarser voxels answers for what lies beside, and one of finer ones says unknown between returns."""
    own_m = getattr(mapper, "resolution_", None) or getattr(getattr(mapper, "evidence_", None), "resolution_m", site.resolution_m)
    if own_m != site.resolution_m:
        warnings.warn(
            f"{name}: its voxels are of {own_m:g} m, those of {site.name} of {site.resolution_m:g}: give it resolution_m", stacklevel=4
        )
