"""The files for other tools of a map that was fitted, grown or loaded in Python."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from hilbertvae.checks import InputError, check_cell_m, check_writable
from hilbertvae.exports.formats import check_names, suiting_exports, write_exports
from hilbertvae.exports.map_cells import MapCells, reach_of
from hilbertvae.exports.map_folder import SUMMARY, check_replaced, listed_files, replace_map, writing_beside, written_files
from hilbertvae.exports.summary import map_summary, point_counts
from hilbertvae.files import write_json
from hilbertvae.mappers.hilbert_map import HilbertMap
from hilbertvae.mappers.octomap_mapper import OctoMapMapper
from hilbertvae.mappers.saved_map import MAP
from hilbertvae.mappers.turns import turn_of
from hilbertvae.reports.provenance import made_by


def write_map(
    mapper: HilbertMap, folder: str | os.PathLike, exports: Sequence[str] | None = None, resolution_m: float | None = None
) -> list[Path]:
    """Write a map's cells, observed ones and those that are filled in around them, into `folder`; the paths of the files.

    mapper: fitted. exports: some of `ros`, `ot`, `bt`, `points`, `mesh`, `npz` and `rerun`, all that suit the map unless given; files are
    named as those of `hilbertvae-map`. resolution_m: of the cells, the map's own voxels unless given; coarser ones join these.
    Beside them `summary.json` lists the files, and counts cells. The next call for that folder replaces those that it lists, also where it
    has fewer formats; no other file is replaced, and a full disk leaves the folder as it was.
    Raises `InputError` for another kind of mapper, finer cells, formats that don't suit, a file that another has left under such a name,
    and a folder that `hilbertvae-map` has written, whose files belong together.
    """
    if isinstance(mapper, OctoMapMapper):
        raise InputError("mapper: expected a HilbertMap, got an OctoMap; hilbertvae-map scans=<its .ot or .bt> fill=off writes it")
    if not isinstance(mapper, HilbertMap) or not hasattr(mapper, "evidence_"):
        raise InputError(f"mapper: expected a fitted map, as of load_mapper or load_map, got {mapper!r:.80}")
    if not isinstance(folder, str | os.PathLike) or not str(folder):
        raise InputError(f"folder: expected a path, got {folder!r:.80}")
    output, fine_m = Path(folder), mapper.evidence_.resolution_m
    check_names(exports)
    exports, asked_for = suiting_exports(exports, mapper.evidence_.dimension), exports is not None
    if not exports:
        raise InputError("exports: expected at least one format, got none")
    if resolution_m is not None and check_cell_m(resolution_m, "resolution_m") < fine_m * (1 - 1e-9):
        raise InputError(f"resolution_m: expected at least the map's own {fine_m:g} m, got {resolution_m:g}")
    check_writable(output, "folder")
    if MAP in listed_files(output):
        raise InputError(f"folder: {output} has a map of hilbertvae-map; choose another")
    check_replaced(output, written_files(exports), "folder")
    with turn_of(mapper):  # all of one state of a map that grows
        seen = mapper.evidence_.cloud()
        cells = MapCells.sample(mapper, seen.points, fine_m, reach_of(mapper, fine_m, mapper.evidence_.dimension))
    if resolution_m is not None:
        cells = cells.coarser(resolution_m)
    with writing_beside(output) as beside:
        write_exports(exports, cells, beside, asked_for=asked_for)
        files = sorted(file.name for file in beside.iterdir())
        summary = map_summary(output.resolve().name, point_counts(seen), cells, beside)
        write_json(beside / SUMMARY, {**summary, "files": files, **made_by()})
        check_replaced(output, written_files(exports), "folder")  # again: something may have come there meanwhile
        replace_map(beside, output, files)
    return [output / name for name in files]
