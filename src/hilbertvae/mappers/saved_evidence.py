"""Evidence as a few small arrays and back: bricks as bit masks, votes in as few bytes as hold them, means where there are votes."""

from __future__ import annotations

import numpy as np

from hilbertvae.checks import InputError
from hilbertvae.mappers.evidence import Evidence
from hilbertvae.mappers.voxel_bricks import BITS
from hilbertvae.voxel_votes import MARGIN

FARTHEST = 2**50
"""Bricks from the origin, beyond which float64 has no voxels."""


def evidence_arrays(evidence: Evidence) -> dict[str, np.ndarray]:
    """corner: (B, D) whole numbers, where bricks lie in their lattice; seen: (B, side^D / 8) uint8, a bit per voxel; hits, frees: (V,) by
    brick and voxel; hit_mean, free_mean: float32 (., D), of the voxels that have some."""
    bricks = np.lexsort(evidence.bricks.corners.T[::-1])
    rows, _ = evidence.bricks.voxels(bricks)
    seen = evidence.bricks.blocks[(slice(None), *evidence.bricks.parts()[0])][bricks] > 0
    arrays = {
        "corner": _narrow(evidence.bricks.corners[bricks], (np.int32,)),
        "seen": np.packbits(seen.reshape(len(bricks), -1), axis=1),
    }
    for name, votes, mean in (("hit", evidence.hits, evidence.hit_mean), ("free", evidence.frees, evidence.free_mean)):
        arrays[f"{name}s"] = _narrow(votes[rows], (np.uint8, np.uint16, np.uint32, np.float32))
        arrays[f"{name}_mean"] = np.stack([axis[rows[votes[rows] > 0]] for axis in mean], axis=1)
    return arrays


def evidence_of(arrays: dict[str, np.ndarray], dimension: int, resolution_m: float) -> Evidence:
    """The inverse of `evidence_arrays`, to the bit; an `InputError` that names the array for what is none."""
    corner = _array(arrays, "corner", "iu", (None, dimension))
    side = 1 << BITS[dimension]
    seen = _array(arrays, "seen", "u", (len(corner), side**dimension // 8))
    if seen.dtype != np.uint8 or not seen.any(axis=1).all():
        raise InputError("seen: expected bytes with at least one voxel per brick")
    if len(corner) and not (np.abs(corner.astype(float)) < FARTHEST).all():
        raise InputError("corner: expected bricks nearer to the origin")
    votes, means = [], []
    for name in ("hit", "free"):
        found = _array(arrays, f"{name}s", "uf", (int(np.bitwise_count(seen).sum()),)).astype(float)
        if not (np.isfinite(found) & (found >= 0)).all():
            raise InputError(f"{name}s: expected counts, got some that are negative, NaN or inf")
        mean = _array(arrays, f"{name}_mean", "f", (np.count_nonzero(found), dimension))
        if not ((mean > 0) & (mean < 1)).all():
            raise InputError(f"{name}_mean: expected places within a voxel, from 0 to 1")
        votes.append(found)
        means.append(np.clip(mean, MARGIN, 1 - MARGIN).astype(np.float32))  # older maps have places nearer to a side
    if not (votes[0] + votes[1] > 0).all():
        raise InputError("hits, frees: expected votes of every voxel seen")
    # Last of all: the places take a hundred times as much memory as the bits that say them.
    brick, cell = np.nonzero(np.unpackbits(seen, axis=1))
    index = corner.astype(np.int64)[brick] * side + np.stack(np.unravel_index(cell, (side,) * dimension), axis=1)
    try:
        return Evidence.of_voxels(index, *votes, *means, resolution_m)
    except InputError as error:
        raise InputError(f"corner: {error}") from error


def _narrow(values: np.ndarray, kinds: tuple[type, ...]) -> np.ndarray:
    """`values` as the first of `kinds` that keeps them all, else as they are."""
    for kind in kinds:
        with np.errstate(invalid="ignore", over="ignore"):
            narrow = values.astype(kind)
        if np.array_equal(narrow.astype(values.dtype), values):
            return narrow
    return values


def _array(arrays: dict[str, np.ndarray], name: str, kinds: str, shape: tuple[int | None, ...]) -> np.ndarray:
    """The array of that name, if it is of a kind and shape as expected."""
    if name not in arrays:
        raise InputError(f"{name}: expected an array of that name, got none")
    found = arrays[name]
    fits = len(found.shape) == len(shape) and all(wanted in (None, size) for wanted, size in zip(shape, found.shape, strict=True))
    if found.dtype.kind not in kinds or not fits:
        wanted = tuple("any" if size is None else size for size in shape)
        raise InputError(f"{name}: expected shape {wanted} of kind {kinds}, got {found.shape} {found.dtype}")
    return found
