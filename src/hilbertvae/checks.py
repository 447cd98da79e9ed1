"""Checks of what comes in from outside, each with one clear message."""

from __future__ import annotations

import errno
import importlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

import numpy as np


class InputError(ValueError):
    """Bad input: the message names the file, key or argument and what was expected instead."""


@contextmanager
def named(where: str | Path) -> Iterator[None]:
    """Puts `where` ahead of an `InputError` of the block that does not know it."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def check_points(points, name: str = "points", dimension: int | None = None, allow_empty: bool = False, hint: str = "") -> np.ndarray:
    """`points` as a finite (N, D) float64 array, D 2 or 3 (or `dimension`); an `InputError` otherwise. hint: what to do about a NaN."""
    refuse_more_than_numbers(points, name)
    try:
        points = np.asarray(points, dtype=np.float64)
    except (TypeError, ValueError, RuntimeError) as error:  # the last is torch's, of what has a gradient
        said = f" ({error})" if isinstance(error, RuntimeError) else ""
        raise InputError(f"{name}: expected an (N, D) array of numbers, got {type(points).__name__}{said}") from error
    wanted = f"(N, {dimension})" if dimension else "(N, 2) or (N, 3)"
    if points.ndim != 2 or points.shape[1] not in ((dimension,) if dimension else (2, 3)):
        raise InputError(f"{name}: expected shape {wanted}, got {points.shape}")
    if not allow_empty and len(points) == 0:
        raise InputError(f"{name}: expected at least one point, got none")
    finite = np.isfinite(points).all(axis=1)
    if not finite.all():
        found = f"{np.count_nonzero(~finite)} of {len(points)} points with NaN or inf"
        raise InputError(f"{name}: expected finite coordinates, got {found}{hint}")
    return points


def refuse_more_than_numbers(points, name: str) -> None:
    """An `InputError` for an array some of whose values are masked, since what is behind a mask would count as if it were not; and for one
    with named fields, as readers of ROS clouds and PCD files give them, which numpy makes no numbers of."""
    if names := getattr(getattr(points, "dtype", None), "names", None):
        raise InputError(f"{name}: expected plain numbers, got an array with the fields {', '.join(names)}; stack them as columns")
    if np.ma.is_masked(points):
        raise InputError(f"{name}: expected no masked values, got {np.count_nonzero(np.ma.getmaskarray(points))}; leave them out")


def labels_alike(labels):
    """Labels that came as objects, as a data frame's column may, as an array of what they are; an `InputError` where kinds are mixed."""
    if getattr(labels, "ndim", 1) != 1 or (found := np.asarray(labels)).dtype != object or found.ndim != 1:
        return labels
    plain = [label.item() if isinstance(label, np.generic) else label for label in found.tolist()]
    if len(kinds := sorted({type(label).__name__ for label in plain})) > 1:
        raise InputError(f"y: expected labels of one kind, got {' and '.join(kinds)}")
    return np.array(plain)


def check_positive(value: float, name: str) -> float:
    """`value` as a positive finite float; an `InputError` otherwise."""
    if not _is_number(value) or value <= 0:
        raise InputError(f"{name}: expected a positive number, got {value!r}")
    return float(value)


def check_cell_m(value: float, name: str) -> float:
    """`value` as the side of a map's cell, metres; an `InputError` for one that no map can have, which would overflow whole numbers."""
    if not 1e-4 <= check_positive(value, name) <= 1e4:
        raise InputError(f"{name}: expected from 0.0001 to 10000 metres, got {value!r}")
    return float(value)


def check_not_negative(value: float, name: str) -> float:
    """`value` as a finite float from 0 on; an `InputError` otherwise."""
    if not _is_number(value) or value < 0:
        raise InputError(f"{name}: expected a number from 0 on, got {value!r}")
    return float(value)


def check_share(value: float, name: str) -> float:
    """`value` as a float from 0 to 1; an `InputError` otherwise."""
    if not _is_number(value) or not 0 <= value <= 1:
        raise InputError(f"{name}: expected a share in [0, 1], got {value!r}")
    return float(value)


def check_finite(node: object, path: str = "") -> None:
    """An `InputError` that names the key for a NaN or an infinity in nested dicts and lists, which JSON lacks: a run
    with one could not be written down."""
    if isinstance(node, dict):
        for key, value in node.items():
            check_finite(value, f"{path}.{key}" if path else str(key))
    elif isinstance(node, (list, tuple)):
        for place, value in enumerate(node):
            check_finite(value, f"{path}[{place}]")
    elif isinstance(node, float) and not np.isfinite(node):
        raise InputError(f"{path}: expected a finite number, got {node}")


def check_seeds(seeds: list[int], name: str) -> None:
    """An `InputError` unless `seeds` are one or more different whole numbers from 0 on."""
    if not isinstance(seeds, (list, tuple)):
        raise InputError(f"{name}: expected a list of seeds, got {seeds!r:.60}")
    if not all(map(_is_whole, seeds)) or not seeds or len(set(seeds)) != len(seeds) or min(seeds) < 0:
        raise InputError(f"{name}: expected one or more different seeds from 0 on, got {seeds}")


def check_whole(value: int, name: str) -> int:
    """`value` as a whole number from 0 on; an `InputError` otherwise."""
    return check_count(value, name, least=0)


def check_count(value: int, name: str, most: int | None = None, least: int = 1) -> int:
    """`value` as a whole number from `least` on, at most `most` where that is given; an `InputError` otherwise."""
    if not _is_whole(value) or value < least or (most is not None and value > most):
        wanted = f"of at least {least}" if most is None else f"from {least} to {most}"
        raise InputError(f"{name}: expected a whole number {wanted}, got {value!r}")
    return int(value)


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float, np.number)) and not isinstance(value, bool) and -np.inf < value < np.inf


def _is_whole(value: object) -> bool:
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool)


def how_to_install(extra: str) -> str:
    """What to type where an extra of the package is not installed."""
    return f"pip install 'hilbertvae[{extra}]', in a checkout '.[{extra}]'"


def extra_module(extra: str, module: str, needs: str = "this needs") -> ModuleType:
    """A module of an extra of the package; an `InputError` that says what `needs` the extra, where it is not installed."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        missing = f"{error.name or module} is not installed: {how_to_install(extra)}"
        raise InputError(f"{needs} the extra '{extra}', and {missing}") from error


def check_readable(path: Path) -> None:
    """An `InputError` for a file that may not be read, of which safetensors says that it is not there."""
    try:
        path.open("rb").close()
    except OSError as error:
        raise InputError(f"{path}: can't be read ({error.strerror})") from error


def check_writable(output: Path, key: str = "output") -> None:
    """An `InputError`, which names `key`, where no folder can be made or written, before any work is done for it."""
    if output.is_symlink() and not output.exists():
        raise InputError(f"{key}: expected a folder, {output} is a link to nothing")
    try:
        os.lstat(output)
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.ENAMETOOLONG):
            raise InputError(f"{key}: expected a folder, got {output!s:.200} ({error.strerror})") from error
    there = next(folder for folder in (output, *Path(os.path.realpath(output)).parents) if folder.exists())
    if not there.is_dir():
        raise InputError(f"{key}: expected a folder, {there} is a file")
    if not os.access(there, os.W_OK | os.X_OK):
        raise InputError(f"{key}: {there} can't be written")
