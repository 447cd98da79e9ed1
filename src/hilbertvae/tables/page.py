"""What a table is made of, before it is Markdown or CSV: rows of cells, and columns that say what stands in them and how it is shown."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from matplotlib.figure import Figure

from hilbertvae.reports.score_table import NOTHING, as_percent, markdown
from hilbertvae.tables.spread import Spread

Cell = Spread | float | int | str | None
Row = dict[str, Cell]
MEASURED = ("_mean", "_sd", "_n")
"""What a `Spread` is in CSV: a column each."""


class Column(NamedTuple):
    """A column of the Markdown table, with its unit in the title; several keys stand in one cell with a stroke between them."""

    title: str
    keys: tuple[str, ...]
    show: Callable[..., str]
    """Text of (mean, sd) where the column is measured, else of the value itself."""
    measured: bool = True
    """Whether cells are a `Spread`."""


@dataclass
class Table:
    """Rows under columns. Tables of the same name stand in one CSV file: other columns of the same rows, or rows of another site."""

    name: str
    rows: list[Row]
    columns: list[Column]
    caption: str = ""


@dataclass
class Page:
    """All that is made of a sweep. figure: made when asked for, since it takes longest."""

    title: str
    tables: list[Table]
    figure: Callable[[], Figure]
    notes: list[str] = field(default_factory=list)

    def markdown(self) -> str:
        parts = [f"# {self.title}"]
        for table in self.tables:
            parts += [part for part in (table.caption, markdown_of(table)) if part]
        return "\n\n".join(parts + self.notes) + "\n"

    def csv_files(self) -> dict[str, str]:
        """CSV by file name: `table.csv`, and `table-<name>.csv` for tables of other rows."""
        files: dict[str, list[Table]] = {}
        for table in self.tables:
            files.setdefault(table.name, []).append(table)
        return {f"{name}.csv": _merged(tables) for name, tables in files.items()}


def text(title: str, key: str) -> Column:
    """A column of words."""
    return Column(title, (key,), str, measured=False)


def value(title: str, *keys: str, show: Callable[[Any], str] | None = None) -> Column:
    """A column of numbers that were set or printed, not measured here."""
    return Column(title, keys, show or (lambda given: f"{given:g}"), measured=False)


def hidden(key: str) -> Column:
    """A column that only CSV has."""
    return Column("", (key,), str, measured=False)


def measured(title: str, *keys: str, show: Callable[..., str] = as_percent) -> Column:
    """A column of means with their spread, in percent unless told."""
    return Column(title, keys, show)


def number(mean: float, sd: float | None = None) -> str:
    """Three digits that count, all of those before the point, and as many after it for the deviation."""
    if sd is None and float(mean).is_integer():
        return f"{mean:.0f}"
    decimals = max(0, 2 - math.floor(math.log10(abs(mean)))) if mean else 2
    return "±".join(f"{value:.{decimals}f}" for value in (mean, sd) if value is not None)


def megabytes(mean: float, sd: float | None = None) -> str:
    """Bytes as MB (1e6 bytes)."""
    return number(mean / 1e6, None if sd is None else sd / 1e6)


def signed_points(mean: float, sd: float | None = None) -> str:
    """A difference of shares in points of percent, with its sign."""
    return f"{100 * mean:+.1f}" + ("" if sd is None else f"±{100 * sd:.1f}")


def printed_percent(share: float) -> str:
    """A share in percent with the two decimals that the paper prints."""
    return f"{100 * share:.2f}"


def markdown_of(table: Table) -> str:
    """The table as Markdown, or nothing where it has no rows."""
    if not table.rows:
        return ""
    columns = [column for column in table.columns if column.title]
    words = tuple(place for place, column in enumerate(columns) if column.show is str)
    return markdown([column.title for column in columns], [[_shown(row, column) for column in columns] for row in table.rows], words)


def _shown(row: Row, column: Column) -> str:
    cells = [row.get(key) for key in column.keys]
    if all(cell is None for cell in cells):
        return NOTHING
    return " / ".join(_show(cell, column) for cell in cells)


def _show(cell: Cell, column: Column) -> str:
    if cell is None:
        return NOTHING
    if isinstance(cell, str):  # a word where a number is missing
        return " ".join(cell.split())
    return column.show(cell.mean, cell.sd) if isinstance(cell, Spread) else column.show(cell)


def _merged(tables: list[Table]) -> str:
    lists = {id(table.rows): table.rows for table in tables}
    return csv_of([row for rows in lists.values() for row in rows], [column for table in tables for column in table.columns])


def csv_of(rows: list[Row], columns: list[Column]) -> str:
    """One line per row; a measured key is three columns, `_mean`, `_sd` and `_n`, with every digit that a float64 has."""
    keys = {key: column.measured for column in columns for key in column.keys}
    header = [name for key, measured in keys.items() for name in ([key + part for part in MEASURED] if measured else [key])]
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(header)
    for row in rows:
        writer.writerow([cell for key, measured in keys.items() for cell in _cells(row.get(key), measured)])
    return out.getvalue()


def _cells(cell: Cell, measured: bool) -> list[str]:
    if not measured:
        return ["" if cell is None else cell if isinstance(cell, str) else repr(cell)]
    if isinstance(cell, Spread):
        return [repr(cell.mean), "" if cell.sd is None else repr(cell.sd), repr(cell.n)]
    return ["", "", ""]  # words are for readers; `status` says it to programs
