"""A map before and after: what was observed, and what was filled in beside it."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from hilbertvae.checks import InputError
from hilbertvae.drawing.canvas import height_bar, new_figure, probability_bar, save_picture, scale_bar, show_probability, title_of
from hilbertvae.drawing.lit_colours import GAP_TINT, HEIGHT, HEIGHTS_M
from hilbertvae.drawing.oblique import render_voxels, whole_view
from hilbertvae.exports.cell_heights import heights_above_ground
from hilbertvae.exports.map_cells import MapCells

MOST_PX = 2400
"""Cells along a side of a drawn 2D map; the likeliest to be occupied of those that become one, so that thin walls stay."""

LEAST_IN = 1.6
"""Inches along a side of a sheet: in a narrower one no title fits."""
LEAST_VOXELS = 8
"""A 3D view is at least so wide."""


def write_picture(cells: MapCells, path: str | os.PathLike, title: str) -> Path:
    """The picture of a sampled map at `path`. Raises `InputError` for a map without known cells."""
    if not len(cells):
        raise InputError(f"{path}: expected a map with known cells, got none")
    save_picture(_flat(cells, title) if cells.dimension == 2 else _solid(cells, title), path)
    return Path(path)


def _flat(cells: MapCells, title: str) -> Figure:
    """p(occupied), unknown grey: as observed, and filled in if anything was."""
    any_filled = not cells.observed.all()
    cells, seen = cells.fitting(MOST_PX)
    low, shape = cells.box()
    observed = np.full(shape, np.float32(0.5))
    observed[tuple((seen.index - low).T)] = seen.probability
    sheets = {f"{title}, as observed": observed.T}
    if any_filled:
        sheets["filled in"] = cells.dense(cells.probability, np.float32(0.5)).T
    left, bottom = low * cells.resolution_m
    extent = (left, left + shape[0] * cells.resolution_m, bottom, bottom + shape[1] * cells.resolution_m)
    wide = shape[0] >= 2 * shape[1]
    side = 7.0
    width, height = (2 * side, 2 * side * shape[1] / shape[0]) if wide else (side * min(shape[0] / shape[1], 2), side)
    width, height = max(width, LEAST_IN), max(height, LEAST_IN)
    rows, columns = (len(sheets), 1) if wide else (1, len(sheets))
    figure = new_figure(columns * width + 1.2, rows * (height + 0.3) + 0.1)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, (said, sheet) in zip(panels, sheets.items(), strict=True):
        image = show_probability(axes, sheet, extent)
        scale_bar(axes)
        title_of(axes, said)
    probability_bar(figure, image, panels.tolist(), shrink=0.8)
    return figure


def _solid(cells: MapCells, title: str) -> Figure:
    """The occupied voxels from obliquely above, coloured by height, what was filled in tinted."""
    occupied = cells.select(cells.occupied) if cells.occupied.any() else cells.select(np.argsort(cells.probability)[-1:])
    margin = LEAST_VOXELS / 2 * cells.resolution_m  # else a single voxel would be seen from no distance
    camera = whole_view(np.concatenate([occupied.centres - margin, occupied.centres + margin]))
    height_m = heights_above_ground(occupied)
    side = 9.0
    drawn = {f"{title}, as observed": occupied.observed}
    if not cells.observed.all():
        drawn["filled in, orange"] = np.ones(len(occupied), bool)
    figure = new_figure(side + 1.0, len(drawn) * (side * camera.pixels[1] / camera.pixels[0] + 0.3))
    panels = figure.subplots(len(drawn), 1, squeeze=False).ravel()
    for axes, (said, shown) in zip(panels, drawn.items(), strict=True):
        part, tinted = occupied.select(shown), ~occupied.observed[shown]
        image = render_voxels(part.centres, height_m[shown], camera, cells.resolution_m, HEIGHT, HEIGHTS_M, tinted, GAP_TINT)
        axes.imshow(image, extent=(0, camera.pixels[0] * camera.pixel_m, 0, camera.pixels[1] * camera.pixel_m), interpolation="antialiased")
        axes.set(xticks=[], yticks=[])
        scale_bar(axes)
        title_of(axes, said)
    height_bar(figure, panels.tolist(), shrink=0.8)
    return figure
