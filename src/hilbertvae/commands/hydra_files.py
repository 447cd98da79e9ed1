"""A Hydra callback that leaves no word of a single run that is refused: Hydra writes what was typed before anything has looked at it, over
what the run whose results lie there was called with."""

from __future__ import annotations

import shutil
from contextlib import suppress
from pathlib import Path
from typing import Any

from hydra.experimental.callback import Callback
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from hilbertvae.files import atomic
from hilbertvae.reports.run_folder import CHECKPOINTS, LOCK, RESULT, TENSORBOARD, TRAINING


class HydraFiles(Callback):
    """Remembers the files that Hydra is about to write in a run's folder. One process makes one single run."""

    found: dict[Path, bytes | None] = {}
    """By path what was there, None for nothing."""
    made: list[Path] = []
    """Folders that were not there, the innermost first."""
    begun: Path | None = None
    """The run's own folder, if it was not there."""

    def on_run_start(self, config: DictConfig, **_: Any) -> None:
        with suppress(OmegaConfBaseException):  # of a folder that has no name, or not yet, Hydra tells
            folder, inner = Path(config.hydra.run.dir), config.hydra.output_subdir
            written = [folder / inner / f"{name}.yaml" for name in ("config", "hydra", "overrides")] if inner else []
            written.append(folder / f"{config.hydra.job.name}.log")
            HydraFiles.found = {path: path.read_bytes() if path.is_file() else None for path in written}
            HydraFiles.made = [path for path in (folder / (inner or ""), folder, *folder.parents) if not path.exists()]
            HydraFiles.begun = None if folder.exists() else folder

    @staticmethod
    def take_back_training() -> None:
        """What a training that has not got as far as its first epoch has left in a new folder, of which the process has the lock."""
        with suppress(OSError):
            if (own := HydraFiles.begun) and not ((own / RESULT).exists() or any((own / CHECKPOINTS).glob("*.ckpt"))):
                shutil.rmtree(own / TENSORBOARD, ignore_errors=True)
                for name in (TRAINING, LOCK):
                    (own / name).unlink(missing_ok=True)

    @staticmethod
    def take_back() -> None:
        """The files as they were, and no folder that was made for them, unless something else is in it."""
        with suppress(OSError):  # the refusal is what counts
            for path, content in HydraFiles.found.items():
                if content is None:
                    path.unlink(missing_ok=True)
                elif content != path.read_bytes():
                    with atomic(path) as temporary:
                        temporary.write_bytes(content)
            for folder in HydraFiles.made:
                folder.rmdir()
