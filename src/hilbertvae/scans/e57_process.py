"""Unpacks the scans of one E57 file to standard output, as a script: `e57_process.py PATH`. A damaged file can end only this process.

Of each scan come out the number of points (int64), whether its coordinates were spherical (int64), its pose as x y z qx qy qz qw
(7 float64; none is the identity), and the points (N, 3) float64 in the scan's own frame, NaN where the file says there is no return.
"""

import os
import struct
import sys

BLOCK = 2**18
"""Points in memory at a time."""
SMALL_BYTES = 64 * 2**20
MAX_EXPANSION = 32
"""Beyond `SMALL_BYTES`, points that claim to grow more than this are forged: coordinates of 12 bits grow 5 times."""
CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")


def _pose(scan) -> list[float]:
    pose = {"translation": dict.fromkeys("xyz", 0.0), "rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}
    for part, values in pose.items():
        if scan.isDefined(f"pose/{part}"):
            for name in values:  # by name: files may have them in any order
                values[name] = float(scan["pose"][part][name].value())
    return [*pose["translation"].values(), *pose["rotation"].values()]


def _points(np, libe57, image, points, names: tuple[str, ...], flag: str | None):
    """Blocks (n, 3) of the coordinates `names`, NaN where `flag` is not 0."""
    columns = {name: np.empty(BLOCK) for name in (*names, *([flag] if flag else []))}
    buffers = libe57.VectorSourceDestBuffer()
    for name, column in columns.items():
        buffers.append(libe57.SourceDestBuffer(image, name, column, BLOCK, True, True))
    reader = points.reader(buffers)
    while count := reader.read():
        block = np.column_stack([columns[name][:count] for name in names])
        if flag:
            block[columns[flag][:count] != 0] = np.nan
        yield block


def _cartesian(np, block):
    """E57 has the azimuth from x to y, and the elevation from the x-y plane up."""
    length, azimuth, elevation = block.T
    level = length * np.cos(elevation)
    return np.column_stack([level * np.cos(azimuth), level * np.sin(azimuth), length * np.sin(elevation)])


def _main(path: str) -> None:
    import numpy as np
    from pye57 import libe57

    image = libe57.ImageFile(path, "r")
    scans = image.root()["data3D"] if image.root().isDefined("data3D") else []
    total, size = sum(scans[number]["points"].childCount() for number in range(len(scans))), os.path.getsize(path)
    if 24 * total > max(SMALL_BYTES, MAX_EXPANSION * size):
        raise ValueError(f"truncated or forged: {total} points claimed in {size} bytes")
    out = sys.stdout.buffer
    for number in range(len(scans)):
        scan = scans[number]
        points = scan["points"]
        fields = libe57.StructureNode(points.prototype())
        names = next((names for names in (CARTESIAN, SPHERICAL) if all(map(fields.isDefined, names))), None)
        if names is None:
            raise ValueError(f"scan {number} has neither {', '.join(CARTESIAN)} nor {', '.join(SPHERICAL)}")
        flag = f"{'spherical' if names is SPHERICAL else 'cartesian'}InvalidState"
        count = points.childCount()
        out.write(struct.pack("<qq7d", count, names is SPHERICAL, *_pose(scan)))
        written = 0
        for block in _points(np, libe57, image, points, names, flag if fields.isDefined(flag) else None) if count else ():
            out.write(np.ascontiguousarray(_cartesian(np, block) if names is SPHERICAL else block, "<f8"))
            written += len(block)
        if written != count:
            raise ValueError(f"truncated or forged: scan {number} claims {count} points, {written} are there")


if __name__ == "__main__":
    try:
        _main(sys.argv[1])
    except Exception as error:
        # The first line says it; what follows is for the library's authors.
        sys.exit(f"{type(error).__name__}: {error}".split("\n")[0])
