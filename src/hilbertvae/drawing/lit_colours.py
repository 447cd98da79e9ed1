"""Colours of shaded 3D pictures, where near white and near black are left to the light."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import LinearSegmentedColormap, to_rgb

from hilbertvae.drawing.surface import Surface
from hilbertvae.ground import BlockGround, Ground

HEIGHT = LinearSegmentedColormap.from_list(
    "height", ["#d3cfc7", "#d3cfc7", "#9dbbdc", "#5b8ecb", "#6a68bd", "#a85aa8", "#e0708a", "#f6a35c", "#fbd25f"]
)
"""Height above the ground: the ground itself a grey, what stands on it in colours without the green of gaps."""
HEIGHTS_M = (-0.4, 4.4)
"""The heights at the ends of `HEIGHT`."""
LIT = LinearSegmentedColormap.from_list("lit-probability", ["#bfe6ff", "#c4d6e8", "#c8c8c8", "#d8ac92", "#c4573c", "#8f2a1a"])
"""p(occupied), in the hues of `PROBABILITY`."""
GAP_TINT = "#17c795"
"""`GAP_COLOUR` for shaded voxels, which are darker than their colour."""
PREDICTED_SHARE = 0.5
"""The share of the tint where a surface was predicted, not observed."""


def surface_colours(surface: Surface, ground: Ground | BlockGround | None = None) -> np.ndarray:
    """(V, 3) uint8: by height above the ground, tinted where the surface was predicted. Without a ground, above its own low end."""
    if not len(surface):
        return np.empty((0, 3), np.uint8)
    z = surface.vertices[:, 2]
    height = z - np.quantile(z, 0.02) if ground is None else ground.height_above(surface.vertices)
    return height_colours(height, ~surface.observed)


def height_colours(height_m: np.ndarray, predicted: np.ndarray) -> np.ndarray:
    """(N, 3) uint8 by `height_m (N,)` above the ground, tinted where `predicted (N,)`."""
    low, high = HEIGHTS_M
    return tinted(HEIGHT(np.clip((height_m - low) / (high - low), 0, 1))[:, :3], predicted)


def tinted(colours: np.ndarray, predicted: np.ndarray) -> np.ndarray:
    """(N, 3) uint8: `colours (N, 3)` from 0 to 1, with a tint where `predicted (N,)`."""
    colours = np.where(predicted[:, None], (1 - PREDICTED_SHARE) * colours + PREDICTED_SHARE * np.array(to_rgb(GAP_TINT)), colours)
    return np.round(colours * 255).astype(np.uint8)
