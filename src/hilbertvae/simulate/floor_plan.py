"""Random floor plans: walls, doors, windows and furniture around the floors that a layout has drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from hilbertvae.simulate import furniture
from hilbertvae.simulate.layouts import LAYOUTS, Floor, Sketch
from hilbertvae.simulate.shapes import SNAP_M, box, boxes, discs, grown, parts, turned, united, without


@dataclass(frozen=True)
class FloorPlan:
    """A building's ground plan, metres. Height is not part of it: `laser.extrude` gives it one.

    floors: where one can stand, before furniture.
    solids: (K,) polygons of walls, door leaves and furniture; they may overlap.
    glass: (G,) polygons of panes.
    """

    floors: list[Floor]
    solids: np.ndarray
    glass: np.ndarray


def draw_floor_plan(rng: np.random.Generator, extent_m: float, style: str) -> FloorPlan:
    """A floor plan about `extent_m` long. `style` is a key of `LAYOUTS`."""
    inner_m, outer_m = rng.choice([0.1, 0.15, 0.2, 0.3]) * rng.uniform(0.8, 1.2), rng.uniform(0.2, 0.5)
    sketch = Sketch(inner_m, outer_m)
    LAYOUTS[style](rng, sketch, extent_m)
    if extent_m > 20 and rng.random() < 0.35:
        _add_wing(rng, sketch, extent_m)
    if rng.random() < 0.35:
        _distort(rng, sketch, extent_m)
    openings, leaves, before_doors = _doors(rng, sketch)
    standing = sketch.solids + leaves
    keep_clear = united(before_doors + [leaf.buffer(0.1) for leaf in leaves]) if before_doors else None
    fullness = rng.choice(4, p=[0.12, 0.26, 0.34, 0.28])
    for floor in sketch.floors:
        standing += furniture.furnish(rng, floor.polygon, _fullness(rng, floor, fullness), keep_clear)
    space = united([floor.polygon for floor in sketch.floors] + openings)
    walls = without(grown(space, sketch.outer_wall_m), space)
    panes, walls = _windows(rng, sketch, space, walls)
    standing += _outdoors(rng, space) if panes else []
    plan = FloorPlan(sketch.floors, np.array(parts(walls) + standing, dtype=object), np.array(panes, dtype=object))
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


def _doors(rng, sketch: Sketch):
    """Doors between neighbouring floors.

    Returns the openings cut through the walls, the leaves (shut ones fill their opening, open ones stand at an angle),
    and what furniture must leave free.
    """
    reach_m = sketch.wall_m * 1.3 + 0.05
    polygons = np.array([floor.polygon for floor in sketch.floors])
    tree = shapely.STRtree(polygons)
    mostly_open, openings, leaves, clear = rng.uniform(0.35, 0.9), [], [], []
    for i, floor in enumerate(sketch.floors):
        for j in sorted(tree.query(floor.polygon.buffer(reach_m))):
            if j <= i:
                continue
            kinds = {floor.kind, sketch.floors[j].kind}
            if rng.random() > (0.2 if kinds == {"room"} else 0.95):
                continue
            shared = _segments_facing(polygons[j], floor.polygon, reach_m)
            for _ in range(1 if rng.random() < 0.85 else 2):
                width_m = rng.uniform(0.85, 1.1) if rng.random() < 0.8 else rng.uniform(1.2, 2.2)
                long = [ends for ends in shared if np.linalg.norm(ends[1] - ends[0]) > width_m + 0.1]
                if long:
                    _hang_door(
                        rng,
                        long[rng.integers(len(long))],
                        width_m,
                        reach_m,
                        (polygons[j], np.delete(polygons, j)),
                        rng.random() < mostly_open,
                        openings,
                        leaves,
                        clear,
                    )
    return openings, leaves, clear


def _segments_facing(polygon, other, reach_m: float) -> list[np.ndarray]:
    """(2, 2) pieces of `polygon`'s outline within `reach_m` of `other`, clockwise: `polygon` lies on their right."""
    corners = shapely.get_coordinates(shapely.normalize(polygon).exterior)
    near = grown(other, reach_m)
    pieces = []
    for start, end in zip(corners[:-1], corners[1:], strict=True):
        inside = shapely.get_coordinates(near.intersection(shapely.LineString([start, end])))
        if len(inside) == 2:
            pieces.append(inside if (inside[1] - inside[0]) @ (end - start) > 0 else inside[::-1])
    return pieces


