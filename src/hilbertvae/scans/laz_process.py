"""Unpacks one LAZ file to standard output, as a script: `laz_process.py PATH BYTES`. A damaged file can end only this process.

What comes out are X, Y and Z after one another, N int32 each, in counts of the header's scale.
"""

import sys

BASE_BYTES = 2 * 2**30
"""Address space of the interpreter and its libraries, most of which is never touched."""
COPIES = 6
"""How often the records and what is made of them may be in memory at once."""


def _limit_memory(unpacked_bytes: int) -> None:
    try:
        import resource
    except ImportError:  # not on Windows, where an allocation that can't be met fails by itself
        return
    limit = BASE_BYTES + COPIES * unpacked_bytes
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (limit if hard == resource.RLIM_INFINITY else min(limit, hard), hard))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _main(path: str, unpacked_bytes: int) -> None:
    _limit_memory(unpacked_bytes)
    import laspy
    import numpy as np

    with laspy.open(path, laz_backend=laspy.LazBackend.Lazrs, read_evlrs=False) as file:
        points = file.read_points(file.header.point_count)
    for axis in "XYZ":
        sys.stdout.buffer.write(np.ascontiguousarray(points[axis], np.int32))


if __name__ == "__main__":
    _main(sys.argv[1], int(sys.argv[2]))
