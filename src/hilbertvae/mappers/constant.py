"""Mappers that learn nothing from their cloud: what every real one has to beat (METHOD 6 and 7)."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from hilbertvae.checks import InputError, check_share
from hilbertvae.mappers.mapper import Mapper


class _DeafMapper(Mapper):
    """Base of the two below: nothing of the cloud is used but its dimension."""

    needs_both_classes = False

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.classifier_tags.poor_score = True
        return tags


class ConstantMapper(_DeafMapper):
    """Answers `probability` everywhere: 1 is "all occupied"."""

    def __init__(self, probability=1.0):
        self.probability = probability

    def check_settings(self) -> None:
        super().check_settings()
        check_share(self.probability, "probability")

    def _fit(self, points, occupied, weight):
        pass

    def _probability(self, queries):
        return np.full(len(queries), float(self.probability))


class GapCentreMapper(_DeafMapper):
    """Leak check: p = 1 / (1 + distance in metres to the nearest gap's centre).

    Its AUC in gaps is that of minus this distance. Well above 0.5 it would mean that the place of a gap tells where its wall was.
    centres: (G, D) metres.
    """

    told_gaps = True

    def __init__(self, centres=((0.0, 0.0),)):
        self.centres = centres

    def _fit(self, points, occupied, weight):
        centres = np.asarray(self.centres, dtype=np.float64)
        if centres.ndim != 2 or not len(centres) or centres.shape[1] != points.shape[1] or not np.isfinite(centres).all():
            raise InputError(f"centres: expected finite (G, {points.shape[1]}) with at least one gap, got shape {centres.shape}")
        self.tree_ = cKDTree(centres)

    def _probability(self, queries):
        return 1.0 / (1.0 + self.tree_.query(queries)[0])
