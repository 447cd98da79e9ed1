"""Accuracy against speed (the paper's abstract): grid cells, K, inner radius and latent dimension, each changed alone."""

from __future__ import annotations

from collections import Counter
from itertools import cycle
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hilbertvae.drawing.canvas import HALO
from hilbertvae.drawing.colours import OTHERS
from hilbertvae.reports.mapper_names import configured_as
from hilbertvae.reports.score_pictures import MARKERS
from hilbertvae.tables.ablation import DEFAULT
from hilbertvae.tables.canvas import empty_picture, measured_rows, panels, percents
from hilbertvae.tables.cases import case_rows, case_tables, champions
from hilbertvae.tables.measure import COST_LEGEND, COSTS, LEGEND, Group, costs_of, score_of
from hilbertvae.tables.page import Page, Row, measured, text
from hilbertvae.tables.sweep import Run, Sweep

TITLE = "Accuracy against speed"
CELLS, RADIUS = "grid cells", "inner radius (m)"
SETTINGS = {
    CELLS: ("grid.cells",),
    "K": ("mapper.{}.neighbours",),
    RADIUS: ("mapper.{}.inner_radius_m", "grid.inner_radius_m"),
    "latent": ("network.latent",),
}
"""What may vary, and where it is set; the first place that has it holds. {}: the mapper's name in the configuration."""
CHANGED = (*(key.format("*") for keys in SETTINGS.values() for key in keys), "grid.cluster_diameter_m", "augmentation.balls")
"""And what goes with it: a box of more cells is larger, and has more of the balls that are cut out of it."""
UNSET = "default"
"""Shown where a setting is left to the code's own default."""
WHAT = (text("varied", "varied"), text("value", "value"))
SCORES = [
    measured("gaps, voxels: AUC (%)", "gaps_voxels_auc"), measured("best F1 (%)", "gaps_voxels_best_f1"),
    measured("gaps, points: AUC (%)", "gaps_auc"), measured("F1 (%)", "gaps_f1"),
]  # fmt: skip
SECONDS = {"fit_s": "fit (s)", "query_s_per_million": "query (s per million)"}


def tradeoff_page(sweep: Sweep) -> Page:
    """Tables and figure of accuracy against speed: by site, a row per setting that was changed."""
    base = _base(sweep.scored)
    tables, shown = [], []
    for site, runs in sweep.by_site():

        def row_of(group: Group) -> Row:
            points, voxels = champions(group)
            row = dict(zip(("varied", "value"), _varied(next(iter(group.values())), base), strict=True))
            row |= {f"gaps_voxels_{metric}": score_of(group, voxels, "voxels", "gaps", metric) for metric in ("auc", "best_f1")}
            row |= {f"gaps_{metric}": score_of(group, points, "points", "gaps", metric) for metric in ("auc", "f1")}
            return row | costs_of(group, voxels)

        rows = case_rows(sweep, site, runs, SCORES, row_of, lambda run: (run.case != DEFAULT, run.case))
        shown = shown or rows
        tables += case_tables(sweep, site, rows, SCORES, COSTS, named=WHAT)
    return Page(TITLE, tables, lambda: tradeoff_picture(shown), [LEGEND, COST_LEGEND])


def _values(run: Run) -> dict[str, Any]:
    """What a run has set, by name of the setting."""
    return {setting: next((value for key in keys if (value := _set(run, key)) is not None), None) for setting, keys in SETTINGS.items()}


def _set(run: Run, key: str) -> Any:
    mapper = run.champion("voxels") or ""
    names = (mapper, configured_as(mapper))
    return next((value for name in names if (value := run.config(key.format(name))) is not None), None)


def _of_map(run: Run) -> bool:
    """Whether the map has an inner radius of its own, other than that of the grids that the network was trained on."""
    return _set(run, SETTINGS[RADIUS][0]) is not None


def _base(runs: list[Run]) -> dict[str, Any]:
    """The values that the others are changes of: the default case's, else the most frequent ones."""
    values = [_values(run) for run in runs]
    default = next((found for run, found in zip(runs, values, strict=True) if run.case == DEFAULT), None)
    return default or {setting: Counter(found[setting] for found in values).most_common(1)[0][0] for setting in SETTINGS if values}


def _varied(run: Run, base: dict[str, Any]) -> tuple[str, str]:
    """Which settings of a run are others than the base's, and their values."""
    changed = {setting: value for setting, value in _values(run).items() if value != base[setting]}
    if CELLS in changed and len(changed) > 1 and not _of_map(run):
        changed.pop(RADIUS, None)  # a larger box has its clusters further apart: what varies is the box
    if not changed:
        return "nothing", UNSET
    return " and ".join(changed), " and ".join(UNSET if value is None else f"{value:g}" for value in changed.values())


def tradeoff_picture(rows: list[Row]) -> Figure:
    """AUC in gaps over seconds to fit and seconds to query: a line per setting, through the default."""
    key = "gaps_voxels_auc"
    scored = measured_rows(rows, key, *SECONDS)
    if not scored:
        return empty_picture(TITLE)
    base = [row for row in scored if row["varied"] == "nothing"]
    figure, axes = panels([f"gaps, voxels: AUC over {title}" for title in SECONDS.values()])
    for panel, (second, title) in zip(axes, SECONDS.items(), strict=True):
        changed = dict.fromkeys(row["varied"] for row in scored if row not in base)
        for varied, colour, marker in zip(changed, cycle(OTHERS), cycle(MARKERS), strict=False):
            line = sorted([*(row for row in scored if row["varied"] == varied), *base], key=lambda row: row[second].mean)
            times, means = ([row[which].mean for row in line] for which in (second, key))
            panel.errorbar(
                times, [100 * mean for mean in means], percents(line, key)[1],
                color=colour, marker=marker, markersize=4, linewidth=1.3, elinewidth=0.8, label=varied,
            )  # fmt: skip
            for row in line:
                if row not in base:
                    _label(panel, row["value"], (row[second].mean, 100 * row[key].mean), colour, (4, 4))
        for row in base:
            place = row[second].mean, 100 * row[key].mean
            panel.plot(*place, "o", color="black", markersize=7, zorder=5)
            _label(panel, UNSET, place, "black", (6, -11))
        panel.set(xlabel=title, ylabel="AUC (%)")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False, fontsize=8)
    return figure


def _label(panel: Axes, words: str, place: tuple[float, float], colour: str, offset: tuple[int, int]) -> None:
    panel.annotate(words, place, offset, textcoords="offset points", fontsize=8, color=colour, path_effects=HALO, zorder=6)
