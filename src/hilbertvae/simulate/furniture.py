"""What stands in rooms at a laser's height: cabinets and desks along walls, legs of tables and chairs, people, clutter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from hilbertvae.simulate.shapes import boxes, discs, turned


@dataclass(frozen=True)
class Furnishing:
    """How full a kind of floor is: pieces per metre of wall, and pieces per square metre."""

    along_walls_per_m: float
    tables_per_m2: float
    chairs_per_m2: float
    clutter_per_m2: float
    people_per_m2: float
    deepest_m: float


EMPTY = Furnishing(0.02, 0.0, 0.0, 0.01, 0.0, 0.5)
SPARSE = Furnishing(0.12, 0.01, 0.03, 0.06, 0.01, 0.6)
OFFICE = Furnishing(0.40, 0.07, 0.14, 0.25, 0.015, 0.9)
CRAMMED = Furnishing(0.60, 0.10, 0.25, 0.7, 0.015, 0.9)
PASSAGE = Furnishing(0.10, 0.0, 0.0, 0.01, 0.004, 0.4)
BARE_PASSAGE = Furnishing(0.05, 0.0, 0.0, 0.001, 0.001, 0.15)


def furnish(rng: np.random.Generator, floor: shapely.Polygon, amount: Furnishing, keep_clear) -> list[shapely.Polygon]:
    """Solid polygons that stand on `floor` and leave `keep_clear` (what lies before doors) free."""
    area_m2, angle = floor.area, main_angle(floor)
    pieces = [
        _along_walls(rng, floor, rng.poisson(amount.along_walls_per_m * floor.length), amount.deepest_m),
        _tables(rng, floor, rng.poisson(amount.tables_per_m2 * area_m2), angle),
        _chairs(rng, scattered(rng, floor, rng.poisson(amount.chairs_per_m2 * area_m2)), rng.uniform(0, np.pi)),
        _clutter(rng, scattered(rng, floor, rng.poisson(amount.clutter_per_m2 * area_m2))),
        _people(rng, scattered(rng, floor, rng.poisson(amount.people_per_m2 * area_m2))),
    ]
    pieces = np.concatenate([piece for piece in pieces if len(piece)] or [np.empty(0, dtype=object)])
    if len(pieces) == 0:
        return []
    shapely.prepare(floor)
    fits = shapely.contains_properly(floor, pieces)
    if keep_clear is not None:
        shapely.prepare(keep_clear)
        fits &= ~shapely.intersects(keep_clear, pieces)
    return list(pieces[fits])


def main_angle(floor) -> float:
    """Direction of the longest wall, radians."""
    corners = shapely.get_coordinates(floor.exterior)
    steps = np.diff(corners, axis=0)
    longest = steps[np.argmax((steps**2).sum(axis=1))]
    return float(np.arctan2(longest[1], longest[0]))


def lattice(floor) -> tuple[np.ndarray, float, float]:
    """Where rows that cover `floor` start from: its middle (2,), their reach to each side (metres), and their direction (radians)."""
    x0, y0, x1, y1 = floor.bounds
    return np.array([x0 + x1, y0 + y1]) / 2, float(np.hypot(x1 - x0, y1 - y0)) / 2, main_angle(floor)


def walls(floor) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of the floor's outline, clockwise, so that inside is on the right: corners (K + 1, 2), ways from one to the next (K, 2), and how long
    these are (K,), metres."""
    corners = shapely.get_coordinates(shapely.normalize(floor).exterior)
    steps = np.diff(corners, axis=0)
    return corners, steps, np.linalg.norm(steps, axis=1)


