"""People who walk past while a robot maps: legs that are in a few sweeps and leave traces of specks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hilbertvae.simulate.shapes import turned

LEG_RADIUS_M = 0.07


@dataclass(frozen=True)
class PassersBy:
    """Where legs stand. sweep: (L,) int, the sweep that a leg is in; centre: (L, 2) float64, metres."""

    sweep: np.ndarray
    centre: np.ndarray

    def ranges(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """(S, B) metres along each beam to the first leg, inf where there is none. Both arrays are (S, B, 2)."""
        towards = self.centre[:, None] - origins[self.sweep]  # (L, B, 2)
        ahead = directions[self.sweep]
        along = (towards * ahead).sum(axis=2)
        aside = towards[..., 0] * ahead[..., 1] - towards[..., 1] * ahead[..., 0]
        depth = np.sqrt(np.maximum(LEG_RADIUS_M**2 - aside**2, 0.0))
        reached = np.where((np.abs(aside) < LEG_RADIUS_M) & (along > depth), along - depth, np.inf)
        nearest = np.full(origins.shape[:2], np.inf)
        np.minimum.at(nearest, self.sweep, reached)
        return nearest


def draw_passers_by(rng: np.random.Generator, poses: np.ndarray, space, each_sweeps: float) -> PassersBy:
    """People near the robot's way, one every `each_sweeps` sweeps on average; inf: none.

    Each appears 1.5 to 8 m ahead, walks or stands for up to 15 sweeps, and is gone where `space` (a `FreeSpace`)
    leaves no room.
    """
    count = rng.poisson(len(poses) / each_sweeps)
    sweeps, centres = [], []
    for _ in range(count):
        first, stay = rng.integers(len(poses)), rng.integers(1, 16)
        sweep = np.arange(first, min(first + stay, len(poses)))
        x, y, heading = poses[first]
        start = [x, y] + turned(np.array([rng.uniform(1.5, 8.0), 0.0]), heading + rng.normal(0, 0.7))
        stride = turned(
            np.array([rng.choice([0.02, rng.uniform(0.3, 1.2)]), 0.0]),
            heading + rng.choice([0, np.pi]) + rng.normal(0, 0.3),
        )
        place = start + np.arange(len(sweep))[:, None] * stride + rng.normal(0, 0.03, (len(sweep), 2))
        here = np.logical_and.accumulate(space.at(place) > 0.2) & (np.linalg.norm(place - poses[sweep, :2], axis=1) > 0.6)
        apart = turned(np.array([0.13, 0.0]), rng.uniform(0, np.pi, len(sweep)))
        for side in (-1, 1):
            sweeps.append(sweep[here])
            centres.append((place + side * apart)[here])
    if not sweeps:
        return PassersBy(np.empty(0, dtype=int), np.empty((0, 2)))
    return PassersBy(np.concatenate(sweeps), np.concatenate(centres))
