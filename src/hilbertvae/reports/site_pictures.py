"""Whole sites: the contact sheet (the paper's Fig. 4), a site before, with gaps and after, and zooms on its gaps (Fig. 5)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from hilbertvae.cloud import Cloud
from hilbertvae.drawing.canvas import (
    corner_note,
    new_figure,
    outline_gaps,
    probability_bar,
    row_label,
    scale_bar,
    show_codes,
    show_probability,
    title_of,
)
from hilbertvae.drawing.raster import Raster
from hilbertvae.gaps import Gaps
from hilbertvae.mappers.mapper import Mapper
from hilbertvae.scoring.result import Result
from hilbertvae.site import Site

SHEET_CELLS = 480
"""Cells along the longer side of a site on the contact sheet."""
MAP_CELLS = 1000
"""Cells along the longer side of the drawn codes of a whole site."""

SLICE_M = 1.0
"""Above the median height of a 3D site's ground: the slice that stands for it on the contact sheet."""
ZOOM = 2.0
"""Half the side of a gap's window, in radii of the gap."""
ZOOMED = 6
"""How many gaps are zoomed, which have their numbers on the map of the site."""


def contact_sheet(sites: Sequence[tuple[Site, str]], columns: int = 4) -> Figure:
    """Each site's voxels, free light, occupied dark, unknown grey, under its name and role; `sites` are (site, role). Of 3D sites a slice,
    `SLICE_M` above the median height of the ground, which a note says."""
    columns = min(columns, len(sites))
    rows = math.ceil(len(sites) / columns)
    solid = any(site.dimension == 3 for site, _ in sites)
    figure = new_figure(3.2 * columns, 3.3 * rows + 0.2 * solid)
    if solid:
        corner_note(figure, f"3D sites: slices {SLICE_M:g} m above the median ground")
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, (site, role) in zip(panels, sites, strict=False):
        height_m = float(np.median(site.ground.height_m)) + SLICE_M if site.dimension == 3 else None
        raster = Raster.around(site.voxels.points, site.resolution_m, 1.0, height_m)
        codes, extent = raster.coarse(raster.codes(site.voxels), SHEET_CELLS)
        show_codes(axes, _squared(codes), _squared_extent(codes, extent))
        scale_bar(axes)
        title_of(axes, site.name, fontweight="bold")
        axes.set_title(role, fontsize=9, color="#555555", loc="right", pad=3)
    for axes in panels[len(sites) :]:
        axes.set_visible(False)
    return figure


