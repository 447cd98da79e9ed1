"""Drawing by shares: of sensors, styles, kinds of furniture."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

import numpy as np

Kind = TypeVar("Kind")


def picked(rng: np.random.Generator, shares: Mapping[Kind, float]) -> Kind:
    """A key, by shares that need not sum to 1."""
    weights = np.array(list(shares.values()))
    return list(shares)[rng.choice(len(weights), p=weights / weights.sum())]
