"""3D sites in the way of the paper's Fig. 8: what a mapper was shown beside its map, and close-ups of gaps."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from hilbertvae.drawing.canvas import bare_axes, height_bar, new_figure, probability_bar, scale_bar, title_of
from hilbertvae.drawing.colours import GAP_COLOUR
from hilbertvae.drawing.lit_colours import GAP_TINT, HEIGHT, HEIGHTS_M, LIT
from hilbertvae.drawing.oblique import ELEVATION_DEG, Camera, render_voxels, visible, whole_view
from hilbertvae.gaps import INSIDE, Gaps
from hilbertvae.ground import ABOVE_GROUND_M
from hilbertvae.reports.site_view import SiteView, Voxels, one_gap, telling_gaps

CLOSE_UP_PX = 640, 520
"""The width and height of a close-up."""
WINDOW = 2.4
"""Half the side of a close-up's window, in radii of the gap."""
TURNS_DEG = (0.0, -25.0, 25.0, -50.0, 50.0)
"""How far a close-up may turn from the sensor's view."""


def site_view_picture(view: SiteView) -> Figure:
    """The whole site: what the mapper was shown beside its map, coloured by height and by p(occupied); gaps outlined and tinted."""
    camera = whole_view(view.truth.centres)
    width, height = camera.pixels
    side = 7.2
    figure = new_figure(2 * side + 1.0, 2 * (side * height / width + 0.3))
    panels = figure.subplots(2, 2)
    drawn = {"shown": (view.shown, f"{view.name}, shown: {len(view.gaps.centres)} gaps cut"), "map": (view.map, "map, gaps tinted")}
    for column, (name, (voxels, title)) in enumerate(drawn.items()):
        tinted = view.in_gaps(voxels) if name == "map" else None
        top, bottom = panels[:, column]
        _show(top, render_voxels(voxels.centres, voxels.height_m, camera, view.resolution_m, HEIGHT, HEIGHTS_M, tinted, GAP_TINT), camera)
        _show(bottom, render_voxels(voxels.centres, voxels.probability, camera, view.resolution_m, LIT), camera)
        title_of(top, title)
    panels[1, 0].set_title("shown, by the map's p(occupied)", fontsize=10, loc="left", pad=3)
    panels[1, 1].set_title("map, by its p(occupied)", fontsize=10, loc="left", pad=3)
    _outline_balls(panels[0, 0], view.gaps, camera, 0.6)
    height_bar(figure, panels[0].tolist())
    probability_bar(figure, ScalarMappable(Normalize(0, 1), LIT), panels[1].tolist(), shrink=0.8)
    return figure


def _show(axes: Axes, image: np.ndarray, camera: Camera) -> None:
    """A rendered picture with metres along its axes, as they are across the line of sight."""
    width, height = (camera.pixel_m * p for p in camera.pixels)
    axes.imshow(image, extent=(0, width, 0, height), interpolation="antialiased")
    bare_axes(axes)
    scale_bar(axes)


def _outline_balls(axes: Axes, gaps: Gaps, camera: Camera, linewidth: float) -> None:
    """Circles around gaps: a ball seen along parallel rays is one."""
    column, row, _ = camera.project(gaps.centres).T
    for x, y, radius in zip(column * camera.pixel_m, (camera.pixels[1] - row) * camera.pixel_m, gaps.radius_m, strict=True):
        axes.add_patch(Circle((x, y), radius, fill=False, edgecolor=GAP_COLOUR, linewidth=linewidth, zorder=5))


def close_up_picture(view: SiteView, gaps: dict[int, str] | None = None) -> Figure:
    """A gap a row (`telling_gaps` unless given): shown | truth | map, coloured by height, what lies in gaps tinted, and if the view has it
    the map calibrated for points, the paper's reading: a voxel on a wall has many of them."""
    chosen = telling_gaps(view) if gaps is None else gaps
    drawn = {"shown": view.shown, "truth": view.truth, "map": view.map}
    if view.for_points is not None:
        drawn["map, calibrated for points"] = view.for_points
    width, height = CLOSE_UP_PX
    side = 3.6
    figure = new_figure(len(drawn) * side + 0.9, max(len(chosen), 1) * (side * height / width + 0.25))
    panels = figure.subplots(max(len(chosen), 1), len(drawn), squeeze=False)
    for line, (gap, why) in zip(panels, chosen.items(), strict=False):
        windows = [_window(view, voxels, gap) for voxels in drawn.values()]
        camera = _best_view(view, windows[1], gap)
        for axes, title, voxels in zip(line, drawn, windows, strict=True):
            image = render_voxels(
                voxels.centres, voxels.height_m, camera, view.resolution_m, HEIGHT, HEIGHTS_M, view.in_gaps(voxels), GAP_TINT
            )
            _show(axes, image, camera)
            _outline_balls(axes, one_gap(view.gaps, gap), camera, 1.4)
            axes.set(xlim=(0, width * camera.pixel_m), ylim=(0, height * camera.pixel_m))
            axes.set_title(title, fontsize=10, loc="right", pad=3)
        line[0].set_title(f"gap {gap + 1}: {why}", fontsize=9, loc="left", pad=3)
    for axes in panels[len(chosen) :].ravel():
        axes.set_visible(False)
    height_bar(figure, panels.ravel().tolist(), shrink=min(1.0, 1.8 / len(panels)))
    return figure


def _window(view: SiteView, voxels: Voxels, gap: int) -> Voxels:
    reach = WINDOW * view.gaps.radius_m[gap]
    return voxels.select(np.abs(voxels.centres[:, :2] - view.gaps.centres[gap, :2]).max(axis=1) <= reach)


def _best_view(view: SiteView, truth: Voxels, gap: int) -> Camera:
    """Roughly as the nearest sweep saw it, turned so that most of the gap's true voxels above ground can be seen.

    From behind, a map would hide the gap wherever it goes on into what no beam reached.
    """
    inside = (one_gap(view.gaps, gap).part(truth.centres) == INSIDE) & (truth.height_m > ABOVE_GROUND_M)
    away = view.gaps.centres[gap, :2] - view.sensors[:, :2]
    away = away[np.argmin(np.linalg.norm(away, axis=1))]
    azimuth = math.degrees(math.atan2(away[1], away[0]))
    small = tuple(p // 4 for p in CLOSE_UP_PX)
    top = np.array([0, 0, view.gaps.radius_m[gap]])
    framed = np.vstack([truth.centres, view.gaps.centres[gap] + top, view.gaps.centres[gap] - top])

    def seen(turn: float) -> int:
        voxel = visible(truth.centres, Camera.around(framed, azimuth + turn, ELEVATION_DEG, small), view.resolution_m)
        return np.count_nonzero(inside[voxel[voxel >= 0]])

    return Camera.around(framed, azimuth + max(TURNS_DEG, key=seen), ELEVATION_DEG, CLOSE_UP_PX, margin=0.04)
