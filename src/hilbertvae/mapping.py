"""Scans in; a gap-filled map, and everything to look at it with, out: what `hilbertvae-map` does."""

from __future__ import annotations

import math
import os
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from pathlib import Path

import numpy as np

from hilbertvae.checks import InputError, check_cell_m
from hilbertvae.cloud import fit_cloud
from hilbertvae.exports.formats import check_names, suiting_exports, write_exports
from hilbertvae.exports.map_cells import REACH_M, MapCells
from hilbertvae.exports.map_folder import (
    MAP,
    PAGE,
    PICTURE,
    SUMMARY,
    check_output,
    check_writable,
    listed_files,
    scans_hash,
    writing_beside,
)
from hilbertvae.exports.map_picture import write_picture
from hilbertvae.exports.page import write_page
from hilbertvae.exports.summary import map_summary, point_counts, summary_tables
from hilbertvae.files import write_json
from hilbertvae.mappers.given_map import GivenMap, is_given_map, read_given_map, warn_of_moved_walls
from hilbertvae.mappers.loading import load_mapper
from hilbertvae.mappers.saved_map import save_map
from hilbertvae.mappers.weights import check_calibration
from hilbertvae.reconstruction.precision import check_device
from hilbertvae.reports.provenance import made_by
from hilbertvae.scans.formats import ReadingSettings, read_scans_path
from hilbertvae.scans.kitti import VELODYNE
from hilbertvae.scans.scan import Scans
from hilbertvae.voxel_blocks import SIDE

Say = Callable[[str], None]
FLAT_M = 1e-3
"""Points of a planar laser in a format of three coordinates differ in height by rounding alone."""


@dataclass
class MapSettings(ReadingSettings):
    """One run of `hilbertvae-map`; how scans are read is inherited."""

    scans: str = ""
    """A file or a folder of scans, or a map to be filled: an OctoMap `.ot` or `.bt`, a ROS map's `.yaml`. Of maps that
    were filled before, give the `_observed` one: what a map holds is taken as seen. Cells count from (0, 0): where a ROS map's `origin` is
    no whole number of cells, its walls move by up to half a cell, with a warning, and its unknown margin is not kept."""
    output: str | None = None
    """Folder to write to; `outputs/maps/<name of the scans>` unless given."""
    weights: str | None = None
    """A network that comes with the package, or the `model.safetensors` of a training; `2d` or `3d`, as the data are, unless given."""
    resolution_m: float | None = None
    """Side of the map's cells; the network's own (0.1 in 2D, 0.2 in 3D), or that of a map to be filled, unless given."""
    fill: bool = True
    """`off` gives the observed map alone."""
    adapt_steps: int = 0
    """For how many steps the network first learns from the scans themselves, from gaps cut for that; 100 take 25 to 55 s in 2D."""
    calibration: str = "voxels"
    """What the map is made for. `voxels`: a probability is the share of cells that are occupied. `points`: the cut of 0.6 finds most
    of what beams would hit. It fills in two to four times as much, and more of that is wrong (a street's gaps, by cells: recall 89 %
    for 43 %, precision 54 % for 88 %); of seen cells some more are occupied (4 % more in a street, 14 % in a building)."""
    exports: list[str] | None = None
    """Which formats are written, as `exports=[ros,points]`, of ros, ot, bt, points, mesh, npz and rerun; all that suit the map and need no
    extra, unless given."""
    device: str = "cpu"
    """Where the network computes: `cpu`, or `cuda` where there is one."""

    def reading(self) -> ReadingSettings:
        """How scans are read."""
        return ReadingSettings(**{part.name: getattr(self, part.name) for part in fields(ReadingSettings)})


