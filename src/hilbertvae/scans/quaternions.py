"""Between two rotations as unit quaternions (x, y, z, w), as ROS and TUM write them."""

from __future__ import annotations

import numpy as np


def slerp(first: np.ndarray, second: np.ndarray, share: float) -> np.ndarray:
    """The unit quaternion (4,) a `share` of 0 to 1 of the way from one to the other, at a constant turn rate, the short way round.

    Shoemake, *Animating rotation with quaternion curves*, 1985.
    """
    cosine = float(first @ second)
    if cosine < 0:  # q and -q are one rotation
        second, cosine = -second, -cosine
    if cosine > 0.9995:  # the angle's sine vanishes; over so short a way a chord is an arc
        between = first + share * (second - first)
    else:
        angle = np.arccos(cosine)
        between = np.sin((1 - share) * angle) * first + np.sin(share * angle) * second
    return between / np.sqrt(between @ between)
