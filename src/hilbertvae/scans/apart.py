"""Reading a file in a process of its own, with limits on memory and time: for libraries that a damaged file can bring down."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from hilbertvae.checks import InputError

FOLDER = Path(__file__).parent
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "RUST_BACKTRACE": "0"}
"""BLAS would set aside memory for each of its threads."""


def read_apart(path: Path, kind: str, script: str, memory_bytes: int, timeout_s: float) -> bytes:
    """What `script`, a file beside this one, writes to standard output for `path`.

    kind: what the file is, for messages. memory_bytes: address space beyond what the interpreter takes. Raises `InputError` where the
    process ends with an error, is ended by the system, or does not end in time.
    """
    command = [sys.executable, "-P", str(FOLDER / "limited_process.py"), str(memory_bytes), str(FOLDER / script), str(path)]
    try:
        done = subprocess.run(command, capture_output=True, stdin=subprocess.DEVNULL, timeout=timeout_s, env={**os.environ, **ONE_THREAD})
    except subprocess.TimeoutExpired as error:
        raise InputError(f"{path}: damaged {kind}; unpacking it did not end within {error.timeout:.0f} s") from error
    if done.returncode:
        last = done.stderr.decode("latin1").strip().splitlines()[-1:]
        raise InputError(f"{path}: damaged {kind}, can't be unpacked ({' '.join(last)[:200] or f'exit status {done.returncode}'})")
    return done.stdout
