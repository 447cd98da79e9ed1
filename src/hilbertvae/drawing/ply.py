"""Writer of PLY files: points with properties, and faces over them. Coordinates are doubles, which keep those of maps such as UTM."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from hilbertvae.files import atomic

_KINDS = {"f8": ("double", "<f8"), "f4": ("float", "<f4"), "u1": ("uchar", "u1"), "b1": ("uchar", "u1")}
"""PLY's and numpy's names, by the type of a column."""


def write_ply_table(path: str | os.PathLike, vertices: dict[str, np.ndarray], faces: np.ndarray | None = None, comment: str = "") -> Path:
    """A binary PLY at `path`, whole or not there.

    vertices: columns (V,) of float64, float32, uint8 or bool, by property: `x`, `y`, `z` first. faces: (F, 3) whole numbers.
    """
    kinds = {name: _KINDS[column.dtype.str[1:]] for name, column in vertices.items()}
    count = len(next(iter(vertices.values())))
    table = np.empty(count, [(name, kind) for name, (_, kind) in kinds.items()])
    for name, column in vertices.items():
        table[name] = column
    header = ["ply", "format binary_little_endian 1.0", *([f"comment {comment}"] if comment else []), f"element vertex {count}"]
    header += [f"property {kind} {name}" for name, (kind, _) in kinds.items()]
    if faces is not None:
        header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    with atomic(path) as temporary, open(temporary, "wb") as file:
        file.write("\n".join([*header, "end_header\n"]).encode("ascii"))
        file.write(table.data)
        if faces is not None:
            corners = np.empty(len(faces), [("count", "u1"), ("corners", "<i4", 3)])
            corners["count"], corners["corners"] = 3, faces
            file.write(corners.data)
    return Path(path)
