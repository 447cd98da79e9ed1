"""A sweep's tables and figure as files."""

from __future__ import annotations

import os
from contextlib import ExitStack
from pathlib import Path

from hilbertvae.drawing.canvas import save_picture
from hilbertvae.files import atomic
from hilbertvae.signals import to_its_end
from hilbertvae.tables.layouts import read_page


def write_tables(folder: str | os.PathLike, output: str | os.PathLike | None = None, kind: str | None = None) -> str:
    """Write `table.md`, `table.csv` (a line per row) and `figure.png` of the sweep in `folder` into `output`, or into `folder` itself.

    Tables of other rows than the first one's go into `table-<name>.csv`. kind: which sweep's table it is to have, for a folder without
    `sweep.json`, or of a sweep of somebody's own. Returns the Markdown. Raises `InputError`, before anything is written, for results that
    can't be read or can't stand in one table.
    """
    folder = Path(folder)
    output = Path(output) if output is not None else folder
    page = read_page(folder, kind)
    figure = page.figure()
    texts = {"table.md": page.markdown(), **page.csv_files()}
    with ExitStack() as files:  # all or none: a new table beside an old figure would pass for one
        for name, content in texts.items():
            files.enter_context(atomic(output / name)).write_text(content, encoding="utf-8", newline="")
        save_picture(figure, files.enter_context(atomic(output / "figure.png")))
        to_its_end(files.pop_all().close)
    return texts["table.md"]
