"""The trained networks that come with the package, by name."""

from __future__ import annotations

import os
from pathlib import Path

FOLDER = Path(__file__).parent.parent / "weights"
SHIPPED = {
    "2d": "buildings: six real ones and simulated ones",
    "3d": "streets and floors: thirteen real streets, simulated streets and simulated floors of buildings",
    "2d-sim": "simulated buildings alone",
    "3d-sim": "simulated streets and floors of buildings alone",
    "2d-map": "maps of buildings: of six real ones and of simulated ones",
}
"""What each was trained on. Those on simulated sites alone are free of the terms of anybody's scans."""


def network_for(dimension: int, is_map: bool) -> str:
    """The name of the network that fills scans of so many dimensions, or an existing map, unless another one is asked for."""
    given_a_map = f"{dimension}d-map"
    return given_a_map if is_map and given_a_map in SHIPPED else f"{dimension}d"


def checkpoint_path(name: str | os.PathLike) -> Path:
    """Where the network of this name lies; anything that is no name of ours is a path already."""
    return FOLDER / f"{name}.safetensors" if name in SHIPPED else Path(name)
