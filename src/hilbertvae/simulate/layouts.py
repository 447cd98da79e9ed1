"""Where the rooms and corridors of a building lie: one function for each style of building.

A style adds floors to a `Sketch`. A floor that would overlap an earlier one is cut back by the thickness of a wall, so
that corridors come first, rooms fill what is left, and outlines come out irregular by themselves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import shapely

from hilbertvae.simulate.shapes import box, boxes, discs, grown, parts, turned, united, without
from hilbertvae.simulate.skeletons import SKELETONS

SMALLEST_ROOM_M2 = 3.0


@dataclass
class Floor:
    """A place to stand: its polygon in metres, and whether it is a "corridor", a "room" or a "hall"."""

    polygon: shapely.Polygon
    kind: str


@dataclass
class Sketch:
    """A building in the making.

    wall_m: thickness of inner walls; outer_wall_m: of outer walls.
    floors: no two overlap, but for the passage to a wing; where they are `wall_m` apart a wall stands between them.
    solids: partitions, pillars and blocks that stand on the floors.
    """

    wall_m: float
    outer_wall_m: float
    floors: list[Floor] = field(default_factory=list)
    solids: list[shapely.Polygon] = field(default_factory=list)

    def add(self, polygon: shapely.Polygon, kind: str) -> None:
        """Adds what of `polygon` keeps a wall's distance from all floors that are there already."""
        near = [other.polygon for other in self.floors if other.polygon.distance(polygon) < self.wall_m]
        if near:
            polygon = without(polygon, grown(united(near), self.wall_m))
        # An opening by half a door's width drops the slivers that a cut leaves.
        pieces = parts(grown(grown(polygon, -0.35), 0.35), SMALLEST_ROOM_M2)
        self.floors.extend(Floor(shapely.simplify(piece, 0.02), kind) for piece in pieces)


def corridors(rng: np.random.Generator, sketch: Sketch, extent_m: float) -> None:
    """Corridors in a line, an L, a T, a loop, a ladder or an oblique chain, with alcoves and rooms along both sides."""
    skeleton = SKELETONS[rng.integers(len(SKELETONS))](rng, extent_m)
    width_m = rng.uniform(1.5, 3.0)
    widths = np.where(rng.random(len(skeleton)) < 0.7, width_m, rng.uniform(1.4, 4.0, len(skeleton)))
    floor = [
        shapely.LineString(ends).buffer(w / 2, cap_style="square", join_style="mitre") for ends, w in zip(skeleton, widths, strict=True)
    ]
    for ends, width in zip(skeleton, widths, strict=True):
        floor += _alcoves(rng, ends, width)
    if rng.random() < 0.3:  # a round place where corridors meet
        floor.append(discs(skeleton[rng.integers(len(skeleton))][0], width_m * rng.uniform(0.9, 2.2), 24)[0])
    sketch.add(united(floor), "corridor")
    room_m = rng.uniform(2.6, 6.0)
    for ends, width in zip(skeleton, widths, strict=True):
        for side in (-1, 1):
            _rooms_along(rng, sketch, ends, width, side, room_m)


def _alcoves(rng, ends, width_m) -> list[shapely.Polygon]:
    """Niches, lift lobbies and waiting corners that widen a corridor here and there."""
    start, along, length_m = ends[0], _unit(ends), float(np.linalg.norm(ends[1] - ends[0]))
    count = rng.poisson(length_m / rng.uniform(6, 30))
    places, sides = rng.uniform(0, length_m, count), rng.choice([-1, 1], count)
    depths = np.where(rng.random(count) < 0.7, rng.uniform(0.1, 0.6, count), rng.uniform(0.6, 3.0, count))
    centres = start + places[:, None] * along + (sides * (width_m + depths) / 2)[:, None] * _normal(along)
    angle = np.arctan2(along[1], along[0])
    return list(boxes(centres, angle, rng.uniform(0.8, 3.5, count), depths + 0.02)) if count else []


