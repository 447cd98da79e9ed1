"""The paper's Tables I and II (section IV): every mapper beside the numbers that the paper prints, what it costs, and whose order holds."""

from __future__ import annotations

from hilbertvae.reports.mapper_names import is_network, reading_of
from hilbertvae.reports.paper_table import NOTE as PAPER_NOTE
from hilbertvae.reports.paper_table import OCTOMAP_NOTE, PAPER, PaperRow
from hilbertvae.tables.cases import heading
from hilbertvae.tables.measure import (
    COST_LEGEND,
    COSTS,
    COUNTS,
    LEGEND,
    NOTE,
    N,
    absent_row,
    costs_of,
    counts_of,
    mapper_groups,
    network_of,
    note_of,
    own_network,
    score_of,
)
from hilbertvae.tables.method_pictures import methods_picture
from hilbertvae.tables.page import Page, Row, Table, hidden, measured, printed_percent, signed_points, text, value
from hilbertvae.tables.paper_order import order_table
from hilbertvae.tables.spread import Spread
from hilbertvae.tables.sweep import Run, Sweep

DIMENSIONS = {"table1": 2, "table2": 3}
PAPER_NETWORK = {"kind": "paper", "channels": [64, 128, 256, 256], "kernels": [9, 7, 5, 5]}
PAPER_CELLS, PAPER_LATENT = 64, {2: 25, 3: 100}
"""The baseline of section IV."""
NAMED = [text("method", "method"), hidden("site"), hidden("mapper")]
SCORES = [
    value("observed P / R, paper (%)", "paper_observed_precision", "paper_observed_recall", show=printed_percent),
    measured("fitted P / R (%)", "fitted_precision", "fitted_recall"),
    measured("difference, fitted (points)", "difference_fitted_precision", "difference_fitted_recall", show=signed_points),
    measured("held-out P / R (%)", "observed_precision", "observed_recall"),
    value("gaps P / R, paper (%)", "paper_gaps_precision", "paper_gaps_recall", show=printed_percent),
    measured("gaps P / R (%)", "gaps_precision", "gaps_recall"),
    measured("difference, gaps (points)", "difference_precision", "difference_recall", show=signed_points),
]
MORE = [
    measured("gaps, points: F1 (%)", "gaps_f1"),
    measured("AUC (%)", "gaps_auc"),
    measured("gaps, voxels: best F1 (%)", "gaps_voxels_best_f1"),
    measured("AUC (%)", "gaps_voxels_auc"),
]
OTHERWISE = {
    "octomap": "fed labelled points, not rays, which would cross gaps",
    "gpom": "local: a query asks the points about it, thinned; the paper does not say how it made a whole site tractable",
    "lard-hm": "a feature for each cluster of the paper's 5 m, whatever the size of CVAE-HM's; the paper does not give its settings",
}
"""What is known to differ from the paper's for rows without a network; docs/decisions.md has what it does."""
WHERE_SCORED = {
    "gaps-above-ground_best_f1": ("voxels", "gaps-above-ground", "best_f1", "gaps above ground, voxels: best F1 (%)"),
    "gaps-above-ground_auc": ("voxels", "gaps-above-ground", "auc", "AUC (%)"),
    "occluded-sparse_auc": ("voxels", "occluded-sparse", "auc", "occluded, sparse, voxels: AUC (%)"),
    "occluded-half_auc": ("voxels", "occluded-half", "auc", "occluded, half, voxels: AUC (%)"),
}
"""Columns of regions that not every run has."""
SCORED = {
    **{f"{region}_{metric}": ("points", region, metric) for region in ("fitted", "observed", "gaps") for metric in ("precision", "recall")},
    **{f"gaps_{metric}": ("points", "gaps", metric) for metric in ("f1", "auc")},
    **{f"gaps_voxels_{metric}": ("voxels", "gaps", metric) for metric in ("best_f1", "auc")},
    **{key: what[:3] for key, what in WHERE_SCORED.items()},
}
"""Cells by key: reading, region and metric."""


def methods_page(sweep: Sweep) -> Page:
    """Tables of scores and costs for each site, then the order of the methods against the paper's."""
    dimension = next((run.result.dimension for run in sweep.scored), DIMENSIONS.get(sweep.kind, 2))
    cells = [(run, mapper) for run in sweep.scored for mapper in run.result.scores]
    further = [
        measured(title, key)
        for key, (*what, title) in WHERE_SCORED.items()
        if any(run.result.values(mapper, *what) for run, mapper in cells)
    ]
    tables, shown = [], []
    for site, runs in sweep.by_site():
        rows = method_rows(sweep, runs, site, dimension)
        shown = shown or rows
        tables.append(Table("table", rows, [*NAMED, *COUNTS, *SCORES, N, NOTE], caption=heading(sweep, site)))
        tables.append(Table("table", rows, [NAMED[0], *MORE, *further, *COSTS]))
        tables.append(order_table(runs, site, dimension))
    notes = [LEGEND, COST_LEGEND, PAPER_NOTE, *([OCTOMAP_NOTE] if dimension == 3 else [])]
    title = f"Methods in {dimension}D beside the paper's Table {'I' * (dimension - 1)}"
    return Page(title, tables, lambda: methods_picture(shown, title), notes)


