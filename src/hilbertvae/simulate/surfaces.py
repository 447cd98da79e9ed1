"""How a laser sees surfaces: which triangle a ray meets first, how bright it answers, and what passes through."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hilbertvae.simulate.laser import RayCaster
from hilbertvae.simulate.soup import Soup, Surface


@dataclass(frozen=True)
class Optics:
    """One surface. brightness: share of light sent back head on; shine: how fast that falls off to the side (power of the cosine).

    return_share, pass_share: of the beams that meet it, those it answers and those that go on; the rest is lost.
    roughness_m: spread of the depth at which it answers.
    """

    brightness: float
    shine: float = 1.0
    return_share: float = 1.0
    pass_share: float = 0.0
    roughness_m: float = 0.0


OPTICS = {
    Surface.WALL: Optics(0.4, roughness_m=0.012),
    Surface.ROAD: Optics(0.16),
    Surface.GRASS: Optics(0.4, roughness_m=0.03),
    Surface.LEAF: Optics(0.35, 0.5, roughness_m=0.03),
    Surface.PAINT: Optics(0.35, 1.5),
    Surface.DARK: Optics(0.05, 2.0),
    Surface.GLASS: Optics(0.1, 2.0, return_share=0.015, pass_share=0.04),
    Surface.PANE: Optics(0.1, 2.0, return_share=0.03, pass_share=0.85),
    Surface.NET: Optics(0.3, 1.0, return_share=0.35, pass_share=0.65),
    Surface.CLOTH: Optics(0.3),
}
"""Asphalt and car paint are dark or mirror the beam away: both vanish first as range grows. A window of coated glass loses nearly
all beams, a plain pane lets them through: whole windows are black in real scans, and others show what is behind them."""

_BRIGHTNESS, _SHINE, _RETURNS, _PASSES, _ROUGH = np.array(
    [[o.brightness, o.shine, o.return_share, o.pass_share, o.roughness_m] for o in (OPTICS[kind] for kind in Surface)]
).T
PANES = 3
"""A beam goes through so many panes or nets at most: in and out of a car, and through a fence behind it."""


class SurfaceCaster(RayCaster):
    """A `RayCaster` that also tells which triangle was hit and how steeply."""

    def __init__(self, scene: Soup):
        super().__init__(scene.triangles.reshape(-1, 3), np.arange(3 * len(scene)).reshape(-1, 3))
        self._surface = scene.surface
        if len(scene):
            self._normals = self._normals / np.maximum(np.linalg.norm(self._normals, axis=1, keepdims=True), 1e-12)

    def hits(self, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(N,) metres (inf where nothing is hit), (N,) surface, (N,) cosine of the angle to the surface's normal."""
        ranges, cosines = np.full(len(origins), np.inf), np.ones(len(origins))
        surface = np.zeros(len(origins), dtype=np.int8)
        hit, triangle, slope, reached = self._first(origins, directions)
        ranges[hit] = np.where(np.isfinite(reached) & (reached > 0), reached, np.inf)
        surface[hit] = self._surface[triangle]
        cosines[hit] = np.abs(slope)
        return ranges, surface, cosines


@dataclass(frozen=True)
class Echo:
    """Where beams end. ranges: (N,) metres, inf for nowhere; brightness: (N,) share sent back; roughness_m: (N,)."""

    ranges: np.ndarray
    brightness: np.ndarray
    roughness_m: np.ndarray


def echoes(rng: np.random.Generator, casters: list[SurfaceCaster], origins: np.ndarray, directions: np.ndarray) -> Echo:
    """What answers each beam, after panes and nets that it went through. `origins`, `directions`: (N, 3), unit length."""
    count = len(origins)
    travelled, alive = np.zeros(count), np.arange(count)
    ranges, brightness, rough = np.full(count, np.inf), np.zeros(count), np.zeros(count)
    for _ in range(PANES + 1):
        start = origins[alive] + travelled[alive, None] * directions[alive]
        found, surface, cosines = _nearest([caster.hits(start, directions[alive]) for caster in casters])
        fate = rng.random(len(alive))
        answers = np.isfinite(found) & (fate < _RETURNS[surface])
        done, made_of = alive[answers], surface[answers]
        ranges[done] = travelled[done] + found[answers]
        brightness[done] = _BRIGHTNESS[made_of] * cosines[answers] ** _SHINE[made_of]
        rough[done] = _ROUGH[made_of]
        passes = np.isfinite(found) & ~answers & (fate < _RETURNS[surface] + _PASSES[surface])
        alive = alive[passes]
        if len(alive) == 0:
            break
        travelled[alive] += found[passes] + 1e-3
    return Echo(ranges, brightness, rough)


def _nearest(hits):
    ranges, surface, cosines = hits[0]
    for other, other_surface, other_cosines in hits[1:]:
        nearer = other < ranges
        ranges, surface = np.where(nearer, other, ranges), np.where(nearer, other_surface, surface)
        cosines = np.where(nearer, other_cosines, cosines)
    return ranges, surface, cosines