def make_map(settings: MapSettings, say: Say = lambda stage: None) -> Path:
    """Map the scans and write the results; the folder that has them. `say` is called with the name of each stage as it begins.

    Files are written beside their places and moved there together at the end, so that what fails leaves nothing. Raises `InputError`
    for what can't be read or mapped, and `OSError` where the folder can't be written.
    """
    if not settings.scans:
        raise InputError("scans: expected a file or a folder of scans, got none; give scans=<path>")
    if settings.resolution_m is not None:
        check_cell_m(settings.resolution_m, "resolution_m")
    check_names(settings.exports)
    check_device(settings.device)
    check_calibration(settings.calibration)
    mapper = load_mapper(settings.weights) if settings.weights else None  # before the scans, which may take long
    name = Path(settings.scans).resolve().name
    output = Path(settings.output or Path("outputs/maps") / name)
    name = name.encode("utf-8", "replace").decode()  # a name of another encoding can't be drawn or written
    if output.resolve() in (Path(settings.scans).resolve(), (Path(settings.scans) / VELODYNE).resolve()):
        raise InputError(f"output: {output} is the folder that is read, where a map would lie among the scans; choose another")
    check_writable(output)
    clock = Clock(say)
    clock.start("read")
    source = _read(settings)
    exports = suiting_exports(settings.exports, source.dimension)
    check_output(output, Path(settings.scans), exports, by_name=not settings.output)
    weights = settings.weights or f"{source.dimension}d"
    chosen = {name: getattr(settings, name) for name in ("fill", "adapt_steps", "calibration")}
    mapper = (mapper or load_mapper(weights)).set_params(**chosen, device=settings.device)
    if mapper.reconstructor.dimension != source.dimension:
        raise InputError(f"weights: {weights} is a network for {mapper.reconstructor.dimension}D, got {source.dimension}D scans")
    network_m = mapper.reconstructor.resolution_m
    resolution_m = settings.resolution_m or (source.cell_m if isinstance(source, GivenMap) else network_m)
    # A coarser map is asked for finely, and its cells joined: the network has to see places in its own resolution. A whole number of
    # fine cells makes a coarse one, else what is seen in one would leak into the next.
    mapper.resolution_m = fine_m = resolution_m / max(1, math.ceil(resolution_m / network_m - 1e-9))
    if isinstance(source, GivenMap):
        warn_of_moved_walls(settings.scans, source, resolution_m, fine_m)

    with writing_beside(output) as folder:
        clock.start("label points")
        try:
            cloud = source.cloud(fine_m) if isinstance(source, GivenMap) else fit_cloud(source, fine_m)
        except InputError as error:
            raise InputError(f"{settings.scans}: {error}") from error
        points = point_counts(cloud, source if isinstance(source, Scans) else None)
        dimension = source.dimension
        if cloud.occupied.all() or not cloud.occupied.any():
            found = "occupied" if cloud.occupied.any() else "free"
            raise InputError(f"{settings.scans}: expected free and occupied space, found {found} space alone")
        del source  # a long drive's returns take much of the memory
        clock.start("complete grids" if settings.fill else "gather evidence")
        mapper.progress = clock.share
        mapper.fit(cloud.points, cloud.occupied, cloud.weight)
        clock.start("ask each cell")
        # Without grids a map says nothing beside what was seen, and asking there would take most of the time.
        reach_m = min(REACH_M, SIDE[dimension] * fine_m) if settings.fill else None
        cells = MapCells.sample(mapper, cloud.points, fine_m, reach_m, clock.share).coarser(resolution_m)
        del cloud
        if not len(cells):
            raise InputError(f"{settings.scans}: expected scans that show something, got none")
        clock.start("write")
        save_map(mapper, folder / MAP)
        del mapper
        write_exports(exports, cells, folder, asked_for=settings.exports is not None)
        write_picture(cells, folder / PICTURE, name)
        clock.stop()
        summary = map_summary(name, points, cells)
        summary |= {"weights": Path(weights).name, **chosen, "seconds": clock.seconds}
        write_page(cells, folder / PAGE, name, summary_tables(summary))
        files = sorted(file.name for file in folder.iterdir())
        write_json(folder / SUMMARY, {**summary, "scans_hash": scans_hash(Path(settings.scans)), "files": files, **made_by()})
        stale = listed_files(output) - {*files, SUMMARY}
        for file in (*files, SUMMARY):
            os.replace(folder / file, output / file)
        for file in stale:  # of a map that was here before: two maps in one folder would pass for one
            (output / file).unlink(missing_ok=True)
    return output


def _read(settings: MapSettings) -> Scans | GivenMap:
    if is_given_map(settings.scans):
        given = [part.name for part in fields(ReadingSettings) if getattr(settings, part.name) != getattr(ReadingSettings(), part.name)]
        if given:
            raise InputError(f"{given[0]}: {settings.scans} is a map, where this has no meaning; leave it unset")
        return read_given_map(settings.scans)
    scans = read_scans_path(settings.scans, settings.reading())
    if not len(scans):
        raise InputError(f"{settings.scans}: expected returns, found none; are all ranges beyond max_range_m, or no returns?")
    if scans.dimension == 3 and np.ptp([*_ends(scans.points[:, 2]), *_ends(scans.origins[:, 2])]) < FLAT_M:
        warnings.warn(f"{settings.scans}: all beams run at one height, so that the map is of two dimensions", stacklevel=3)
        return Scans(scans.points[:, :2], scans.origins[:, :2], scans.scan, scans.beam)
    return scans


def _ends(values: np.ndarray) -> tuple[float, float]:
    return values.min(), values.max()


@dataclass
class Clock:
    """Seconds by stage, in the order in which they began."""

    say: Say
    seconds: dict[str, float] = field(default_factory=dict)
    _running: tuple[str, float] | None = None

    def start(self, stage: str) -> None:
        """End the stage that runs, and begin another."""
        self.stop()
        self.say(stage)
        self._running = (stage, time.perf_counter())

    def share(self, done: int, total: int) -> None:
        """Say how far the stage that runs is."""
        self.say(f"{self._running[0]}, {100 * done // max(total, 1)} %")

    def stop(self) -> None:
        """End the stage that runs."""
        if self._running:
            stage, began = self._running
            self.seconds[stage] = round(time.perf_counter() - began, 3)
        self._running = None
