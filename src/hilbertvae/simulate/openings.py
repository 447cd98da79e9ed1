"""Openings in a building's walls: doors between its floors, shut or open, and windows in its outer walls."""

from __future__ import annotations

import numpy as np
import shapely

from hilbertvae.simulate.layouts import Sketch
from hilbertvae.simulate.shapes import SNAP_M, box, boxes, common, grown, parts, turned, united, without


def draw_doors(rng, sketch: Sketch):
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


def draw_windows(rng, sketch: Sketch, space, walls):
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
    panes = [*glass, _panes_at_corners(space, walls, united(holes), united(glass))]
    return [p for g in panes for p in parts(g)], united([cut, *[f for f in frames if rng.random() < 0.5]])


def _panes_at_corners(space, walls, holes, glass):
    """What of `holes` opens another wall than its own, as at inner corners, is a pane, too: else that floor would lie outdoors."""
    opened = shapely.intersection(shapely.boundary(space), holes, grid_size=SNAP_M)
    return without(common(shapely.buffer(opened, 0.03, cap_style="flat"), walls), glass)
