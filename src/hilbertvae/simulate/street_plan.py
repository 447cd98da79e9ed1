"""The plan of a street: carriageway, kerb lines, lots along them with their drives, side streets, an open place, a car park.

Plans are drawn straight, in (s, t): s metres along the street, t metres to its left; `terrain.StreetGround` bends them into the world.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from hilbertvae.simulate.kerb_lines import Line, Lot, draw_lots, lines_around, main_lines, ribbon, side_lines
from hilbertvae.simulate.shapes import united, without
from hilbertvae.simulate.terrain import StreetGround, strips

BEYOND_M = 85.0
"""How far the street goes on before and after the drive, and side streets to the side: about as far as lidars see."""
ENTRANCE_M = 6.0
"""How wide ways into car parks are."""
CORNER_M = 8.0
"""Of land beside a side street, or there is none."""


@dataclass(frozen=True)
class StreetPlan:
    """lane_t: of the lane that is driven, towards +s; other_t: of the oncoming one. extent, car_parks: boxes (s0, t0, s1, t1).

    island: s and radius in an open place of radius `ring_m`, or None. kept_free: before the car parks' entrances, where nobody parks.
    """

    character: str
    ground: StreetGround
    grass: shapely.Geometry
    extent: tuple[float, float, float, float]
    lines: list[Line]
    lots: list[Lot]
    lane_t: float
    other_t: float
    island: tuple[float, float] | None
    ring_m: float
    car_parks: np.ndarray
    kept_free: shapely.Geometry


def draw_street_plan(rng: np.random.Generator, character: str, drive_m: float, beyond_m: float = BEYOND_M) -> StreetPlan:
    """A random plan for a drive from s = 0 to s = drive_m, with land for `beyond_m` around it."""
    beyond_m = max(beyond_m, 25.0)
    low, high = -beyond_m, drive_m + beyond_m
    wide = character == "avenue"
    lane = rng.uniform(2.6, 3.5) * (2 if wide else 1)
    parking = {"residential": (0.3, 0.45, 0.1, 0.15), "town": (0.25, 0.5, 0.2, 0.05), "avenue": (0.7, 0.25, 0.05, 0)}.get(
        character, (0.85, 0.15, 0, 0)
    )
    modes = rng.choice(["none", "along", "across", "on kerb"], 2, p=parking)
    widths = [lane + {"along": 2.1, "across": 4.9}.get(mode, 0.2) for mode in modes]  # right, left
    pavements = rng.uniform(1.0, 2.8, 2) + rng.uniform(0, 1, 2) * {"town": 2.5, "avenue": 7.0}.get(character, 0.0)
    driven = rng.choice([-1, 1], p=[0.75, 0.25])  # some countries drive on the left
    mouths, side_streets = _side_streets(rng, drive_m, low, high)
    boxes = [(low, -widths[0], high, widths[1])]
    for s, side, half in side_streets:
        boxes.append((s - half, 0 if side > 0 else -beyond_m, s + half, beyond_m if side > 0 else 0))
    island, ring = None, 0.0
    if not side_streets and rng.random() < 0.2:
        island = (rng.uniform(-10, 25), rng.uniform(2.5, 9.0))
        ring = max(island[1] + rng.uniform(5.5, 8.5), max(widths) + 2)
        mouths = [[(island[0] - ring - 1, island[0] + ring + 1)]] * 2
    car_parks = _car_parks(rng, character, widths, pavements, mouths)
    road = strips([*boxes, *car_parks, *_entrances(car_parks)])
    road = _rounded(road)
    if island:
        road = without(united([road, shapely.Point(island[0], 0).buffer(ring)]), shapely.Point(island[0], 0).buffer(island[1]))

    fullness = rng.uniform(0.3, 1.0)
    lines = main_lines(low, high, widths, pavements, modes, fullness, mouths)
    for s, side, half in side_streets:
        lines += side_lines(rng, s, side, half, widths[1] if side > 0 else widths[0], fullness, beyond_m)
    if island:
        lines += lines_around(rng, island[0], ring, widths)
    lots = [lot for line in lines for lot in draw_lots(rng, line, character, car_parks)]
    extent = (low, -beyond_m, high, beyond_m)
    ground = _draw_ground(rng, character, road, widths, pavements, lots)
    lane_t = driven * lane * (rng.choice([0.27, 0.75]) if wide else 0.5)
    grass = _grass(rng, road, lines, lots, island)
    kept_free = without(strips(_entrances(car_parks)), strips(car_parks))
    return StreetPlan(character, ground, grass, extent, lines, lots, lane_t, -driven * lane * 0.5, island, ring, car_parks, kept_free)


def _side_streets(rng, drive_m: float, low: float, high: float):
    """Mouths by side (right, left) as intervals of s, and streets as (s, side, half width): those whose corners have land."""
    streets = []
    if rng.random() < 0.5:
        s, half = rng.uniform(-25, drive_m + 30), rng.uniform(2.6, 4.5)
        for side in rng.choice([-1, 1], 2, replace=False)[: rng.integers(1, 3)]:
            streets.append((s, int(side), half))
    if rng.random() < 0.3:
        streets.append((rng.uniform(drive_m + 38, drive_m + 60), int(rng.choice([-1, 1])), rng.uniform(2.6, 4.0)))
    streets = [(s, side, half) for s, side, half in streets if low + half + CORNER_M < s < high - half - CORNER_M]
    mouths = [[(s - half, s + half) for s, side, half in streets if side == wanted] for wanted in (-1, 1)]
    return mouths, streets


def _car_parks(rng, character: str, widths, pavements, mouths) -> np.ndarray:
    """(K, 4) boxes s0, t0, s1, t1."""
    if rng.random() > (0.08 if character == "park" else 0.25):
        return np.empty((0, 4))
    side, s, length, deep = rng.integers(2), rng.uniform(-20, 15), rng.uniform(20, 45), rng.uniform(15, 32)
    if any(a < s + length + 6 and s - 6 < b for a, b in mouths[side]):
        return np.empty((0, 4))
    near = widths[side] + pavements[side]
    low, high = (near, near + deep) if side else (-near - deep, -near)
    return np.array([[s, low, s + length, high]])


def _entrances(car_parks: np.ndarray):
    return [(s0 + 3, min(t0, 0), s0 + 3 + ENTRANCE_M, max(t1, 0)) for s0, t0, _, t1 in car_parks]


def _rounded(road: shapely.Geometry) -> shapely.Geometry:
    """Inner corners of the carriageway as arcs, as kerbs turn at junctions."""
    return road.buffer(3.0, quad_segs=4).buffer(-3.0, quad_segs=4)


def _grass(rng, road, lines, lots, island) -> shapely.Geometry:
    """Gardens and lawns, and verges between some pavements and the road."""
    soft = []
    verges = rng.random() < 0.35
    for line in lines:
        if verges and line.main:
            soft.append(ribbon(line, 0, line.length_m, 0.15, 0.45 * line.pavement_m))
        if line.pavement_m and rng.random() < 0.05:
            soft.append(ribbon(line, 0, line.length_m, 0.15, line.pavement_m))
    soft += [
        ribbon(lot.line, lot.x_m, lot.x_m + lot.width_m, lot.line.pavement_m if lot.style != "open" else 0.3, 40.0)
        for lot in lots
        if lot.style in ("detached", "apartments", "green", "open")
    ]
    hard = [ribbon(lot.line, lot.x_m + lot.drive_m - 1.5, lot.x_m + lot.drive_m + 1.5, 0, 14) for lot in lots if lot.drive_m is not None]
    if island:
        soft.append(shapely.Point(island[0], 0).buffer(island[1]))
    if not soft:
        return shapely.Polygon()
    return without(without(united(soft), road), united(hard)) if hard else without(united(soft), road)


def _draw_ground(rng, character, road, widths, pavements, lots) -> StreetGround:
    drives = [(*lot.line.at(lot.x_m + lot.drive_m, 0.0), 1.6) for lot in lots if lot.drive_m is not None]
    waves = [(rng.normal(0, 1 / length), rng.normal(0, 1 / length), rng.uniform(0, 6), rng.normal(0, size)) for length, size in
             ((25, 0.12), (12, 0.04), (5, 0.012), (2.5, 0.005), (1.2, 0.003))]  # fmt: skip
    banks = rng.normal(0, 0.04, 2) + (rng.random(2) < 0.25) * rng.normal(0, 0.15, 2)
    kerb = rng.uniform(0.0, 0.06) if character == "park" else rng.choice([rng.uniform(0.09, 0.16), 0.03], p=[0.88, 0.12])
    return StreetGround(
        float(rng.choice([0.0, rng.uniform(-1 / 160, 1 / 160)], p=[0.4, 0.6])),
        float(np.clip(rng.normal(0, 0.015), -0.06, 0.06)),
        float(np.clip(rng.normal(0, 0.01), -0.03, 0.03)),
        float(rng.uniform(0.0, 0.025)),
        float(max(widths) + max(pavements)),
        (float(banks[0]), float(banks[1])),
        np.array(waves),
        road,
        float(kerb),
        np.array(drives, dtype=float).reshape(-1, 3),
    )
