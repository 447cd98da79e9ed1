"""Colours of shaded 3D pictures, where near white and near black are left to the light."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import LinearSegmentedColormap, to_rgb

from hilbertvae.drawing.surface import Surface
from hilbertvae.ground import BlockGround, Ground

HEIGHT = LinearSegmentedColormap.from_list(
    "height", ["#d3cfc7", "#d3cfc7", "#9fbfe2", "#6f9fd0", "#4f7cbf", "#4160a8", "#374689", "#2f2f70"]
)
"""Height above the ground: the ground itself a grey, what stands on it the bluer and the darker the higher it is.

Blues alone leave a hue to the tint that the colour-blind tell from all of them, too."""
HEIGHTS_M = (-0.4, 4.4)
"""The heights at the ends of `HEIGHT`."""
LIT = LinearSegmentedColormap.from_list("lit-probability", ["#bfe6ff", "#c4d6e8", "#c8c8c8", "#d8ac92", "#c4573c", "#8f2a1a"])
"""p(occupied), in the hues of `PROBABILITY`."""
GAP_TINT = "#ef9600"
"""What was filled in, among the colours of `HEIGHT`: an orange, since whatever kind of colours an eye lacks, orange is far from blue."""
LIT_TINT = "#2c6fff"
"""And among those of `LIT`, the other way about."""
UNCERTAINTY_TINT = "#80dfff"
"""And among those of `UNCERTAINTY`."""
PREDICTED_SHARE = 0.6
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


def tinted(colours: np.ndarray, predicted: np.ndarray, tint: str = GAP_TINT) -> np.ndarray:
    """(N, 3) uint8: `colours (N, 3)` from 0 to 1, with a tint where `predicted (N,)`."""
    colours = np.where(predicted[:, None], (1 - PREDICTED_SHARE) * colours + PREDICTED_SHARE * np.array(to_rgb(tint)), colours)
    return np.round(colours * 255).astype(np.uint8)
