"""Clusters: one through the pipeline (the paper's Fig. 3), grids beside their reconstructions, and grids decoded from z ~ N(0, I)."""

from __future__ import annotations

import inspect
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon

from hilbertvae.cloud import Cloud
from hilbertvae.drawing.canvas import (
    bare_axes,
    label_bar,
    new_figure,
    outline_gaps,
    probability_bar,
    scale_bar,
    show_codes,
    show_probability,
)
from hilbertvae.drawing.colours import ERROR, FREE_POINT_COLOUR, PROBABILITY, SELECTED_COLOUR
from hilbertvae.drawing.raster import Raster
from hilbertvae.gaps import Gaps
from hilbertvae.grids.aligned_grid import OCCUPIED, UNKNOWN
from hilbertvae.grids.cluster_grids import bin_shown
from hilbertvae.grids.frame import Frames
from hilbertvae.mappers.hilbert_map import SHOWN_FROM
from hilbertvae.reconstruction.likelihood import LIKELIHOODS
from hilbertvae.reconstruction.reconstructor import Completion, Reconstructor

PIPELINE_CELLS = 700
LEAST_HIDDEN = 20
"""Occupied cells that a gap must hide for a cluster to be worth a row."""


def kernel_probability(values: np.ndarray, likelihood: str) -> np.ndarray:
    """p(occupied) of kernel values, as the likelihood of that kind reads them."""
    return LIKELIHOODS[likelihood].probability(torch.from_numpy(np.asarray(values))).numpy()


def sheet(grid: np.ndarray, layer: int | None = None) -> np.ndarray:
    """A grid (n, ..., n) as an image (rows, columns), x right and y up; of a 3D grid a horizontal `layer`, by default the middle one."""
    if grid.ndim == 3:
        grid = grid[:, :, grid.shape[2] // 2 if layer is None else layer]
    return grid.T


def fullest_layer(chosen: np.ndarray) -> int | None:
    """The horizontal layer of a 3D grid, (n, n, n) bool, with the most `chosen` cells; None in 2D."""
    return int(chosen.sum(axis=(0, 1)).argmax()) if chosen.ndim == 3 else None


def in_grid(gaps: Gaps, frames: Frames, cluster: int, cells: int) -> Gaps:
    """The balls that reach into a cluster's box, in cells of its grid as images have them, the first one's middle at 0."""
    scale = frames.scale[cluster] / cells
    centres = (frames.into(gaps.centres, np.full(len(gaps.centres), cluster)) + 0.5) * cells - 0.5
    near = (np.abs(centres - (cells - 1) / 2) < cells / 2 + gaps.radius_m[:, None] / scale).all(axis=1)
    return replace(gaps, centres=centres[near], radius_m=gaps.radius_m[near] / scale, resolution_m=gaps.resolution_m / scale)


def _outline(axes: Axes, gaps: Gaps, layer: int | None) -> None:
    """Gaps, `in_grid`, around the cells of an image that they cut."""
    outline_gaps(axes, gaps, None if layer is None else float(layer))


def pipeline_picture(
    cloud: Cloud, reconstructor: Reconstructor, frames: Frames, shown: np.ndarray, target: np.ndarray, gaps: Gaps
) -> Figure:
    """Fig. 3: the cloud with one cluster selected, the cluster, its aligned grid, its reconstruction, and the truth.

    cloud: what the mapper is given; frames: its clusters'; shown, target: int8 codes (M, n, ..., n) of it in these, and of what `gaps`
    were cut from. The cluster is the one from which the most occupied cells were cut. In 3D all panels show one layer of that grid,
    the one that lost the most.
    """
    settings = reconstructor.grid
    cluster = int(_hidden(shown, target).argmax())
    occupied = target[cluster] == OCCUPIED
    lost = occupied & (shown[cluster] == UNKNOWN)
    layer = fullest_layer(lost if lost.any() else occupied)
    values = reconstructor.reconstruct(bin_shown(cloud, frames.select(slice(cluster, cluster + 1)), settings, reconstructor.detailed))[0]
    probability = kernel_probability(values, reconstructor.likelihood.kind)

    titles = ["cloud", "cluster", "aligned grid", "reconstruction", "truth"]
    # The unknown around a cloud is cut to 1 : 2 at most by its own shape, so that its panel stays in a row with square ones.
    height_m = _layer_height(frames, cluster, layer, settings.cells)
    reach = _reach(frames, cluster, settings.cluster_diameter_m)
    around = np.concatenate([cloud.points, frames.centre[cluster] + [[-reach], [reach]]])  # a corridor is narrower than its boxes
    raster = Raster.around(around, reconstructor.resolution_m, height_m=height_m)
    aspect = float(np.clip(raster.columns / raster.rows, 0.5, 2.0))
    figure = new_figure(3.1 * (aspect + len(titles) - 1) + 1.0, 3.5)
    panels = figure.subplots(1, len(titles), width_ratios=[aspect] + [1] * (len(titles) - 1))
    for axes, title in zip(panels, titles, strict=True):
        axes.set_title(title, fontsize=10, loc="left", pad=3)

    show_codes(panels[0], *raster.coarse(raster.codes(cloud), PIPELINE_CELLS))
    _outline_frame(panels[0], frames, cluster, settings.cluster_diameter_m)
    scale_bar(panels[0])
    _scatter_cluster(panels[1], cloud, frames, cluster, settings.cluster_diameter_m, height_m, reconstructor.resolution_m)
    show_codes(panels[2], sheet(shown[cluster], layer))
    image = show_probability(panels[3], sheet(probability, layer))
    show_codes(panels[4], sheet(target[cluster], layer))
    for axes in panels[2:]:
        _outline(axes, in_grid(gaps, frames, cluster, settings.cells), layer)
    probability_bar(figure, image, panels.tolist(), shrink=0.85)
    return figure


def _layer_height(frames: Frames, cluster: int, layer: int | None, cells: int) -> float | None:
    if layer is None:
        return None
    return float(frames.centre[cluster, 2] + ((layer + 0.5) / cells - 0.5) * frames.scale[cluster])


def _reach(frames: Frames, cluster: int, diameter_m: float) -> float:
    """How far a cluster's ball and its box reach from its middle, along an axis."""
    return max(frames.scale[cluster] * math.sqrt(2) / 2 if frames.turned else frames.scale[cluster] / 2, diameter_m / 2)


def _outline_frame(axes: Axes, frames: Frames, cluster: int, diameter_m: float) -> None:
    """The cluster's ball and its grid's box, seen from above."""
    corners = np.zeros((4, frames.centre.shape[1]))
    corners[:, :2] = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]
    corners = frames.back(corners, np.full(4, cluster))[:, :2]
    axes.add_patch(Polygon(corners, fill=False, edgecolor=SELECTED_COLOUR, linewidth=1.4, zorder=5))
    axes.add_patch(Circle(frames.centre[cluster, :2], diameter_m / 2, fill=False, edgecolor=SELECTED_COLOUR, linewidth=1.0, zorder=5))


