"""Nested settings by dotted key, as they are typed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any


def leaves(node: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """(key, value) of each value in nested dictionaries that is no dictionary itself, in their order; `node` alone if it is none."""
    if not isinstance(node, dict):
        yield key, node
        return
    for name, inner in node.items():
        yield from leaves(inner, f"{key}.{name}" if key else str(name))
