"""What figures of tables share: numbers with their spread, panels side by side, and a figure of nothing."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hilbertvae.drawing.canvas import new_figure, title_of
from hilbertvae.tables.page import Row
from hilbertvae.tables.spread import Spread

GREY = "#7a7a7a"


def panels(titles: list[str], width_in: float = 4.6, height_in: float = 4.0, sharey: bool = False) -> tuple[Figure, list[Axes]]:
    """A figure with a panel per title, side by side."""
    figure = new_figure(width_in * len(titles), height_in)
    axes = list(figure.subplots(1, len(titles), squeeze=False, sharey=sharey)[0])
    for panel, title in zip(axes, titles, strict=True):
        title_of(panel, title, pad=None)
        panel.spines[["top", "right"]].set_visible(False)
        panel.tick_params(labelsize=8)
        panel.grid(color="#ececec", linewidth=0.7)
        panel.set_axisbelow(True)
    return figure, axes


def measured_rows(rows: list[Row], *keys: str) -> list[Row]:
    """Those of the rows that have a number under every key."""
    return [row for row in rows if all(isinstance(row.get(key), Spread) for key in keys)]


def percents(rows: list[Row], key: str) -> tuple[list[float], list[float]]:
    """Means and deviations (0 where there is none) of a measured key, in percent."""
    cells = [row[key] for row in rows]
    return [100 * cell.mean for cell in cells], [100 * (cell.sd or 0.0) for cell in cells]


def empty_picture(title: str, why: str = "nothing was scored") -> Figure:
    """A figure that says that there is nothing to draw, and why."""
    figure, (axes,) = panels([title])
    axes.text(0.5, 0.5, why, ha="center", va="center", transform=axes.transAxes, color=GREY)
    axes.set_axis_off()
    return figure
