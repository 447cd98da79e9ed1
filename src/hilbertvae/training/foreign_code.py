"""The source of classes that are not of this package, on which what is kept from run to run depends as well."""

from __future__ import annotations

import inspect
import sys
import sysconfig
from functools import cache
from pathlib import Path
from types import ModuleType


def foreign_source(kind: type) -> str | None:
    """The source of the module that `kind` comes from, empty for this package's own; None for a class that no file holds, as one that was
    typed into a notebook, or sent to another process from where it ran as a script."""
    if kind.__module__.partition(".")[0] == "hilbertvae":
        return ""
    module = sys.modules.get(kind.__module__)
    found = module
    for name in kind.__qualname__.split("."):
        found = getattr(found, name, None)
    if found is not kind:  # another one of that name, or none
        return None
    return _source_of(kind, module)


def is_library(kind: type) -> bool:
    """Whether a class is Python's, or of an installed package, which has a version."""
    file = getattr(sys.modules.get(kind.__module__), "__file__", None)
    installed = {Path(sysconfig.get_path(name)).resolve() for name in ("purelib", "platlib")}
    return kind.__module__.partition(".")[0] in sys.stdlib_module_names - {"__main__"} or bool(
        file and installed & {*Path(file).resolve().parents}
    )


@cache
def _source_of(kind: type, module: ModuleType) -> str | None:
    """As it was when a class was first asked for: it may be edited while what was loaded goes on. One that is loaded anew is another."""
    try:
        return inspect.getsource(module)
    except (OSError, TypeError):
        return None
