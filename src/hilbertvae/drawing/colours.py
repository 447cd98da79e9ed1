"""Colours that every picture shares, so that one colour means one thing in all of them."""

from __future__ import annotations

from matplotlib import colormaps
from matplotlib.colors import LinearSegmentedColormap

PROBABILITY = LinearSegmentedColormap.from_list(
    "free-unknown-occupied",
    ["#f4faff", "#d7f3ff", "#c1e8ff", "#b5dbf9", "#b5cadb", "#b6b6b6", "#c39686", "#c86c54", "#a94b36", "#752e21", "#341715"],
)
"""p(occupied): free nearly white, unknown a grey without hue, occupied nearly black; bluish below 0.5 and reddish above.

Lightness falls all the way, so that the order survives a grey print and any kind of colour blindness; hue is left to what matters, the
side of 0.5 that an answer leans to. Interpolated in CIELAB: L 98, 88, 74, 50, 12 at p = 0, 1/4, 1/2, 3/4, 1."""

ERROR = LinearSegmentedColormap.from_list("missed-invented", ["#2d0a6b", "#7b5bb5", "#ffffff", "#e39a3b", "#8a3b00"]).with_extremes(
    bad="#b6b6b6"
)
"""p - truth: violet where occupied space was missed (-1), white where right, orange where it was invented (+1), grey where nobody knows."""

UNCERTAINTY = colormaps["magma_r"]
"""Spread of answers: pale where grids agree, dark where they don't."""
WIDEST_STD = 0.5
"""The dark end of `UNCERTAINTY`: no spread of answers between 0 and 1 is wider."""

GAP_COLOUR = "#009e73"
"""Outlines of gaps: a green that neither map uses and that stays apart from both for the colour-blind (Okabe and Ito)."""
FREE_POINT_COLOUR = "#6fa8d6"
"""Free points drawn as dots, which are too small for the map's nearly white."""
SELECTED_COLOUR = "#0050b0"
"""The cluster that a picture is about."""

OURS = "#a01818"
OTHERS = ("#0072b2", "#009e73", "#d98a00", "#332288", "#56a4d9", "#7a7a7a", "#a6761d", "#c05a94")
