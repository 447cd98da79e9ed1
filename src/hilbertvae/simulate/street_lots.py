"""Lots filled in: terraces, houses in gardens, blocks of flats, greens, works, open land."""

from __future__ import annotations

import numpy as np

from hilbertvae.simulate.facades import draw_garage, draw_house
from hilbertvae.simulate.kerb_lines import Line, Lot
from hilbertvae.simulate.soup import Soup
from hilbertvae.simulate.street_furniture import fence_soup, rail_soup, wall_soup
from hilbertvae.simulate.street_scene import Scene
from hilbertvae.simulate.vegetation import draw_bush, draw_grass, draw_tree, hedge_leaves
from hilbertvae.simulate.vehicles import draw_vehicle


def _terrace(rng, scene: Scene, lot: Lot) -> None:
    town = scene.plan.character in ("town", "avenue")
    house = draw_house(rng, lot.width_m, rng.uniform(8, 13), int(rng.integers(2, 6 if town else 4)), shop=bool(rng.random() < 0.35 * town),
                       roof=str(rng.choice(["eaves", "flat"])))  # fmt: skip
    y0 = lot.line.pavement_m
    back = rng.choice([0.0, rng.uniform(0.0, 0.6), rng.uniform(1.2, 3.0)], p=[0.35, 0.3, 0.35])
    scene.add("house", house, lot.line, lot.x_m, y0 + back)
    if back > 1:
        middle = lot.x_m + rng.uniform(0.2, 0.8) * lot.width_m
        enclose(rng, scene, lot.line, lot.x_m, lot.x_m + lot.width_m, y0 + 0.15, [(middle - 0.6, middle + 0.6)])
        plant(rng, scene, lot.line, (lot.x_m, lot.x_m + lot.width_m), (y0 + 0.5, y0 + back), rng.poisson(0.4 * lot.width_m), 0.08)


def _detached(rng, scene: Scene, lot: Lot) -> None:
    """A house in its garden, with a drive, a garage, and a hedge, wall or fence to the street."""
    line, y0 = lot.line, lot.line.pavement_m
    set_back = rng.uniform(1.5, 7.0)
    house_m = lot.width_m * rng.uniform(0.5, 0.75)
    on_left = lot.drive_m is not None and lot.drive_m < lot.width_m / 2
    if lot.drive_m is not None:  # a car's way beside the house, to the garage
        house_m = min(house_m, (lot.width_m - lot.drive_m if on_left else lot.drive_m) - 2.3)
    x = lot.x_m + (lot.width_m - house_m - 0.5 if on_left else 0.5)
    tilt = rng.choice([0.0, rng.normal(0, 0.15)])
    roof = str(rng.choice(["eaves", "gable"]))
    scene.add("house", draw_house(rng, house_m, rng.uniform(8, 11), int(rng.integers(1, 4)), roof=roof), line, x, y0 + set_back, tilt)
    gate = []
    if lot.drive_m is not None:
        gate = [(lot.drive_m - 1.6, lot.drive_m + 1.6)]
        if rng.random() < 0.6:
            scene.add("garage", draw_garage(rng), line, lot.x_m + lot.drive_m - 1.5, y0 + set_back + rng.uniform(-0.5, 3.5))
        if rng.random() < 0.5:
            car, length, _ = draw_vehicle(rng, rng.choice(["hatchback", "saloon", "estate", "suv", "small"]))
            way = rng.choice([-1, 1]) * np.pi / 2 + rng.normal(0, 0.05)
            scene.add("vehicle", car, line, lot.x_m + lot.drive_m, y0 + 0.6 + length / 2, way, draped=True)
    if rng.random() < 0.6:
        door = rng.uniform(0.3, 0.9) * lot.width_m
        gate.append((door - 0.6, door + 0.6))
    enclose(rng, scene, line, lot.x_m, lot.x_m + lot.width_m, y0 + 0.15, [(lot.x_m + a, lot.x_m + b) for a, b in gate])
    if rng.random() < 0.5:
        _across(rng, scene, line, lot.x_m, y0, set_back + rng.uniform(0, 12))
    low, high = 0.5, lot.width_m - 0.5
    if lot.drive_m is not None:  # none grow on the drive
        low, high = (lot.drive_m + 1.7, high) if on_left else (low, lot.drive_m - 1.7)
    plant(rng, scene, line, (lot.x_m + low, lot.x_m + high), (y0 + 0.8, y0 + set_back - 0.5), rng.poisson(6), 0.15)
    plant(rng, scene, line, (lot.x_m, lot.x_m + lot.width_m), (y0 + set_back + 12, y0 + set_back + 25), rng.poisson(2), 0.7)


def _apartments(rng, scene: Scene, lot: Lot) -> None:
    line, y0 = lot.line, lot.line.pavement_m
    set_back = rng.uniform(3, 14)
    block = draw_house(
        rng, lot.width_m - rng.uniform(1, 6), rng.uniform(10, 14), int(rng.integers(3, 8)), roof=str(rng.choice(["flat", "eaves"]))
    )
    scene.add("house", block, line, lot.x_m + 0.5, y0 + set_back)
    if rng.random() < 0.4:
        enclose(
            rng,
            scene,
            line,
            lot.x_m,
            lot.x_m + lot.width_m,
            y0 + 0.15,
            [(lot.x_m + lot.width_m / 2 - 1.5, lot.x_m + lot.width_m / 2 + 1.5)],
        )
    plant(rng, scene, line, (lot.x_m, lot.x_m + lot.width_m), (y0 + 1, y0 + set_back - 0.5), rng.poisson(5), 0.4)


