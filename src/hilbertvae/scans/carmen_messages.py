"""Laser messages of CARMEN logs: `FLASER`, of before 2005, and `ROBOTLASER1`, which says itself how its beams lie."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hilbertvae.checks import InputError

MAX_BEAMS = 4096
"""More beams than any planar laser of this format has; a larger count is a forged line."""
URG_04LX_DEG = 360 / 1024
LAYOUTS_DEG = {180: 1.0, 181: 1.0, 360: 0.5, 361: 0.5, 541: 0.5, 721: 0.25, 1081: 0.25} | dict.fromkeys((682, 683, 726, 769), URG_04LX_DEG)
"""Degrees between beams by how many there are: half circles of SICK's LMS, 270 degrees of SICK's and Hokuyo's (541, 1081), and 240 or, with
what is at its ends, 255 and 270 of Hokuyo's URG-04LX (682 to 769)."""
HALF_CIRCLES = (180, 360)
"""Counts whose last beam is one step short of 90 degrees."""
BEFORE_RANGES = 8
"""Fields of a `ROBOTLASER1` line before its ranges: type, first angle, field of view, step, farthest range, accuracy, remission's mode,
and how many ranges follow. Angles are in radians."""


@dataclass(frozen=True)
class Sweep:
    """ranges (n,) in metres, inf where none was measured; the laser's pose (x, y, heading); where beams point from there, in degrees,
    counter-clockwise; ranges from `farthest_m` on are no-return codes. known: whether `LAYOUTS_DEG` has so many beams, or the line says how
    they lie."""

    ranges: np.ndarray
    pose: np.ndarray
    first_deg: float
    step_deg: float
    farthest_m: float = np.inf
    known: bool = True


def beam_step_deg(beams: int) -> float:
    """Degrees between beams, as `LAYOUTS_DEG` has it; 1 or 0.5 for other counts. Beams run counter-clockwise.

    Spreading 180 beams over exactly 180 degrees gives maps 2 to 12 % blurrier on the catalogue's logs.
    """
    return LAYOUTS_DEG.get(beams, 1.0 if beams <= 181 else 0.5)


def first_beam_deg(beams: int, step_deg: float) -> float:
    """The bearing of beam 0: -90 for a half circle, and in general as far to the right as the last one is to the left."""
    return -90.0 if beams in HALF_CIRCLES and step_deg == LAYOUTS_DEG[beams] else -step_deg * (beams - 1) / 2


def front_laser(path: Path, number: int, line: bytes, step_deg: float | None = None) -> Sweep:
    """The sweep of `FLASER n r_1 .. r_n x y theta ...`. step_deg: between its beams, unless as so many have them."""
    fields = line.split()
    count = _count(path, number, fields, 1, "FLASER <number of ranges> ...")
    ranges, pose = np.split(_numbers(path, number, fields, 2, count + 3, f"{count} ranges and a pose"), [count])
    step = beam_step_deg(count) if step_deg is None else step_deg
    known = count in LAYOUTS_DEG or step_deg is not None or not count
    return _sweep(path, number, ranges, pose, first_deg=first_beam_deg(count, step), step_deg=step, known=known)


def robot_laser(path: Path, number: int, line: bytes, step_deg: float | None = None) -> Sweep:
    """The sweep of `ROBOTLASER1 <8 fields> r_1 .. r_n m remission_1 .. remission_m x y theta ...`, with the laser's pose.

    step_deg: between its beams, which then lie as those of `FLASER`, unless as the line says."""
    fields = line.split()
    expected = "ROBOTLASER1 type first_angle field_of_view step farthest_range accuracy remission_mode <number of ranges> ..."
    count = _count(path, number, fields, BEFORE_RANGES, expected)
    first, _, step, farthest = _numbers(path, number, fields, 2, 4, "angles and a farthest range")
    ranges = _numbers(path, number, fields, BEFORE_RANGES + 1, count, f"{count} ranges")
    after = BEFORE_RANGES + 1 + count
    remissions = _count(path, number, fields, after, f"ROBOTLASER1 with a number of remissions behind its {count} ranges")
    pose = _numbers(path, number, fields, after + 1 + remissions, 3, f"{count} ranges, {remissions} remissions and a pose")
    if step_deg is not None:
        return _sweep(path, number, ranges, pose, first_deg=first_beam_deg(count, step_deg), step_deg=step_deg)
    if not (np.isfinite(first) and abs(first) <= 2 * np.pi and 0 < step * max(count - 1, 1) <= 2.01 * np.pi):
        turns = f"first angle {first:g}, {count} ranges {step:g} apart"
        raise InputError(f"{path}, line {number}: expected radians within a turn, got {turns}; or set reading.beam_step_deg")
    farthest = farthest if farthest > 0 else np.inf
    return _sweep(path, number, ranges, pose, first_deg=np.rad2deg(first), step_deg=np.rad2deg(step), farthest_m=farthest)


MESSAGES = {b"FLASER": front_laser, b"ROBOTLASER1": robot_laser}
"""What reads the messages of a log's front laser, by their name."""


def _count(path: Path, number: int, fields: list[bytes], place: int, expected: str) -> int:
    if len(fields) <= place or not fields[place].isdigit() or len(fields[place]) > 18:
        raise InputError(f"{path}, line {number}: expected '{expected}', got {b' '.join(fields)[:40]!r}")
    count = int(fields[place])
    if count > MAX_BEAMS:
        raise InputError(f"{path}, line {number}: expected at most {MAX_BEAMS} ranges, the line claims {count}")
    return count


def _numbers(path: Path, number: int, fields: list[bytes], place: int, count: int, claimed: str) -> np.ndarray:
    if len(fields) < place + count:
        found = max(len(fields) - place, 0)
        raise InputError(f"{path}, line {number}: truncated; {claimed} claimed, {found} numbers found")
    try:
        return np.array(fields[place : place + count], dtype=np.float64)
    except ValueError as error:
        raise InputError(f"{path}, line {number}: expected numbers ({error})") from error


def _sweep(path: Path, number: int, ranges: np.ndarray, pose: np.ndarray, **beams) -> Sweep:
    if not np.isfinite(pose).all():
        raise InputError(f"{path}, line {number}: expected a finite pose, got {pose.tolist()}")
    return Sweep(np.where(np.isnan(ranges), np.inf, ranges), pose, **beams)
