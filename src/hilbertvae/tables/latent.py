"""The paper's Fig. 6: latent dimension against scores, with sampling (CVAE) and without (CAE), on observed data and in gaps."""

from __future__ import annotations

from matplotlib.figure import Figure

from hilbertvae.drawing.colours import OTHERS, OURS
from hilbertvae.tables.canvas import empty_picture, measured_rows, panels, percents
from hilbertvae.tables.cases import case_rows, case_tables, champions
from hilbertvae.tables.measure import COST_LEGEND, COSTS, LEGEND, Group, costs_of, score_of
from hilbertvae.tables.page import Page, Row, measured, text, value
from hilbertvae.tables.sweep import Run, Sweep

SETTINGS = LATENT, VARIATIONAL = "network.latent", "network.variational"
"""What this sweep changes of the settings."""
TITLE = "Latent dimension, as in the paper's Fig. 6"
METRICS = {"best_f1": "best F1", "auc": "AUC"}
"""A map of its grids alone has no constant to move a cut with, so F1 at the cut of 0.6 would show how sure it is and not what it knows."""
REGIONS = {"observed": "--", "gaps": "-"}
SCORES = [
    measured("held-out: F1 (%)", "observed_f1"), measured("best F1 (%)", "observed_best_f1"), measured("AUC (%)", "observed_auc"),
    measured("gaps: F1 (%)", "gaps_f1"), measured("best F1 (%)", "gaps_best_f1"), measured("AUC (%)", "gaps_auc"),
]  # fmt: skip
WHAT = (text("network", "network"), value("latent dimension", "latent"), text("mapper", "mapper"))
MARKS = {"CVAE": (OURS, "o"), "CAE": (OTHERS[0], "s")}


def latent_page(sweep: Sweep) -> Page:
    """Tables and figure of latent dimensions: by site, a row per dimension, with sampling and without."""
    tables, shown = [], []
    for site, runs in sweep.by_site():
        rows = case_rows(sweep, site, runs, SCORES, _row, _key)
        shown = shown or rows
        captions = ("Scored on points.", "")
        tables += case_tables(sweep, site, rows, SCORES, COSTS, named=WHAT, captions=captions)
    return Page(TITLE, tables, lambda: latent_picture(shown), [LEGEND, COST_LEGEND])


def _key(run: Run) -> tuple[bool, int]:
    return not run.setting(VARIATIONAL), run.setting(LATENT)


def _row(group: Group) -> Row:
    run = next(iter(group.values()))
    mapper, _ = champions(group)
    row = {"network": "CVAE" if run.setting(VARIATIONAL) else "CAE", "latent": run.setting(LATENT), "mapper": mapper}
    cells = [(region, metric) for region in REGIONS for metric in ("f1", *METRICS)]
    return (
        row
        | {f"{region}_{metric}": score_of(group, mapper, "points", region, metric) for region, metric in cells}
        | costs_of(group, mapper)
    )


def latent_picture(rows: list[Row]) -> Figure:
    """Best F1 and AUC over the latent dimension: whole lines in gaps, broken ones on held-out beams."""
    if not measured_rows(rows, "gaps_f1"):
        return empty_picture(TITLE)
    figure, axes = panels([f"{title}, points" for title in METRICS.values()])
    for panel, metric in zip(axes, METRICS, strict=True):
        for network, (colour, marker) in MARKS.items():
            for region, dash in REGIONS.items():
                key = f"{region}_{metric}"
                scored = [row for row in measured_rows(rows, key) if row["network"] == network]
                means, deviations = percents(scored, key)
                label = f"{network}, {'gaps' if region == 'gaps' else 'held-out beams'}"
                latents, style = [row["latent"] for row in scored], {"marker": marker, "linestyle": dash, "color": colour}
                panel.errorbar(latents, means, deviations, **style, markersize=4, capsize=2, label=label)
        panel.set_xscale("log", base=2)
        ticks = sorted({row["latent"] for row in measured_rows(rows, "gaps_f1")})
        panel.set_xticks(ticks, [str(tick) for tick in ticks])
        panel.minorticks_off()
        panel.set(xlabel="latent dimension", ylabel=f"{METRICS[metric]} (%)")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False, fontsize=8, handlelength=3)
    return figure
