"""What stands and walks along a kerb: parked vehicles, poles, signs, bins, street trees, people."""

from __future__ import annotations

import numpy as np

from hilbertvae.simulate.kerb_lines import Line
from hilbertvae.simulate.people import draw_bicycle, draw_person
from hilbertvae.simulate.street_furniture import (
    draw_bench,
    draw_bin,
    draw_bollard,
    draw_box,
    draw_lamp_post,
    draw_shelter,
    draw_sign,
    draw_traffic_light,
)
from hilbertvae.simulate.street_scene import Mover, Scene, Thing
from hilbertvae.simulate.vegetation import draw_tree
from hilbertvae.simulate.vehicles import draw_vehicle


def park(rng, scene: Scene, line: Line) -> None:
    """Vehicles along a kerb, not before drives or entrances, and where poles leave room."""
    if line.parking == "none":
        return
    blocked = [lot.x_m + lot.drive_m for lot in scene.plan.lots if lot.line is line and lot.drive_m is not None]
    x = rng.uniform(0, 4)
    slant = rng.choice([np.pi / 2, np.deg2rad(60)])
    ways = rng.random()
    while x < line.length_m - 5:
        vehicle, length, width = draw_vehicle(rng)
        fits = {"across": length < 5.2, "along": width < 2.1}.get(line.parking, True)  # a lorry would stand in the lane
        if line.parking == "across":
            room = width + rng.uniform(0.7, 1.1)
            middle, y, turn = x + room / 2, -2.5, rng.choice([slant, slant + np.pi])
        else:
            room = length + rng.uniform(0.5, 1.6)
            y = -width / 2 - rng.uniform(0.1, 0.3) if line.parking == "along" else rng.uniform(0.0, 0.5) + width / 2 + 0.05
            middle, turn = x + room / 2, (np.pi if rng.random() < ways else 0.0)
        clear = fits and x + room < line.length_m and not any(abs(middle - drive) < room / 2 + 1.6 for drive in blocked)
        roomy = line.parking != "on kerb" or line.pavement_m > width + 0.6
        if clear and roomy and rng.random() < line.fullness:
            scene.add("vehicle", vehicle, line, middle, y + rng.normal(0, 0.06), turn + rng.normal(0, 0.02), draped=True)
        x += room


def line_pavement(rng, scene: Scene, line: Line, tree_gap: float) -> None:
    """Poles, bins, trees and people on a pavement."""
    drives = np.array([lot.x_m + lot.drive_m for lot in scene.plan.lots if lot.line is line and lot.drive_m is not None])

    def clear(x: float) -> bool:
        return not len(drives) or np.abs(drives - x).min() > 1.9

    def along(kind, draw, y, gap, turn=0.0, jitter=0.2):
        for x in np.arange(rng.uniform(0, min(gap, 60)), line.length_m, gap):
            x = x + rng.normal(0, jitter)
            if clear(x):
                soup = draw(rng)
                beside = np.abs(soup.triangles[..., 1]).max() if kind == "sign" else 0.0  # wide boards stand beside the road, not over it
                scene.add(kind, soup, line, x, max(y, beside), turn)

    near, back = rng.uniform(0.3, 0.6), line.pavement_m - 0.3
    pole_y = near if rng.random() < 0.8 else back
    along("lamp post", draw_lamp_post, pole_y, rng.uniform(20, 38))
    along("sign", draw_sign, near, rng.uniform(15, 50), rng.choice([0, np.pi]), 4)
    along("bin", draw_bin, back, rng.uniform(18, 70), 0.0, 5)
    along("box", draw_box, back, rng.uniform(30, 100), 0.0, 5)
    if rng.random() < 0.2:
        start = rng.uniform(0, max(line.length_m - 15, 1))
        for x in np.arange(start, min(start + rng.uniform(6, 25), line.length_m), rng.uniform(1.4, 2.5)):
            if clear(x):
                scene.add("bollard", draw_bollard(rng), line, x, near)
    if line.main and np.isfinite(tree_gap) and line.pavement_m > 1.6:
        for x in np.arange(rng.uniform(0, tree_gap), line.length_m, tree_gap):
            if clear(x):
                y = near + 0.3
                scene.add(
                    "tree", draw_tree(rng, scene.leaf_m(line, x, y), scene.bare_trees, beside_road=True), line, x, y, rng.uniform(0, 6)
                )
    if line.pavement_m > 2.4:
        along("bench", draw_bench, back - 0.3, rng.uniform(30, 120), 0.0, 5)
        if scene.plan.character in ("avenue", "town") and rng.random() < 0.25 and line.length_m > 20:
            scene.add("shelter", draw_shelter(rng), line, rng.uniform(5, line.length_m - 5), line.pavement_m - 1.7)
    if line.main and line.length_m < scene.plan.extent[2] - scene.plan.extent[0] - 1 and rng.random() < 0.5:
        for x, ahead in ((1.0, -1), (line.length_m - 1.0, 1)):
            scene.add("traffic light", draw_traffic_light(rng, ahead), line, x, near)
    busy = {"town": 0.06, "avenue": 0.03, "residential": 0.012, "park": 0.015}.get(scene.plan.character, 0.005)
    for x in rng.uniform(0, line.length_m, rng.poisson(busy * line.length_m)):
        y = rng.uniform(0.4, max(line.pavement_m - 0.4, 0.5))
        _walker(rng, scene, line, x, y)
    if rng.random() < 0.15 and line.pavement_m > 2:
        x0 = rng.uniform(0, line.length_m)
        for x in x0 + 0.7 * np.arange(rng.integers(1, 8)):
            scene.add("bicycle", draw_bicycle(rng, rider=False), line, x, back - 0.6, np.pi / 2 + rng.normal(0, 0.1))


def _walker(rng, scene: Scene, line: Line, x: float, y: float) -> None:
    walks = rng.random() < 0.75
    s, t = line.at(x, y)
    angle = line.angle_rad + rng.choice([0, np.pi]) + rng.normal(0, 0.1) if walks else rng.uniform(0, 6)
    thing = Thing("person", draw_person(rng, walks), float(s), float(t), float(angle))
    if walks:
        scene.send(Mover(thing, rng.uniform(0.1, 0.8)))
    else:
        scene.put(thing)