def _hang_door(rng, ends, width_m, reach_m, floors, is_open, openings, leaves, clear) -> None:
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    angle = np.arctan2(along[1], along[0])
    outward = np.array([-along[1], along[0]])
    slack_m = np.linalg.norm(ends[1] - ends[0]) - width_m
    # Doors stand at a room's end more often than in its middle.
    share = rng.choice([rng.uniform(0, 0.15), rng.uniform(0.85, 1), rng.random()])
    middle = ends[0] + (share * slack_m + width_m / 2) * along
    openings.append(box(middle + outward * reach_m / 2, angle, width_m, reach_m + 0.04))
    clear.append(box(middle + outward * reach_m / 2, angle, width_m, reach_m + 1.4))
    leaf_m = 0.04
    if not is_open:
        # The wall is as thick as the nearest other floor is away. Where a passage runs into a floor there is none.
        here, others = floors
        half = along * (width_m / 2 + 0.01)
        sill = shapely.LineString([middle - half, middle + half])
        wall_m = shapely.distance(others, sill).min()
        leaf = box(middle + outward * rng.uniform(leaf_m / 2, max(leaf_m, wall_m) - leaf_m / 2), angle, width_m + 0.02, leaf_m)
        if wall_m >= leaf_m and not here.intersects(leaf.buffer(-SNAP_M)):
            leaves.append(leaf)
    elif rng.random() < 0.65:
        hinge_end = rng.choice([-1, 1])
        hinge = middle + hinge_end * along * (width_m / 2 - leaf_m / 2)
        swing = np.pi / 2 * rng.uniform(0.7, 1.5)  # into the room, which lies to the right of `along`
        direction = turned(-hinge_end * along, hinge_end * swing)
        leaves.append(box(hinge + direction * width_m / 2, np.arctan2(direction[1], direction[0]), width_m, leaf_m))


def _windows(rng, sketch: Sketch, space, walls):
    """Panes in outer walls, low enough for the laser: none in half of the buildings, a whole front in a few."""
    share = rng.choice([0.0, rng.uniform(0.02, 0.15), rng.uniform(0.2, 0.6)], p=[0.5, 0.35, 0.15])
    if share == 0:
        return [], walls
    outlines = [shapely.get_coordinates(part.exterior) for part in parts(space)]
    starts, steps = (np.concatenate(ends) for ends in ([o[:-1] for o in outlines], [np.diff(o, axis=0) for o in outlines]))
    lengths = np.linalg.norm(steps, axis=1)
    across = turned(steps, np.pi / 2) / lengths[:, None] * max(2 * sketch.outer_wall_m + 0.2, sketch.wall_m + 0.1)
    along = starts + np.array([0.25, 0.5, 0.75])[:, None, None] * steps
    left, right = (shapely.contains_xy(space, *np.moveaxis(along + side, -1, 0)) for side in (across, -across))
    inner = (left & right).any(axis=0)  # floors on both sides
    chosen = (lengths > 1.5) & (rng.random(len(lengths)) < share) & ~inner
    if not chosen.any():
        return [], walls
    size_m = np.minimum(rng.uniform(0.8, 12.0, chosen.sum()), lengths[chosen] - 0.4)
    centres = starts[chosen] + steps[chosen] / 2
    angles = np.arctan2(steps[chosen, 1], steps[chosen, 0])
    holes = boxes(centres, angles, size_m, 2 * sketch.outer_wall_m + 0.2)
    glass = shapely.intersection(boxes(centres, angles, size_m, 0.06), walls, grid_size=SNAP_M)
    frames = boxes(
        np.concatenate([centres - steps[chosen] * (k * size_m / lengths[chosen])[:, None] for k in (-0.25, 0.25)]),
        np.tile(angles, 2),
        0.08,
        0.12,
    )
    cut = without(walls, united(holes))
    return [p for g in glass for p in parts(g)], united([cut, *[f for f in frames if rng.random() < 0.5]])


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

    def turn(geometry):
        return shapely.transform(geometry, lambda xy: turned(xy, angle_rad))

    return FloorPlan(
        [Floor(turn(f.polygon), f.kind) for f in plan.floors],
        turn(plan.solids),
        turn(plan.glass) if len(plan.glass) else plan.glass,
    )
