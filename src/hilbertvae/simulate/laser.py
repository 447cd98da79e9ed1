"""A laser scanner: rays against a triangle mesh in two or three dimensions, and what a real sensor makes of ranges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hilbertvae.checks import InputError, check_count, check_not_negative, check_positive, check_share, extra_module

MIXED_M = 1.5
"""Up to such a depth a planar laser mixes the two sides of an edge."""


@dataclass(frozen=True)
class LaserSettings:
    """A planar laser and its faults.

    miss_share: beams that return nothing for no visible reason. Real logs miss 1 to 13 % in all.
    glass_return_share: of the beams that reach a pane, those that the pane itself returns; `glass_pass_share`: those
    that go through and see what lies behind. The rest return nothing.
    edge_mix_share: of the beams next to a depth edge, those that return a range between the two depths.
    """

    beams: int = 180
    field_of_view_deg: float = 180.0
    max_range_m: float = 30.0
    range_noise_m: float = 0.015
    range_step_m: float = 0.01
    miss_share: float = 0.015
    glass_return_share: float = 0.03
    glass_pass_share: float = 0.6
    edge_mix_share: float = 0.2

    def __post_init__(self):
        check_count(self.beams, "laser.beams")
        for name in ("field_of_view_deg", "max_range_m"):
            check_positive(getattr(self, name), f"laser.{name}")
        if self.field_of_view_deg > 360:
            raise InputError(f"laser.field_of_view_deg: expected at most 360, got {self.field_of_view_deg!r}")
        for name in ("range_noise_m", "range_step_m"):
            check_not_negative(getattr(self, name), f"laser.{name}")
        for name in ("miss_share", "glass_return_share", "glass_pass_share", "edge_mix_share"):
            check_share(getattr(self, name), f"laser.{name}")
        if self.glass_return_share + self.glass_pass_share > 1:
            raise InputError("laser.glass_return_share + laser.glass_pass_share: expected at most 1 together")


class RayCaster:
    """Distances along rays to the first surface of a triangle mesh.

    vertices: (V, 3) float64, metres; faces: (F, 3) int. No faces: nothing is ever hit.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray):
        trimesh, embree = sim_extra("trimesh"), sim_extra("trimesh.ray.ray_pyembree")
        self._corners = np.asarray(vertices, dtype=np.float64)[faces]
        self._intersector = None
        if len(faces):
            normals = np.cross(self._corners[:, 1] - self._corners[:, 0], self._corners[:, 2] - self._corners[:, 0])
            self._normals = normals
            self._intersector = embree.RayMeshIntersector(trimesh.Trimesh(vertices, faces, process=False))

    def ranges(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """(N,) float64 metres, inf where nothing is hit. Both arrays are (N, D), D 2 or 3; 2D rays run at height 0.

        `directions` have unit length. embree works in float32, so it only names the triangle; the distance to its plane
        is computed in float64.
        """
        distances = np.full(len(origins), np.inf)
        hit, _, _, reached = self._first(_lifted(origins), _lifted(directions))
        distances[hit] = np.where(np.isfinite(reached) & (reached >= 0), reached, np.inf)
        return distances

    def _first(self, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, ...]:
        """Of rays (N, 3) those (M,) that meet a triangle, which (M,), its normal times the direction (M,), and metres to its plane (M,)."""
        if self._intersector is None or len(origins) == 0:
            return np.empty(0, int), np.empty(0, int), np.empty(0), np.empty(0)
        triangle = self._intersector.intersects_first(origins, directions)
        hit = np.flatnonzero(triangle >= 0)
        triangle = triangle[hit]
        normals = self._normals[triangle]
        slope = np.einsum("ij,ij->i", normals, directions[hit])
        with np.errstate(divide="ignore", invalid="ignore"):
            reached = np.einsum("ij,ij->i", normals, self._corners[triangle, 0] - origins[hit]) / slope
        return hit, triangle, slope, reached


def _lifted(vectors: np.ndarray) -> np.ndarray:
    vectors = np.asarray(vectors, dtype=np.float64)
    return vectors if vectors.shape[1] == 3 else np.column_stack([vectors, np.zeros(len(vectors))])


def sim_extra(module: str):
    """A module of the extra `sim`; an `InputError` that names the extra where it is not installed."""
    return extra_module("sim", module, "simulated sites need")


def check_sim_extra() -> None:
    """An `InputError` that names the extra `sim` unless all of it is installed: before hours of work that end with a simulated site."""
    for module in ("shapely", "trimesh", "trimesh.ray.ray_pyembree"):
        sim_extra(module)


def extrude(edges: np.ndarray, bottom_m: float = -1.0, top_m: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Upright faces over a plan's edges (E, 2, 2): vertices (4 E, 3), faces (2 E, 3). A level laser sees no lids."""
    low = np.concatenate([edges, np.full((*edges.shape[:2], 1), bottom_m)], axis=2)
    high = np.concatenate([edges, np.full((*edges.shape[:2], 1), top_m)], axis=2)
    vertices = np.concatenate([low, high], axis=1).reshape(-1, 3)  # per edge: start, end, start above, end above
    faces = 4 * np.arange(len(edges))[:, None, None] + np.array([[0, 1, 3], [0, 3, 2]])
    return vertices, faces.reshape(-1, 3)


def bearings(settings: LaserSettings) -> np.ndarray:
    """(B,) radians from straight ahead, counter-clockwise: beam k at -fov / 2 + k * fov / beams, as in CARMEN logs."""
    return np.deg2rad(settings.field_of_view_deg * (np.arange(settings.beams) / settings.beams - 0.5))


def sense(
    rng: np.random.Generator,
    settings: LaserSettings,
    solid: RayCaster,
    glass: RayCaster,
    origins: np.ndarray,
    directions: np.ndarray,
    moving: np.ndarray | float = np.inf,
) -> np.ndarray:
    """What the laser reports: (S, B) float64 metres, NaN for no return.

    `origins` and `directions` are (S, B, D); `moving` (S, B) are the ranges to what is in no mesh, people who pass by.
    """
    sweeps, dimension = origins.shape[:2], origins.shape[2]
    flat = origins.reshape(-1, dimension), directions.reshape(-1, dimension)
    ranges = np.minimum(solid.ranges(*flat).reshape(sweeps), moving)
    to_glass = glass.ranges(*flat).reshape(sweeps)
    fate = rng.random(sweeps)
    at_glass = to_glass < ranges
    ranges = np.where(at_glass & (fate < settings.glass_return_share), to_glass, ranges)
    passes = settings.glass_return_share + settings.glass_pass_share
    ranges = np.where(at_glass & (fate >= passes), np.inf, ranges)
    in_turn = np.pad(ranges.T, ((2, 1), (0, 0)), constant_values=np.nan)
    ranges = mixed_at_edges(rng, in_turn, settings.edge_mix_share, MIXED_M).T
    ranges = ranges + rng.normal(0.0, 1.0, sweeps) * settings.range_noise_m
    if settings.range_step_m > 0:
        ranges = np.round(ranges / settings.range_step_m) * settings.range_step_m
    lost = rng.random(sweeps) < settings.miss_share
    return np.where(lost | ~(ranges < settings.max_range_m) | (ranges <= 0.02), np.nan, ranges)


def mixed_at_edges(rng: np.random.Generator, in_turn: np.ndarray, share: float, deepest_m: float) -> np.ndarray:
    """(B, ...) metres: ranges, a `share` of those at an edge to the beam before somewhere in between.

    `in_turn` (2 + B + 1, ...): beams in turn and, around them, the last two and the first of their neighbours, NaN for none.
    A beam is a cone: beside an edge part of it goes on, and some sensors answer with a range in between. Over gaps from
    `deepest_m` on the two echoes are told apart.
    """
    before, ranges = in_turn[1:-2], in_turn[2:-1]
    with np.errstate(invalid="ignore", divide="ignore"):
        jump = np.abs(ranges - before)
        edge = (jump > 0.1) & (jump < deepest_m) & ~_joined(1 / np.where(np.isfinite(in_turn), in_turn, np.nan))
    mixes = edge & (rng.random(jump.shape) < share)
    return np.where(mixes, np.minimum(ranges, before) + rng.random(jump.shape) * np.where(mixes, jump, 0.0), ranges)


def _joined(nearness: np.ndarray) -> np.ndarray:
    """(B, ...) bool: beams whose surface goes on to the beam before; `nearness` (2 + B + 1, ...), 1 / m.

    Along a straight wall 1 / range is all but linear in the angle, however slanted the wall is. So two beams are on one
    surface where either side, extrapolated, comes within 0.1 m of the other's return, or where both meet in between, at
    a corner. A side of a single beam tells nothing. On rough surfaces, as foliage, a third of the steps pass for joined by chance.
    """
    before, here = nearness[1:-2], nearness[2:-1]
    from_before, from_here = 2 * before - nearness[:-3], 2 * here - nearness[3:]
    meets = np.abs(from_before - here) < 0.1 * from_before * here
    met = np.abs(from_here - before) < 0.1 * from_here * before
    return meets | met | ((from_before - here) * (before - from_here) < 0)
