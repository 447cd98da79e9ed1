"""A street plan filled: its lots and kerbs, car parks, an island, what lies behind, and traffic."""

from __future__ import annotations

import numpy as np

from hilbertvae.simulate.facades import draw_house
from hilbertvae.simulate.kerb_lines import Line
from hilbertvae.simulate.kerbside import line_pavement, park
from hilbertvae.simulate.people import draw_bicycle
from hilbertvae.simulate.street_furniture import draw_sign
from hilbertvae.simulate.street_lots import LOT_BUILDERS, enclose, plant
from hilbertvae.simulate.street_plan import StreetPlan
from hilbertvae.simulate.street_scene import Mover, Scene, Thing
from hilbertvae.simulate.vehicles import draw_vehicle


def fill(rng: np.random.Generator, plan: StreetPlan, drive_m: float) -> Scene:
    """A scene for `plan`."""
    scene = Scene(plan, drive_m, bare_trees=rng.random() < 0.2)
    for lot in plan.lots:
        LOT_BUILDERS[lot.style](rng, scene, lot)
    tree_gap = rng.uniform(7, 16) if rng.random() < 0.45 else np.inf
    for line in plan.lines:
        line_pavement(rng, scene, line, tree_gap)
        park(rng, scene, line)
    for car_park in plan.car_parks:
        _fill_car_park(rng, scene, car_park)
    if plan.island:
        _fill_island(rng, scene)
    if rng.random() < (0.35 if plan.character == "avenue" else 0.65):
        _behind(rng, scene)
    return scene


def _fill_car_park(rng, scene: Scene, box: np.ndarray) -> None:
    """Single rows of parked cars, evenly 8.2 m apart: a lane lies before each of them."""
    s0, t0, s1, t1 = box
    full = rng.uniform(0.3, 0.95)
    rows = np.arange(t0 + 2.6, t1 - 2, 8.2)
    if t1 < 0:
        rows = t0 + t1 - rows
    for row in rows:
        for s in np.arange(s0 + (10.5 if abs(row) < abs(t0 + t1) / 2 else 1.5), s1 - 1.2, 2.6):
            if rng.random() < full:
                car, length, _ = draw_vehicle(rng)
                if length < 5.5:
                    angle = rng.choice([-1, 1]) * np.pi / 2 + rng.normal(0, 0.03)
                    scene.put(Thing("vehicle", car, float(s + rng.normal(0, 0.1)), float(row + rng.normal(0, 0.2)), float(angle), True))
    line = Line((s0, t1), 0.0, s1 - s0, 0.0) if t1 > 0 else Line((s1, t0), np.pi, s1 - s0, 0.0)
    enclose(rng, scene, line, 0, line.length_m, 0.3, [])
    plant(rng, scene, line, (0, line.length_m), (1.5, 6.0), rng.poisson(6), 0.5)


def _fill_island(rng, scene: Scene) -> None:
    s, radius = scene.plan.island
    line = Line((s, 0.0), 0.0, 1.0, 0.0)
    inner = 0.6 * radius
    plant(rng, scene, line, (-inner, inner), (-inner, inner), rng.poisson(0.5 * radius), 0.3)
    for way in rng.uniform(0, 6.28, 3):
        scene.add("sign", draw_sign(rng), line, (radius - 0.6) * np.cos(way), (radius - 0.6) * np.sin(way), way)


def _behind(rng, scene: Scene) -> None:
    """Houses and trees of the next streets, seen through gaps."""
    for side in (-1, 1):
        low, _, high, land = scene.plan.extent
        line = Line((low + 15, 0.0), 0.0, 1, 0) if side > 0 else Line((high - 15, 0.0), np.pi, 1, 0)
        length, x = high - low - 30, 0.0
        while x < length and land > 60:
            width, y = rng.uniform(9, 18), rng.uniform(34, 48)
            if rng.random() < 0.5 and scene.plan.character != "park":
                scene.add("house", draw_house(rng, width, rng.uniform(8, 12), int(rng.integers(2, 5))), line, x, y, rng.normal(0, 0.1))
            else:
                plant(rng, scene, line, (x, x + width), (y - 5, y + 8), 2, 0.8)
            x += width + rng.uniform(1, 8)


def add_traffic(rng: np.random.Generator, scene: Scene, step_m: float, lane_s: np.ndarray) -> None:
    """Vehicles and cyclists that drive, ahead, behind and towards; `lane_s` are the places of the sensor, kept clear."""
    plan = scene.plan
    if plan.island:
        return
    for lane, way, last in ((plan.lane_t, 1, 65.0), (plan.other_t, -1, 65.0 + 2 * lane_s[-1])):
        places = np.arange(-45, last, 11.0)
        step = step_m * (rng.uniform(0.9, 1.1) if way > 0 else rng.uniform(0.6, 1.4))  # one of all, or they would drive through each other
        for s in rng.choice(places, min(rng.poisson(0.12 * len(places)), len(places) // 2), replace=False) + rng.uniform(-1, 1):
            vehicle, length, _ = draw_vehicle(rng)
            gap = s + np.arange(len(lane_s)) * step * way - lane_s
            if way < 0 or np.abs(gap).min() > length / 2 + 6:
                thing = Thing("vehicle", vehicle, float(s), float(lane + rng.normal(0, 0.1)), 0.0 if way > 0 else np.pi, True)
                scene.movers.append(Mover(thing, step))
    for _ in range(rng.poisson(0.4)):
        way = rng.choice([-1, 1])
        edge = (plan.lane_t if way > 0 else plan.other_t) + np.sign(plan.lane_t * way) * 0.75
        s = rng.uniform(5, 40)
        if way < 0 or np.abs(s + 0.5 * step_m * np.arange(len(lane_s)) - lane_s).min() > 4:
            thing = Thing("cyclist", draw_bicycle(rng), float(s), float(edge), 0.0 if way > 0 else np.pi)
            scene.movers.append(Mover(thing, 0.5 * step_m))
