"""A Hydra callback that tells of a run's folder that can't be written before Hydra makes it, which would be a traceback."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

from hydra.experimental.callback import Callback
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from hilbertvae.checks import InputError, check_writable


class WritableFolder(Callback):
    """Of single runs; `SweepProgress`, which knows the folders of all jobs, tells of a multirun's."""

    def on_run_start(self, config: DictConfig, **_: Any) -> None:
        with suppress(OmegaConfBaseException):  # of a folder that has no name, or not yet, Hydra tells
            folder, inner = Path(config.hydra.run.dir), config.hydra.output_subdir
            refuse_unwritable([folder, folder / inner] if inner else [folder])


def refuse_unwritable(folders: Iterable[Path]) -> None:
    """The end, with one line and exit code 2, where one of `folders` can't be made or written."""
    try:
        for folder in folders:
            check_writable(folder)
    except InputError as error:
        print(f"hilbertvae-train: {error}", file=sys.stderr)
        sys.exit(2)  # Hydra goes on after any other exception of a callback
