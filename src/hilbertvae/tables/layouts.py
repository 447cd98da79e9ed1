"""Which table each kind of sweep becomes, and what may differ between its rows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from hilbertvae.checks import InputError
from hilbertvae.tables.alike import check_alike, origin_notes
from hilbertvae.tables.methods import methods_page
from hilbertvae.tables.page import Page
from hilbertvae.tables.sweep import Sweep, read_kind, read_sweep


@dataclass(frozen=True)
class Layout:
    """page: makes the tables of checked runs. varies, same: see `check_alike`."""

    page: Callable[[Sweep], Page]
    varies: frozenset[str] = frozenset()
    same: tuple[str, ...] = ()

    def read(self, folder: Path, kind: str) -> Page:
        sweep = read_sweep(folder, kind)
        check_alike(sweep, self.varies, self.same)
        return finished(self.page(sweep), kind, sweep.size, sweep.troubles(), origin_notes(sweep))


LAYOUTS = {
    "table1": Layout(methods_page),
    "table2": Layout(methods_page),
}


def read_page(folder: Path, kind: str | None = None) -> Page:
    """The tables and the figure of a sweep's folder; an `InputError` for what can't be read or can't stand in one table."""
    kind, *_ = read_kind(folder, kind)
    if kind not in LAYOUTS:
        raise InputError(f"{folder / 'sweep.json'}: sweep: expected one of {', '.join(LAYOUTS)}, got {kind!r}")
    return LAYOUTS[kind].read(folder, kind)


def finished(page: Page, kind: str, size: str | None, troubles: list[str], origin: list[str]) -> Page:
    """The page with what is the same for all kinds: its name and size, what is missing, and what made the rows."""
    title = f"{page.title} ({kind}{f', size {size}' if size else ''})"
    lists = [f"{heading}\n\n" + "\n".join(lines) for heading, lines in (("Not there:", troubles), ("Made by:", origin)) if lines]
    return replace(page, title=title, notes=[*page.notes, *lists])
