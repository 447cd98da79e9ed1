"""How sure a map is: its spread beside its errors, and what single grids make of the same gap, side by side."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from scipy.special import expit

from hilbertvae.drawing.canvas import new_figure, outline_gaps, probability_bar, row_label, scale_bar, show_codes, show_probability
from hilbertvae.drawing.colours import UNCERTAINTY, WIDEST_STD
from hilbertvae.drawing.raster import Raster
from hilbertvae.gaps import Gaps
from hilbertvae.grids.kernel import NONE, cell_index, kernel
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.reports.site_pictures import ZOOM
from hilbertvae.site import Site

COMPLETIONS = 3
"""Single grids beside their mean."""


def uncertainty_picture(mapper: HilbertMap, site: Site, gaps: Gaps, chosen: list[int]) -> Figure:
    """A gap a row: truth | map | its spread (`predict_std`) | what each of the nearest grids makes of it alone; in 3D a slice at the gap.

    mapper: fitted on what is shown of the site. The single grids are completions of one place from different surroundings, not samples
    from a posterior: where they differ the map is unsure, and the spread is made of them.
    """
    titles = ["truth", "map", "spread", *(f"grid {number + 1} alone" for number in range(COMPLETIONS))]
    side = 2.2
    figure = new_figure(side * len(titles) + 1.6, side * len(chosen) + 0.4)
    panels = figure.subplots(len(chosen), len(titles), squeeze=False)
    for line, gap in zip(panels, chosen, strict=True):
        centre, radius_m = gaps.centres[gap], gaps.radius_m[gap]
        height_m = float(centre[2]) if site.dimension == 3 else None
        raster = Raster.around(centre[None], site.resolution_m, ZOOM * radius_m, height_m)
        queries = raster.queries()
        image = show_probability(line[1], raster.image(mapper.predict_map(queries)), raster.extent)
        show_codes(line[0], raster.codes(site.voxels), raster.extent)
        spread = line[2].imshow(
            raster.image(mapper.predict_std(queries)), UNCERTAINTY, vmin=0, vmax=WIDEST_STD, origin="lower", extent=raster.extent
        )
        several = completions(mapper, queries, centre)
        for axes, alone in zip(line[3:], several, strict=False):
            show_probability(axes, raster.image(alone), raster.extent)
        for axes in line[3 + len(several) :]:  # white paper in a frame would look like a grid of free space
            axes.set_axis_off()
            axes.text(0.5, 0.5, "no further grid", ha="center", va="center", transform=axes.transAxes, color="#7a7a7a", fontsize=8)
        for axes in line[: 3 + len(several)]:
            axes.set(xticks=[], yticks=[])
            outline_gaps(axes, gaps, height_m, linewidth=1.5)
            axes.set(xlim=raster.extent[:2], ylim=raster.extent[2:])
        row_label(line[0], f"gap {gap + 1}")
    for axes, title in zip(panels[0], titles, strict=True):
        axes.set_title(title, fontsize=9, pad=3)
    scale_bar(panels[0, 0])
    probability_bar(figure, image, panels[:, 3:].ravel().tolist())
    bar = figure.colorbar(spread, ax=panels[:, :3].ravel().tolist(), shrink=0.6, aspect=30, pad=0.01)
    bar.set_label("spread: standard deviation of p", fontsize=9)
    return figure


def completions(mapper: HilbertMap, queries: np.ndarray, centre: np.ndarray) -> list[np.ndarray]:
    """p(occupied) (Q,) of each of the `COMPLETIONS` boxes nearest to `centre (D,)` that hold it, as if all boxes said what it says.

    Fewer where fewer hold it; 0.5 outside of a box. What was observed is left out: this is what a grid has drawn.
    """
    nearest = mapper.index_.holding(centre[None], mapper.neighbours)[0]
    nothing_seen = np.zeros(len(queries), bool), np.empty((0, mapper.evidence_.feature_count))
    found = []
    for box in nearest[nearest != NONE][:COMPLETIONS]:
        inside = cell_index(mapper.frames_, queries, np.full(len(queries), box), mapper.grids_.shape[1])[1]
        holding = np.where(inside, box, NONE)[:, None]
        value = kernel(mapper.grids_, mapper.frames_, queries, holding, mapper.grid_.interpolated)
        values = np.repeat(value, mapper.neighbours, axis=1)
        found.append(expit(mapper.rank_weights_.logit(values, inside * mapper.neighbours, *nothing_seen)))
    return found
