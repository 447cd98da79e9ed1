"""Unpacks one LAZ file to standard output, as a script: `laz_process.py PATH`. A damaged file can end only this process.

What comes out are X, Y and Z after one another, N int32 each, in counts of the header's scale; then N bytes, 1 for a withheld point.
"""

import sys


def _main(path: str) -> None:
    import laspy
    import numpy as np

    with laspy.open(path, laz_backend=laspy.LazBackend.Lazrs, read_evlrs=False) as file:
        points = file.read_points(file.header.point_count)
    for axis in "XYZ":
        sys.stdout.buffer.write(np.ascontiguousarray(points[axis], np.int32))
    sys.stdout.buffer.write(np.ascontiguousarray(points["withheld"], np.uint8))


if __name__ == "__main__":
    _main(sys.argv[1])