def _rooms_along(rng, sketch: Sketch, ends, width_m: float, side: int, room_m: float) -> None:
    """Rooms side by side along one side of a corridor, of one depth with exceptions."""
    start, along, length_m = ends[0], _unit(ends), float(np.linalg.norm(ends[1] - ends[0]))
    across = side * _normal(along)
    depth_m = rng.uniform(3.0, 7.5)
    place_m = rng.uniform(-room_m, width_m)
    filled = rng.uniform(0.6, 1.0)
    while place_m < length_m:
        wide_m = room_m * rng.choice([0.7, 1.0, 1.0, 1.5, 2.0]) * rng.uniform(0.85, 1.15)
        if rng.random() < filled:
            deep_m = depth_m if rng.random() < 0.8 else depth_m * rng.uniform(0.4, 1.6)
            outline = room_outline(rng, wide_m, deep_m)
            corner = start + place_m * along + (width_m / 2 + sketch.wall_m) * across
            sketch.add(shapely.polygons(corner + outline[:, :1] * along + outline[:, 1:] * across), "room")
        place_m += wide_m + sketch.wall_m


def room_outline(rng: np.random.Generator, wide_m: float, deep_m: float) -> np.ndarray:
    """(C, 2) corners of a room of about `wide_m` by `deep_m`, its door's wall on the x axis: most are plain rectangles,
    some have an oblique corner, a curved far wall, a bay, a shaft in a corner or an oblique side."""
    w, d = wide_m, deep_m
    kind = rng.choice(6, p=[0.62, 0.09, 0.06, 0.08, 0.09, 0.06])
    if kind == 1:
        a, b = rng.uniform(0.2, 0.6) * w, rng.uniform(0.2, 0.6) * d
        outline = [[0, 0], [w, 0], [w, d - b], [w - a, d], [0, d]]
    elif kind == 2:
        x = np.linspace(w, 0, 9)
        bow = rng.uniform(0.15, 0.5) * w * (1 - (2 * x / w - 1) ** 2)
        outline = [[0, 0], [w, 0], *np.stack([x, d + bow], axis=-1)]
    elif kind == 3:
        a, b, c = rng.uniform(0.1, 0.3) * w, rng.uniform(0.7, 0.9) * w, rng.uniform(0.4, 1.5)
        outline = [[0, 0], [w, 0], [w, d], [b, d], [b - 0.3 * c, d + c], [a + 0.3 * c, d + c], [a, d], [0, d]]
    elif kind == 4:
        a, b = rng.uniform(0.15, 0.45) * w, rng.uniform(0.15, 0.45) * d
        outline = [[0, 0], [w, 0], [w, d - b], [w - a, d - b], [w - a, d], [0, d]]
    elif kind == 5:
        outline = [[0, 0], [w, 0], [w + rng.uniform(-0.3, 0.2) * w, d], [rng.uniform(-0.2, 0.3) * w, d]]
    else:
        outline = [[0, 0], [w, 0], [w, d], [0, d]]
    outline = np.array(outline, dtype=float)
    if rng.random() < 0.5:
        outline[:, 0] = w - outline[:, 0]
    return outline


def hall(rng: np.random.Generator, sketch: Sketch, extent_m: float) -> None:
    """One to three large halls with oblique or curved sides, pillars, free-standing walls, cubicles and rooms around."""
    place_m = 0.0
    for _ in range(rng.integers(1, 4)):
        long_m = extent_m * rng.uniform(0.3, 0.7)
        wide_m = min(long_m, rng.uniform(8, 26)) * rng.uniform(0.7, 1.0)
        outline = shapely.box(place_m, 0, place_m + long_m, wide_m)
        for _ in range(rng.integers(0, 3)):  # a half-plane at any angle cuts a side or a corner off
            angle = rng.uniform(0, 2 * np.pi)
            reach_m = rng.uniform(0.75, 1.0) * (abs(np.cos(angle)) * long_m + abs(np.sin(angle)) * wide_m) / 2
            away = turned(np.array([reach_m + 500, 0.0]), angle)
            outline = without(outline, box([place_m + long_m / 2, wide_m / 2] + away, angle, 1000, 1000))
        if rng.random() < 0.25:
            outline = outline.union(
                discs([place_m + rng.random() * long_m, rng.choice([0, wide_m])], wide_m * rng.uniform(0.2, 0.5), 24)[0]
            )
        sketch.add(outline, "hall")
        _stand_in_hall(rng, sketch, outline)
        ends = np.array([[place_m, wide_m / 2], [place_m + long_m, wide_m / 2]])
        for side in (-1, 1):
            if rng.random() < 0.6:
                _rooms_along(rng, sketch, ends, wide_m, side, rng.uniform(3, 8))
        place_m += long_m + (sketch.wall_m if rng.random() < 0.7 else rng.uniform(2, 8))