def _scatter_cluster(axes: Axes, cloud: Cloud, frames: Frames, cluster: int, diameter_m: float, height_m, resolution_m: float) -> None:
    """The cluster's points in the map's axes, with its ball and its box; paler, those of the box alone, which fill the grid too."""
    centre, number = frames.centre[cluster], np.full(len(cloud), cluster)
    inside = np.linalg.norm(cloud.points - centre, axis=1) <= diameter_m / 2
    shown = inside | (np.abs(frames.into(cloud.points, number)) <= 0.5).all(axis=1)
    if height_m is not None:
        shown &= np.abs(cloud.points[:, 2] - height_m) <= resolution_m / 2
    for occupied, colour, size in ((False, FREE_POINT_COLOUR, 3), (True, PROBABILITY(1.0), 5)):
        for ball, alpha in ((True, 1.0), (False, 0.35)):
            points = cloud.points[shown & (inside == ball) & (cloud.occupied == occupied)]
            axes.scatter(points[:, 0], points[:, 1], s=size, color=colour, alpha=alpha, linewidths=0)
    _outline_frame(axes, frames, cluster, diameter_m)
    reach = _reach(frames, cluster, diameter_m) * 1.03
    axes.set(xlim=(centre[0] - reach, centre[0] + reach), ylim=(centre[1] - reach, centre[1] + reach), aspect="equal")
    bare_axes(axes)
    scale_bar(axes)


def gapped_clusters(shown: np.ndarray, target: np.ndarray, count: int = 6) -> np.ndarray:
    """Random numbers of clusters from which a gap cut at least `LEAST_HIDDEN` occupied cells; fewer than `count` if there are fewer."""
    telling = np.flatnonzero(_hidden(shown, target) >= LEAST_HIDDEN)
    return np.sort(np.random.default_rng(0).permutation(telling)[:count])


def _hidden(shown: np.ndarray, target: np.ndarray) -> np.ndarray:
    """(B,) how many occupied cells of `target` (B, n, ..., n) are unknown as shown."""
    return ((target == OCCUPIED) & (shown == UNKNOWN)).reshape(len(shown), -1).sum(axis=1)


