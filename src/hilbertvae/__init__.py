"""Occupancy maps from laser scans, with gaps filled in by a network that learned how places go on.

`METHOD n` in docstrings is section n of docs/method.md; equations and figures are the paper's (Guizilini and Ramos, RSS 2017)."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:  # what is imported late (below), for editors and type checkers, which don't follow it
    from hilbertvae.checks import InputError
    from hilbertvae.cloud import cloud_from_scans
    from hilbertvae.exports.written_map import write_map
    from hilbertvae.mappers.hilbert_map import HilbertMap
    from hilbertvae.mappers.loading import load_mapper
    from hilbertvae.mappers.saved_map import load_map, save_map
    from hilbertvae.scoring.protocol import evaluate
    from hilbertvae.scoring.protocol_settings import Protocol
    from hilbertvae.site import open_site

__version__ = "0.1.0"
__all__ = [
    "HilbertMap", "InputError", "Protocol", "cloud_from_scans", "evaluate", "load_map", "load_mapper", "open_site", "save_map", "write_map",
]  # fmt: skip

_WHERE = {
    "HilbertMap": "hilbertvae.mappers.hilbert_map",
    "InputError": "hilbertvae.checks",
    "Protocol": "hilbertvae.scoring.protocol_settings",
    "cloud_from_scans": "hilbertvae.cloud",
    "evaluate": "hilbertvae.scoring.protocol",
    "load_map": "hilbertvae.mappers.saved_map",
    "load_mapper": "hilbertvae.mappers.loading",
    "open_site": "hilbertvae.site",
    "save_map": "hilbertvae.mappers.saved_map",
    "write_map": "hilbertvae.exports.written_map",
}


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])


if not TYPE_CHECKING:  # to whom every name would be there

    def __getattr__(name: str):
        # Late, so that `import hilbertvae` costs nothing and a command's --help does not wait for torch.
        if name not in _WHERE:
            raise AttributeError(f"module 'hilbertvae' has no attribute {name!r}")
        from importlib import import_module

        return getattr(import_module(_WHERE[name]), name)
