"""People on foot and on bicycles, as lasers see them: legs, a trunk, arms, a head, two wheels."""

from __future__ import annotations

import numpy as np

from hilbertvae.simulate.soup import Soup, Surface, boxes_3d, ellipsoids, joined, tubes


def draw_person(rng: np.random.Generator, walking: bool = True) -> Soup:
    """Somebody who stands at the origin and faces +x; legs and arms swing while walking."""
    tall = rng.uniform(1.5, 1.92) * (0.65 if rng.random() < 0.08 else 1.0)
    broad = rng.uniform(0.17, 0.24) * tall / 1.75
    stride = rng.uniform(0.05, 0.22) * tall * walking
    swing = np.array([stride, -stride])
    hip, shoulder = 0.5 * tall, 0.81 * tall
    sides = np.array([-1, 1])
    zeros = np.zeros(2)
    feet = np.stack([swing, 0.09 * sides, zeros + 0.05], -1)
    hips = np.stack([zeros, 0.08 * sides, zeros + hip], -1)
    hands = np.stack([-0.8 * swing, (broad + 0.06) * sides, zeros + 0.47 * tall], -1)
    shoulders = np.stack([zeros, broad * sides, zeros + shoulder], -1)
    parts = [
        tubes(feet, hips, 0.055, 0.085, 6, Surface.CLOTH),
        boxes_3d(feet * [1, 1, 0] + [0.05, 0, 0], [0.26, 0.09, 0.08], surface=Surface.CLOTH),
        tubes(shoulders, hands, 0.05, 0.04, 5, Surface.CLOTH),
        ellipsoids([[0, 0, 0.66 * tall], [0.01, 0, 0.93 * tall]], [[0.62 * broad, broad, 0.2 * tall], [0.1, 0.085, 0.125]]),
    ]
    if rng.random() < 0.3:
        parts.append(boxes_3d([-0.62 * broad - 0.06, 0, 0.62 * tall], [0.16, 0.28, 0.35], surface=Surface.CLOTH))
    if rng.random() < 0.06:
        parts.append(boxes_3d([0.75, 0, 0.4], [0.7, 0.45, 0.6], surface=Surface.CLOTH))
        parts.append(boxes_3d([[0.5, 0, 0.0], [1.0, 0, 0.0]], [0.15, 0.45, 0.25], surface=Surface.CLOTH))
    return joined(parts)


def draw_bicycle(rng: np.random.Generator, rider: bool = True) -> Soup:
    """A bicycle at the origin that faces +x, with somebody on it or alone."""
    around = np.arange(13) * 2 * np.pi / 12
    rim = np.stack([0.33 * np.cos(around), 0 * around, 0.33 + 0.33 * np.sin(around)], -1)
    parts = []
    for axle in (0.52, -0.52):
        wheel = rim + [axle, 0, 0]
        parts.append(tubes(wheel[:-1], wheel[1:], 0.025, 0.025, 4, Surface.DARK))
    low, seat, head, bar, front, back = np.array(
        [[-0.05, 0, 0.3], [-0.2, 0, 0.9], [0.38, 0, 0.85], [0.33, 0, 1.02], [0.52, 0, 0.33], [-0.52, 0, 0.33]]
    )
    starts, ends = np.array([low, low, seat, head, low, seat, head]), np.array([seat, head, head, front, back, back, bar])
    parts.append(tubes(starts, ends, 0.02, 0.02, 4))
    parts.append(tubes([bar - [0, 0.28, 0]], [bar + [0, 0.28, 0]], 0.02, 0.02, 4))
    if rider:
        lean = rng.uniform(0.1, 0.35)
        shoulder = seat + [lean, 0, 0.52]
        for side in (-1, 1):
            knee, foot = np.array([0.18, 0.11 * side, 0.75 + 0.12 * side]), np.array([0.0, 0.12 * side, 0.3 + 0.15 * side])
            joints = np.array([seat, knee, shoulder + [0, 0.19 * side, 0]])
            parts.append(
                tubes(joints, np.array([knee, foot, bar + [0, 0.25 * side, 0]]), [0.09, 0.07, 0.055], [0.07, 0.05, 0.04], 6, Surface.CLOTH)
            )
        parts.append(tubes([seat], [shoulder], 0.15, 0.19, 7, Surface.CLOTH))
        parts.append(ellipsoids([shoulder + [0.08, 0, 0.24]], [[0.12, 0.095, 0.14]]))
    return joined(parts)
