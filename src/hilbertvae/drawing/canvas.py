"""Strokes that pictures are made of. Figures are matplotlib objects without pyplot: no display, no global state."""

from __future__ import annotations

import math
import os
import warnings

import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colorbar import Colorbar
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Circle
from PIL import Image

from hilbertvae.drawing.colours import GAP_COLOUR, PROBABILITY
from hilbertvae.drawing.lit_colours import HEIGHT, HEIGHTS_M
from hilbertvae.files import atomic
from hilbertvae.gaps import Gaps
from hilbertvae.mappers.mapper import OCCUPIED_ABOVE

DPI = 150
Extent = tuple[float, float, float, float]
FRAME = {"edgecolor": "#808080", "linewidth": 0.6}
HALO = [patheffects.withStroke(linewidth=2.5, foreground="white")]


def new_figure(width_in: float, height_in: float) -> Figure:
    """An empty figure of so many inches, whose parts make room for each other."""
    return Figure(figsize=(width_in, height_in), dpi=DPI, layout="constrained", facecolor="white")


def save_picture(figure: Figure, path: str | os.PathLike) -> np.ndarray:
    """The figure as a PNG at `path`, whole or not there; returns its `pixels`, since drawing it again would take as long."""
    image = pixels(figure)
    with atomic(path) as temporary:
        Image.fromarray(image).save(temporary, format="png", dpi=(figure.dpi, figure.dpi))
    return image


def pixels(figure: Figure) -> np.ndarray:
    """(height, width, 3) uint8, as TensorBoard takes it."""
    canvas = FigureCanvasAgg(figure)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from font")  # a line for each letter of a name that has others than the font's
        if figure.get_layout_engine() is not None:
            figure.get_layout_engine().execute(figure)  # once more than drawing does: the first time leaves titles half outside
        canvas.draw()
    return np.asarray(canvas.buffer_rgba())[:, :, :3].copy()


def show_probability(axes: Axes, probability: np.ndarray, extent: Extent | None = None) -> AxesImage:
    """p(occupied) (rows, columns), the first row at the bottom; extent in metres, or in cells unless given."""
    bare_axes(axes)
    # Blended as colours, not as numbers: halfway between free and occupied must not look like unknown.
    return axes.imshow(probability, PROBABILITY, vmin=0, vmax=1, origin="lower", extent=extent, interpolation_stage="rgba")


def show_codes(axes: Axes, codes: np.ndarray, extent: Extent | None = None) -> AxesImage:
    """Codes (rows, columns) in the colours of p = 0 (free), 0.5 (unknown) and 1 (occupied)."""
    return show_probability(axes, (codes + 1) / 2, extent)


def title_of(axes: Axes, text: str, **how) -> None:
    """A title at the left that may have the name of somebody's file, in which `$` stands for itself and begins no formula."""
    axes.set_title(text, **{"fontsize": 10, "loc": "left", "pad": 3, **how}, parse_math=False)


def corner_note(figure: Figure, text: str) -> None:
    """Small words in the upper right corner, above all titles."""
    figure.suptitle(text, x=0.995, ha="right", fontsize=8, color="#555555")


def bare_axes(axes: Axes) -> None:
    """A thin frame without ticks."""
    axes.set(xticks=[], yticks=[])
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_visible(False)  # measured for each layout, ticks or not: two thirds of its time
    for spine in axes.spines.values():
        spine.set(**FRAME)


def row_label(axes: Axes, text: str) -> None:
    """Words along the left side of bare axes, about all that stand in their row."""
    axes.yaxis.set_visible(True)
    axes.set_ylabel(text, fontsize=10)


def scale_bar(axes: Axes) -> None:
    """A bar of 1, 2 or 5 times a power of ten metres, about a fifth of the picture's width, in its lower left corner."""
    left, right = axes.get_xlim()
    bottom, top = axes.get_ylim()
    length = round_length((right - left) / 5)
    x, y = left + 0.04 * (right - left), bottom + 0.045 * (top - bottom)
    axes.plot([x, x + length], [y, y], color="black", linewidth=2.2, solid_capstyle="butt", path_effects=HALO, zorder=6)
    axes.annotate(
        f"{length:g} m", (x + length / 2, y), (0, 3), textcoords="offset points", ha="center", va="bottom",
        fontsize=8, path_effects=HALO, zorder=6,
    )  # fmt: skip
    axes.set(xlim=(left, right), ylim=(bottom, top))


def round_length(metres: float) -> float:
    """The largest of 1, 2 and 5 times a power of ten that is at most `metres`."""
    power = 10.0 ** math.floor(math.log10(metres) + 1e-9)
    return power * max(step for step in (1, 2, 5) if step <= metres / power + 1e-9)


def outline_gaps(
    axes: Axes, gaps: Gaps, height_m: float | None = None, linewidth: float = 1.0, numbers: dict[int, str] | None = None
) -> None:
    """Circles around gaps; in 3D, where the sheet at `height_m` cuts the balls. `numbers` writes a label beside chosen gaps."""
    for number, (centre, radius) in enumerate(zip(gaps.centres, gaps.radius_m, strict=True)):
        if height_m is not None and len(centre) == 3:
            squared = radius**2 - (centre[2] - height_m) ** 2
            if squared <= 0:
                continue
            radius = math.sqrt(squared)
        axes.add_patch(Circle(centre[:2], radius, fill=False, edgecolor=GAP_COLOUR, linewidth=linewidth, zorder=5))
        if numbers and number in numbers:
            axes.annotate(
                numbers[number], centre[:2] + radius / math.sqrt(2), (1.5, 1.5), textcoords="offset points", fontsize=9,
                fontweight="bold", color=GAP_COLOUR, path_effects=HALO, zorder=6, clip_on=True,
            )  # fmt: skip


def probability_bar(figure, image: AxesImage, axes, **where) -> None:
    """The colour bar of p(occupied), with ticks at the cuts beyond which a point is called free or occupied."""
    bar = figure.colorbar(image, ax=axes, **{"shrink": 0.6, "aspect": 30, "pad": 0.01, **where})
    bar.set_ticks([0, 0.2, 0.4, 0.5, OCCUPIED_ABOVE, 0.8, 1], labels=["0  free", "0.2", "0.4", "unknown", "0.6", "0.8", "1  occupied"])
    label_bar(bar, "p(occupied)")


def height_bar(figure: Figure, axes, shrink: float = 0.8) -> None:
    """The colour bar of heights above the ground, as voxels are coloured by them."""
    scale = ScalarMappable(Normalize(*HEIGHTS_M), HEIGHT)
    bar = figure.colorbar(scale, ax=axes, shrink=shrink, aspect=30, pad=0.01, extend="max", extendfrac=0.03)
    bar.set_ticks([0, 1, 2, 3, 4])
    label_bar(bar, "height above ground (m)")


def label_bar(bar: Colorbar, label: str) -> None:
    """A colour bar's label, ticks and frame, as in every picture."""
    bar.ax.tick_params(labelsize=8, length=2)
    bar.set_label(label, fontsize=9)
    bar.outline.set(**FRAME)
