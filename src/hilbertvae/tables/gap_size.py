"""The paper's Fig. 7: gaps of several sizes by cluster size, and whether the best clusters are twice as large as the gap (section IV)."""

from __future__ import annotations

from itertools import cycle

from matplotlib.figure import Figure

from hilbertvae.drawing.colours import OTHERS
from hilbertvae.reports.score_pictures import MARKERS
from hilbertvae.tables.alike import GAPS
from hilbertvae.tables.canvas import GREY, empty_picture, measured_rows, panels, percents
from hilbertvae.tables.cases import case_rows, case_tables, champions
from hilbertvae.tables.measure import LEGEND, Group, per_seed, score_of
from hilbertvae.tables.page import Page, Row, Table, hidden, measured, signed_points, text, value
from hilbertvae.tables.spread import differences, over_seeds, share_of
from hilbertvae.tables.sweep import Run, Sweep, grouped

CLUSTER = "grid.cluster_diameter_m"
VARIES = frozenset({"protocol.gap_ratio", "protocol.cluster_size_m", "gap_diameter_m", GAPS})
"""What this sweep changes of the protocol: the gaps' size, however it is written."""
SETTINGS = (CLUSTER, "grid.cells", "grid.inner_radius_m", "augmentation.balls")
"""And of the settings: a larger box has more cells and more of the balls that are cut out of it, and its clusters are further apart."""
TITLE = "Gap size by cluster size, as in the paper's Fig. 7"
METRICS = {"precision": "precision", "recall": "recall", "f1": "F1", "best_f1": "best F1", "auc": "AUC"}
SCORES = [measured(f"{'gaps: ' if place == 0 else ''}{title} (%)", f"gaps_{m}") for place, (m, title) in enumerate(METRICS.items())]
SCORES.append(measured("held-out: F1 (%)", "observed_f1"))
RATIO = value("gap / cluster", "ratio", show=lambda ratio: f"{ratio:.2f}")
WHAT = (value("cluster (m)", "cluster_m"), value("gap (m)", "gap_m"), RATIO, text("mapper", "mapper"))
HALF = 0.5
"""Of a cluster's size: the gap that the paper estimates to be best."""
BEST = [
    value("gap (m)", "gap_m"), hidden("site"), value("best cluster (m)", "cluster_m"), RATIO,
    measured("F1 in gaps (%)", "gaps_f1"), value("next best (m)", "next_m"),
    measured("paired difference to it (points)", "difference", show=signed_points), text("better in", "better_in"),
]  # fmt: skip


def gap_size_page(sweep: Sweep) -> Page:
    """Tables and figure of gap sizes: by site, a row per cluster size and gap."""
    tables, shown = [], []
    for site, runs in sweep.by_site():
        rows = case_rows(sweep, site, runs, SCORES, _row, _key)
        shown = shown or rows
        tables += case_tables(sweep, site, rows, SCORES, named=WHAT, captions=("Scored on points.",))
        caption = "The best cluster size for each gap, by F1 in gaps at the cut; the paper's estimate is a gap of half the cluster."
        tables.append(Table("table-best", _best(site, runs), BEST, caption))
    return Page(TITLE, tables, lambda: gap_size_picture(shown), [LEGEND])


def _key(run: Run) -> tuple[float, float]:
    return float(run.setting(CLUSTER)), run.result.gap_diameter_m


def _row(group: Group) -> Row:
    cluster, gap = _key(next(iter(group.values())))
    mapper, _ = champions(group)
    row = {"cluster_m": cluster, "gap_m": gap, "ratio": gap / cluster, "mapper": mapper}
    row |= {f"gaps_{metric}": score_of(group, mapper, "points", "gaps", metric) for metric in METRICS}
    return row | {"observed_f1": score_of(group, mapper, "points", "observed", "f1")}


def _best(site: str, runs: list[Run]) -> list[Row]:
    """For each gap the cluster size with the best mean, and by how much: the same balls are cut for all of a gap's rows."""
    groups = grouped(runs, _key)
    rows = []
    for gap in sorted({gap for _, gap in groups}):
        found = {c: per_seed(group, champions(group)[0], "points", "gaps", "f1") for (c, g), group in groups.items() if g == gap}
        scored = {cluster: over_seeds(list(values.values())) for cluster, values in found.items() if values}
        ranked = sorted(scored, key=lambda cluster: scored[cluster].mean, reverse=True)
        if len(ranked) > 1:
            best, second = ranked[:2]
            by = differences(found[best], found[second])
            row = {"site": site, "gap_m": gap, "cluster_m": best, "ratio": gap / best, "gaps_f1": scored[best], "next_m": second}
            rows.append(row | {"difference": over_seeds(list(by.values())), "better_in": share_of(by, lambda value: value > 0)})
    return rows


def gap_size_picture(rows: list[Row]) -> Figure:
    """F1 over the gap's size, in gaps and on held-out beams, a line per cluster size; dots where the gap is half of it."""
    scored = measured_rows(rows, "gaps_f1", "observed_f1")
    if not scored:
        return empty_picture(TITLE)
    figure, axes = panels(["gaps, points", "held-out beams, points"])
    for panel, key in zip(axes, ("gaps_f1", "observed_f1"), strict=True):
        for cluster, colour, marker in zip(sorted({row["cluster_m"] for row in scored}), cycle(OTHERS), cycle(MARKERS), strict=False):
            line = [row for row in scored if row["cluster_m"] == cluster]
            means, deviations = percents(line, key)
            gaps = [row["gap_m"] for row in line]
            label = f"clusters of {cluster:g} m"
            panel.errorbar(gaps, means, deviations, marker=marker, color=colour, markersize=4, capsize=2, linewidth=1.3, label=label)
            panel.axvline(HALF * cluster, color=colour, linestyle=":", linewidth=1)
        panel.set(xlabel="gap's diameter (m)", ylabel="F1 (%)")
    axes[0].plot([], [], ":", color=GREY, label="half the cluster")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False, fontsize=8)
    return figure