def reconstruction_rows(
    shown: np.ndarray, target: np.ndarray, values: np.ndarray, gaps: Sequence[Gaps], likelihood: str = "bernoulli"
) -> Figure:
    """A row per cluster: input | reconstruction | truth | error, gaps outlined.

    shown, target: int8 codes (B, n, ..., n); values: kernel values of the same shape, as `Reconstructor.reconstruct` gives them; gaps: of
    each, `in_grid`. The error is p - truth where the truth is known. Of 3D grids, each row shows the layer with the most occupied cells.
    """
    probability = kernel_probability(values, likelihood)
    titles = ("input", "reconstruction", "truth", "error")
    side = 1.9
    figure = new_figure(side * 4 + 2.2, side * len(shown) + 0.3)
    panels = figure.subplots(len(shown), 4, squeeze=False)
    for axes, title in zip(panels[0], titles, strict=True):
        axes.set_title(title, fontsize=10, pad=3)
    for line, given, answer, truth, balls in zip(panels, shown, probability, target, gaps, strict=True):
        layer = fullest_layer(truth == OCCUPIED)
        given, answer, truth = sheet(given, layer), sheet(answer, layer), sheet(truth, layer)
        show_codes(line[0], given)
        image = show_probability(line[1], answer)
        show_codes(line[2], truth)
        error = show_probability(line[3], np.ma.masked_where(truth == UNKNOWN, answer - (truth == OCCUPIED)))
        error.set(cmap=ERROR, clim=(-1, 1))
        for axes in line:
            _outline(axes, balls, layer)
    probability_bar(figure, image, panels[:, :3].ravel().tolist(), location="left", shrink=min(1.0, 3 / len(shown)))
    bar = figure.colorbar(error, ax=panels[:, 3].tolist(), shrink=min(1.0, 3 / len(shown)), aspect=30, pad=0.02)
    bar.set_ticks([-1, 0, 1], labels=["missed", "right", "invented"])
    label_bar(bar, "p(occupied) - truth")
    return figure


def completion_rows(
    shown: np.ndarray, target: np.ndarray, guess: Completion, draws: np.ndarray, gaps: Sequence[Gaps], likelihood: str = "bernoulli"
) -> Figure:
    """A row per cluster: input | the map's guess | draws from the conditional prior | truth, gaps outlined.

    shown, target: int8 codes (B, n, ..., n); guess: of the same shape; draws: kernel values (L, B, n, ..., n); gaps: of each,
    `in_grid`. Guess and draws fade, as maps do, where it is unlikely that scans would see a cell at all. Of 3D grids, each row shows the
    layer with the most occupied cells.
    """
    titles = ["input", "guess", *(f"draw {number}" for number in range(1, len(draws) + 1)), "truth"]
    side = 1.5
    figure = new_figure(side * len(titles) + 1.0, side * len(shown) + 0.3)
    panels = figure.subplots(len(shown), len(titles), squeeze=False)
    for axes, title in zip(panels[0], titles, strict=True):
        axes.set_title(title, fontsize=9, pad=3)
    answers = kernel_probability(np.concatenate([guess.value[None].astype(np.float32), draws]), likelihood)
    if guess.known is not None:
        answers = 0.5 + (answers - 0.5) * np.minimum(guess.known / 255 / SHOWN_FROM[shown.ndim - 1], 1.0)
    for row, line in enumerate(panels):
        layer = fullest_layer(target[row] == OCCUPIED)
        given, truth = sheet(shown[row], layer), sheet(target[row], layer)
        show_codes(line[0], given)
        show_codes(line[-1], truth)
        for axes, answer in zip(line[1:-1], answers[:, row], strict=True):
            image = show_probability(axes, sheet(answer, layer))
        for axes in line:
            _outline(axes, gaps[row], layer)
    probability_bar(figure, image, panels.ravel().tolist(), shrink=min(1.0, 3 / len(shown)))
    return figure


def decodes_alone(reconstructor: Reconstructor) -> bool:
    """Whether its network makes grids of z alone: one of somebody's own may call something else `decode`, which asks for more."""
    decode = getattr(reconstructor.network, "decode", None)
    if decode is None or not hasattr(reconstructor.network_settings, "latent"):
        return False
    try:
        inspect.signature(decode).bind("z")
    except TypeError:
        return False
    return True


def prior_picture(reconstructor: Reconstructor, columns: int = 8, rows: int = 3, seed: int = 0) -> Figure:
    """Grids decoded from z ~ N(0, I) alone: what the decoder takes places to be like (II-C). Of 3D grids the middle layer."""
    generator = torch.Generator().manual_seed(seed)
    z = torch.randn(rows * columns, reconstructor.network_settings.latent, generator=generator)
    network = reconstructor.network.eval().cpu()
    with torch.inference_mode():
        values = LIKELIHOODS[reconstructor.likelihood.kind].kernel_value(network.decode(z)).numpy()
    figure = new_figure(1.4 * columns + 1.0, 1.45 * rows)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, probability in zip(panels, kernel_probability(values, reconstructor.likelihood.kind), strict=True):
        image = show_probability(axes, sheet(probability))
    probability_bar(figure, image, panels.tolist(), shrink=0.9, aspect=25)
    return figure
