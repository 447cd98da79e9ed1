"""`hilbertvae-query`: what a map says at given points."""

from __future__ import annotations

import sys
import warnings
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from hilbertvae.checks import InputError, check_writable
from hilbertvae.commands.keywords import from_home, run_command
from hilbertvae.files import atomic
from hilbertvae.scans.planar import FLAT_M
from hilbertvae.scans.point_files import read_points
from hilbertvae.scans.rounded import warn_if_rounded

if TYPE_CHECKING:
    from hilbertvae.mappers.hilbert_map import HilbertMap
    from hilbertvae.mappers.octomap_mapper import OctoMapMapper

ABOUT = "Ask a map that hilbertvae-map wrote for p(occupied) at any points; one line of text per point."


@dataclass
class QuerySettings:
    """One run of `hilbertvae-query`."""

    map: str = ""
    """A `map.safetensors`, or the folder that has it; or an OctoMap `.ot` or `.bt`."""
    points: str = ""
    """A file of points in metres in the map's frame: text, .npz, or a cloud in a format that scans may have; `-` is text from the standard
    input."""
    output: str | None = None
    """A .csv, or a .npz; unless given, text goes to the standard output. It has the coordinates and the answers, and no other columns
    of the points, so neither they nor a file of a map are replaced."""


def run(settings: QuerySettings) -> None:
    """Ask the map, and write the answers."""
    from hilbertvae.mappers.saved_map import load_map, map_path  # late: whoever asks for help does not wait for torch

    settings = from_home(settings, "map", "points", "output")
    for key in ("map", "points"):
        if not getattr(settings, key):
            raise InputError(f"{key}: expected a path, got none; give {key}=<path>")
    if settings.output and Path(settings.output).suffix not in (".csv", ".npz"):
        raise InputError(f"output: expected a name that ends in .csv or .npz, got {settings.output}")
    if not settings.output and sys.stdout is None:
        raise InputError("output: expected a name, since the standard output is closed; give output=<path>")
    map_file = map_path(settings.map)
    if settings.output:
        check_writable(Path(settings.output).parent)
        _check_replaced(Path(settings.output), Path(settings.points), map_file)
    mapper = load_map(map_file)
    points = _standard_input() if settings.points == "-" else read_points(settings.points).points
    placed = np.isfinite(points).all(axis=1)  # an organised cloud has rows without
    warn_if_rounded(points[placed], settings.points, came_as=np.float64)  # a few may have been typed, with the digits that were meant
    if points.shape[1] == 3 and mapper.n_features_in_ == 2 and np.ptp(points[placed, 2]) < FLAT_M:
        if (height_m := points[placed][0, 2]) != 0:  # of 0 as a PLY of a plan has it, `points.ply` among them
            warnings.warn(f"{settings.points}: the map is a plan, so the third coordinate, {height_m:g} m, is left out", stacklevel=2)
        points = points[:, :2]
    if points.shape[1] != mapper.n_features_in_:
        raise InputError(f"{settings.points}: expected {mapper.n_features_in_} coordinates, as the map has, got {points.shape[1]}")
    if not placed.all():
        nowhere = f"{np.count_nonzero(~placed)} of {len(points)} points have NaN or inf for a place"
        warnings.warn(f"{settings.points}: {nowhere}; their answers are nan", stacklevel=2)
    _warn_if_off(settings.points, points[placed], mapper)
    # Each answer stands in the row of its point, as in the cloud that was asked.
    answers = {"probability": np.full(len(points), np.nan), "std": np.full(len(points), np.nan), "observed": np.zeros(len(points), bool)}
    for answer, said in zip(answers.values(), mapper.describe(points[placed]), strict=True):
        answer[placed] = said
    if settings.output and Path(settings.output).suffix == ".npz":
        with atomic(settings.output) as temporary:
            np.savez_compressed(temporary, points=points, **answers)
        return
    table = np.column_stack([points, *(answer.astype(float) for answer in answers.values())])
    shape = ["%s"] * points.shape[1] + ["%.4f", "%.4f", "%d"]  # of a coordinate as many digits as it takes to be the same number
    names = ["x", "y", "z"][: points.shape[1]] + list(answers)
    if settings.output:
        with atomic(settings.output) as temporary:
            np.savetxt(temporary, table, shape, ",", header=",".join(names), comments="")
    else:
        np.savetxt(sys.stdout, table, shape, ",", header=",".join(names), comments="")


def _standard_input() -> np.ndarray:
    """Points as text, (N, D); readers want a file, in which they can go back."""
    if sys.stdin is None:
        raise InputError("points: expected text on the standard input, which is closed")
    with TemporaryDirectory() as folder:
        copy = Path(folder) / "points.txt"
        copy.write_bytes(sys.stdin.buffer.read())
        try:
            return read_points(copy).points
        except InputError as error:
            raise InputError(str(error).replace(str(copy), "standard input")) from error


def _warn_if_off(name: str, points: np.ndarray, mapper: HilbertMap | OctoMapMapper) -> None:
    """A `UserWarning` where all points lie so far from a map that it says nothing of any, as those in another frame or unit do."""
    from hilbertvae.drawing.field import REACH_M

    if hasattr(mapper, "evidence_"):
        low, high = mapper.evidence_.bounds()
        lowest, highest = mapper.frames_.boxes()  # what they hold is answered, too
        lowest, highest = np.vstack([low, lowest]).min(axis=0), np.vstack([high, highest]).max(axis=0)
    else:
        tree, shift = mapper.tree(), mapper.shift_ * mapper.resolution_
        lowest, highest = low, high = [np.asarray(end)[: len(shift)] + shift for end in (tree.getMetricMin(), tree.getMetricMax())]
    if ((points < lowest - REACH_M) | (points > highest + REACH_M)).any(axis=1).all():  # beside a map is no other frame
        said = [
            ", ".join(f"{axis} {near:.6g} to {far:.6g} m" for axis, near, far in zip("xyz", *box, strict=False))
            for box in ((points.min(axis=0), points.max(axis=0)), (low, high))
        ]
        warnings.warn(f"{name}: all points lie off the map ({said[0]}; the map {said[1]}); are they in its frame?", stacklevel=2)


def _check_replaced(output: Path, points: Path, map_file: Path) -> None:
    """An `InputError` where answers would replace what is asked, or a file of a map."""
    from hilbertvae.exports.map_folder import is_of_a_map

    if not output.exists():
        return
    for key, path in (("points", points), ("map", map_file)):
        if path.exists() and output.samefile(path):
            raise InputError(f"output: {output} is what {key}= is read from, and would be replaced; choose another name")
    if is_of_a_map(output.resolve()):
        raise InputError(f"output: {output} is a file of the map in that folder, and would be replaced; choose another name")


def main(words: list[str] | None = None) -> int:
    """Entry point; the exit code, 2 for what can't be read or written."""
    return run_command("hilbertvae-query", QuerySettings, ABOUT, run, words)


if __name__ == "__main__":
    sys.exit(main())