def _stand_in_hall(rng, sketch: Sketch, outline) -> None:
    """Pillars in a lattice; free-standing walls, lone, at a right angle, around three sides, or in combs of cubicles."""
    x0, y0, x1, y1 = outline.bounds
    inner, solids = outline.buffer(-0.8), []
    if rng.random() < 0.7:
        spacing_m, offset = rng.uniform(3, 8), rng.random(2)
        xs, ys = (
            np.arange(x0 + offset[0] * spacing_m, x1, spacing_m),
            np.arange(y0 + offset[1] * spacing_m, y1, spacing_m),
        )
        centres = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
        size_m = rng.uniform(0.25, 0.8)
        if len(centres):
            solids += list(discs(centres, size_m / 2, 12) if rng.random() < 0.4 else boxes(centres, 0.0, size_m, size_m))
    main_angle = rng.choice([0.0, rng.uniform(0, np.pi)], p=[0.6, 0.4])
    for _ in range(rng.poisson(outline.area / rng.uniform(20, 140))):
        centre, angle = rng.uniform([x0, y0], [x1, y1]), main_angle + rng.choice([0, np.pi / 2]) + rng.normal(0, 0.02)
        solids += _free_standing(rng, centre, angle)
    sketch.solids += [solid for solid in solids if inner.contains(solid)]


def _free_standing(rng, centre, angle) -> list[shapely.Polygon]:
    thick_m, long_m, deep_m = rng.choice([0.06, 0.12, 0.25]), rng.uniform(1.5, 7), rng.uniform(1.2, 4)
    kind = rng.choice(4, p=[0.3, 0.2, 0.3, 0.2])
    local = [([0, 0], 0, long_m, thick_m)]
    if kind >= 1:
        local.append(([-(long_m - thick_m) / 2, deep_m / 2], np.pi / 2, deep_m, thick_m))
    if kind == 2:
        local.append(([(long_m - thick_m) / 2, deep_m / 2], np.pi / 2, deep_m, thick_m))
    if kind == 3:
        teeth = np.arange(-long_m / 2, long_m / 2, rng.uniform(1.6, 2.6))[1:]
        local += [([x, deep_m / 2 * s], np.pi / 2, deep_m, thick_m) for x in teeth for s in (-1, 1)]
    return [box(centre + turned(np.array(at, dtype=float), angle), angle + a, length, width) for at, a, length, width in local]


def enfilade(rng: np.random.Generator, sketch: Sketch, extent_m: float) -> None:
    """One to three rows of rooms that open into one another, with thick walls and bays, as in castles and museums."""
    sketch.wall_m = rng.uniform(0.25, 0.8)
    base_m, angle = 0.0, rng.normal(0, 0.03)
    for row in range(rng.integers(1, 4)):
        deep_m, place_m = rng.uniform(3.0, 9.0), 0.0
        bay_m = rng.uniform(1.5, 4.0)
        while place_m < extent_m:
            wide_m = rng.uniform(3, 12)
            floor = [shapely.box(place_m, base_m, place_m + wide_m, base_m + deep_m)]
            if row == 0 and rng.random() < 0.8:
                floor += [
                    shapely.polygons([[x, base_m + 0.01], [x + 0.3, base_m - 0.7], [x + 1.2, base_m - 0.7], [x + 1.5, base_m + 0.01]])
                    for x in np.arange(place_m + 0.3, place_m + wide_m - 1.5, bay_m)
                ]
            sketch.add(shapely.transform(united(floor), lambda xy: turned(xy, angle)), "hall")
            place_m += wide_m + sketch.wall_m
        base_m += deep_m + sketch.wall_m


def _unit(ends) -> np.ndarray:
    return (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])


def _normal(along) -> np.ndarray:
    return np.array([-along[1], along[0]])


LAYOUTS: dict[str, Callable] = {"corridors": corridors, "hall": hall, "enfilade": enfilade}