def method_rows(sweep: Sweep, runs: list[Run], site: str, dimension: int) -> list[Row]:
    """A row per mapper: in the paper's order as in the paper, then ours, then all others; those that are missing or failed, too."""
    groups = mapper_groups(runs)
    cases = [mapper for mapper, _ in groups]
    failed = _failed(runs)
    rows = []
    for (mapper, case), group in groups.items():
        name = mapper if cases.count(mapper) == 1 else f"{mapper} ({case})"
        row = {"site": site, "method": name, "mapper": mapper, **counts_of(group), **costs_of(group, mapper)}
        row |= {key: score_of(group, mapper, *what) for key, what in SCORED.items()}
        reasons = [*_reasons(mapper, next(iter(group.values())), dimension), *_silence(row)]
        rows.append(row | {"note": note_of(group, *reasons, *sweep.gone(case), *failed.pop(mapper, []))})
    absent = {mapper: ("failed", "; ".join(notes)) for mapper, notes in failed.items()}
    if site == sweep.by_site()[0][0]:
        absent |= {case: (status, "see below") for case, status in sweep.absent().items()}
    absent = {name: status for name, status in absent.items() if name not in cases}
    for paper in PAPER[dimension]:
        if not any(name in cases or name in absent for name in paper.ours[:1]):
            absent[paper.ours[0]] = ("missing", "no job scored it")
    for name, (status, note) in absent.items():
        rows.append(absent_row(status, [*SCORES], site=site, method=name, mapper=name, note=note))
    for row in rows:
        row |= _beside_paper(row, dimension)
    return sorted(rows, key=lambda row: _rank(row["mapper"], dimension))


def _failed(runs: list[Run]) -> dict[str, list[str]]:
    """Notes by mapper on those that failed in runs that scored others."""
    found: dict[str, list[str]] = {}
    for run in runs:
        for mapper, message in run.result.failed.items():
            found.setdefault(mapper, []).append(f"failed in {run.name}: {' '.join(message.split())}")
    return found


def paper_row(mapper: str, dimension: int) -> PaperRow | None:
    """The row of the paper that a mapper stands for."""
    return next((row for row in PAPER[dimension] if mapper in row.ours), None)


def _rank(mapper: str, dimension: int) -> tuple[int, int]:
    """As in the paper, in its order; then ours in the same order; then what else is made of a network; then all others."""
    for place, row in enumerate(PAPER[dimension]):
        if mapper in row.ours:
            return min(row.ours.index(mapper), 1), place
    return (2 if is_network(mapper) else 3), len(PAPER[dimension])


def _beside_paper(row: Row, dimension: int) -> Row:
    paper = paper_row(row["mapper"], dimension)
    if paper is None:
        return {}
    found: Row = {}
    for place, metric in enumerate(("precision", "recall")):
        found[f"paper_observed_{metric}"] = round(paper.observed[place] / 100, 6)
        found[f"paper_gaps_{metric}"] = printed = round(paper.gaps[place] / 100, 6)
        for name, region, theirs in (("difference", "gaps", printed), ("difference_fitted", "fitted", found[f"paper_observed_{metric}"])):
            ours = row.get(f"{region}_{metric}")
            if isinstance(ours, Spread):
                found[f"{name}_{metric}"] = Spread(ours.mean - theirs, ours.sd, ours.n)
    return found


def _silence(row: Row) -> list[str]:
    """What stands behind a precision of 0 where nothing is called occupied."""
    precision, recall = (row.get(f"gaps_{metric}") for metric in ("precision", "recall"))
    silent = isinstance(precision, Spread) and isinstance(recall, Spread) and precision.mean == recall.mean == 0
    return ["calls nothing in a gap occupied, so that its precision there is none"] if silent else []


def _reasons(mapper: str, run: Run, dimension: int) -> list[str]:
    """Why a row can differ from the paper's, as far as the run's own settings tell."""
    if not is_network(mapper):
        return [OTHERWISE[mapper]] if mapper in OTHERWISE else []
    if not mapper.endswith("-paper"):
        return [f"{network_of(run, mapper)}; calibrated for {reading_of(mapper)}"]
    own = own_network(run, mapper)
    network = {key: run.config(f"{own}network.{key}") for key in PAPER_NETWORK}
    shape = run.config(f"{own}grid.cells"), run.config(f"{own}network.latent")
    same = network == PAPER_NETWORK and shape == (PAPER_CELLS, PAPER_LATENT[dimension])
    return [f"the paper's {'network' if same else 'recipe on another network than its baseline'}: {network_of(run, mapper)}"]