def scattered(rng, floor, count: int) -> np.ndarray:
    """(K, 2) about `count` places on `floor`: in half of the cases all over it, else in a few clumps, mostly near a wall."""
    if count == 0:
        return np.empty((0, 2))
    if rng.random() < 0.5:
        x0, y0, x1, y1 = floor.bounds
        # Bounding boxes of oblique or holed floors are mostly empty: draw as many as the floor's share of its box asks for.
        return rng.uniform([x0, y0], [x1, y1], (rng.poisson(count * (x1 - x0) * (y1 - y0) / floor.area), 2))
    outline = floor.exterior
    heads = rng.integers(1, 2 + count // 4)
    middles = shapely.get_coordinates(shapely.line_interpolate_point(outline, rng.uniform(0, outline.length, heads)))
    middles += rng.normal(0, 0.2 * np.sqrt(floor.area), middles.shape)
    # Places off the floor are dropped later; twice as many make up for them.
    return middles[rng.integers(heads, size=2 * count)] + rng.normal(0, 0.9, (2 * count, 2))


def _along_walls(rng, floor, count: int, deepest_m: float) -> np.ndarray:
    """Shelves, cabinets, radiators and desks with their backs near a wall, sometimes slightly turned."""
    if count == 0:
        return np.empty(0, dtype=object)
    corners, steps, lengths = walls(floor)
    chosen = rng.choice(len(steps), count, p=lengths / lengths.sum())
    along = steps[chosen] / lengths[chosen, None]
    inward = np.stack([along[:, 1], -along[:, 0]], axis=-1)
    depth = np.minimum(rng.choice([0.08, 0.2, 0.35, 0.45, 0.6, 0.8], count) * rng.uniform(0.8, 1.2, count), deepest_m)
    length = rng.choice([0.4, 0.8, 1.0, 1.6, 2.4], count) * rng.uniform(0.8, 1.2, count)
    gap = np.where(rng.random(count) < 0.7, 0.01, rng.uniform(0.01, 0.15, count))
    centres = corners[chosen] + rng.random(count)[:, None] * steps[chosen] + (gap + depth / 2)[:, None] * inward
    tilt = np.where(rng.random(count) < 0.1, rng.normal(0, 0.15, count), 0.0)
    return boxes(centres, np.arctan2(along[:, 1], along[:, 0]) + tilt, length, depth)


def _tables(rng, floor, count: int, angle: float) -> np.ndarray:
    """Tables on four legs (or boxes: counters, closed desks) with chairs around them."""
    centres = scattered(rng, floor, count)
    count = len(centres)
    if count == 0:
        return np.empty(0, dtype=object)
    angles = angle + rng.choice([0, np.pi / 2], count) + np.where(rng.random(count) < 0.2, rng.uniform(0, np.pi, count), 0)
    sizes = np.stack([rng.uniform(1.0, 2.0, count), rng.uniform(0.6, 1.0, count)], axis=-1)
    closed = rng.random(count) < 0.3
    legs = _around(centres, angles, sizes / 2 - 0.05)[~closed].reshape(-1, 2)
    seats = _around(centres, angles, sizes * [0.25, 0.5] + [0, 0.25]).reshape(-1, 2)
    seats = seats[rng.random(len(seats)) < 0.5]
    seats += rng.normal(0, 0.1, seats.shape)
    return np.concatenate(
        [
            boxes(legs, np.repeat(angles[~closed], 4), rng.uniform(0.04, 0.08), rng.uniform(0.04, 0.08)) if len(legs) else [],
            boxes(centres[closed], angles[closed], sizes[closed, 0], sizes[closed, 1]) if closed.any() else [],
            _chairs(rng, seats, angle),
        ]
    )


def _around(centres, angles, half_sizes) -> np.ndarray:
    """(K, 4, 2): the corners of K rectangles."""
    corners = half_sizes[:, None] * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return centres[:, None] + turned(corners, angles[:, None])


def _chairs(rng, centres, angle) -> np.ndarray:
    """Chairs: a column or bulk on castors, or four thin legs."""
    count = len(centres)
    if count == 0:
        return np.empty(0, dtype=object)
    angles = angle + rng.normal(0, 0.4, count)
    four = rng.random(count) < 0.5
    legs = _around(centres[four], angles[four], np.full((four.sum(), 2), 0.2)).reshape(-1, 2)
    bulk = centres[~four]
    return np.concatenate(
        [
            boxes(legs, np.repeat(angles[four], 4), 0.03, 0.03) if len(legs) else [],
            discs(bulk, rng.uniform(0.04, 0.25, len(bulk)), 7) if len(bulk) else [],
        ]
    )


def _clutter(rng, centres) -> np.ndarray:
    """Bags, bins, cables, boxes on the floor."""
    if len(centres) == 0:
        return np.empty(0, dtype=object)
    size = rng.uniform(0.03, 0.4, (len(centres), 2)) * rng.uniform(0.3, 1.0, (len(centres), 1))
    return boxes(centres, rng.uniform(0, np.pi, len(centres)), size[:, 0], size[:, 1])


def _people(rng, centres) -> np.ndarray:
    """People who stand still: two legs."""
    if len(centres) == 0:
        return np.empty(0, dtype=object)
    step = turned(np.array([rng.uniform(0.09, 0.2), 0.0]), rng.uniform(0, np.pi, len(centres)))
    return np.concatenate([discs(centres + step, 0.07), discs(centres - step, 0.07)])
