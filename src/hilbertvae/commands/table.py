"""`hilbertvae-table`: the table and the figure of a sweep, from its result files alone."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from hilbertvae import __version__
from hilbertvae.checks import InputError
from hilbertvae.signals import stopped_by_signals
from hilbertvae.tables.kinds import KINDS
from hilbertvae.terminal import show_any_text


def main(words: list[str] | None = None) -> int:
    """Entry point; the exit code, 2 for results that make no table and for a folder that can't be written."""
    parser = argparse.ArgumentParser(prog="hilbertvae-table", description="Write table.md, table.csv and figure.png of a sweep's results.")
    parser.add_argument("folder", type=Path, help="folder of a sweep, with a folder per job and result.json in each")
    parser.add_argument("--output", type=Path, help="where to write; by default the folder itself")
    parser.add_argument("--sweep", choices=KINDS, help="whose table it is to have: without sweep.json, or of a sweep of your own")
    parser.add_argument("--version", action="version", version=f"hilbertvae {__version__}")
    given = parser.parse_args(words)
    show_any_text()
    try:
        with stopped_by_signals():
            from hilbertvae.tables.write import write_tables  # here: --help and typing errors wait for neither scikit-learn nor matplotlib

            print(write_tables(given.folder, given.output, given.sweep), end="")
    except KeyboardInterrupt:
        print("hilbertvae-table: stopped", file=sys.stderr)
        return 130
    except (InputError, OSError) as error:
        print(f"hilbertvae-table: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
