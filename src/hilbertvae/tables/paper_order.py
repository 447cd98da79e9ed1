"""Whether methods stand in the order that the paper's numbers put them in, pair by pair."""

from __future__ import annotations

from itertools import combinations

from hilbertvae.reports.mapper_names import is_network
from hilbertvae.reports.paper_table import PAPER, PaperRow
from hilbertvae.reports.score_table import NOTHING
from hilbertvae.tables.measure import Group, mapper_groups, per_seed
from hilbertvae.tables.page import Row, Table, hidden, measured, printed_percent, signed_points, text, value
from hilbertvae.tables.spread import differences, over_seeds, share_of
from hilbertvae.tables.sweep import Run

COLUMNS = [
    hidden("site"),
    text("the paper's order", "pair"),
    value("F1 in gaps, paper (%)", "paper_better_f1", "paper_worse_f1", show=printed_percent),
    text("here", "mappers"),
    measured("F1 in gaps (%)", "better_f1", "worse_f1"),
    measured("paired difference (points)", "difference", show=signed_points),
    text("better in", "better_in"),
    text("same order", "agrees"),
]


def gaps_f1(row: PaperRow) -> float:
    """F1 of the precision and recall that the paper prints for gaps, as a share; it prints no F1 itself."""
    precision, recall = row.gaps
    return 2 * precision * recall / (precision + recall) / 100


def order_table(runs: list[Run], site: str, dimension: int) -> Table:
    """Every two of the paper's methods, in its order by F1 in gaps: networks as in the paper, then ours. Differences are per gap seed."""
    ranked = sorted(PAPER[dimension], key=gaps_f1, reverse=True)
    groups: dict[str, Group] = {}
    for (mapper, case), group in mapper_groups(runs).items():
        if mapper not in groups or case == mapper:  # where several cases scored it, one is named after it
            groups[mapper] = group
    rows = []
    for better, worse in combinations(ranked, 2):
        for recipe in (0, 1):
            names = [row.ours[min(recipe, len(row.ours) - 1)] for row in (better, worse)]
            if recipe == 0 or any(is_network(name) for name in names):
                rows.append(_row(better, worse, names, groups) | {"site": site})
    caption = "The order of the methods, by F1 in gaps on points, against the paper's, two by two."
    return Table("table-order", rows, COLUMNS, caption)


def _row(better: PaperRow, worse: PaperRow, names: list[str], groups: dict[str, Group]) -> Row:
    ours, theirs = (per_seed(groups.get(name, {}), name, "points", "gaps", "f1") for name in names)
    found = differences(ours, theirs, untrained=not all(map(is_network, names)))
    difference = over_seeds(list(found.values()))
    return {
        "pair": f"{better.name} > {worse.name}",
        "paper_better_f1": gaps_f1(better),
        "paper_worse_f1": gaps_f1(worse),
        "mappers": " > ".join(names),
        "better_f1": over_seeds(list(ours.values())),
        "worse_f1": over_seeds(list(theirs.values())),
        "difference": difference,
        "better_in": share_of(found, lambda value: value > 0) or NOTHING,
        "agrees": NOTHING if difference is None else "yes" if difference.mean > 0 else "no" if difference.mean else "tie",
    }
