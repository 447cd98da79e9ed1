"""The quick ablation, as small as `debug=fast` makes it: in a process like a user's, or without that process's start."""

import os
import subprocess
import sys
from pathlib import Path

from narrow_networks import shared_grids
from warm_start import train

TRAIN = [sys.executable, "-m", "hilbertvae.train"]
ABLATION = ("-m", "+sweep=ablation", "debug=fast", "trainer.threads=1", "evaluation.occlusion=false")


def multirun(folder: Path, *overrides: str) -> subprocess.CompletedProcess:
    return train(folder, *ABLATION, f"data.cache={shared_grids(folder)}", *overrides)


def environment() -> dict[str, str]:
    return {**os.environ, "OMP_NUM_THREADS": "1"}


def by_itself(folder: Path, *overrides: str) -> subprocess.CompletedProcess:
    """The same in a process like a user's, for what starts processes of its own."""
    command = [*TRAIN, *ABLATION, *overrides]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, env=environment())
