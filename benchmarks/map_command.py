"""`hilbertvae-map` on one path of scans, stage by stage, beside OctoMap's insertion of the same rays and its own writing of the map.

    python benchmarks/map_command.py [--scans simulated] [--quick]

`--scans` is a path, or the name of a real site of the catalogue, whose file is taken. Every file that was written is read back by a reader
that is not ours: the octree by OctoMap, the ROS map by Pillow, the points by trimesh. OctoMap inserts on one core, since its binding is
built without OpenMP; `hilbertvae-map` has all. The peak of memory is that of this process until the map is written.
"""

from __future__ import annotations

import json
import os
import tempfile
import time
from pathlib import Path

import numpy as np
import octomap
import trimesh
from measuring import OCTOMAP_CORES, arguments, report, target
from PIL import Image

from hilbertvae.exports.grid_npz import read_grid
from hilbertvae.exports.map_folder import SUMMARY
from hilbertvae.mapping import MapSettings, make_map
from hilbertvae.reports.provenance import peak_memory_mb
from hilbertvae.scans.formats import read_scans_path
from hilbertvae.scans.scan import Scans
from hilbertvae.scans.sites import CATALOGUE, site_path
from hilbertvae.simulate.building import BuildingSettings, simulate_building


def settings_of(scans: str, quick: bool, folder: Path) -> MapSettings:
    """How the path is read: a site of the catalogue as that says, a simulated building from a file that is written first."""
    if scans == "simulated":
        made = simulate_building(BuildingSettings(scans=8 if quick else 200), 1)
        np.savez(folder / "simulated.npz", points=made.points, origins=made.origins, scan=made.scan)
        return MapSettings(scans=str(folder / "simulated.npz"))
    if scans not in CATALOGUE:
        return MapSettings(scans=scans)
    entry = CATALOGUE[scans]
    settings = MapSettings(scans=str(site_path(scans)), max_range_m=entry.max_range_m, every=entry.every)
    if entry.dimension == 3:
        settings.beam_origin = entry.beam_origin
    return settings


def octomap_seconds(scans: Scans, resolution_m: float, folder: Path) -> dict[str, float]:
    """OctoMap's insertion of every scan's rays, and its own writing."""
    tree = octomap.OcTree(resolution_m)
    low = np.zeros(3)
    start = time.perf_counter()
    for part in np.split(np.arange(len(scans)), np.flatnonzero(np.diff(scans.scan)) + 1):
        points, origin = np.tile(low, (len(part), 1)), low.copy()
        points[:, : scans.dimension], origin[: scans.dimension] = scans.points[part], scans.origins[part[0]]
        tree.insertPointCloud(points, origin)
    inserted = time.perf_counter()
    tree.write(os.fsencode(folder / "octomap.ot"))
    return {"insert": inserted - start, "write": time.perf_counter() - inserted}


def read_back(folder: Path) -> dict[str, int]:
    """Occupied cells by reader; all of them have to count the same."""
    cells = read_grid(folder / "map.npz")
    found = {"NPZ": int(cells.occupied.sum()), "trimesh": len(trimesh.load(folder / "points.ply").vertices)}
    tree = octomap.OcTree(cells.resolution_m)
    assert tree.readBinary(os.fsencode(folder / "map.bt"))
    places = np.full((len(cells), 3), cells.resolution_m / 2)
    places[:, : cells.dimension] = cells.centres
    found["OctoMap"] = int(np.count_nonzero(np.array(tree.getLabels(places)) == 1))
    if cells.dimension == 2:
        found["Pillow"] = int(np.count_nonzero(np.asarray(Image.open(folder / "map.pgm")) == 0))
    return found


def main(words: list[str] | None = None) -> None:
    parser = arguments(__doc__)
    parser.add_argument("--scans", default="simulated")
    parser.add_argument("--kept", type=Path, help="leave what was written here")
    given = parser.parse_args(words)
    with tempfile.TemporaryDirectory() as place:
        settings = settings_of(given.scans, given.quick, Path(place))
        settings.output = str(given.kept or Path(place) / "out")
        folder = make_map(settings)
        peak_mb = peak_memory_mb()
        summary = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
        rows = [{"what": f"hilbertvae-map: {stage}", "seconds": seconds} for stage, seconds in summary["seconds"].items()]
        peer = octomap_seconds(read_scans_path(settings.scans, settings.reading()), summary["resolution_m"], Path(place))
        rows += [{"what": f"OctoMap: {stage}", "seconds": seconds} for stage, seconds in peer.items()]
        counted = read_back(folder)
        sizes = {path.name: path.stat().st_size for path in sorted(folder.iterdir())}
    differ = max(counted.values()) - min(counted.values())
    targets = [target("occupied cells that independent readers count differently", "0", differ, not differ)]
    about = {key: summary[key] for key in ("name", "dimension", "resolution_m", "extent_m", "points", "cells", "weights")}
    about |= {"occupied": counted, "bytes": sizes, "peak_memory_mb": peak_mb, "OctoMap's cores": OCTOMAP_CORES}
    report(f"map_command_{Path(given.scans).name}", given, rows, targets, about, script="map_command")


if __name__ == "__main__":
    main()
