"""Networks and recipes side by side, each trained several times with the same budget: a row per case and mapper."""

from __future__ import annotations

from matplotlib.figure import Figure

from hilbertvae.drawing.colours import OURS
from hilbertvae.reports.mapper_names import is_network
from hilbertvae.tables.canvas import empty_picture, measured_rows, panels, percents
from hilbertvae.tables.cases import CASE, heading
from hilbertvae.tables.measure import COUNTS, LEGEND, NOTE, N, absent_row, counts_of, mapper_groups, network_of, note_of, score_of
from hilbertvae.tables.page import Page, Row, Table, hidden, measured, text
from hilbertvae.tables.sweep import Sweep

SAME = ("trainer.epochs", "trainer.steps_per_epoch", "trainer.batch_size", "data")
"""The budget: networks may differ in all else that their recipe says."""
TITLE = "Networks and recipes at the same budget"
METRICS = {
    "observed_f1": ("points", "observed", "f1", "held-out, points: F1"),
    "gaps_precision": ("points", "gaps", "precision", "gaps, points: precision"),
    "gaps_recall": ("points", "gaps", "recall", "recall"),
    "gaps_best_f1": ("points", "gaps", "best_f1", "best F1"),
    "gaps_auc": ("points", "gaps", "auc", "AUC"),
    "gaps_voxels_best_f1": ("voxels", "gaps", "best_f1", "gaps, voxels: best F1"),
    "gaps_voxels_auc": ("voxels", "gaps", "auc", "AUC"),
}
SCORES = [measured(f"{title} (%)", key) for key, (*_, title) in METRICS.items()]


def recipes_page(sweep: Sweep) -> Page:
    """Tables and figure of recipes: by site, a row per case and mapper."""
    tables, shown = [], []
    for site, runs in sweep.by_site():
        rows = []
        for (mapper, case), group in sorted(mapper_groups(runs).items(), key=lambda item: item[0][::-1]):
            if is_network(mapper):
                run = next(iter(group.values()))
                row = {"site": site, "case": case, "mapper": mapper, "note": note_of(group, network_of(run), *sweep.gone(case))}
                cells = {key: score_of(group, mapper, *what) for key, (*what, _) in METRICS.items()}
                rows.append(row | counts_of(group) | cells)
        if not shown:
            rows += [absent_row(status, SCORES, site=site, case=case, note="see below") for case, status in sweep.absent().items()]
            shown = rows
        columns = [CASE, hidden("site"), *COUNTS, text("mapper", "mapper"), *SCORES, N, NOTE]
        tables.append(Table("table", rows, columns, heading(sweep, site)))
    return Page(TITLE, tables, lambda: recipes_picture(shown), [LEGEND])


def recipes_picture(rows: list[Row]) -> Figure:
    """Dots of AUC inside gaps with their deviation, a line per case and mapper."""
    keys = {"gaps_voxels_auc": "gaps, voxels: AUC", "gaps_auc": "gaps, points: AUC"}
    scored = measured_rows(rows, *keys)
    if not scored:
        return empty_picture(TITLE)
    figure, axes = panels(list(keys.values()), 4.6, 1.2 + 0.32 * len(scored), sharey=True)
    for panel, key in zip(axes, keys, strict=True):
        means, deviations = percents(scored, key)
        panel.errorbar(means, range(len(scored)), xerr=deviations, fmt="o", color=OURS, markersize=5, elinewidth=1)
        panel.set_xlabel("%")
    axes[0].set_yticks(range(len(scored)), [f"{row['case']}, {row['mapper']}" for row in scored], fontsize=8)
    axes[0].set_ylim(len(scored) - 0.5, -0.5)
    return figure
