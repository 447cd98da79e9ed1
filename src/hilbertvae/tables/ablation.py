"""What each part is worth: a row per switch, with its differences from the default, gap seed by gap seed."""

from __future__ import annotations

from matplotlib.figure import Figure

from hilbertvae.dotted_keys import leaves
from hilbertvae.drawing.colours import OTHERS, OURS
from hilbertvae.reports.score_table import NOTHING
from hilbertvae.tables import recipe
from hilbertvae.tables.canvas import GREY, empty_picture, measured_rows, panels, percents
from hilbertvae.tables.cases import case_rows, case_tables, champions
from hilbertvae.tables.measure import LEGEND, Group, per_seed
from hilbertvae.tables.page import Column, Page, Row, measured, signed_points, text
from hilbertvae.tables.spread import differences, over_seeds, share_of
from hilbertvae.tables.sweep import Run, Sweep

TITLE = "Each part switched alone"
DEFAULT = "default"
"""The case that all others are compared with."""
METRICS = {
    "gaps_voxels_auc": ("voxels", "gaps", "auc", "gaps, voxels: AUC"),
    "gaps_voxels_best_f1": ("voxels", "gaps", "best_f1", "best F1"),
    "gaps_auc": ("points", "gaps", "auc", "gaps, points: AUC"),
    "gaps_best_f1": ("points", "gaps", "best_f1", "best F1"),
    "observed_f1": ("points", "observed", "f1", "held-out, points: F1"),
}
SCORES = [measured(f"{title} (%)", key) for key, (*_, title) in METRICS.items()]
PARTS = tuple(part for part in recipe.PARTS if part != "flips")
"""Parts of the configuration that a switch can stand in; `flips` are those of its mappers."""
SHOWN = 4
"""Changed settings that a row names; more would hide the table."""
DIFFERENCE_LEGEND = (
    "Differences are from the default, paired by training seed and gap seed; worse in: of how many such pairs the switch is worse."
)
NO_DEFAULT = f"No case `{DEFAULT}` was scored: nothing to differ from."


def ablation_page(sweep: Sweep) -> Page:
    """Tables and figure of an ablation: by site, a row per switch."""
    tables, shown = [], []
    for site, runs in sweep.by_site():
        default = {run.seed: run for run in runs if run.case == DEFAULT}

        def row_of(group: Group, default: Group = default) -> Row:
            return _row(group, default)

        rows = case_rows(sweep, site, runs, SCORES, row_of, lambda run: (run.case != DEFAULT, run.case))
        shown = shown or rows
        tables += case_tables(sweep, site, rows, SCORES, _difference_columns(), named=(text("switched", "switched"),))
    compared = any(run.case == DEFAULT for run in sweep.scored)
    return Page(TITLE, tables, lambda: ablation_picture(shown), [LEGEND, DIFFERENCE_LEGEND if compared else NO_DEFAULT])


def _difference_columns() -> list[Column]:
    pairs = (
        (measured(f"{title} (points)", f"{key}_difference", show=signed_points), text("worse in", f"{key}_worse"))
        for key, (*_, title) in METRICS.items()
    )
    return [column for pair in pairs for column in pair]


def _row(group: Group, default: Group) -> Row:
    row: Row = {"switched": switched(next(iter(group.values())), next(iter(default.values()), None))}
    unpaired = {}
    for key, (reading, region, metric, _) in METRICS.items():
        ours, theirs = (per_seed(runs, champions(runs)[reading == "voxels"], reading, region, metric) for runs in (group, default))
        row[key] = over_seeds(list(ours.values()))
        if group.keys() != default.keys() or any(group[seed] is not default[seed] for seed in group):
            found = differences(ours, theirs)
            row[f"{key}_difference"] = over_seeds(list(found.values()))
            row[f"{key}_worse"] = share_of(found, lambda value: value < 0)
            if default and len(found) < len(ours):
                unpaired[f"differences of {len(found)} of {len(ours)} training seeds"] = None
    return row | {"note": "; ".join(unpaired)}


def switched(run: Run, default: Run | None) -> str:
    """The settings of a run that are others than the default's, as overrides of a command line."""
    if default is None or run.case == DEFAULT:
        return NOTHING
    ours, theirs = (dict(leaves({part: of.config(part) for part in PARTS})) for of in (run, default))
    changed = [f"{key}={ours.get(key)}" for key in sorted({*ours, *theirs}) if ours.get(key) != theirs.get(key)]
    return ", ".join(changed[:SHOWN]) + (f" and {len(changed) - SHOWN} more" if len(changed) > SHOWN else "") or "the same settings"


def ablation_picture(rows: list[Row]) -> Figure:
    """Bars of the difference in AUC inside gaps, with its deviation; to the left a switch makes the map worse."""
    keys = {"gaps_voxels_auc_difference": "gaps, voxels: AUC", "gaps_auc_difference": "gaps, points: AUC"}
    scored = measured_rows(rows, *keys)
    if not scored:
        return empty_picture(TITLE, f"no case `{DEFAULT}` was scored:\nnothing to differ from" if rows else "nothing was scored")
    figure, axes = panels(list(keys.values()), 4.6, 1.2 + 0.32 * len(scored), sharey=True)
    for panel, key in zip(axes, keys, strict=True):
        means, deviations = percents(scored, key)
        colours = [OURS if mean < 0 else OTHERS[0] for mean in means]
        panel.barh(range(len(scored)), means, xerr=deviations, color=colours, height=0.65, error_kw={"elinewidth": 1, "ecolor": GREY})
        panel.axvline(0, color="black", linewidth=0.8)
        panel.set_xlabel("difference from the default (points)")
    axes[0].set_yticks(range(len(scored)), [row["case"] for row in scored], fontsize=8)
    axes[0].set_ylim(len(scored) - 0.5, -0.5)
    return figure
