"""Precision and recall of every method, the paper's and ours, on observed data and in gaps."""

from __future__ import annotations

from matplotlib.figure import Figure

from hilbertvae.drawing.colours import OTHERS, OURS
from hilbertvae.tables.canvas import empty_picture, measured_rows, panels, percents
from hilbertvae.tables.page import Row
from hilbertvae.tables.spread import Spread

PARTS = {"fitted": ("observed (fitted points)", "observed"), "gaps": ("gaps (points)", "gaps")}
"""By region here: the panel's title, and the paper's word; its observed rows are on points that were fitted."""
METRICS = {"precision": ("o", -0.16), "recall": ("s", 0.16)}
PAPER_COLOUR = OTHERS[0]


def methods_picture(rows: list[Row], title: str) -> Figure:
    """A line per method, the first row on top: filled marks are ours with their deviation, open ones the paper's. Where a method finds
    nothing its precision, 0 by convention, has no mark."""
    rows = [row for row in rows if row in measured_rows(rows, "gaps_precision") or "paper_gaps_precision" in row]
    if not rows:
        return empty_picture(title)
    figure, axes = panels([name for name, _ in PARTS.values()], 4.9, 1.4 + 0.34 * len(rows), sharey=True)
    for panel, (region, (_, printed)) in zip(axes, PARTS.items(), strict=True):
        for metric, (marker, shift) in METRICS.items():
            scored = [row for row in measured_rows(rows, f"{region}_{metric}") if metric != "precision" or _finds_any(row, region)]
            means, deviations = percents(scored, f"{region}_{metric}")
            places = [rows.index(row) + shift for row in scored]
            panel.errorbar(means, places, xerr=deviations, fmt=marker, color=OURS, markersize=5, elinewidth=1, label=f"{metric}, here")
            there = [row for row in rows if f"paper_{printed}_{metric}" in row]
            panel.plot(
                [100 * row[f"paper_{printed}_{metric}"] for row in there],
                [rows.index(row) + shift for row in there],
                marker, color=PAPER_COLOUR, markerfacecolor="none", markersize=6, label=f"{metric}, paper",
            )  # fmt: skip
        panel.set(xlim=(-2, 102), xlabel="%")
    axes[0].set_yticks(range(len(rows)), [row["method"] for row in rows], fontsize=8)
    axes[0].set_ylim(len(rows) - 0.5, -0.5)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False, fontsize=8)
    return figure


def _finds_any(row: Row, region: str) -> bool:
    recall = row.get(f"{region}_recall")
    return not isinstance(recall, Spread) or recall.mean > 0
