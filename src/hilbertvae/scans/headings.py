"""Whether headings of poses in the plane, which should be radians, are degrees."""

from __future__ import annotations

import math
import os
import warnings

import numpy as np

WOUND_RAD = 4 * math.pi
"""Headings in radians get beyond by winding up, turn after turn, and then in small steps."""
WRAPPED_RAD = 2 * math.pi
"""Headings in radians up to here may be of one turn, in which a robot may go sideways; those beyond are compared with its way."""
LEAST_STEP_M = 0.05
"""Shorter steps say little of where a robot goes: poses are uncertain by centimetres."""
LEAST_STEPS = 10
FITS, UNFIT = 0.7, 0.5
"""How steady the angle between heading and way is, 0 to 1: of degrees that fit at least the first, and of radians that don't at most the
second share of it. A robot that drives has 0.9 and more, at whatever angle its laser is mounted, and random headings 0.1 to 0.3."""


def warn_of_degrees(places: np.ndarray, headings: np.ndarray, path: str | os.PathLike) -> None:
    """One `UserWarning` where headings (S,) of poses at places (S, 2), metres, can hardly be radians and can be degrees: where they take
    big steps, or where the way from place to place goes along with them if they are read as degrees alone."""
    most = float(max(headings, key=abs, default=0.0))
    steps = np.diff(headings) if len(headings) > 1 else headings
    if WOUND_RAD < abs(most) <= 360 and np.abs(steps).max() > math.pi:
        said = "in big steps"
    elif abs(most) > WRAPPED_RAD and _goes_by_degrees(places, headings):
        said = "and the way from place to place fits them as degrees"
    else:
        return
    warnings.warn(f"{path}: headings in radians are expected and go up to {most:.6g}, {said}; are they degrees?", stacklevel=5)


def _goes_by_degrees(places: np.ndarray, headings: np.ndarray) -> bool:
    steps = np.diff(places, axis=0)
    told = np.hypot(*steps.T) > LEAST_STEP_M
    if np.count_nonzero(told) < LEAST_STEPS:
        return False
    course, seen = np.arctan2(steps[told, 1], steps[told, 0]), headings[:-1][told]
    as_degrees = _steadiness(course - np.deg2rad(seen))
    return as_degrees >= FITS and _steadiness(course - seen) <= UNFIT * as_degrees


def _steadiness(angles: np.ndarray) -> float:
    """The mean resultant length of angles, radians: 1 where all are the same, 0 where they point everywhere alike."""
    return float(np.abs(np.exp(1j * angles).mean()))
