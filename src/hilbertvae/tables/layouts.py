"""Which table each kind of sweep becomes, and what may differ between its rows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

from hilbertvae.checks import InputError
from hilbertvae.tables import gap_size, generalise, latent, tradeoff
from hilbertvae.tables.ablation import ablation_page
from hilbertvae.tables.alike import BUDGET, TRAINED, Alike, check_alike, origin_notes
from hilbertvae.tables.clustering import read_starts
from hilbertvae.tables.gap_size import gap_size_page
from hilbertvae.tables.generalise import generalise_page
from hilbertvae.tables.latent import latent_page
from hilbertvae.tables.measure import ceiling_note
from hilbertvae.tables.methods import methods_page
from hilbertvae.tables.page import Page
from hilbertvae.tables.starts import starts_page
from hilbertvae.tables.sweep import SWEEP, Sweep, read_kind, read_sweep
from hilbertvae.tables.tradeoff import tradeoff_page


@dataclass(frozen=True)
class Layout:
    """page: makes the tables of checked runs. alike: what has to agree between them."""

    page: Callable[[Sweep], Page]
    alike: Alike = field(default_factory=Alike)

    def read(self, folder: Path, kind: str) -> Page:
        """The page of the sweep in a folder; an `InputError` for runs that can't stand in one table."""
        sweep = read_sweep(folder, kind)
        check_alike(sweep, self.alike)
        page = self.page(sweep)
        page = replace(page, notes=[*page.notes, *ceiling_note(sweep.scored)])
        return finished(page, kind, sweep.size, sweep.troubles(), origin_notes(sweep.scored))


class StartsLayout:
    """Fig. 2 scores no map: its jobs leave another kind of file."""

    def read(self, folder: Path, kind: str) -> Page:
        """The page of the study in a folder."""
        study = read_starts(folder, kind)
        return finished(starts_page(study), kind, study.size, study.troubles(), origin_notes(study.measured))


LAYOUTS: dict[str, Layout | StartsLayout] = {
    "table1": Layout(methods_page, Alike(trained=TRAINED)),
    "table2": Layout(methods_page, Alike(trained=TRAINED)),
    "fig2": StartsLayout(),
    "fig6": Layout(latent_page, Alike(same=BUDGET, but=latent.SETTINGS)),
    "fig7": Layout(gap_size_page, Alike(gap_size.VARIES, same=BUDGET, but=gap_size.SETTINGS)),
    "tradeoff": Layout(tradeoff_page, Alike(same=BUDGET, but=tradeoff.CHANGED)),
    "ablation": Layout(ablation_page),
    "generalise": Layout(generalise_page, Alike(generalise.VARIES, same=BUDGET, but=generalise.SETTINGS)),
}


def read_page(folder: Path, kind: str | None = None) -> Page:
    """The tables and the figure of a sweep's folder; an `InputError` for what can't be read or can't stand in one table."""
    kind, *_ = read_kind(folder, kind)
    if kind not in LAYOUTS:
        raise InputError(f"{folder / SWEEP}: sweep: expected one of {', '.join(LAYOUTS)}, got {kind!r}")
    return LAYOUTS[kind].read(folder, kind)


def finished(page: Page, kind: str, size: str | None, troubles: list[str], origin: list[str]) -> Page:
    """The page with what is the same for all kinds: its name and size, what is missing, and what made the rows."""
    title = f"{page.title} ({kind}{f', size {size}' if size else ''})"
    lists = [f"{heading}\n\n" + "\n".join(lines) for heading, lines in (("Not there:", troubles), ("Made by:", origin)) if lines]
    return replace(page, title=title, notes=[*page.notes, *lists])
