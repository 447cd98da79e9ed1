"""Runs a script under a limit on memory, as a script: `limited_process.py BYTES SCRIPT ARGUMENTS...`.

It stands alone: the process that it is imports nothing of this package.
"""

import runpy
import sys

BASE_BYTES = 2 * 2**30
"""Address space of the interpreter and its libraries, most of which is never touched."""


def _limit_memory(beyond_base: int) -> None:
    try:
        import resource
    except ImportError:  # not on Windows, where an allocation that can't be met fails by itself
        return
    limit = BASE_BYTES + beyond_base
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (limit if hard == resource.RLIM_INFINITY else min(limit, hard), hard))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


if __name__ == "__main__":
    _limit_memory(int(sys.argv[1]))
    sys.argv = sys.argv[2:]
    runpy.run_path(sys.argv[0], run_name="__main__")
