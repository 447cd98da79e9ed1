"""Courses of corridors: lists of segments (2, 2), metres, about `extent_m` long."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np


def _line(rng, extent_m):
    return _segments([(0, 0), (extent_m, 0)])


def _ell(rng, extent_m):
    return _segments([(0, 0), (extent_m, 0), (extent_m, extent_m * rng.uniform(0.2, 0.8))])


def _tee(rng, extent_m):
    x, y = extent_m * rng.uniform(0.2, 0.8), extent_m * rng.uniform(0.2, 0.6)
    return _segments([(0, 0), (extent_m, 0)]) + _segments([(x, 0), (x, y)])


def _loop(rng, extent_m):
    w, h = extent_m * rng.uniform(0.5, 0.9), extent_m * rng.uniform(0.2, 0.7)
    tail = rng.choice([0.0, 0.3 * extent_m])
    return _segments([(-tail, 0), (w, 0), (w, h), (0, h), (0, 0)])


def _ladder(rng, extent_m):
    w, h = extent_m * rng.uniform(0.6, 0.9), extent_m * rng.uniform(0.3, 0.8)
    rungs = [_segments([(x * w, 0), (x * w, h)]) for x in rng.uniform(0.25, 0.75, rng.integers(1, 3))]
    across = _segments([(0, h / 2), (w, h / 2)]) if rng.random() < 0.5 else []
    return _segments([(0, 0), (w, 0), (w, h), (0, h), (0, 0)]) + sum(rungs, []) + across


def _chain(rng, extent_m):
    turns = np.cumsum(rng.choice([0.3, 0.6, 1.0, np.pi / 2], 4) * rng.choice([-1, 1], 4))
    steps_m = extent_m * rng.uniform(0.25, 0.55, 4)
    return _segments([(0, 0), *np.cumsum(steps_m[:, None] * np.stack([np.cos(turns), np.sin(turns)], axis=-1), axis=0)])


def _segments(corners) -> list[np.ndarray]:
    corners = np.asarray(corners, dtype=float)
    return [corners[i : i + 2] for i in range(len(corners) - 1)]


SKELETONS: list[Callable] = [_line, _ell, _tee, _loop, _ladder, _chain]
