"""Plane shapes in bulk: oriented boxes, discs and edges, as arrays and as shapely polygons."""

from __future__ import annotations

import numpy as np
import shapely


def turned(vectors: np.ndarray, angle_rad) -> np.ndarray:
    """`vectors` (..., 2) turned counter-clockwise by `angle_rad` (broadcast against the leading axes)."""
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)


def boxes(centres: np.ndarray, angles_rad, lengths_m, widths_m) -> np.ndarray:
    """(K,) rectangles around `centres` (K, 2), their length along the angle and their width across it."""
    centres = np.atleast_2d(centres)
    half = np.stack(np.broadcast_arrays(lengths_m, widths_m, centres[:, 0])[:2], axis=-1) / 2
    corners = half[:, None] * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return shapely.polygons(centres[:, None] + turned(corners, np.broadcast_to(angles_rad, len(centres))[:, None]))


def box(centre, angle_rad: float, length_m: float, width_m: float) -> shapely.Polygon:
    """One rectangle of `boxes`."""
    return boxes(np.asarray(centre, dtype=float), angle_rad, length_m, width_m)[0]


def discs(centres: np.ndarray, radii_m, sides: int = 10) -> np.ndarray:
    """(K,) regular polygons that stand for discs around `centres` (K, 2)."""
    centres = np.atleast_2d(centres)
    angles = np.arange(sides) * (2 * np.pi / sides)
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return shapely.polygons(centres[:, None] + np.broadcast_to(radii_m, len(centres))[:, None, None] * ring)


SNAP_M = 0.001
"""Overlays are snapped to a lattice of 1 mm: at full precision they fail on walls that nearly coincide."""


def united(geometries):
    """The union of all geometries."""
    return _area(shapely.union_all(geometries, grid_size=SNAP_M))


def without(geometry, removed):
    """What of `geometry` lies outside `removed`."""
    return _area(shapely.difference(geometry, removed, grid_size=SNAP_M))


def common(geometry, other):
    """What of `geometry` lies in `other`."""
    return _area(shapely.intersection(geometry, other, grid_size=SNAP_M))


def grown(geometry, by_m: float):
    """The geometry with a margin of `by_m` and sharp corners; a negative margin shrinks it."""
    # Mitred buffers of intricate outlines now and then cross themselves, and overlays of those fail.
    return _area(shapely.make_valid(shapely.buffer(geometry, by_m, join_style="mitre", mitre_limit=3.0)))


def _area(geometry):
    """The geometry without the lines and points that overlays leave where areas only touch: no overlay takes such a mix."""
    return shapely.MultiPolygon(parts(geometry)) if geometry.geom_type == "GeometryCollection" else geometry


def parts(geometry, smallest_m2: float = 0.0) -> list[shapely.Polygon]:
    """The polygons of any geometry that are larger than `smallest_m2`."""
    pieces = shapely.get_parts(shapely.get_parts(geometry))
    return [piece for piece in pieces if piece.geom_type == "Polygon" and piece.area > smallest_m2]


def edges(polygons) -> np.ndarray:
    """(E, 2, 2) float64: the edges of all rings, outer rings clockwise and holes counter-clockwise."""
    polygons = np.asarray(polygons, dtype=object)
    if len(polygons) == 0:
        return np.empty((0, 2, 2))
    coordinates, ring = shapely.get_coordinates(shapely.get_rings(shapely.normalize(polygons)), return_index=True)
    follows = ring[1:] == ring[:-1]
    return np.stack([coordinates[:-1][follows], coordinates[1:][follows]], axis=1)
