"""Cells that every kind of sweep has: scores and costs of a group of runs that differ in their training seed alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from hilbertvae.reports.mapper_names import is_network
from hilbertvae.reports.score_table import NOTHING, as_percent
from hilbertvae.scoring.result import PRECISIONS, calls_any
from hilbertvae.tables.alike import is_unclean
from hilbertvae.tables.page import Column, Row, hidden, measured, megabytes, number, text
from hilbertvae.tables.spread import Paired, Spread, over_seeds
from hilbertvae.tables.sweep import UNCLEAN, Run, grouped

Group = Mapping[int, Run]
"""Runs of one row by training seed."""
BASELINES = "baselines"
"""The case of a sweep that scores all mappers without a network."""

COUNTS = [hidden("status"), hidden("training_seeds"), hidden("gap_seeds")]
COSTS = [
    measured("training (s)", "train_s", show=number),
    measured("training grids (s)", "grids_s", show=number),
    measured("fit (s)", "fit_s", show=number),
    measured("query (s per million)", "query_s_per_million", show=number),
    measured("clusters", "clusters", show=number),
    measured("map (MB)", "map_bytes", show=megabytes),
]
N = text("n", "n")
NOTE = text("note", "note")
LEGEND = (
    "Scores in percent, differences in points of percent, mean±sd. n: training seeds × gap seeds; the mean is over gap seeds and then"
    " over training seeds, the sd over training seeds where there are several, else over gap seeds; of a single one there is none. "
    "Precision, recall and F1 at p > 0.6, best F1 at the best cut, AUC at all cuts; "
    "precision is over the seeds in which anything was called occupied."
)
COST_LEGEND = (
    "MB: 1e6 bytes. Training and its grids are of the run's network, so that mappers without one have none. Grids that another run had "
    "built before are loaded, in a second or two. Older results count, of a training that was interrupted, only what came after."
)


def score_of(group: Group, mapper: str | None, reading: str, region: str, metric: str) -> Spread | None:
    """A score over a group; None where it was not scored. A precision leaves out trainings whose map called nothing so with any gap seed,
    unless that is so of all."""
    if mapper is None:
        return None
    runs = [run.result for run in group.values()]
    if metric in PRECISIONS:  # which is 0 there, as if all that was called had been wrong
        runs = [run for run in runs if calls_any(run.regions(mapper, reading).get(region, {}), metric)] or runs
    return over_seeds([run.values(mapper, reading, region, metric) for run in runs])


def per_seed(group: Group, mapper: str | None, reading: str, region: str, metric: str) -> Paired:
    """A score by training seed, one number per gap seed."""
    found = {seed: run.result.values(mapper, reading, region, metric) for seed, run in group.items()} if mapper else {}
    return {seed: values for seed, values in found.items() if values}


def mapper_groups(runs: Sequence[Run]) -> dict[tuple[str, str], dict[int, Run]]:
    """Runs by (mapper, case), and in there by training seed.

    Nothing in a mapper without a network depends on a training: of these one run is enough, of the baselines' case where that scored it,
    and further ones would only make the spread look smaller than it is.
    """
    found: dict[tuple[str, str], dict[int, Run]] = {}
    for mapper in dict.fromkeys(mapper for run in runs for mapper in run.result.scores):
        cases = grouped((run for run in runs if mapper in run.result.scores), lambda run: run.case)
        if not is_network(mapper):
            cases = {case: {min(group): group[min(group)]} for case, group in cases.items() if case == BASELINES or BASELINES not in cases}
        found |= {(mapper, case): group for case, group in sorted(cases.items())}
    return found


def costs_of(group: Group, mapper: str | None) -> Row:
    """Seconds of every stage, number of clusters and bytes of the map, for `COSTS`."""
    runs = list(group.values())
    if mapper is None:
        return {}
    trained = runs if is_network(mapper) else []
    return {
        "train_s": over_seeds([run.stage_seconds("train") for run in trained]),
        "grids_s": over_seeds([run.stage_seconds("grids") for run in trained]),
        "fit_s": over_seeds([run.seconds(mapper, "fit") for run in runs]),
        "query_s_per_million": over_seeds([run.seconds(mapper, "query_per_million") for run in runs]),
        "clusters": over_seeds([run.map(mapper, "clusters") for run in runs]),
        "map_bytes": over_seeds([run.map(mapper, "bytes") for run in runs]),
    }


def counts_of(group: Group) -> Row:
    """How many seeds stand behind a row, for `COUNTS` and `N`."""
    gap_seeds = max((len(run.result.gap_seeds) for run in group.values()), default=0)
    n = f"{len(group)}×{gap_seeds}" if group else NOTHING
    return {"status": "ok", "training_seeds": len(group), "gap_seeds": gap_seeds, "n": n}


def absent_row(status: str, columns: list[Column], **named) -> Row:
    """A row of which nothing is known but that it is `missing` or `failed`, which its first measured column says."""
    first = next(column for column in columns if column.measured)
    return {first.keys[0]: status, "status": status, "training_seeds": 0, "gap_seeds": 0, "n": NOTHING, **named}


def ceiling_note(runs: Sequence[Run]) -> list[str]:
    """The best that a vote at each site's own cell size does on held-out beams."""
    found = {run.result.site: run.result.ceiling for run in runs if run.result.ceiling}
    parts = []
    for site, ceiling in found.items():
        pairs = (f"{reading} {as_percent(best['precision'])} / {as_percent(best['recall'])}" for reading, best in ceiling.items())
        parts.append(f"{site}, {', '.join(pairs)}")
    return [f"Ceiling, the best vote at the map's cell size on held-out beams, P / R (%): {'; '.join(parts)}."] if parts else []


def own_network(run: Run, mapper: str | None) -> str:
    """What the keys of a mapper's network begin with: those of the run's, unless mappers name several."""
    return f"networks.{mapper}." if run.config(f"networks.{mapper}") else ""


def network_of(run: Run, mapper: str | None = None) -> str:
    """The network of a run, or of a mapper that names its own, in words: its kind, channels, cells of its grids and latent dimension;
    nothing of a run without one."""
    own = own_network(run, mapper)
    kind, channels = run.config(f"{own}network.kind"), run.config(f"{own}network.channels")
    if kind is None:
        return ""
    parts = [str(kind) + (" " + "/".join(map(str, channels)) if isinstance(channels, list) else "")]
    parts += [f"{cells} cells"] if (cells := run.config(f"{own}grid.cells")) else []
    parts += [f"latent {latent}"] if (latent := run.config(f"{own}network.latent")) else []
    return ", ".join(parts)


def note_of(group: Group, *parts: str) -> str:
    """Notes of a row, and whether it was made from code that no commit holds."""
    unclean = [UNCLEAN] if any(is_unclean(run) for run in group.values()) else []
    return "; ".join(part for part in (*parts, *unclean) if part) or NOTHING
