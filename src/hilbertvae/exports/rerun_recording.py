"""A map as a Rerun recording, observed and predicted cells apart (extra `rerun`)."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from hilbertvae.checks import InputError, extra_module
from hilbertvae.drawing.lit_colours import LIT, LIT_TINT, tinted
from hilbertvae.exports.map_cells import MapCells
from hilbertvae.files import atomic


def write_rerun(cells: MapCells, path: str | os.PathLike) -> Path:
    """Write the occupied cells as points, the entities `map/observed` and `map/predicted`, each with `probability` and `std`.

    Rerun's coordinates are float32: they count from the corner of the map in whole metres, which is `map`'s value `origin_m`, (0, 0, 0)
    for a map within a kilometre of the origin. A 2D map lies at z = 0.
    Raises `InputError` where rerun-sdk is not installed.
    """
    path = Path(path)
    if path.suffix != ".rrd":
        raise InputError(f"{path}: expected a name that ends in .rrd")
    rerun = extra_module("rerun", "rerun", f"{path}: needs")
    chosen = cells.select(cells.occupied)
    colours = tinted(LIT(chosen.probability.astype(np.float64))[:, :3], ~chosen.observed, LIT_TINT)  # Rerun's background is black
    places = np.zeros((len(chosen), 3))
    places[:, : chosen.dimension] = chosen.centres
    origin_m = np.zeros(3)
    if np.abs(places).max(initial=0.0) > 1000:
        origin_m = np.floor(places.min(axis=0))
    places = (places - origin_m).astype(np.float32)
    recording = rerun.RecordingStream("hilbertvae")
    if not recording.is_enabled():
        raise InputError(f"{path}: Rerun is switched off by the environment variable RERUN")
    kept = recording.memory_recording()  # its own files end half-written on a full disk, with a line in the log
    with atomic(path) as temporary:
        recording.log("map", rerun.AnyValues(origin_m=origin_m, resolution_m=cells.resolution_m), static=True)
        for name, part in (("observed", chosen.observed), ("predicted", ~chosen.observed)):
            points = rerun.Points3D(places[part], colors=colours[part], radii=np.float32(cells.resolution_m / 2))
            values = [rerun.AnyValues(probability=chosen.probability[part], std=chosen.std[part])] if part.any() else []
            recording.log(f"map/{name}", points, *values, static=True)
        temporary.write_bytes(kept.drain_as_bytes())
    return path
