"""Slices through the p(occupied) of a 3D map: one that follows the ground, one upright through a gap, with what was observed over them."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from hilbertvae.drawing.canvas import HALO, new_figure, probability_bar, scale_bar, show_probability, title_of
from hilbertvae.drawing.colours import GAP_COLOUR
from hilbertvae.drawing.raster import Raster
from hilbertvae.reports.site_view import SiteView, fullest_gap
from hilbertvae.voxel_votes import voxel_index

LEVEL_M = 1.0
"""The height of the slice that follows the ground: cars, trunks and walls are in it, kerbs are not."""
REACH_M = 18.0
"""How far the upright slice goes to each side of its gap."""
BELOW_M, ABOVE_M = 1.0, 6.0
"""How far the upright slice goes below and above the ground at its gap."""
OBSERVED_COLOUR = "#1f9bff"
"""Occupied points over a map: a blue that stands out from both ends of its colours."""


def slice_picture(view: SiteView, gap: int | None = None) -> Figure:
    """p(occupied) 1 m above the ground of the whole site, and upright through one gap (the fullest above ground unless given).

    Dots are the occupied points that the mapper was shown in the voxels of the slice; the gaps that the slice cuts are outlined.
    """
    gap = fullest_gap(view) if gap is None else gap
    # Without the few points far off.
    corners = np.quantile(view.truth.centres, [0.002, 0.998], axis=0)
    raster = Raster.around(corners, view.resolution_m, margin_m=2.0, height_m=0.0)
    width = 13.0
    flat = width * raster.rows / raster.columns
    upright = width * (BELOW_M + ABOVE_M) / (2 * REACH_M)
    figure = new_figure(width + 1.0, flat + upright + 0.6)
    top, bottom = figure.subplots(2, 1, height_ratios=[flat, upright])
    image = _level_slice(top, view, raster)
    _upright_slice(bottom, top, view, gap)
    probability_bar(figure, image, [top, bottom])
    return figure


def _level_slice(axes: Axes, view: SiteView, raster: Raster):
    queries = raster.queries()
    queries[:, 2] = LEVEL_M - view.ground.height_above(queries * [1, 1, 0])
    image = show_probability(axes, raster.image(view.mapper.predict_map(queries)), raster.extent)
    points = view.cloud.points[view.cloud.occupied]
    at_height = np.abs(view.ground.height_above(points) - LEVEL_M) <= view.resolution_m / 2
    _dots(axes, points[at_height, :2], 2.5)
    height = LEVEL_M - view.ground.height_above(view.gaps.centres * [1, 1, 0])
    _cut_balls(axes, view, view.gaps.centres[:, :2], view.gaps.centres[:, 2] - height)
    axes.set(xlim=raster.extent[:2], ylim=raster.extent[2:])
    scale_bar(axes)
    title_of(axes, f"{view.name}, {LEVEL_M:g} m above the ground; dots: occupied points shown")
    return image


def _upright_slice(axes: Axes, level: Axes, view: SiteView, gap: int) -> None:
    """Along the map's x or y, whichever meets more of what is occupied; a line in `level` shows where it is."""
    centre, cell = view.gaps.centres[gap], view.resolution_m
    near = np.abs(view.truth.centres[:, :2] - centre[:2]) <= cell
    along = int(near[:, 0].sum() > near[:, 1].sum())
    across = 1 - along
    ground = centre[2] - view.ground.height_above(centre[None])[0]
    low = voxel_index(np.array([centre[along] - REACH_M, ground - BELOW_M]), cell)
    high = voxel_index(np.array([centre[along] + REACH_M, ground + ABOVE_M]), cell)
    columns, rows = high - low + 1
    sheet = voxel_index(centre[across], cell)
    row, column = np.divmod(np.arange(rows * columns), columns)
    queries = np.empty((rows * columns, 3))
    queries[:, along], queries[:, 2] = (column + low[0] + 0.5) * cell, (row + low[1] + 0.5) * cell
    queries[:, across] = (sheet + 0.5) * cell
    extent = (low[0] * cell, (high[0] + 1) * cell, low[1] * cell, (high[1] + 1) * cell)
    show_probability(axes, view.mapper.predict_map(queries).reshape(rows, columns), extent)
    points = view.cloud.points[view.cloud.occupied]
    _dots(axes, points[voxel_index(points[:, across], cell) == sheet][:, [along, 2]], 6)
    _cut_balls(axes, view, view.gaps.centres[:, [along, 2]], view.gaps.centres[:, across] - (sheet + 0.5) * cell)
    axes.set(xlim=extent[:2], ylim=extent[2:])
    scale_bar(axes)
    axes.set_title(f"upright along {'xy'[along]} through gap {gap + 1} (the line above)", fontsize=10, loc="left", pad=3)
    ends = np.array([[extent[0], extent[1]], [centre[across]] * 2])
    level.plot(*(ends if along == 0 else ends[::-1]), color="black", linewidth=1.2, path_effects=HALO, zorder=6)


def _dots(axes: Axes, places: np.ndarray, size: float) -> None:
    axes.scatter(*places.T, s=size, color=OBSERVED_COLOUR, linewidths=0, zorder=4)


def _cut_balls(axes: Axes, view: SiteView, centres: np.ndarray, distance_m: np.ndarray) -> None:
    """Circles where a slice, at a distance from the gaps' centres, cuts the balls."""
    squared = view.gaps.radius_m**2 - distance_m**2
    for place, square in zip(centres[squared > 0], squared[squared > 0], strict=True):
        axes.add_patch(Circle(place, np.sqrt(square), fill=False, edgecolor=GAP_COLOUR, linewidth=1.0, zorder=5))
