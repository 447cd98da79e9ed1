"""The hash of sources of this package, so that nothing that is kept from run to run outlives the code that made it."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import hilbertvae
from hilbertvae.files import hash_of

PACKAGE = Path(hilbertvae.__file__).parent


@cache
def code_hash(parts: tuple[str, ...]) -> str:
    """Of `parts`, the names of files and folders of the package."""
    files = sorted(file for part in parts for file in ([PACKAGE / part] if part.endswith(".py") else (PACKAGE / part).rglob("*.py")))
    return hash_of([file.read_text(encoding="utf-8") for file in files])
