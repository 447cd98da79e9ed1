"""Random floor plans: walls, doors, windows and furniture around the floors that a layout has drawn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import shapely

from hilbertvae.simulate import furniture
from hilbertvae.simulate.layouts import LAYOUTS, Floor, Sketch
from hilbertvae.simulate.openings import draw_doors, draw_windows
from hilbertvae.simulate.shapes import boxes, discs, grown, parts, turned, united, without


@dataclass(frozen=True)
class FloorPlan:
    """A building's ground plan, metres. Height is not part of it: `laser.extrude` gives it one, `interior.py` gives each solid its own.

    floors: where one can stand, before furniture.
    solids: (K,) polygons of walls, door leaves and furniture; they may overlap. kinds: (K,) what each is, one of `KINDS`.
    glass: (G,) polygons of panes.
    doorways: (D,) polygons that were cut through walls, and reach a little beyond them.
    turned_rad: how far the whole was turned about the origin after it had been drawn.
    """

    floors: list[Floor]
    solids: np.ndarray
    kinds: np.ndarray
    glass: np.ndarray
    doorways: np.ndarray
    turned_rad: float = 0.0


KINDS = ("wall", "block", "leaf", "thing", "outdoors")
"""Of solids: walls; partitions, pillars and blocks; leaves of doors; furniture and people; what is seen through windows."""

Furnish = Callable[[np.random.Generator, shapely.Polygon, furniture.Furnishing, shapely.Geometry | None], list[shapely.Polygon]]
"""What stands on a floor, as polygons: of how full it is, and of what is to be kept clear."""


def draw_floor_plan(rng: np.random.Generator, extent_m: float, style: str, furnish: Furnish = furniture.furnish) -> FloorPlan:
    """A floor plan about `extent_m` long. `style` is a key of `LAYOUTS`; `furnish` puts things on each floor before it is turned."""
    inner_m, outer_m = rng.choice([0.1, 0.15, 0.2, 0.3]) * rng.uniform(0.8, 1.2), rng.uniform(0.2, 0.5)
    sketch = Sketch(inner_m, outer_m)
    LAYOUTS[style](rng, sketch, extent_m)
    if extent_m > 20 and rng.random() < 0.35:
        _add_wing(rng, sketch, extent_m)
    if rng.random() < 0.35:
        _distort(rng, sketch, extent_m)
    openings, leaves, before_doors = draw_doors(rng, sketch)
    things: list[shapely.Polygon] = []
    keep_clear = united(before_doors + [leaf.buffer(0.1) for leaf in leaves]) if before_doors else None
    fullness = rng.choice(4, p=[0.12, 0.26, 0.34, 0.28])
    for floor in sketch.floors:
        things += furnish(rng, floor.polygon, _fullness(rng, floor, fullness), keep_clear)
    space = united([floor.polygon for floor in sketch.floors] + openings)
    walls = without(grown(space, sketch.outer_wall_m), space)
    panes, walls = draw_windows(rng, sketch, space, walls)
    solids = dict(zip(KINDS, (parts(walls), sketch.solids, leaves, things, _outdoors(rng, space) if panes else []), strict=True))
    kinds = np.repeat(KINDS, [len(of_kind) for of_kind in solids.values()])
    plan = FloorPlan(sketch.floors, _array(sum(solids.values(), [])), kinds, _array(panes), _array(openings))
    return _turn(plan, rng.choice([rng.normal(0, 0.06), rng.uniform(0, np.pi)], p=[0.6, 0.4]))


def _fullness(rng, floor: Floor, fullness: int) -> furniture.Furnishing:
    """Rooms of one building are about equally full; corridors are nearly empty."""
    if floor.kind == "corridor":
        return furniture.PASSAGE if fullness >= 2 else furniture.BARE_PASSAGE
    if floor.kind == "hall":
        fullness = min(fullness, 2) - 1
    levels = [furniture.EMPTY, furniture.SPARSE, furniture.OFFICE, furniture.CRAMMED]
    return levels[int(np.clip(fullness + rng.choice([-1, 0, 0, 1]), 0, 3))]


def _add_wing(rng, sketch: Sketch, extent_m: float) -> None:
    """A second, smaller layout at an odd angle, joined to the first by a passage through whatever lies between."""
    wing = Sketch(sketch.wall_m, sketch.outer_wall_m)
    LAYOUTS[rng.choice(list(LAYOUTS))](rng, wing, extent_m * 0.5)
    main = [floor.polygon for floor in sketch.floors]
    x0, y0, x1, y1 = shapely.total_bounds(main)
    angle, place = rng.uniform(0, 2 * np.pi), rng.uniform([x0, y0], [x1, y1])
    place[1] = rng.choice([y0 - 0.15 * extent_m, y1 + 0.15 * extent_m])

    def moved(polygon):
        return shapely.transform(polygon, lambda xy: turned(xy, angle) + place)

    links = [max(s.floors, key=lambda floor: (floor.kind == "corridor", floor.polygon.area)).polygon for s in (sketch, wing)]
    link = shapely.shortest_line(links[0], moved(links[1])).buffer(rng.uniform(0.8, 1.5), cap_style="square")
    clear = grown(without(link, links[0]), sketch.wall_m)
    floors, sketch.floors = sketch.floors, [Floor(united([links[0], link]), "corridor")]
    if sketch.floors[0].polygon.geom_type != "Polygon":
        sketch.floors = floors
        return
    for floor in floors:
        if floor.polygon is not links[0]:
            sketch.add(floor.polygon, floor.kind)
    taken = united([*main, clear])
    for floor in wing.floors:
        sketch.add(moved(floor.polygon), floor.kind)
    sketch.solids += [solid for solid in map(moved, wing.solids) if not taken.intersects(solid)]
    # The passage reaches into the wing's main floor, from which `add` has just walled it off.
    sketch.floors.append(Floor(shapely.shortest_line(links[0], moved(links[1])).buffer(0.6, cap_style="square"), "corridor"))


def _distort(rng, sketch: Sketch, extent_m: float) -> None:
    """Bends the building into an arc, or shears it, so that corridors curve and walls meet obliquely."""
    if rng.random() < 0.5:
        radius_m = extent_m * rng.uniform(0.7, 2.5) * rng.choice([-1, 1])

        def bend(xy):
            angle = xy[:, 0] / radius_m
            return np.stack([(radius_m - xy[:, 1]) * np.sin(angle), radius_m - (radius_m - xy[:, 1]) * np.cos(angle)], axis=-1)
    else:
        slope = rng.uniform(-0.35, 0.35)

        def bend(xy):
            return np.stack([xy[:, 0] + slope * xy[:, 1], xy[:, 1]], axis=-1)

    def distorted(polygon):
        return shapely.make_valid(shapely.transform(shapely.segmentize(polygon, 2.5), bend))

    sketch.floors = [Floor(piece, floor.kind) for floor in sketch.floors for piece in parts(distorted(floor.polygon), 1.0)]
    sketch.solids = [piece for solid in sketch.solids for piece in parts(distorted(solid))]


def _outdoors(rng, space) -> list[shapely.Polygon]:
    """Trunks, bushes, parked things and a wall or two, as far as a laser sees through windows."""
    x0, y0, x1, y1 = space.bounds
    centres = rng.uniform([x0 - 15, y0 - 15], [x1 + 15, y1 + 15], (rng.integers(50, 250), 2))
    things = np.concatenate(
        [
            discs(centres, rng.uniform(0.03, 0.3, len(centres)), 7),
            boxes(centres[:6] + 3, rng.uniform(0, np.pi, len(centres[:6])), rng.uniform(2, 15, len(centres[:6])), 0.3),
        ]
    )
    return list(things[~shapely.intersects(space.buffer(1.0), things)])


def _turn(plan: FloorPlan, angle_rad: float) -> FloorPlan:
    """The plan turned as a whole: a map's axes are where its robot started, not along walls."""

    def turn(geometry):  # `transform` takes no empty array
        return shapely.transform(geometry, lambda xy: turned(xy, angle_rad)) if np.size(geometry) else geometry

    floors = [Floor(turn(floor.polygon), floor.kind) for floor in plan.floors]
    return replace(plan, floors=floors, **{name: turn(getattr(plan, name)) for name in POLYGONS}, turned_rad=float(angle_rad))


POLYGONS = ("solids", "glass", "doorways")


def _array(polygons: list[shapely.Polygon]) -> np.ndarray:
    return np.array(polygons, dtype=object)
