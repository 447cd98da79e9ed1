"""Houses: fronts with windows and doors set back in them, bays, plinths, steps, roofs; garages and halls.

A house stands with its front along x from the origin; the street is at y < 0 and the house at y > 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hilbertvae.simulate.soup import Soup, Surface, boxes_3d, joined, quads, soup, tubes

FOOT_M = -1.5
"""Walls go on below ground, so that no gap opens on a slope."""


@dataclass(frozen=True)
class Front:
    """One front. columns of openings, a width each; storeys and their height; how far panes lie back; from which height they begin.

    shop: the ground floor's openings begin low and are wide. doors: numbers of the columns that are doors on the ground floor.
    """

    width_m: float
    storeys: int
    columns: int
    opening_m: float = 1.2
    storey_m: float = 2.9
    sill_m: float = 0.9
    recess_m: float = 0.15
    shop: bool = False
    doors: tuple[int, ...] = ()
    shutters: float = 0.15


def front_soup(rng: np.random.Generator, front: Front) -> Soup:
    """The front in the plane y = 0 seen from y < 0; panes lie at y = recess."""
    height = front.storeys * front.storey_m
    if front.columns == 0:
        return _panel([[0, front.width_m]], [[FOOT_M, height + 0.3]], 0.0, Surface.WALL)
    opening = min(front.opening_m, 0.75 * front.width_m / front.columns)
    middles = (np.arange(front.columns) + 0.5) * front.width_m / front.columns
    parts = []
    for storey in range(front.storeys):
        floor = storey * front.storey_m
        ground = storey == 0
        half = 0.42 * front.width_m / front.columns if ground and front.shop else opening / 2
        left, right = middles - half, middles + half
        sill = np.full(front.columns, floor + (0.35 if ground and front.shop else front.sill_m))
        top = np.full(front.columns, floor + min(2.35, front.storey_m - 0.35))
        is_door = np.isin(np.arange(front.columns), front.doors) & ground
        sill[is_door] = 0.02
        parts.append(_openings(rng, left, right, sill, top, front, is_door))
        # Piers between the openings, and what is below and above each.
        low = FOOT_M if ground else floor
        edges = np.concatenate([[0], np.stack([left, right], -1).ravel(), [front.width_m]]).reshape(-1, 2)
        parts.append(_panel(edges, np.broadcast_to([low, floor + front.storey_m], edges.shape), 0.0, Surface.WALL))
        across = np.stack([left, right], -1)
        parts.append(_panel(across, np.stack([np.full_like(sill, low), sill], -1), 0.0, Surface.WALL))
        parts.append(_panel(across, np.stack([top, np.full_like(top, floor + front.storey_m)], -1), 0.0, Surface.WALL))
    parts.append(_panel([[0, front.width_m]], [[height, height + 0.3]], 0.0, Surface.WALL))
    return joined(parts)


def _panel(x: np.ndarray, z: np.ndarray, y, kind) -> Soup:
    """Upright rectangles: x and z are (K, 2) from and to, y is a depth for all or each."""
    x, z = np.asarray(x, dtype=float), np.asarray(z, dtype=float)
    y = np.broadcast_to(y, len(x))
    return quads(np.stack([np.stack([x[:, i], y, z[:, j]], -1) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))], axis=1), kind)


def _openings(rng, left, right, sill, top, front: Front, is_door) -> Soup:
    """Panes or door leaves at the back of their reveals, sills, and shutters or curtains in some."""
    back = np.where(is_door, front.recess_m + 0.12, front.recess_m)
    shut = rng.random(len(left)) < front.shutters
    coated = rng.random() < 0.4
    panes = np.where(rng.random(len(left)) < 0.85, Surface.GLASS if coated else Surface.PANE, Surface.PANE if coated else Surface.GLASS)
    kinds = np.where(shut | is_door & (rng.random(len(left)) < 0.7), Surface.WALL, panes)
    corners = [(left, sill), (right, sill), (right, top), (left, top)]
    reveals = []
    for (x0, z0), (x1, z1) in zip(corners, corners[1:] + corners[:1], strict=True):
        reveals.append(
            np.stack([np.stack([x, y, z], -1) for x, y, z in ((x0, 0 * back, z0), (x1, 0 * back, z1), (x1, back, z1), (x0, back, z0))], 1)
        )
    parts = [
        _panel(np.stack([left, right], -1), np.stack([sill, top], -1), back, kinds),
        quads(np.concatenate(reveals), Surface.WALL),
    ]
    curtain = ~is_door & (rng.random(len(left)) < 0.6)
    if curtain.any():
        depth = (back + rng.choice([0.12, 0.3, 2.5], len(back), p=[0.5, 0.3, 0.2]))[curtain]
        parts.append(_panel(np.stack([left, right], -1)[curtain], np.stack([sill, top], -1)[curtain], depth, Surface.CLOTH))
    glazed = kinds != Surface.WALL
    if glazed.any():
        bar, z = (left + right)[glazed] / 2, np.stack([sill, top], -1)[glazed]
        parts.append(_panel(np.stack([bar - 0.05, bar + 0.05], -1), z, back[glazed] - 0.02, Surface.WALL))
    ledge = ~is_door
    feet = np.stack([(left + right) / 2, 0 * back - 0.04, sill - 0.05], -1)[ledge]
    parts.append(boxes_3d(feet, np.stack([right - left + 0.1, 0 * back + 0.12, 0 * back + 0.05], -1)[ledge]) if ledge.any() else joined([]))
    return joined(parts)


def draw_house(rng: np.random.Generator, width_m: float, depth_m: float, storeys: int, shop: bool = False, roof: str | None = None) -> Soup:
    """A house with a front to the street, plainer sides and a blind back, some with bays, steps, down pipes or balconies."""
    columns = max(int(width_m / rng.uniform(2.2, 3.6)), 1)
    storey = rng.uniform(2.6, 3.4) + (0.6 if shop else 0)
    doors = tuple(rng.choice(columns, min(columns, 1 + int(width_m > 14)), replace=False).tolist())
    look = {
        "storey_m": storey,
        "opening_m": rng.uniform(0.9, 1.7),
        "sill_m": rng.uniform(0.7, 1.3),
        "recess_m": rng.choice([0.06, 0.12, 0.2, 0.3]),
        "shutters": rng.choice([0.05, 0.2, 0.5]),
    }
    front = front_soup(rng, Front(width_m, storeys, columns, shop=shop, doors=doors, **look))
    flank = Front(depth_m, storeys, int(rng.integers(0, 3)), **look)
    parts = [
        front,
        front_soup(rng, flank).moved([width_m, 0, 0], np.pi / 2),
        front_soup(rng, flank).moved([0, depth_m, 0], -np.pi / 2),
        front_soup(rng, Front(width_m, storeys, 0, **look)).moved([width_m, depth_m, 0], np.pi),
        roof_soup(width_m, depth_m, storeys * storey + 0.3, roof or rng.choice(["eaves", "gable", "flat"], p=[0.5, 0.3, 0.2])),
        _details(rng, width_m, storeys, storey, (np.array(doors) + 0.5) * width_m / columns),
    ]
    return joined(parts)


def roof_soup(width_m: float, depth_m: float, height_m: float, kind: str) -> Soup:
    """A ridge along the street ("eaves") or across it ("gable"), or a flat roof."""
    if kind == "flat":
        return boxes_3d([width_m / 2, depth_m / 2, height_m], [width_m + 0.3, depth_m + 0.3, 0.3])
    across = kind == "gable"
    length, span = (depth_m, width_m) if across else (width_m, depth_m)
    ridge, over = height_m + 0.42 * span, 0.35
    x = np.array([-over, length + over])
    low = height_m - 0.42 * over
    slopes = [[[x[0], y, low], [x[1], y, low], [x[1], span / 2, ridge], [x[0], span / 2, ridge]] for y in (-over, span + over)]
    ends = [[[at, 0, height_m], [at, span, height_m], [at, span / 2, ridge]] for at in (0, length)]
    whole = joined([quads(slopes, Surface.WALL), soup(ends, Surface.WALL)])
    return whole.moved([width_m, 0, 0], np.pi / 2) if across else whole


def _details(rng, width_m: float, storeys: int, storey_m: float, doors: np.ndarray) -> Soup:
    """What stands out from a front: plinth, steps, canopies, down pipes, a bay, balconies, boxes on the wall."""
    parts = []
    if rng.random() < 0.5:
        parts.append(boxes_3d([width_m / 2, 0, FOOT_M], [width_m, 0.12, -FOOT_M + rng.uniform(0.2, 0.8)]))
    if rng.random() < 0.6:
        steps = rng.integers(1, 4)
        for step in range(steps):
            size = [1.5, 2 * (0.3 + 0.3 * (steps - step)), 0.16 * (step + 1) + 0.6]
            parts.append(boxes_3d(np.column_stack([doors, 0 * doors, 0 * doors - 0.6]), size))
    if rng.random() < 0.3:
        parts.append(boxes_3d(np.column_stack([doors, 0 * doors - 0.5, 0 * doors + 2.4]), [1.8, 1.0, 0.1]))
    pipes = np.array([0.15, width_m - 0.15])[: rng.integers(0, 3)]
    if len(pipes):
        low = np.column_stack([pipes, 0 * pipes - 0.1, 0 * pipes])
        parts.append(tubes(low, low + [0, 0, storeys * storey_m], 0.06, 0.06, 6))
    if rng.random() < 0.35 and width_m > 6:
        wide, out = rng.uniform(1.8, 3.2), rng.uniform(0.5, 1.1)
        left = rng.uniform(0.3, width_m - wide - 0.3)
        bay = Front(wide, max(1, storeys - 1), 1, 0.7 * wide, storey_m, 0.8, 0.06)
        slant = rng.choice([0.0, 0.6])
        parts.append(front_soup(rng, bay).moved([left, -out, 0]))
        for x0, x1 in ((left, left - slant), (left + wide, left + wide + slant)):
            parts.append(_upright([x0, -out], [x1, 0], FOOT_M, bay.storeys * storey_m))
        top = bay.storeys * storey_m
        lid = [[left - slant, 0, top], [left, -out, top], [left + wide, -out, top], [left + wide + slant, 0, top]]
        parts.append(quads(lid, Surface.WALL))
    if storeys > 1 and rng.random() < 0.35:
        count = int(rng.integers(1, 3))
        left = rng.uniform(0.5, max(width_m - 3.5, 0.6), count)
        level = storey_m * rng.integers(1, storeys, count)
        deep = rng.uniform(0.8, 1.5)
        parts.append(boxes_3d(np.column_stack([left + 1.5, 0 * left - deep / 2, level]), [3.0, deep, 0.18]))
        parts.append(_panel(np.stack([left, left + 3], -1), np.stack([level, level + 1.0], -1), -deep, Surface.NET))
    boxes = rng.integers(0, 3)
    if boxes:
        feet = np.column_stack([rng.uniform(0.3, width_m - 0.3, boxes), np.full(boxes, -0.1), rng.uniform(0.4, 1.6, boxes)])
        parts.append(boxes_3d(feet, np.column_stack([rng.uniform(0.2, 0.6, boxes), np.full(boxes, 0.2), rng.uniform(0.2, 0.7, boxes)])))
    return joined(parts)


def _upright(start, end, low: float, high: float) -> Soup:
    """A wall from start to end (2,)."""
    return quads([[*start, low], [*end, low], [*end, high], [*start, high]], Surface.WALL)


def draw_garage(rng: np.random.Generator) -> Soup:
    """A garage with a door set back in its front."""
    height, back = rng.uniform(2.3, 2.8), rng.uniform(0.05, 0.5)
    width_m, depth_m = 3.0, 5.5
    reveals = np.array([0.3, 0.3 + width_m - 0.6])  # to the last bit what sites of a seed have
    door = np.array([[0.0, 2.1]])
    edges = np.concatenate([[0], reveals, [width_m]]).reshape(-1, 2)
    jambs = np.stack(
        [np.stack([reveals, 0 * reveals + y, 0 * reveals + z], -1) for y, z in ((0, 0), (back, 0), (back, 2.1), (0, 2.1))], axis=1
    )
    return joined(
        [
            _panel(reveals[None], door, back, Surface.WALL),
            _panel(edges, np.broadcast_to([FOOT_M, height], edges.shape), 0.0, Surface.WALL),
            _panel(reveals[None], door * 0 + [2.1, height], 0.0, Surface.WALL),
            quads(jambs, Surface.WALL),
            *(
                _upright(a, b, FOOT_M, height)
                for a, b in (([0, 0], [0, depth_m]), ([width_m, 0], [width_m, depth_m]), ([0, depth_m], [width_m, depth_m]))
            ),
            boxes_3d([width_m / 2, depth_m / 2, height], [width_m + 0.2, depth_m + 0.2, 0.15]),
        ]
    )
