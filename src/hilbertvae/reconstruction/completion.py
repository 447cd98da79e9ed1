"""What a network makes of a map's grids. Apart from networks, so that a saved map answers without torch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Completion:
    """value: float16 (M, n, ..., n), the kernel values of Eq. 7. known: uint8, in 255ths the probability that a cell would be known if
    its site were scanned as training sites were, 255 where it is; None for a network that does not say."""

    value: np.ndarray
    known: np.ndarray | None
