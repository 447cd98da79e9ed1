"""Each site left out of training in turn: our map and the best baseline, both on the site that the network has not seen."""

from __future__ import annotations

from matplotlib.figure import Figure

from hilbertvae.drawing.colours import OTHERS, OURS
from hilbertvae.reports.comparison import HEADLINES
from hilbertvae.reports.mapper_names import is_rival
from hilbertvae.tables.alike import GAPS, SITE
from hilbertvae.tables.canvas import empty_picture, measured_rows, panels, percents
from hilbertvae.tables.cases import case_rows, case_tables, champions
from hilbertvae.tables.measure import LEGEND, Group, per_seed
from hilbertvae.tables.page import Column, Page, Row, measured, signed_points, text
from hilbertvae.tables.spread import differences, over_seeds, share_of, spread
from hilbertvae.tables.sweep import Sweep

VARIES = frozenset({SITE, GAPS})
SETTINGS = ("data.train", "data.calibrate", "data.validate")
"""What this sweep changes of the settings: a site that is left out has no other part in a training, either."""
TITLE = "Each site left out of training in turn"
EVERY = "all sites"
"""The last row: mean and deviation over the sites' means."""
BASELINE_LEGEND = (
    "baseline: the mapper without a network that is best there by that column, a choice made with the answers known. Differences are "
    f"paired by gap seed. {EVERY}: mean±sd over the means of "
    "those sites that have ours, the baseline and the difference."
)


def generalise_page(sweep: Sweep) -> Page:
    """Tables and figure of sites left out: a row per site."""
    columns = [_columns(reading) for reading in ("points", "voxels")]
    groups = [case_rows(sweep, site, runs, columns[0], _row, lambda run: run.case) for site, runs in sweep.by_site()]
    rows = [row for found in groups for row in found]
    rows = [row for row in rows if row["status"] == "ok"] + [row for row in rows if row["status"] != "ok"]
    scored = [row for row in rows if row["status"] == "ok"]
    if len(scored) > 1:
        rows.append(_every(scored))
    tables = case_tables(sweep, "", rows, *columns, named=(text("test site", "site"),))
    tables[0].caption = "## Inside gaps of every site"
    return Page(TITLE, tables, lambda: generalise_picture(scored), [LEGEND, BASELINE_LEGEND])


def _name(reading: str, metric: str) -> str:
    return f"gaps_{reading}_{metric}"


def _columns(reading: str) -> list[Column]:
    columns = []
    for where, metric, title in HEADLINES:
        if where == reading:
            key = _name(reading, metric)
            columns += [
                measured(f"{reading}: {title} (%)", key), measured("baseline (%)", f"{key}_baseline"), text("which", f"{key}_which"),
                measured("difference (points)", f"{key}_difference", show=signed_points), text("better in", f"{key}_better"),
            ]  # fmt: skip
    return columns


def _row(group: Group) -> Row:
    row: Row = {}
    points, voxels = champions(group)
    rivals = {name: None for run in group.values() for name in run.result.scores if is_rival(name)}
    for reading, metric, _ in HEADLINES:
        key = _name(reading, metric)
        ours = per_seed(group, points if reading == "points" else voxels, reading, "gaps", metric)
        row[key] = over_seeds(list(ours.values()))
        theirs = {name: per_seed(group, name, reading, "gaps", metric) for name in rivals}
        theirs = {name: values for name, values in theirs.items() if values}
        if not theirs:
            continue
        best = max(theirs, key=lambda name: over_seeds(list(theirs[name].values())).mean)
        # The same answers from every training seed's run: one of them shows how gap seeds differ.
        one = dict([min(theirs[best].items())])
        found = differences(ours, one, untrained=True)
        row |= {f"{key}_baseline": over_seeds(list(one.values())), f"{key}_which": best}
        row |= {f"{key}_difference": over_seeds(list(found.values())), f"{key}_better": share_of(found, lambda value: value > 0)}
    return row


def _every(rows: list[Row]) -> Row:
    """Headlines over the sites that have all of one, so that ours less the baseline is the difference; a note says where some do not."""
    found, notes = {}, []
    for reading, metric, title in HEADLINES:
        key = _name(reading, metric)
        keys = [each for each in (key, f"{key}_baseline", f"{key}_difference") if measured_rows(rows, each)]
        whole = measured_rows(rows, *keys)
        found |= {each: spread([row[each].mean for row in whole]) for each in keys}
        notes += [f"{reading}, {title}: {len(whole)} of {len(rows)} sites"] if len(whole) < len(rows) else []
    counts = {"training_seeds": max(row["training_seeds"] for row in rows), "gap_seeds": max(row["gap_seeds"] for row in rows)}
    return {"case": EVERY, "site": EVERY, "status": "ok", "n": f"{len(rows)} sites", "note": "; ".join(notes) or None, **counts, **found}


def generalise_picture(rows: list[Row]) -> Figure:
    """Dots per site: ours, and the best baseline, with the deviation over gap seeds."""
    keys = [_name(reading, metric) for reading, metric, _ in HEADLINES]
    scored = measured_rows(rows, *keys)
    if not scored:
        return empty_picture(TITLE)
    figure, axes = panels([f"gaps, {reading}: {title}" for reading, _, title in HEADLINES], 3.1, 1.6 + 0.34 * len(scored), sharey=True)
    for panel, key in zip(axes, keys, strict=True):
        for suffix, colour, marker, shift, label in (("", OURS, "o", -0.12, "ours"), ("_baseline", OTHERS[0], "s", 0.12, "best baseline")):
            found = measured_rows(scored, key + suffix)
            means, deviations = percents(found, key + suffix)
            places = [scored.index(row) + shift for row in found]
            panel.errorbar(means, places, xerr=deviations, fmt=marker, color=colour, markersize=5, elinewidth=1, label=label)
        panel.set_xlabel("%")
    axes[0].set_yticks(range(len(scored)), [row["site"] for row in scored], fontsize=8, parse_math=False)
    axes[0].set_ylim(len(scored) - 0.5, -0.5)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False, fontsize=8)
    return figure
