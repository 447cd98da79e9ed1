"""Nested settings by dotted key, as they are typed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any


def leaves(node: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """(key, value) of everything in nested dictionaries that is none, in their order; of what is no dictionary, itself."""
    if not isinstance(node, dict):
        yield key, node
        return
    for name, inner in node.items():
        yield from leaves(inner, f"{key}.{name}" if key else str(name))