def _padding(shape: tuple[int, int]) -> list[tuple[int, int]]:
    return [((max(shape) - length) // 2, max(shape) - length - (max(shape) - length) // 2) for length in shape]


def _squared(codes: np.ndarray) -> np.ndarray:
    """Codes in the middle of a square of unknown, so that sites of any shape stand in rows."""
    return np.pad(codes, _padding(codes.shape))


def _squared_extent(codes: np.ndarray, extent):
    left, right, bottom, top = extent
    cell = (right - left) / codes.shape[1]
    (below, above), (before, behind) = _padding(codes.shape)
    return left - before * cell, right + behind * cell, bottom - below * cell, top + above * cell


def gaps_of(result: Result, site: Site, seed: int) -> Gaps:
    """The gaps that a `Result` was scored on with this gap seed."""
    ball = next(ball for ball in result.gaps if ball["seed"] == seed)
    return Gaps(np.array(ball["centres"]), np.array(ball["radius_m"]), site.resolution_m, rim=result.protocol["rim"])


@dataclass(frozen=True)
class SiteMaps:
    """Images of one 2D site on one raster: truth and shown (rows, columns) int8 codes, maps by mapper (rows, columns) p(occupied)."""

    name: str
    raster: Raster
    gaps: Gaps
    hidden: np.ndarray
    """(G,) how many occupied voxels each gap hides."""
    truth: np.ndarray
    shown: np.ndarray
    maps: dict[str, np.ndarray]

    @classmethod
    def draw(cls, site: Site, gaps: Gaps, shown: Cloud, mappers: Mapping[str, Mapper]) -> SiteMaps:
        """Ask every mapper, already fitted on `shown` of the site, outside of `gaps`, at each cell of the map's resolution."""
        # Windows around gaps at the site's edge stay inside: where a mapper was not asked, white paper would look like free space.
        reach = ZOOM * gaps.radius_m[:, None]
        held = np.concatenate([site.voxels.points, gaps.centres - reach, gaps.centres + reach])
        raster = Raster.around(held, site.resolution_m)
        return cls(
            site.name,
            raster,
            gaps,
            gaps.count(site.voxels.points[site.voxels.occupied]),
            raster.codes(site.voxels),
            raster.codes(shown),
            {name: raster.probability(mapper) for name, mapper in mappers.items()},
        )

    def telling(self, count: int) -> list[int]:
        """Numbers of gaps worth a closer look: from the one that hides the most occupied voxels down to the middle one, evenly.

        So the choice knows the truth and no mapper's answer.
        """
        order = np.argsort(-self.hidden, kind="stable")
        ranks = np.linspace(0, (len(order) - 1) / 2, min(count, (len(order) + 1) // 2)).round().astype(int)
        return sorted(order[ranks].tolist())


def site_map_picture(site_maps: SiteMaps) -> Figure:
    """Before, with gaps (what mappers are given), and every mapper's map, gaps outlined; the zoomed ones have their numbers."""
    raster, gaps = site_maps.raster, site_maps.gaps
    panels = {"before": None, f"with {len(gaps.centres)} gaps: what mappers are given": None, **site_maps.maps}
    aspect = raster.columns / raster.rows
    rows, columns = _arranged(len(panels), aspect)
    # As wide as a page allows, and no side of a panel longer than 9 inches.
    width = min(15.0 / columns, 13.0 / rows * aspect, 9.0, 9.0 * aspect)
    figure = new_figure(columns * width + 1.1, rows * (width / aspect + 0.3))
    drawn = figure.subplots(rows, columns, squeeze=False).ravel()
    numbers = {gap: str(gap + 1) for gap in site_maps.telling(ZOOMED)}
    image = None
    for axes, (title, probability) in zip(drawn, panels.items(), strict=False):
        if probability is None:
            image = show_codes(axes, *raster.coarse(site_maps.truth if title == "before" else site_maps.shown, MAP_CELLS))
        else:
            image = show_probability(axes, probability, raster.extent)
        outline_gaps(axes, gaps, numbers=numbers)
        axes.set(xlim=raster.extent[:2], ylim=raster.extent[2:])
        scale_bar(axes)
        title_of(axes, f"{site_maps.name}, {title}" if title == "before" else title)
    for axes in drawn[len(panels) :]:
        axes.set_visible(False)
    probability_bar(figure, image, drawn.tolist())
    return figure


def _arranged(panels: int, aspect: float) -> tuple[int, int]:
    """(rows, columns) of equal panels, as near to a page's shape as can be without more than one place left empty."""
    fits = [(math.ceil(panels / columns), columns) for columns in range(1, panels + 1)]
    full = [(rows, columns) for rows, columns in fits if rows * columns - panels <= (panels > 4)]
    return min(full, key=lambda shape: abs(math.log(shape[1] * aspect / shape[0] / 1.4)))


def gap_zoom_picture(site_maps: SiteMaps) -> Figure:
    """A few gaps (`SiteMaps.telling`), one a column: the truth above, then every mapper's answer; windows of twice the diameter."""
    raster, gaps, chosen = site_maps.raster, site_maps.gaps, site_maps.telling(ZOOMED)
    rows = {"truth": None, **site_maps.maps}
    side = 2.1
    figure = new_figure(side * len(chosen) + 1.3, side * len(rows) + 0.3)
    panels = figure.subplots(len(rows), len(chosen), squeeze=False)
    image = None
    for line, (title, probability) in zip(panels, rows.items(), strict=True):
        for axes, gap in zip(line, chosen, strict=True):
            if probability is None:
                image = show_codes(axes, site_maps.truth, raster.extent)
                axes.set_title(f"gap {gap + 1}", fontsize=9, pad=3)
            else:
                image = show_probability(axes, probability, raster.extent)
            outline_gaps(axes, gaps, linewidth=1.5)
            reach = ZOOM * gaps.radius_m[gap]
            x, y = gaps.centres[gap, :2]
            axes.set(xlim=(x - reach, x + reach), ylim=(y - reach, y + reach))
        row_label(line[0], title)
    scale_bar(panels[0, 0])
    probability_bar(figure, image, panels.ravel().tolist())
    return figure
