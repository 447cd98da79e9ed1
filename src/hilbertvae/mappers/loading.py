"""Mappers from trained weights."""

from __future__ import annotations

import os

from hilbertvae.checks import named
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.weights import check_learned
from hilbertvae.reconstruction.reconstructor import Reconstructor


def load_mapper(checkpoint: str | os.PathLike, **settings) -> HilbertMap:
    """An unfitted `HilbertMap` with the network and the weights of `checkpoint`.

    That is a network that comes with the package (`2d`, `3d`, `2d-sim` and `3d-sim`, which were trained on simulated sites alone, or
    `2d-map`, which fills existing maps), or the path of a `.safetensors` that training wrote.

    It needs no configuration and no site: `.fit(points, y, sample_weight=None)` on any cloud, `points (N, D)` in metres and `y (N,)` bool,
    whether each is occupied, then `.predict_proba(queries)` -> (Q, 2), columns free and occupied. `settings` are the mapper's own, such
    as `calibration="points"`. Raises `InputError` for a file that is missing, damaged or not ours.
    """
    reconstructor = Reconstructor.load(checkpoint)
    with named(checkpoint):
        check_learned(reconstructor.map_weights)
    return HilbertMap(reconstructor, **settings)
