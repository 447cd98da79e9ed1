"""What a terminal, or a log in its place, can show."""

from __future__ import annotations

import io
import os
import sys


def show_any_text() -> None:
    """From now on the standard output has `?` for what its encoding lacks, such as the ± of a table or a folder's name in another
    encoding: a line that can't be shown is no reason for work to fail."""
    if isinstance(sys.stdout, io.TextIOWrapper):  # a notebook's own output takes all of Unicode
        sys.stdout.reconfigure(errors="replace")


def let_go_of_output() -> None:
    """After a `BrokenPipeError`: whoever read the standard output, such as `head`, has had enough, so that nothing more is written there,
    nor as the process ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
