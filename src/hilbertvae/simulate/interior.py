"""A floor of a building in space: walls up to ceilings, doors with lintels, windows with sills, and what stands and hangs there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely

from hilbertvae.simulate.ceilings import draw_ceiling
from hilbertvae.simulate.floor_plan import FloorPlan, draw_floor_plan
from hilbertvae.simulate.laser import extrude
from hilbertvae.simulate.layouts import Floor
from hilbertvae.simulate.room_filling import Piece, RoomFilling
from hilbertvae.simulate.shapes import SNAP_M, edges, grown, parts, without
from hilbertvae.simulate.soup import Soup, Surface, joined, soup

DOOR_M = 2.05
"""Height of doors and doorways."""
PILLAR_M2 = 1.0
"""A larger free-standing block is furniture, and ends below the ceiling more often than not."""


def draw_interior(rng: np.random.Generator, extent_m: float, style: str) -> tuple[FloorPlan, Soup]:
    """A furnished floor about `extent_m` long: its plan, in which what stands takes its place, and its surfaces, the ground at height 0."""
    filling = RoomFilling()
    plan = draw_floor_plan(rng, extent_m, style, filling)
    ceilings = _ceilings_m(rng, plan.floors)
    top = max(ceilings)
    plan, pieces = _fitting(plan, filling.pieces, ceilings)
    things = [piece.soup.moved(np.zeros(3), plan.turned_rad) for piece in pieces]
    above = [draw_ceiling(rng, floor.polygon, ceiling) for floor, ceiling in zip(plan.floors, ceilings, strict=True)]
    lids = [lid(floor.polygon, ceiling) for floor, ceiling in zip(plan.floors, ceilings, strict=True)]
    indoors = shapely.union_all([floor.polygon for floor in plan.floors], grid_size=SNAP_M)
    standing = [*_walls(rng, plan, top), *_lintels(plan, indoors, top), *_windows(rng, plan, indoors, top), *_outdoors(rng, plan)]
    return plan, joined([_ground(rng, plan), *standing, *lids, *above, *things])


def _ceilings_m(rng, floors: list[Floor]) -> list[float]:
    """How high each floor is. A wing's passage, which overlaps what it joins, is as high as that."""
    storey_m = rng.uniform(2.4, 3.3)
    heights = [_ceiling_m(rng, floor.kind, storey_m) for floor in floors]
    polygons = np.array([floor.polygon for floor in floors])
    for here, polygon in enumerate(polygons):
        joined_ones = [*np.flatnonzero(shapely.area(shapely.intersection(polygon, polygons[:here], grid_size=SNAP_M)) > 0.01), here]
        lowest = min(heights[k] for k in joined_ones)
        for k in joined_ones:
            heights[k] = lowest
    return heights


def _fitting(plan: FloorPlan, pieces: list[Piece], ceilings: list[float]) -> tuple[FloorPlan, list[Piece]]:
    """The plan and its pieces without those that stand in a pillar or a partition, or reach through their ceiling."""
    things = np.flatnonzero(plan.kinds == "thing")  # one of each piece that stands, in their order
    blocks = shapely.union_all(_of(plan, "block"), grid_size=SNAP_M)
    solid = iter(shapely.intersects(blocks, plan.solids[things]))
    kept = [not (piece.stands and next(solid)) and piece.top_m < ceilings[piece.floor] for piece in pieces]
    standing = np.array([keeps for piece, keeps in zip(pieces, kept, strict=True) if piece.stands], dtype=bool)
    left = np.delete(np.arange(len(plan.solids)), things[~standing])
    return replace(plan, solids=plan.solids[left], kinds=plan.kinds[left]), [p for p, keeps in zip(pieces, kept, strict=True) if keeps]


def _ceiling_m(rng, kind: str, storey_m: float) -> float:
    if kind == "hall" and rng.random() < 0.7:
        return storey_m + rng.uniform(0.5, 4.0)
    return max(2.2, storey_m - rng.choice([0.0, 0.25, 0.5])) if kind == "corridor" else storey_m


def sides(polygons, low_m: float, high_m: float, surface: Surface = Surface.WALL) -> Soup:
    """Upright faces over the edges of polygons."""
    vertices, faces = extrude(edges(polygons), low_m, high_m)
    return soup(vertices[faces], surface)


def lid(polygon: shapely.Geometry, height_m: float, surface: Surface = Surface.WALL) -> Soup:
    """A polygon's area as level triangles at a height, holes left open."""
    corners = shapely.get_coordinates(shapely.get_parts(shapely.constrained_delaunay_triangles(polygon)))
    triangles = corners.reshape(-1, 4, 2)[:, :3]
    return soup(np.concatenate([triangles, np.full((*triangles.shape[:2], 1), height_m)], axis=2), surface)


def prism(polygon: shapely.Geometry, low_m: float, high_m: float) -> Soup:
    """A polygon's sides, and lids above and below: wall."""
    return joined([sides([polygon], low_m, high_m), lid(polygon, low_m), lid(polygon, high_m)])


def _of(plan: FloorPlan, *kinds: str) -> np.ndarray:
    return plan.solids[np.isin(plan.kinds, kinds)]


def _walls(rng, plan: FloorPlan, top_m: float) -> list[Soup]:
    blocks = _of(plan, "block")
    low = rng.random(len(blocks)) < [0.7 if block.area > PILLAR_M2 else 0.1 for block in blocks]
    heights = np.where(low, rng.uniform(0.9, 2.2, len(blocks)), top_m)
    return [
        sides(_of(plan, "wall"), 0.0, top_m),
        *(prism(block, 0.0, height) for block, height in zip(blocks, heights, strict=True)),
        sides(_of(plan, "leaf"), 0.01, DOOR_M),
    ]


def _lintels(plan: FloorPlan, indoors: shapely.Geometry, top_m: float) -> list[Soup]:
    """What of a wall is above its doorways."""
    cut = shapely.get_parts(shapely.difference(plan.doorways, indoors, grid_size=SNAP_M))
    return [prism(piece, DOOR_M, top_m) for piece in cut if piece.geom_type == "Polygon" and piece.area > 0.01]


def _windows(rng, plan: FloorPlan, indoors: shapely.Geometry, top_m: float) -> list[Soup]:
    """Panes between a sill and a head; some reach the ground.

    Each is a closed polygon, so that a beam crosses two faces: in all 0.056 of the beams come back from it and 0.72 go through, where
    `surfaces.OPTICS` says 0.03 and 0.85 of one `PANE`, as houses have.
    """
    if len(plan.glass) == 0:
        return []
    sill, head = rng.choice([0.0, 0.3, 0.9, 1.0]), rng.uniform(1.9, 2.4)
    walls = [part for pane in plan.glass for part in parts(without(grown(pane, 0.08), indoors))]  # around panes, and not into rooms
    around = [prism(wall, low, high) for wall in walls for low, high in ((0.0, sill), (head, top_m)) if high > low]
    return [sides(plan.glass, sill, head, Surface.PANE), *around]


def _outdoors(rng, plan: FloorPlan) -> list[Soup]:
    return [prism(thing, 0.0, rng.uniform(0.5, 6.0)) for thing in _of(plan, "outdoors")]


def _ground(rng, plan: FloorPlan) -> Soup:
    bounds = np.array([solid.bounds for solid in plan.solids])
    land = shapely.box(*(bounds[:, :2].min(axis=0) - 5), *(bounds[:, 2:].max(axis=0) + 5))
    return lid(land, 0.0, rng.choice([Surface.WALL, Surface.ROAD, Surface.CLOTH]))
