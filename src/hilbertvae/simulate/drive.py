"""A drive through a building: goals in corridors and rooms, short paths with clearance between them, poses on the way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from hilbertvae.simulate.floor_plan import FloorPlan
from hilbertvae.simulate.free_space import FreeSpace

ROAD_CELL = 2
"""Paths run over every second cell of the free space's raster: four times fewer nodes."""


@dataclass(frozen=True)
class Roads:
    """A graph over free cells: nodes (N, 2) metres, and costs (N, N) sparse, metres made longer close to obstacles."""

    nodes: np.ndarray
    costs: sparse.csr_matrix


def find_roads(space: FreeSpace, clearance_m: float) -> Roads:
    """The largest connected part of the cells with at least `clearance_m`, each joined to its eight neighbours."""
    clearance = space.clearance_m[::ROAD_CELL, ::ROAD_CELL]
    labels, count = ndimage.label(clearance >= clearance_m, structure=np.ones((3, 3)))
    if count == 0:
        return Roads(np.empty((0, 2)), sparse.csr_matrix((0, 0)))
    open_cells = labels == 1 + np.argmax(np.bincount(labels.ravel())[1:])
    number = np.full(open_cells.shape, -1)
    number[open_cells] = np.arange(open_cells.sum())
    rows, columns, costs = [], [], []
    height, width = open_cells.shape
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        a = (slice(0, height - dy), slice(max(0, -dx), width - max(0, dx)))
        b = (slice(dy, height), slice(max(0, dx), width - max(0, -dx)))
        joined = open_cells[a] & open_cells[b]
        near = np.minimum(clearance[a], clearance[b])[joined]
        rows.append(number[a][joined])
        columns.append(number[b][joined])
        costs.append(np.hypot(dx, dy) * ROAD_CELL * space.cell_m * (1 + 0.4 / (near + 0.1)))
    rows, columns, costs = (np.concatenate(part) for part in (rows, columns, costs))
    size = int(open_cells.sum())
    graph = sparse.coo_matrix((np.tile(costs, 2), (np.append(rows, columns), np.append(columns, rows))), shape=(size, size))
    y, x = np.nonzero(open_cells)
    nodes = space.lower + space.cell_m * (np.stack([x, y], axis=-1) * ROAD_CELL + 0.5)
    return Roads(nodes, graph.tocsr())


def drive(rng: np.random.Generator, plan: FloorPlan, space: FreeSpace, clearance_m: float, length_m: float) -> np.ndarray:
    """(P, 2) float64 metres, the way in steps of a cell or so, about `length_m` long at most; empty if there is none."""
    roads = find_roads(space, clearance_m)
    if len(roads.nodes) < 2:
        return np.empty((0, 2))
    waiting = list(_goals(rng, plan, roads))
    returns = [waiting[0]] * int(rng.integers(0, 4))
    here = int(waiting.pop(rng.integers(len(waiting))))
    way, driven_m = [roads.nodes[here : here + 1]], 0.0
    while waiting and driven_m < length_m:
        cost, before = _reach_some(roads, here, waiting)
        order = np.argsort(cost[waiting])
        # The nearest goal next, mostly: drivers sweep a building, but leave things out and come back.
        pick = order[min(rng.geometric(0.75) - 1, np.isfinite(cost[waiting]).sum() - 1)]
        goal, leg = int(waiting.pop(pick)), []
        step = goal
        while step != here:
            leg.append(step)
            step = before[step]
        leg = roads.nodes[leg[::-1]]
        if len(leg):
            way.append(leg)
            driven_m += np.linalg.norm(np.diff(np.concatenate([way[-2][-1:], leg]), axis=0), axis=1).sum()
        here = goal
        if not waiting and returns:
            # A second look at what was seen first: maps of real buildings have walls seen twice.
            waiting.append(returns.pop())
            returns[:] = rng.choice(len(roads.nodes), len(returns)).tolist()
    return _smoothed(np.concatenate(way), space, clearance_m)


def _reach_some(roads: Roads, here: int, goals: list[int]):
    """Costs and predecessors from `here`, over just as wide a region as has a few of the goals in it."""
    limit = 20.0
    while True:
        cost, before = csgraph.dijkstra(roads.costs, indices=here, return_predecessors=True, limit=limit)
        found = np.isfinite(cost[goals]).sum()
        if found >= min(3, len(goals)) or limit > 1e4:
            return cost, before
        limit *= 2.5 if found == 0 else 4


def _goals(rng, plan: FloorPlan, roads: Roads) -> np.ndarray:
    """Nodes to visit: all over corridors and halls. Some rooms are driven through, some looked into, some passed by."""
    enters, looks_in = rng.uniform(0.1, 0.9), rng.uniform(0.1, 0.5)
    goals = []
    main = plan.floors[int(np.argmax([floor.polygon.area * (floor.kind != "room") for floor in plan.floors]))].polygon
    for floor in plan.floors:
        x0, y0, x1, y1 = floor.polygon.bounds
        near = np.flatnonzero(((roads.nodes >= [x0, y0]) & (roads.nodes <= [x1, y1])).all(axis=1))
        near = near[shapely.contains_xy(floor.polygon, roads.nodes[near])] if len(near) else near
        if len(near) == 0:
            continue
        if floor.kind != "room":
            goals.append(rng.choice(near, min(len(near), 1 + int(floor.polygon.area / 25))))
        elif rng.random() < enters:
            goals.append(rng.choice(near, min(len(near), rng.integers(1, 3))))
        elif rng.random() < looks_in:
            goals.append(near[[np.argmin(shapely.distance(main, shapely.points(roads.nodes[near])))]])
    return np.unique(np.concatenate(goals)) if goals else rng.choice(len(roads.nodes), 2)


def _smoothed(way: np.ndarray, space: FreeSpace, clearance_m: float) -> np.ndarray:
    """The way without a raster's corners: running means, kept only where they keep their clearance."""
    for width in (9, 5):
        mean = ndimage.uniform_filter1d(way, width, axis=0, mode="nearest")
        way = np.where((space.at(mean) >= clearance_m)[:, None], mean, way)
    return way


def poses_along(rng: np.random.Generator, way: np.ndarray, step_m: float, turn_deg: float, scans: int) -> np.ndarray:
    """(S, 3) x, y (metres) and heading (radians), one every `step_m` or `turn_deg` of heading, whichever comes first.

    Where the way turns sharply the robot turns on the spot, as real ones do.
    """
    steps = np.diff(way, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    moved = lengths > 1e-9
    place = np.concatenate([[0.0], np.cumsum(lengths[moved])])
    way = np.concatenate([way[:1], way[1:][moved]])
    heading = np.unwrap(np.arctan2(steps[moved, 1], steps[moved, 0]))
    wobble = ndimage.gaussian_filter1d(rng.normal(0, 0.5, len(heading)), 6) if len(heading) else heading
    heading = np.append(heading + wobble, heading[-1:]) if len(heading) else np.zeros(1)
    # Progress counts travel and turning in units of one scan; a fold of the way becomes scans at one place.
    progress = np.append(0.0, np.cumsum(np.hypot(np.diff(place) / step_m, np.diff(heading) / np.deg2rad(turn_deg))))
    at = np.arange(0.0, progress[-1] + 1e-9, 1.0)[:scans]
    return np.stack([np.interp(at, progress, values) for values in (way[:, 0], way[:, 1], heading)], axis=-1)
