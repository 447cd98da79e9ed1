"""The paper's Fig. 2: how long each way to start a clustering takes, and the potential that k-means goes on to from there."""

from __future__ import annotations

from collections import defaultdict
from itertools import cycle

import numpy as np
from matplotlib.figure import Figure

from hilbertvae.drawing.colours import OTHERS, OURS
from hilbertvae.reports.score_pictures import MARKERS
from hilbertvae.tables.canvas import empty_picture, measured_rows, panels
from hilbertvae.tables.clustering import Start, Study
from hilbertvae.tables.page import Column, Page, Row, Table, hidden, measured, number, text, value
from hilbertvae.tables.spread import Spread, spread

TITLE = "Ways to start a clustering, as in the paper's Fig. 2"
REFERENCE = "kmeans_plus_plus"
NAMES = {
    "quick_means": "Quick-Means", "ask_means": "ASK-Means", REFERENCE: "k-means++", "kmeans_parallel": "k-means||", "random": "random",
}  # fmt: skip
"""Starts as the paper names them, in the order in which they are drawn."""
WHAT = [text("start", "name"), hidden("start"), value("points", "points"), text("n", "n")]
TIMES = [measured("clusters", "clusters", show=number), measured("seconds", "seconds", show=number)]
LEGEND = (
    "Mean±sd over n seeds, each with a cloud of its own that is the same for all starts. Potential: the sum of squared distances to the "
    f"nearest centre, relative to {NAMES[REFERENCE]} on the same cloud after as many of Lloyd's iterations, which the columns count."
)


def starts_page(study: Study) -> Page:
    """Tables and figure of a study of starts: a row per start and number of clusters."""
    rows = start_rows(study.starts)
    last = max((len(start.potentials_m2) for start in study.starts), default=0)
    relative = [measured(str(step), f"relative_{step}", show=_ratio) for step in range(last)]
    absolute = [Column("", (f"potential_{step}_m2",), number) for step in range(last)]
    tables = [
        Table("table", rows, [*WHAT, *TIMES], "Time to find the seeds."),
        Table("table", rows, [*WHAT, *relative, *absolute], f"Potential relative to {NAMES[REFERENCE]}."),
    ]
    return Page(TITLE, tables, lambda: starts_picture(rows), [LEGEND])


def _ratio(mean: float, sd: float | None = None) -> str:
    return f"{mean:.3f}" + ("" if sd is None else f"±{sd:.3f}")


def start_rows(starts: list[Start]) -> list[Row]:
    """A row per start and number of points, potentials relative to k-means++ of the same points and seed."""
    reference = {(start.points, start.seed): start.potentials_m2 for start in starts if start.start == REFERENCE}
    groups: dict[tuple[str, int], list[Start]] = defaultdict(list)
    for start in starts:
        groups[start.start, start.points].append(start)
    order = [*NAMES, *sorted({start.start for start in starts} - set(NAMES))]
    rows = []
    for (name, points), group in sorted(groups.items(), key=lambda item: (order.index(item[0][0]), item[0][1])):
        row: Row = {"name": NAMES.get(name, name), "start": name, "points": points, "n": str(len(group))}
        row |= {"seconds": spread([start.seconds for start in group]), "clusters": spread([float(start.clusters) for start in group])}
        steps: dict[str, list[float]] = defaultdict(list)
        for start in group:
            base = reference.get((start.points, start.seed), [])
            for step, potential in enumerate(start.potentials_m2):
                steps[f"potential_{step}_m2"].append(potential)
                if step < len(base) and base[step] > 0:
                    steps[f"relative_{step}"].append(potential / base[step])
        rows.append(row | {key: spread(values) for key, values in steps.items()})
    return rows


def starts_picture(rows: list[Row]) -> Figure:
    """Seconds over the number of points, and the potential over Lloyd's iterations on the largest cloud."""
    if not rows:
        return empty_picture(TITLE)
    largest = max(row["points"] for row in rows)
    figure, axes = panels(["(a) time to find the seeds", f"(b) potential, {largest} points"])
    styles = zip(dict.fromkeys(row["name"] for row in rows), cycle((OURS, *OTHERS)), cycle(MARKERS), strict=False)
    for name, colour, marker in styles:
        timed = [row for row in measured_rows(rows, "seconds") if row["name"] == name]
        _line(axes[0], [row["points"] for row in timed], [row["seconds"] for row in timed], colour, marker, name)
        found = [row for row in timed if row["points"] == largest]
        cells = [cell for row in found for step in range(len(row)) if isinstance(cell := row.get(f"potential_{step}_m2"), Spread)]
        _line(axes[1], list(range(len(cells))), cells, colour, marker, name)
    axes[0].set(xscale="log", yscale="log", xlabel="points", ylabel="seconds")
    axes[1].set(xlabel="Lloyd's iterations", ylabel="potential (m²)")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=5, frameon=False, fontsize=8)
    return figure


def _line(panel, places: list[float], cells: list[Spread], colour: str, marker: str, label: str) -> None:
    means = np.array([cell.mean for cell in cells])
    deviations = np.array([cell.sd or 0.0 for cell in cells])
    panel.plot(places, means, marker=marker, color=colour, markersize=4, linewidth=1.3, label=label)
    if len(means):
        panel.fill_between(places, np.maximum(means - deviations, means * 0.1), means + deviations, color=colour, alpha=0.15, linewidth=0)
