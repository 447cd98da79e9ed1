"""Rows of sweeps that have one for each case: what such rows have in common, site by site."""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable

from hilbertvae.reports.mapper_names import champions as network_rows
from hilbertvae.reports.score_table import NOTHING
from hilbertvae.tables.measure import COUNTS, NOTE, Group, N, absent_row, counts_of, network_of, note_of
from hilbertvae.tables.page import Column, Row, Table, hidden, text
from hilbertvae.tables.sweep import Run, Sweep, grouped

CASE = text("case", "case")
NAMED = [CASE, hidden("site"), *COUNTS]


def heading(sweep: Sweep, site: str) -> str:
    """The site, and the size of the gaps that were cut there, if it is one."""
    gaps = {run.result.gap_diameter_m for run in sweep.scored if run.result.site == site}
    return f"## {site}" + (f", gaps of {gaps.pop():g} m" if len(gaps) == 1 else "") if site else "## No site was scored"


def case_rows(
    sweep: Sweep, site: str, runs: list[Run], columns: list[Column], row_of: Callable[[Group], Row], key: Callable[[Run], Hashable]
) -> list[Row]:
    """A row for each `key` of the runs on a site, in the keys' order; then, after those of the first site, one for each case that left no
    scores: of which site is not known.

    row_of: the cells of a group of runs that differ in their training seed alone.
    """
    rows = []
    for _, group in sorted(grouped(runs, key).items(), key=lambda item: natural(item[0])):
        first = next(iter(group.values()))
        failures = [note for run in group.values() for note in run.failures()]
        alike = _scored_alike(group)
        row = {"site": site, "case": first.case, **counts_of(alike), **row_of(alike)}
        rows.append(
            row | {"note": note_of(group, row.get("note"), network_of(first, first.champion("voxels")), *sweep.gone(first.case), *failures)}
        )
    if site == sweep.by_site()[0][0]:
        rows += [absent_row(status, columns, site=NOTHING, case=case, note="see below") for case, status in sweep.absent().items()]
    return rows


def _scored_alike(group: Group) -> Group:
    """The runs in which each of the row's maps was scored that was in any of them: what stands side by side, and is counted as n, is of the
    same trainings. All of them where there is no such run."""
    known = {name for name in champions(group) if any(name in run.result.scores for run in group.values())}
    return {seed: run for seed, run in group.items() if known <= run.result.scores.keys()} or group


def natural(key: Hashable) -> tuple:
    """What to sort by so that `k-9` stands before `k-10`, in texts and in tuples with texts."""
    if isinstance(key, tuple):
        return tuple(natural(part) for part in key)
    if not isinstance(key, str):
        return (key,)
    parts = re.split(r"(\d+(?:\.\d+)?)", key)  # numbers stand in the odd places
    return tuple((float(part), "") if place % 2 else (0.0, part) for place, part in enumerate(parts))


def case_tables(
    sweep: Sweep,
    site: str,
    rows: list[Row],
    *columns: list[Column],
    named: tuple[Column, ...] = (),
    captions: tuple[str, ...] = (),
) -> list[Table]:
    """The rows under each list of columns, with the case before them, and after the last of them how many runs and notes.

    named: columns beside the case that say what it is. captions: of the tables after the first, which has the site's name.
    """
    tables = [Table("table", rows, [*NAMED, *named, *columns[0]], caption="\n\n".join((heading(sweep, site), *captions[:1])))]
    tables += [
        Table("table", rows, [CASE, *named, *more], caption)
        for more, caption in zip(columns[1:], captions[1:] or [""] * len(columns), strict=False)
    ]
    tables[-1].columns += [N, NOTE]
    return tables


def champions(group: Group) -> tuple[str | None, str | None]:
    """The rows of the group's network that are calibrated for points and for voxels, also where they failed in some of its runs, or all:
    no other row stands in for one."""
    names = dict.fromkeys(name for run in group.values() for name in run.result.mappers())
    points, voxels = (next(iter(network_rows(names, reading)), None) for reading in ("points", "voxels"))
    return points, voxels
