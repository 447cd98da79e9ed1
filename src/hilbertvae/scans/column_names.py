"""Which columns of a table of points are x, y and z, by the names that its first line or a comment above its numbers gives them."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path

from hilbertvae.checks import InputError

METRES = re.compile(r"_m$|\s*(\(m\)|\[m\])$")
"""How the name of a column says that it is in metres."""
OTHERS = ("mm", "cm", "dm", "km", "ft", "feet", "foot", "in", "inch", "inches", "deg", "degrees")
OTHER_UNIT = re.compile(rf"[xyz](?:\s*[\[(]|_)(?:{'|'.join(OTHERS)})[\])]?")
"""A coordinate that is in another unit than metres."""
BRACKETS = re.compile(r"\s*(?:\(([^()]*)\)|\[([^][]*)\])")
"""What may stand behind a name, and is no column's."""
UPWARDS, MAYBE_UPWARDS = re.compile(r"z[^a-z0-9]"), re.compile(r"height|elev|alt")
"""How a column's name begins that must be, or may be, z in other words, where none is called so."""
COMPONENT = re.compile(r"points(?:_m_xyz)?[:_]([012])")
"""What ParaView and VeloView call coordinates."""


def split_fields(line: bytes, delimiter: str | None) -> list[str]:
    """The fields of a line, without the blanks and quotes around them; none behind a delimiter at its end."""
    text = line.decode("latin1")
    return [field.strip(' \t"') for field in (text if delimiter is None else text.removesuffix(delimiter)).split(delimiter)]


def named_columns(path: Path, fields: list[str]) -> list[int]:
    """The columns of x, y (and z) by the names in a table's first line; an `InputError` where these have no x and y in metres, and where
    they have z in another unit."""
    names = _plain_names(fields)
    if not {"x", "y"} <= set(names):
        raise InputError(f"{path}: expected numbers, or a first line that names columns x, y (and z), got {' '.join(fields)[:60]!r}")
    return _coordinates(path, names)


def commented_columns(path: Path, comments: Sequence[bytes], delimiter: str | None, count: int) -> list[int] | None:
    """The columns of x, y (and z) by the last of `comments` that names all `count` columns; None without one: most comments are just that.

    An `InputError` where it says that they are in another unit than metres. One `UserWarning` where comments have the words x and y, and
    none names the columns.
    """
    doubtful = ""
    for comment in reversed(comments):
        text = re.sub(rb"^(#|//)+\s*", b"", comment)
        for fields in _readings(text, delimiter):
            names = _plain_names(fields)
            if len(names) == count and {"x", "y"} <= set(names):
                return _coordinates(path, names)
            if len(names) == count and (other := next(filter(None, map(OTHER_UNIT.fullmatch, names)), None)):
                raise InputError(f"{path}: expected x, y (and z) in metres, got {other[0]!r} in the comment {_shown(text)!r}")
        words = set(re.findall(r"\w+", text.decode("latin1").lower()))
        doubtful = doubtful or (_shown(text) if {"x", "y"} <= words else "")
    if doubtful:
        # The folder is named, so that a thousand scans of one make one warning.
        warnings.warn(
            f"{path.parent}: the comment {doubtful!r} above the numbers of {path.suffix} files has x and y, but not a name for each of "
            f"their {count} columns; the first ones are taken as coordinates",
            stacklevel=5,
        )
    return None


def _readings(text: bytes, delimiter: str | None) -> Iterable[list[str]]:
    """The fields of a comment as it may be meant: numpy.savetxt writes its header as it is given, which may be apart by spaces above
    numbers apart by commas, and units may stand apart from their names."""
    yield split_fields(text, delimiter)
    yield split_fields(text, "\t")
    words = text.decode("latin1").strip(" \t,;")
    yield re.split(r"[\s,;]+", words)
    yield re.split(r"[\s,;]+", BRACKETS.sub(_unit, words))


def _unit(found: re.Match) -> str:
    """A unit that a coordinate may not have, as part of its name; nothing for metres, those of other columns, and remarks."""
    unit = (found[1] or found[2] or "").strip().lower()
    return f"[{unit}]" if unit in OTHERS else ""


def _shown(text: bytes) -> str:
    return " ".join(text.decode("latin1").split())[:60]


def _plain_names(fields: Iterable[str]) -> list[str]:
    """Names of columns in small letters: x, y or z for those that say metres, too, and for a `COMPONENT`, unless another is just that."""
    names, plain = [field.lower() for field in fields], []
    for name in names:
        bare = METRES.sub("", name)
        component = COMPONENT.fullmatch(bare)
        bare = "xyz"[int(component[1])] if component else bare
        plain.append(name if bare in names else bare)
    return plain


def _coordinates(path: Path, names: list[str]) -> list[int]:
    if "z" not in names:
        if meant := next(filter(UPWARDS.match, names), None):
            raise InputError(f"{path}: expected a column z, z_m or z [m] beside x and y, in metres, or none like it, got {meant[:60]!r}")
        if maybe := next(filter(MAYBE_UPWARDS.match, names), None):
            warnings.warn(f"{path.parent}: points are of the plane, by x and y; call {maybe[:60]!r} z if it is their height", stacklevel=6)
    return [names.index(name) for name in "xyz" if name in names]
