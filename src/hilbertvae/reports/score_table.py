"""The final table: every mapper by observed and gaps, for both readings, on the console and as Markdown; made from a `Result` alone."""

from __future__ import annotations

import math

import numpy as np
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from hilbertvae.reports.mapper_names import competes
from hilbertvae.scoring.result import Result

READINGS = ("points", "voxels")
REGIONS = ("observed", "gaps")
SPLIT = (("observed-above-ground", "gaps-above-ground"), ("observed-near-ground", "gaps-near-ground"))
"""What a 3D site's regions are made of: much of a street is ground, which is easy."""
METRICS = {"precision": "prec.", "recall": "recall", "f1": "F1", "auc": "AUC"}
BOLD = ("f1", "auc", "best_f1")
"""Metrics of which the best is set in bold: whoever calls everything occupied has the best recall."""
WIDE = 108
"""Columns of a console from which on observed and gaps stand side by side."""
MARKDOWN_METRICS = METRICS | {"best_f1": "best F1"}
"""Markdown has room for the F1 at the best cut, which the protocol's cut may miss by far (METHOD 7)."""
NOTHING = "-"


def mean_and_spread(values: list[float]) -> tuple[float, float | None]:
    """Mean, and the standard deviation of a sample (n - 1); None for a single value. The same bits on every machine."""
    mean = math.fsum(values) / len(values)
    return mean, math.sqrt(math.fsum((value - mean) ** 2 for value in values) / (len(values) - 1)) if len(values) > 1 else None


def percent(values: list[float]) -> str:
    """Mean +- standard deviation over gap seeds, in percent: `85.1±2.3`, `85.1` of one seed, or `-` of none."""
    return as_percent(*mean_and_spread(values)) if values else NOTHING


def as_percent(mean: float, spread: float | None = None) -> str:
    """A share and its standard deviation, if there is one, in percent."""
    return f"{100 * mean:.1f}" + (f"±{100 * spread:.1f}" if spread is not None else "")


def rows_of(result: Result, reading: str, regions: tuple[str, ...] = REGIONS, metrics: dict[str, str] = METRICS) -> list[list[str]]:
    """A row of cells per mapper, the failed ones after those that were scored, and last the ceiling, which only `observed` has."""
    columns = [(region, metric) for region in regions for metric in metrics]
    best = {column: _best(result, reading, *column) for column in columns if column[1] in BOLD}
    rows = []
    for name in result.scores:
        cells = [(column, result.values(name, reading, *column)) for column in columns]
        bold = [competes(name) and bool(values) and np.mean(values) == best.get(column) for column, values in cells]
        rows.append([name, *(_bold(percent(values), chosen) for (_, values), chosen in zip(cells, bold, strict=True))])
    for name in result.failed:
        if name not in result.scores:
            rows.append([name, "failed", *[NOTHING] * (len(columns) - 1)])
    if "observed" not in regions:
        return rows
    ceiling = result.ceiling.get(reading, {})
    cells = [percent([ceiling[metric]]) if region == "observed" and metric in ceiling else NOTHING for region, metric in columns]
    return [*rows, ["ceiling", *cells]]


def _best(result: Result, reading: str, region: str, metric: str) -> float | None:
    found = [result.values(name, reading, region, metric) for name in result.scores if competes(name)]
    return max((np.mean(values) for values in found if values), default=None)


def _bold(text: str, bold: bool) -> str:
    return f"**{text}**" if bold else text


def score_tables(result: Result, width: int = WIDE) -> list[Table]:
    """Tables for a console of `width` columns: one per reading, or one per reading and region where it is narrow."""
    together = [REGIONS] if width >= WIDE else [(region,) for region in REGIONS]
    return [_console_table(result, reading, regions) for reading in READINGS for regions in together]


def _console_table(result: Result, reading: str, regions: tuple[str, ...]) -> Table:
    title = escape(f"{heading(result)}, scored on {reading}")  # a site may be called `office[new].log`
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), title_justify="left", title=title)
    table.add_column("\nmapper", no_wrap=True)
    for region in regions:
        for place, label in enumerate(METRICS.values()):
            table.add_column(f"{region if place == 0 else ''}\n{label}", justify="right", no_wrap=True, min_width=9)
    rows = rows_of(result, reading, regions)
    for number, row in enumerate(rows):
        cells = (f"[bold]{cell[2:-2]}[/bold]" if cell.startswith("**") else cell for cell in row)
        before_ceiling = number == len(rows) - 2 and rows[-1][0] == "ceiling"
        table.add_row(*cells, style="dim" if row[0] == "ceiling" else None, end_section=before_ceiling)
    return table


NOT_SCANS = {"map": ", given a map", "fine-map": ", given a map of half cells"}
"""By `Protocol.given`, what stands beside the site's name where mappers were not given its scans."""


def told_given(protocol: dict) -> str:
    """What mappers were given of the site, where that was not its scans, as more words."""
    return NOT_SCANS.get(protocol.get("given", "scans"), "")


def told_gaps(protocol: dict) -> str:
    """How gaps were cut, where that was not METHOD 7's way, as more words: such scores stand beside no others."""
    return " without a rim" * (not protocol["rim"]) + " centred on returns" * protocol["centred"]


def heading(result: Result) -> str:
    """What was scored, in a line."""
    seeds = len(result.gap_seeds)
    place = f"{result.site} ({result.dimension}D){told_given(result.protocol)}"
    gaps = f"gaps of {result.gap_diameter_m:g} m{told_gaps(result.protocol)}"
    return f"{place}, {gaps}, {seeds} gap seed{'s' if seeds > 1 else ''}"


LEGEND = (
    "In percent, mean±sd over gap seeds. observed: held-out beams outside gaps. Precision, recall and F1 at p > 0.6, AUC at all cuts; "
    "precision is over the seeds in which anything was called occupied. ceiling: the best vote at the map's cell size."
)
GROUND_LEGEND = "near ground: up to 0.4 m above the local ground, and all below it; above ground: higher."


def print_scores(result: Result, console: Console | None = None) -> None:
    """Print the final table, what failed, and what the numbers are."""
    console = console or Console()
    for table in score_tables(result, console.width):
        console.print(table)
    for name, message in result.failed.items():
        console.print(f"{name} failed: {message}", style="red", markup=False)
    console.print(LEGEND, style="dim")


def markdown_scores(result: Result) -> str:
    """The same tables as Markdown, with what failed under them."""
    parts = [f"### {heading(result)}"]
    for reading in READINGS:
        for regions in (REGIONS, *(SPLIT if result.dimension == 3 else ())):
            header = ["mapper", *(f"{region} {label}" for region in regions for label in MARKDOWN_METRICS.values())]
            parts.append(f"Scored on {reading}:\n\n" + markdown(header, rows_of(result, reading, regions, MARKDOWN_METRICS)))
    parts += [f"{name} failed: {message}" for name, message in result.failed.items()]
    return "\n\n".join([*parts, f"{LEGEND} {GROUND_LEGEND}" if result.dimension == 3 else LEGEND]) + "\n"


def markdown(header: list[str], rows: list[list[str]], words: tuple[int, ...] = ()) -> str:
    """A Markdown table, the first column to the left and the others to the right, but for those in the places of `words`."""
    sides = ["---" if place in (0, *words) else "---:" for place in range(len(header))]
    lines = [header, sides, *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)
