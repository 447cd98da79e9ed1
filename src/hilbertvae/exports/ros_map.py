"""A 2D map as ROS's map_server loads it: a PGM image and a YAML file that says where it lies (Nav2's and ROS 1's rules alike)."""

from __future__ import annotations

import os
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import yaml

from hilbertvae.checks import InputError
from hilbertvae.exports.map_cells import MapCells
from hilbertvae.files import atomic
from hilbertvae.observed_map import FREE_PIXEL, OCCUPIED_PIXEL, UNKNOWN_PIXEL

OCCUPIED_THRESH = 0.65
FREE_THRESH = 0.196
"""ROS 1's default. Nav2's, 0.25, would make free cells of all unknown ones: their pixel, 205, is an occupancy of 50 / 255 = 0.1961."""
_HEADS = {
    "all": "# observed and predicted cells; {other} has the observed ones alone, on the same grid",
    "observed": "# observed cells alone; {other} has the predicted ones, too, on the same grid",
    "nothing predicted": "# observed cells alone, as {other}, since nothing was predicted",
}


def write_ros_map(cells: MapCells, path: str | os.PathLike) -> list[Path]:
    """Write `<name>.yaml` and `<name>.pgm`, and `<name>_observed` of both with the observed cells alone; returns the four paths.

    path: `<name>.yaml`, `.pgm`, or the name alone. Cells are occupied (p > 0.6), free (p <= 0.4) or unknown. All pixels stand on one grid,
    so the pairs lie on each other. The key `hilbertvae_cells`, which map_server passes over, says what is in a pair, `all` or `observed`.
    Raises `InputError` for a 3D map, which OctoMap's formats are for, an empty one, or an extent of more than 2^27 pixels.
    """
    path = Path(path)
    if path.suffix in (".yaml", ".pgm"):
        path = path.with_suffix("")
    if cells.dimension != 2:
        raise InputError(f"{path}: a ROS map is 2D, got a 3D map; write it as .ot or .bt, which octomap_server projects")
    labels = np.where(cells.occupied, OCCUPIED_PIXEL, np.where(cells.free, FREE_PIXEL, UNKNOWN_PIXEL)).astype(np.uint8)
    whole = cells.dense(labels, UNKNOWN_PIXEL)
    written = []
    # Images are moved to their places before the YAML files that name them.
    with ExitStack() as files:
        names = {"all": path.name, "observed": f"{path.name}_observed"}
        texts = {kind: files.enter_context(atomic(path.with_name(f"{name}.yaml"))) for kind, name in names.items()}
        images = {kind: files.enter_context(atomic(path.with_name(f"{name}.pgm"))) for kind, name in names.items()}
        for kind, name in names.items():
            other = names["observed" if kind == "all" else "all"] + ".yaml"
            pixels = whole if kind == "all" else np.where(cells.dense(cells.observed, False), whole, np.uint8(UNKNOWN_PIXEL))
            _write_pgm(images[kind], pixels)
            texts[kind].write_text(_yaml(cells, f"{name}.pgm", kind, other), encoding="utf-8")
            written += [path.with_name(f"{name}.yaml"), path.with_name(f"{name}.pgm")]
    return written


def _write_pgm(path: Path, pixels: np.ndarray) -> None:
    """pixels: (columns, rows) uint8, x and y of the map; an image's rows run from the top, where y is greatest."""
    columns, rows = pixels.shape
    with open(path, "wb") as file:
        file.write(f"P5\n{columns} {rows}\n255\n".encode("ascii"))
        file.write(np.ascontiguousarray(pixels.T[::-1]).data)


def _yaml(cells: MapCells, image: str, kind: str, other: str) -> str:
    corner = [round(float(first * cells.resolution_m), 9) for first in cells.box()[0]]  # of the lower left pixel
    content = {
        "image": image,
        "mode": "trinary",
        "resolution": cells.resolution_m,
        "origin": [*corner, 0.0],
        "negate": 0,
        "occupied_thresh": OCCUPIED_THRESH,
        "free_thresh": FREE_THRESH,
        "hilbertvae_cells": "observed" if cells.observed.all() else kind,
    }
    head = _HEADS["nothing predicted" if cells.observed.all() else kind]
    lines = yaml.safe_dump(content, sort_keys=False, default_flow_style=None, allow_unicode=True, width=1000)
    return head.format(other=" ".join(other.split())) + "\n" + lines
