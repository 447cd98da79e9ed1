"""Scans in; a gap-filled map, and everything to look at it with, out: what `hilbertvae-map` does."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from functools import partial
from pathlib import Path

from hilbertvae.checks import InputError, check_cell_m, check_whole, check_writable, named
from hilbertvae.cloud import Cloud, fit_cloud
from hilbertvae.exports.formats import check_names, suiting_exports, write_exports
from hilbertvae.exports.map_cells import MapCells, reach_of
from hilbertvae.exports.map_folder import (
    PAGE,
    PICTURE,
    SUMMARY,
    check_output,
    replace_map,
    scans_hash,
    writing_beside,
)
from hilbertvae.exports.map_picture import write_picture
from hilbertvae.exports.page import write_page
from hilbertvae.exports.summary import map_summary, point_counts, summary_tables
from hilbertvae.files import write_json
from hilbertvae.map_settings import MapSettings
from hilbertvae.mappers.given_map import MAPS, SAME_CELL, GivenMap, is_given_map, read_given_map, warn_of_moved_walls
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.loading import load_mapper
from hilbertvae.mappers.saved_map import ADAPTED, MAP, save_map
from hilbertvae.mappers.weights import check_calibration
from hilbertvae.reconstruction.precision import check_device
from hilbertvae.reconstruction.shipped import network_for
from hilbertvae.reports.provenance import made_by
from hilbertvae.scans.formats import EXTENSIONS, ReadingSettings, read_scans_path
from hilbertvae.scans.kitti import VELODYNE
from hilbertvae.scans.planar import as_plan
from hilbertvae.scans.scan import Scans

Say = Callable[[str], None]


def make_map(settings: MapSettings, say: Say = lambda stage: None) -> Path:
    """Map the scans and write the results; the folder that has them. `say` is called with the name of each stage as it begins.

    Files are written beside their places and moved there together at the end, so that what fails leaves nothing. Raises `InputError`
    for what can't be read or mapped, and `OSError` where the folder can't be written.
    """
    mapper, output = _checked(settings)
    clock = Clock(say)
    clock.start("read")
    source = _read(settings)
    exports = suiting_exports(settings.exports, source.dimension)
    weights = settings.weights or network_for(source.dimension, isinstance(source, GivenMap))
    beside = (*(source.files if isinstance(source, GivenMap) else ()), Path(weights))  # an earlier map's network may be what is given
    check = partial(check_output, output, Path(settings.scans), exports, by_name=not settings.output, beside=beside)
    check()
    chosen = {name: getattr(settings, name) for name in ("fill", "adapt_steps", "calibration")}
    mapper = (mapper or load_mapper(weights)).set_params(**chosen, device=settings.device)
    if mapper.reconstructor.dimension != source.dimension:
        raise InputError(f"weights: {weights} is a network for {mapper.reconstructor.dimension}D, got {source.dimension}D scans")
    network_m = mapper.reconstructor.resolution_m
    resolution_m = settings.resolution_m or (source.cell_m if isinstance(source, GivenMap) else network_m)
    # A coarser map is asked for finely, and its cells joined: the network has to see places in its own resolution. A whole number of
    # fine cells makes a coarse one, else what is seen in one would leak into the next.
    mapper.resolution_m = fine_m = resolution_m / max(1, math.ceil(resolution_m / network_m - SAME_CELL))
    if isinstance(source, GivenMap):
        warn_of_moved_walls(settings.scans, source, resolution_m, fine_m)

    with writing_beside(output) as folder:
        clock.start("label points")
        cloud = _labelled(settings.scans, source, fine_m)
        points = point_counts(cloud, source if isinstance(source, Scans) else None)
        del source  # a long drive's returns take much of the memory
        clock.start("complete grids" if settings.fill else "gather evidence")
        mapper.progress, mapper.source = clock.share, settings.scans
        mapper.fit(cloud.points, cloud.occupied, cloud.weight)
        clock.start("ask each cell")
        reach_m = reach_of(mapper, fine_m, cloud.points.shape[1])
        cells = MapCells.sample(mapper, cloud.points, fine_m, reach_m, clock.share).coarser(resolution_m)
        del cloud
        if not len(cells):
            raise InputError(f"{settings.scans}: expected scans that show something, got none")
        clock.start("write")
        save_map(mapper, folder / MAP)
        if mapper.adapted_:
            mapper.adapted_.save(folder / ADAPTED)
        del mapper
        about = {"weights": Path(weights).name, **chosen}
        files = _write(settings, exports, cells, points, about, folder, clock)
        check()  # again: another map may have come there meanwhile
        replace_map(folder, output, files)
    return output


def _checked(settings: MapSettings) -> tuple[HilbertMap | None, Path]:
    """The mapper of the network that was given, if one was, since scans may take long to read; and the folder to write to."""
    if not settings.scans:
        raise InputError("scans: expected a file or a folder of scans, got none; give scans=<path>")
    if settings.resolution_m is not None:
        check_cell_m(settings.resolution_m, "resolution_m")
    check_names(settings.exports)
    check_device(settings.device)
    check_calibration(settings.calibration)
    if check_whole(settings.adapt_steps, "adapt_steps") and not settings.fill:
        raise InputError("adapt_steps: expected 0 with fill=off, where no network is asked")
    mapper = load_mapper(settings.weights) if settings.weights else None
    scans = Path(settings.scans)
    output = Path(settings.output or Path("outputs/maps") / os.path.basename(os.path.realpath(scans)))
    if os.path.realpath(output) in (os.path.realpath(scans), os.path.realpath(scans / VELODYNE)):
        if scans.is_file():
            raise InputError(f"output: expected a folder, {output} is the file that is read")
        raise InputError(f"output: {output} is the folder that is read, where a map would lie among the scans; choose another")
    check_writable(output)
    return mapper, output


def _read(settings: MapSettings) -> Scans | GivenMap:
    if is_given_map(settings.scans):
        given = [part.name for part in fields(ReadingSettings) if getattr(settings, part.name) != getattr(ReadingSettings(), part.name)]
        if given:
            raise InputError(f"{given[0]}: {settings.scans} is a map, where this has no meaning; leave it unset")
        return read_given_map(settings.scans)
    path = Path(settings.scans)
    if path.is_dir() and not os.access(path, os.R_OK | os.X_OK):
        raise InputError(f"{path}: can't be read (no permission)")
    if path.suffix.lower() == ".safetensors" or (path / MAP).is_file():
        ways = "give the scans again, or its map_observed.yaml, .ot or .bt; load_map and partial_fit add scans to it"
        raise InputError(f"{path}: expected scans, got what hilbertvae has made; {ways}")
    if path.is_file() and not path.name.lower().endswith(EXTENSIONS):
        known = f"of scans {' '.join(EXTENSIONS)}, of maps {' '.join(MAPS)}"
        raise InputError(f"{path}: unknown extension {path.suffix!r}; known are {known}, and folders of scans")
    scans = read_scans_path(settings.scans, settings.reading())
    if not len(scans):
        raise InputError(f"{settings.scans}: expected returns, found none; are all ranges beyond max_range_m, or no returns?")
    return as_plan(scans, settings.scans)


def _labelled(scans: str, source: Scans | GivenMap, cell_m: float) -> Cloud:
    """The points that a map of such cells is fitted to."""
    with named(scans):
        cloud = source.cloud(cell_m) if isinstance(source, GivenMap) else fit_cloud(source, cell_m)
    if cloud.occupied.all() or not cloud.occupied.any():
        found = "occupied" if cloud.occupied.any() else "free"
        raise InputError(f"{scans}: expected free and occupied space, found {found} space alone")
    return cloud


def _write(settings: MapSettings, exports: list[str], cells: MapCells, points: dict, about: dict, folder: Path, clock: Clock) -> list[str]:
    """Write everything but the map itself, and end the clock; the names of all files but the summary's."""
    name = os.path.basename(os.path.realpath(settings.scans))
    name = name.encode("utf-8", "replace").decode()  # one of another encoding can't be drawn or written
    write_exports(exports, cells, folder, asked_for=settings.exports is not None)
    write_picture(cells, folder / PICTURE, name)
    clock.stop()
    summary = {**map_summary(name, points, cells, folder), **about, "seconds": clock.seconds}
    write_page(cells, folder / PAGE, name, summary_tables(summary))
    files = sorted(file.name for file in folder.iterdir())
    write_json(folder / SUMMARY, {**summary, "scans_hash": scans_hash(Path(settings.scans)), "files": files, **made_by()})
    return files


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