def _green(rng, scene: Scene, lot: Lot) -> None:
    """Shrubs and trees: a loose park or a thicket, some behind a fence, hedge or rail."""
    line, y0, x1 = lot.line, lot.line.pavement_m, lot.x_m + lot.width_m
    if rng.random() < 0.35:
        enclose(rng, scene, line, lot.x_m, x1, y0 + 0.2, [])
    if rng.random() < 0.65:
        edge = rng.uniform(0.8, 5.0)
        count = int(lot.width_m * rng.uniform(0.5, 1.1))
        plant(rng, scene, line, (lot.x_m, x1), (y0 + edge, y0 + edge + 3), count, 0.12)
        plant(rng, scene, line, (lot.x_m, x1), (y0 + edge + 2, y0 + edge + 14), rng.poisson(0.25 * lot.width_m), 0.8)
    else:
        plant(rng, scene, line, (lot.x_m, x1), (y0 + 0.8, y0 + 25), rng.poisson(0.35 * lot.width_m), 0.65)
    tufts = np.column_stack([rng.uniform(0, lot.width_m, 300), rng.uniform(0.5, 10, 300), np.zeros(300)])
    scene.add("grass", draw_grass(rng, tufts), line, lot.x_m, y0, draped=True)


def _works(rng, scene: Scene, lot: Lot) -> None:
    line, y0 = lot.line, lot.line.pavement_m
    set_back = rng.uniform(4, 22)
    scene.add(
        "house",
        draw_house(rng, lot.width_m * rng.uniform(0.5, 0.9), rng.uniform(12, 20), int(rng.integers(1, 4)), roof="flat"),
        line,
        lot.x_m + 1,
        y0 + set_back,
    )
    gates = [(lot.x_m + lot.drive_m - 3, lot.x_m + lot.drive_m + 3)] if lot.drive_m is not None else []
    if rng.random() < 0.6:
        enclose(rng, scene, line, lot.x_m, lot.x_m + lot.width_m, y0 + 0.2, gates)
    if set_back > 7:
        for x in np.arange(lot.x_m + 3, lot.x_m + lot.width_m - 3, 2.7):
            if rng.random() < 0.4 and not any(a < x + 1.5 and x - 1.5 < b for a, b in gates):
                scene.add("vehicle", draw_vehicle(rng)[0], line, x, y0 + set_back - 3.6, rng.choice([-1, 1]) * np.pi / 2, draped=True)


def _open(rng, scene: Scene, lot: Lot) -> None:
    if rng.random() < 0.5:
        scene.add("rail", rail_soup(rng, lot.width_m), lot.line, lot.x_m, 0.6, draped=True)
    plant(rng, scene, lot.line, (lot.x_m, lot.x_m + lot.width_m), (3, 40), rng.poisson(0.15 * lot.width_m), 0.6)
    tufts = np.column_stack([rng.uniform(0, lot.width_m, 400), rng.uniform(1.0, 12, 400), np.zeros(400)])
    scene.add("grass", draw_grass(rng, tufts), lot.line, lot.x_m, 0.0, draped=True)


LOT_BUILDERS = {"terrace": _terrace, "detached": _detached, "apartments": _apartments, "green": _green, "works": _works, "open": _open}


def enclose(rng, scene: Scene, line: Line, x0: float, x1: float, y: float, gates) -> None:
    """A hedge, wall or fence from x0 to x1 with gaps at gates; or nothing."""
    kind = rng.choice(["hedge", "wall", "fence", "nothing"], p=[0.42, 0.27, 0.22, 0.09])
    if kind == "nothing":
        return
    height = {"hedge": rng.uniform(0.7, 2.2), "wall": rng.choice([rng.uniform(0.3, 1.2), rng.uniform(1.2, 2.2)], p=[0.7, 0.3])}.get(
        kind, rng.uniform(0.8, 1.8)
    )
    at = x0
    for a, b in [*sorted(gates), (x1, x1)]:
        if a - at > 0.6:
            piece = _barrier(rng, kind, a - at, height, scene.leaf_m(line, (a + at) / 2, y))
            scene.add(kind, piece, line, at, y + (0.35 if kind == "hedge" else 0.0), draped=True)
        at = max(at, b)


def _barrier(rng, kind: str, length: float, height: float, leaf_m: float) -> Soup:
    if kind == "hedge":
        return hedge_leaves(rng, length, rng.uniform(0.5, 1.0), height, leaf_m)
    return wall_soup(rng, length, height) if kind == "wall" else fence_soup(rng, length, height)


def _across(rng, scene: Scene, line: Line, x: float, y: float, length: float) -> None:
    """A barrier between two gardens."""
    kind = str(rng.choice(["hedge", "wall", "fence"], p=[0.4, 0.2, 0.4]))
    scene.add(
        kind, _barrier(rng, kind, length, rng.uniform(0.8, 1.9), scene.leaf_m(line, x, y + 4)), line, x, y + 0.2, np.pi / 2, draped=True
    )


def plant(rng, scene: Scene, line: Line, x_range, y_range, count: int, tree_share: float) -> None:
    """Bushes and trees scattered over part of a line's land."""
    if y_range[1] <= y_range[0] or x_range[1] <= x_range[0]:
        return
    for x, y in rng.uniform([x_range[0], y_range[0]], [x_range[1], y_range[1]], (count, 2)):
        leaf = scene.leaf_m(line, x, y)
        if rng.random() < tree_share:
            scene.add("tree", draw_tree(rng, leaf, scene.bare_trees), line, x, y, rng.uniform(0, 6))
        else:
            scene.add("bush", draw_bush(rng, leaf), line, x, y, rng.uniform(0, 6))
