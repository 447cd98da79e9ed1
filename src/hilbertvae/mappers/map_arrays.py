"""All that a fitted Hilbert Map knows of its site, as the arrays that its file has."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hilbertvae.mappers.saved_evidence import evidence_arrays

if TYPE_CHECKING:
    from hilbertvae.mappers.hilbert_map import HilbertMap

EVIDENCE = "evidence."
"""Begins the names of what was observed."""


def map_arrays(mapper: HilbertMap) -> dict[str, np.ndarray]:
    """seeds, centre: (M, D) float64, metres; scale: (M,) float64; grids: (M, n, ..., n), float16, or int8 without a network; known: uint8,
    as `Completion` has them. rotation: (M, D, D) where frames are turned; small_seeds: (S, D) and factors: (M,) where there are such."""
    frames = mapper.frames_
    arrays = {"seeds": mapper.seeds_, "centre": frames.centre, "scale": frames.scale, "grids": mapper.grids_}
    if frames.turned:
        arrays["rotation"] = frames.rotation
    for name, array in (("small_seeds", mapper.small_seeds_), ("known", mapper.known_), ("factors", mapper.factors_)):
        if array is not None:
            arrays[name] = array
    return arrays | {EVIDENCE + name: array for name, array in evidence_arrays(mapper.evidence_).items()}
