"""What a map came out as, in numbers: for `summary.json` and for the page."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hilbertvae.cloud import Cloud
from hilbertvae.exports.map_cells import MapCells
from hilbertvae.exports.octree import octree_shift
from hilbertvae.mappers.octomap_mapper import OCTREES
from hilbertvae.scans.scan import Scans

KINDS = ("occupied", "free", "unknown")


def point_counts(cloud: Cloud, scans: Scans | None = None) -> dict[str, int]:
    """How many points were mapped, by what they are, and from how many returns and scans, if it was from scans. And how many returns were
    left out as too near or too far, where any were."""
    read = {"returns": len(scans), "scans": len(np.unique(scans.scan))} if scans is not None else {}
    if scans is not None:
        read |= {f"{name}_left_out": count for name, count in zip(("near", "far"), scans.left_out, strict=False) if count}
    return {**read, "occupied": int(cloud.occupied.sum()), "free": int((~cloud.occupied).sum())}


def map_summary(name: str, points: dict[str, int], cells: MapCells, folder: Path) -> dict:
    """Plain values: extent in metres, `points` as they were counted, and cells by what they are before and after.

    unknown counts the cells of the smallest box that holds all known ones; `filled` those that were not observed. folder: has the files;
    by how much OctoMap's are shifted is told, where they are.
    """
    low, shape = cells.box()
    whole = int(np.prod([float(length) for length in shape]))
    filled = cells.select(~cells.observed)
    before, after = _counts(cells.select(cells.observed), whole), _counts(cells, whole)
    written = any((folder / f"map{ending}").exists() for ending in OCTREES)
    shift = octree_shift(cells)[: cells.dimension] * cells.resolution_m if written else np.zeros(cells.dimension)
    return {
        "name": name,
        "dimension": cells.dimension,
        "resolution_m": cells.resolution_m,
        "extent_m": {"low": (low * cells.resolution_m).tolist(), "high": ((low + shape) * cells.resolution_m).tolist()},
        "points": points,
        "cells": {"before": before, "after": after, "filled": _counts(filled, len(filled))},
        **({"octomap_shift_m": shift.tolist()} if shift.any() else {}),
    }


def _counts(cells: MapCells, whole: int) -> dict[str, int]:
    """Cells by what they are called; `whole` is how many there are with those of which nothing is known."""
    occupied, free = int(cells.occupied.sum()), int(cells.free.sum())
    return {"occupied": occupied, "free": free, "unknown": whole - occupied - free}


def summary_tables(summary: dict) -> dict[str, list[list[str]]]:
    """The summary as tables of text, by heading; each one's first row is its head."""
    cell_m = summary["resolution_m"] ** summary["dimension"]
    unit = "m²" if summary["dimension"] == 2 else "m³"
    cells = summary["cells"]
    rows = [["", *cells]]
    rows += [[f"{kind} ({unit})", *(f"{counts[kind] * cell_m:,.0f}" for counts in cells.values())] for kind in KINDS]
    size = [high - low for low, high in zip(*(summary["extent_m"][end] for end in ("low", "high")), strict=True)]
    about = [["", ""], ["extent (m)", " x ".join(f"{length:,.1f}" for length in size)], ["cells (m)", f"{summary['resolution_m']:g}"]]
    about += [[f"{name} points" if name in KINDS else name.replace("_", " "), f"{count:,}"] for name, count in summary["points"].items()]
    seconds = [["", "s"], *([stage, f"{taken:.1f}"] for stage, taken in summary.get("seconds", {}).items())]
    return {"Cells": rows, "Data": about, "Time": seconds}
