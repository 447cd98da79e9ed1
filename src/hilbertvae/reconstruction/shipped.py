"""The trained networks that come with the package, by name."""

from __future__ import annotations

import os
from pathlib import Path

FOLDER = Path(__file__).parent.parent / "weights"
SHIPPED = {
    "2d": "buildings: six real ones and simulated ones",
    "3d": "streets: thirteen real places and simulated streets",
    "2d-sim": "simulated buildings alone",
    "3d-sim": "simulated streets alone",
}
"""What each was trained on. The last two are free of the terms of anybody's scans."""


def checkpoint_path(name: str | os.PathLike) -> Path:
    """Where the network of this name lies; anything that is no name of ours is a path already."""
    return FOLDER / f"{name}.safetensors" if name in SHIPPED else Path(name)
