"""`result.json`: a `Result` with what made it, written whole or not at all, and read back with its contract checked (METHOD 7)."""

from __future__ import annotations

import json
import os
from pathlib import Path

from hilbertvae.checks import InputError
from hilbertvae.files import write_json
from hilbertvae.scoring.result import SCHEMA_VERSION, Result

KEYS = {
    "status": str, "site": str, "dimension": int, "gap_diameter_m": (int, float), "gap_seeds": list, "ceiling": dict, "scores": dict,
    "seconds": dict, "maps": dict, "failed": dict, "protocol": dict, "gaps": list, "curves": dict,
}  # fmt: skip
"""What every file has at top level, and of which type; whatever else stands there is about the run."""
STATUSES = ("ok", "failed")
FARTHEST = 1e300
"""From 0: no score, time or size is as large, and whole numbers that are larger are no floats."""


def write_result(path: str | os.PathLike, result: Result, about: dict | None = None) -> Path:
    """Write `result` to `path` atomically; `about` is what `provenance` gives. Raises `ValueError` for a number that is not finite."""
    about = about or {}
    taken = sorted(set(about) & {*KEYS, "schema_version"})
    if taken:
        raise ValueError(f"about: {', '.join(taken)} belong to the result itself")
    write_json(path, result.plain(**about))
    return Path(path)


def read_result(path: str | os.PathLike) -> tuple[Result, dict]:
    """The `Result` in a file and what the file says about the run; an `InputError` that names the file and the key otherwise."""
    path = Path(path)
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such result file") from None
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise InputError(f"{path}: not a result file, or damaged ({error})") from error
    if not isinstance(content, dict) or "schema_version" not in content:
        raise InputError(f"{path}: not a result file of hilbertvae: schema_version is missing")
    version = content.pop("schema_version")
    if version != SCHEMA_VERSION:
        raise InputError(f"{path}: schema_version {version!r}, expected {SCHEMA_VERSION}; it was written by another version of hilbertvae")
    for key, kind in KEYS.items():
        if key not in content:
            raise InputError(f"{path}: {key} is missing")
        if not isinstance(content[key], kind) or isinstance(content[key], bool):
            raise InputError(f"{path}: {key}: expected {_words(kind)}, got {content[key]!r:.60}")
    if content["status"] not in STATUSES:
        raise InputError(f"{path}: status: expected ok or failed, got {content['status']!r}")
    _check_contents(path, content)
    values = {key: content.pop(key) for key in KEYS}
    del values["status"]  # follows from `failed`
    return Result(**values), content


def _words(kind) -> str:
    return {str: "text", int: "a whole number", (int, float): "a number", list: "a list", dict: "an object"}[kind]


def _check_contents(path: Path, content: dict) -> None:
    """Each of scores[mapper][reading][region][metric] must be a list with one finite number per gap seed, and so on."""
    seeds = content["gap_seeds"]
    if content["scores"] and not all(isinstance(seed, int) and not isinstance(seed, bool) for seed in seeds):
        raise InputError(f"{path}: gap_seeds: expected whole numbers, got {seeds!r:.60}")
    for where, values in _leaves(path, content["scores"], "scores", depth=4):
        if not _are_numbers(values) or len(values) != len(seeds):
            raise InputError(f"{path}: {where}: expected {len(seeds)} numbers, one per gap seed, got {values!r:.60}")
    for name in ("seconds", "maps"):
        for where, values in _leaves(path, content[name], name, depth=2):
            if not _are_numbers(values):
                raise InputError(f"{path}: {where}: expected a list of numbers, got {values!r:.60}")
    for reading, best in content["ceiling"].items():
        if not isinstance(best, dict) or not all(_is_number(best.get(key)) for key in ("precision", "recall")):
            raise InputError(f"{path}: ceiling.{reading}: expected precision and recall, got {best!r:.60}")
    for name, why in content["failed"].items():
        if not isinstance(why, str):
            raise InputError(f"{path}: failed.{name}: expected text, got {why!r:.60}")


def _leaves(path: Path, node, where: str, depth: int):
    if depth == 0:
        yield where, node
        return
    if not isinstance(node, dict):
        raise InputError(f"{path}: {where}: expected an object, got {node!r:.60}")
    for key, below in node.items():
        yield from _leaves(path, below, f"{where}.{key}", depth - 1)


def _are_numbers(values) -> bool:
    return isinstance(values, list) and all(_is_number(value) for value in values)


def _is_number(value) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and -FARTHEST < value < FARTHEST
