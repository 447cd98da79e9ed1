"""What stands, hangs and lies in rooms, in space: pieces against walls and free ones, their backs at y = 0 and facing +y."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hilbertvae.simulate.people import draw_person
from hilbertvae.simulate.soup import Soup, Surface, boxes_3d, joined, tubes
from hilbertvae.simulate.vegetation import draw_bush

Draw = Callable[[np.random.Generator], Soup]
BOARD_M = 0.03


def _box(x: float, y: float, z: float, length: float, depth: float, height: float, surface=Surface.WALL) -> Soup:
    """A box whose underside's middle is (x, y, z)."""
    return boxes_3d([[x, y, z]], [length, depth, height], surface=surface)


def _legs(length: float, depth: float, height: float, thick: float, y: float = 0.0) -> Soup:
    """Four legs under a top that begins at `y`."""
    x = (length - thick) / 2
    feet = [[side * x, y + at, 0.0] for side in (-1, 1) for at in (thick / 2, depth - thick / 2)]
    return boxes_3d(feet, [thick, thick, height])


def draw_cabinet(rng: np.random.Generator) -> Soup:
    """A shut cabinet, chest or wardrobe, now and then with things on it."""
    length, depth, height = rng.uniform(0.5, 2.0), rng.uniform(0.35, 0.65), rng.choice([0.75, 1.1, 1.4, 1.9, 2.1]) * rng.uniform(0.95, 1.05)
    parts = [_box(0, depth / 2, 0, length, depth, height)]
    if rng.random() < 0.4:
        parts.append(_things(rng, length, depth, height))
    return joined(parts)


def draw_shelf(rng: np.random.Generator) -> Soup:
    """Boards between two sides, open in front and often behind, more or less filled."""
    length, depth, height = rng.uniform(0.8, 2.4), rng.uniform(0.25, 0.5), rng.uniform(1.2, 2.2)
    boards = np.linspace(0.05, height - BOARD_M, int(rng.integers(3, 7)))
    parts = [boxes_3d([[0, depth / 2, z] for z in boards], [length, depth, BOARD_M])]
    parts.append(boxes_3d([[side * length / 2, depth / 2, 0] for side in (-1, 1)], [BOARD_M, depth, height]))
    if rng.random() < 0.5:
        parts.append(_box(0, 0.01, 0, length, 0.02, height))
    for low, high in zip(boards[:-1], boards[1:], strict=True):
        if rng.random() < 0.7:  # a row of books or boxes
            part = rng.uniform(0.3, 1.0) * length
            tall = (high - low - BOARD_M) * rng.uniform(0.4, 0.95)
            parts.append(
                _box(rng.uniform(-1, 1) * (length - part) / 2, depth / 2, low + BOARD_M, part, depth * rng.uniform(0.5, 0.95), tall)
            )
    return joined(parts)


def draw_rack(rng: np.random.Generator) -> Soup:
    """A store's rack: posts, high boards and pallets of goods."""
    length, depth, height = rng.uniform(2.0, 6.0), rng.uniform(0.6, 1.1), rng.uniform(2.0, 4.5)
    boards = np.arange(0.15, height - 0.3, rng.uniform(0.7, 1.6))
    posts = [[x, y, 0] for x in np.linspace(-length / 2, length / 2, 2 + int(length // 3)) for y in (0.05, depth - 0.05)]
    parts = [boxes_3d(posts, [0.08, 0.08, height]), boxes_3d([[0, depth / 2, z] for z in boards], [length, depth, 0.06])]
    for board in boards:
        count = int(rng.integers(0, 1 + length // 0.9))
        feet = np.column_stack([rng.uniform(-0.45, 0.45, count) * length, np.full(count, depth / 2), np.full(count, board + 0.06)])
        parts.append(
            boxes_3d(feet, np.column_stack([rng.uniform(0.3, 0.9, count), np.full(count, 0.85 * depth), rng.uniform(0.2, 0.65, count)]))
        )
    return joined(parts)


def draw_desk(rng: np.random.Generator) -> Soup:
    """A top on legs or sides, screens and things on it, and mostly a chair in front."""
    length, depth, height = rng.uniform(1.0, 2.0), rng.uniform(0.6, 0.85), rng.uniform(0.7, 0.76)
    parts = [_box(0, depth / 2, height - BOARD_M, length, depth, BOARD_M)]
    if rng.random() < 0.5:
        parts.append(_legs(length, depth, height, 0.05))
    else:
        parts.append(boxes_3d([[side * (length / 2 - 0.02), depth / 2, 0] for side in (-1, 1)], [0.03, depth, height]))
    if rng.random() < 0.4:
        parts.append(_box(rng.choice([-1, 1]) * (length / 2 - 0.25), depth / 2, 0, 0.42, depth * 0.8, 0.6))
    screens = rng.integers(0, 3)
    x = np.linspace(-0.3, 0.3, screens) if screens > 1 else np.zeros(screens)
    parts.append(boxes_3d([[at, 0.2, height + 0.12] for at in x], [0.5, 0.04, 0.32], surface=Surface.DARK) if screens else joined([]))
    parts.append(_things(rng, length, depth, height))
    if rng.random() < 0.7:
        chair = draw_chair(rng)
        parts.append(chair.moved([rng.normal(0, 0.15), depth + rng.uniform(0.0, 0.45), 0], np.pi).moved([0, 0.25, 0]))
    return joined(parts)


def draw_kitchen(rng: np.random.Generator) -> Soup:
    """Counters, cupboards that hang above them, and mostly a fridge beside them."""
    length, depth = rng.uniform(1.5, 3.5), 0.62
    parts = [_box(0, depth / 2, 0, length, depth, 0.9), _box(0, 0.17, 1.4, length * rng.uniform(0.5, 1.0), 0.34, 0.7)]
    if rng.random() < 0.6:
        parts.append(_box(length / 2 + 0.32, depth / 2, 0, 0.62, depth, rng.uniform(1.4, 2.0)))
    return joined(parts + [_things(rng, length, depth, 0.9)])


def draw_radiator(rng: np.random.Generator) -> Soup:
    """A radiator on its wall, clear of the floor."""
    return _box(0, 0.09, 0.12, rng.uniform(0.6, 2.0), 0.1, rng.uniform(0.4, 0.6))


def draw_sofa(rng: np.random.Generator) -> Soup:
    """A seat, a back and two arms."""
    length, depth = rng.uniform(0.8, 2.2), rng.uniform(0.75, 0.95)
    arms = boxes_3d([[side * (length / 2 - 0.1), depth / 2, 0] for side in (-1, 1)], [0.18, depth, 0.6], surface=Surface.CLOTH)
    seat, back = _box(0, depth / 2, 0.05, length, depth, 0.37, Surface.CLOTH), _box(0, 0.12, 0.05, length, 0.22, 0.78, Surface.CLOTH)
    return joined([seat, back, arms])


def draw_bed(rng: np.random.Generator) -> Soup:
    """A mattress on a frame, its head at the wall."""
    breadth, length = rng.uniform(0.9, 1.8), 2.05
    return joined([_box(0, length / 2, 0.2, breadth, length, 0.35, Surface.CLOTH), _box(0, 0.03, 0, breadth, 0.06, rng.uniform(0.6, 1.1))])


def draw_machine(rng: np.random.Generator) -> Soup:
    """A vending machine, copier, washing machine or the like."""
    return _box(0, 0.37, 0.02, rng.uniform(0.6, 1.2), 0.7, rng.choice([0.85, 1.1, 1.85]))


def draw_table(rng: np.random.Generator) -> Soup:
    """A table on four legs or one, with chairs around it; its middle at the origin."""
    length, breadth, height = rng.uniform(0.8, 2.4), rng.uniform(0.7, 1.1), rng.uniform(0.7, 0.78)
    if rng.random() < 0.3:
        radius = breadth / 2
        top = tubes([[0, 0, height - BOARD_M]], [[0, 0, height]], radius, radius, 10, caps=True)
        parts, length = [top, tubes([[0, 0, 0]], [[0, 0, height]], 0.05, 0.05, 6), _box(0, 0, 0, 0.5, 0.5, 0.03)], breadth
    else:
        legs = _legs(length - 0.1, breadth - 0.1, height, 0.06, y=0.05).moved([0, -breadth / 2, 0])
        parts = [_box(0, 0, height - BOARD_M, length, breadth, BOARD_M), legs]
    places = [(x, side) for x in np.arange(-length / 2 + 0.35, length / 2 - 0.2, 0.65) for side in (-1, 1)]
    for x, side in places:
        if rng.random() < 0.6:
            away = breadth / 2 + rng.uniform(-0.1, 0.35)
            parts.append(draw_chair(rng).moved([x, side * away, 0], rng.normal(0, 0.25) + (0 if side < 0 else np.pi)))
    if rng.random() < 0.5:
        parts.append(_things(rng, length, breadth, height).moved([0, -breadth / 2, 0]))
    return joined(parts)


def draw_chair(rng: np.random.Generator) -> Soup:
    """A chair on four legs, or on a column with a foot; who sits on it would face +y, its middle is the origin."""
    seat = rng.uniform(0.42, 0.5)
    parts = [_box(0, 0, seat - 0.05, 0.44, 0.44, 0.06, Surface.CLOTH), _box(0, -0.2, seat + 0.1, 0.42, 0.04, 0.4, Surface.CLOTH)]
    if rng.random() < 0.5:
        parts.append(_legs(0.44, 0.44, seat, 0.03).moved([0, -0.22, 0]))
    else:
        parts += [tubes([[0, 0, 0.05]], [[0, 0, seat]], 0.03, 0.03, 5), boxes_3d(np.zeros((2, 3)), [0.6, 0.06, 0.08], [0, np.pi / 2])]
    return joined(parts)


def draw_plant(rng: np.random.Generator) -> Soup:
    """A pot and leaves."""
    pot = tubes([[0, 0, 0]], [[0, 0, 0.35]], 0.14, 0.2, 8, caps=True)
    leaves = draw_bush(rng, 0.12)
    low, high = leaves.triangles.reshape(-1, 3).min(axis=0), leaves.triangles.reshape(-1, 3).max(axis=0)
    size = np.array([0.7, 0.7, rng.uniform(0.5, 1.3)])
    at = (leaves.triangles - (low + high) / 2 * [1, 1, 0] - [0, 0, low[2]]) / (high - low) * size
    return joined([pot, Soup(at + [0, 0, 0.33], leaves.surface)])


def draw_clutter(rng: np.random.Generator) -> Soup:
    """A bin, a bag, a box or a stack of boxes."""
    if rng.random() < 0.3:
        return tubes([[0, 0, 0]], [[0, 0, rng.uniform(0.3, 0.75)]], 0.14, 0.17, 8, caps=True)
    size = np.array([rng.uniform(0.2, 0.7), rng.uniform(0.2, 0.5), rng.uniform(0.15, 0.5)])
    feet = [[*rng.normal(0, 0.03, 2), k * size[2]] for k in range(rng.integers(1, 4))]
    return boxes_3d(feet, size, rng.normal(0, 0.1, len(feet)))


def draw_screen(rng: np.random.Generator) -> Soup:
    """A partition or a board that stands on two feet."""
    length = rng.uniform(1.0, 2.0)
    feet = boxes_3d([[side * (length / 2 - 0.1), 0, 0] for side in (-1, 1)], [0.05, 0.45, 0.04])
    return joined([_box(0, 0, rng.choice([0.05, 0.7]), length, 0.05, rng.uniform(1.0, 1.3)), feet])


def draw_board(rng: np.random.Generator) -> Soup:
    """A picture, a whiteboard, a screen or a box on a wall."""
    depth = rng.choice([0.03, 0.08, 0.2])
    return _box(0, depth / 2, rng.uniform(0.9, 1.6), rng.uniform(0.4, 2.5), depth, rng.uniform(0.4, 1.1))


def draw_cupboard(rng: np.random.Generator) -> Soup:
    """A cupboard or a board with things on a wall."""
    return _box(0, 0.16, rng.uniform(1.3, 1.6), rng.uniform(0.6, 1.8), 0.32, rng.choice([BOARD_M, 0.4, 0.7]))


def draw_somebody(rng: np.random.Generator) -> Soup:
    """Somebody who stands still."""
    return draw_person(rng, walking=False)


def _things(rng: np.random.Generator, length: float, depth: float, height: float) -> Soup:
    """Small boxes on a top of `length`, from y = 0 to `depth`."""
    count = rng.poisson(1.5 * length)
    sizes = rng.uniform(0.05, 0.35, (count, 3))
    y = np.maximum(rng.uniform(0.2, 0.8, count) * depth, np.hypot(*sizes[:, :2].T) / 2)  # none reaches into the wall, however it is turned
    feet = np.column_stack([rng.uniform(-0.45, 0.45, count) * length, y, np.full(count, height)])
    return boxes_3d(feet, sizes, rng.uniform(0, np.pi, count)) if count else joined([])


AGAINST_WALLS: dict[str, dict[Draw, float]] = {
    "office": {draw_desk: 4, draw_cabinet: 3, draw_shelf: 2.5, draw_radiator: 1, draw_machine: 0.4},
    "store": {draw_shelf: 4, draw_cabinet: 2, draw_rack: 1.5, draw_machine: 1},
    "home": {draw_sofa: 1.5, draw_cabinet: 2.5, draw_shelf: 1.5, draw_bed: 1, draw_kitchen: 1, draw_radiator: 1, draw_desk: 0.5},
    "hall": {draw_rack: 2.5, draw_machine: 1, draw_cabinet: 1, draw_shelf: 1},
    "corridor": {draw_cabinet: 2, draw_radiator: 1.5, draw_machine: 1, draw_shelf: 0.4, draw_sofa: 0.3},
}
"""By what a floor is used for: how often each piece stands there."""

FREE: dict[str, dict[Draw, float]] = {
    "office": {draw_table: 1.5, draw_chair: 3, draw_clutter: 3, draw_screen: 0.6, draw_plant: 0.7},
    "store": {draw_clutter: 4, draw_rack: 1, draw_table: 0.5},
    "home": {draw_table: 2, draw_chair: 1.5, draw_plant: 1, draw_clutter: 1.5},
    "hall": {draw_table: 2, draw_rack: 1, draw_clutter: 2, draw_chair: 1, draw_screen: 0.7, draw_plant: 0.5},
    "corridor": {draw_clutter: 2, draw_plant: 1, draw_chair: 1},
}

ON_WALLS: tuple[Draw, ...] = (draw_board, draw_board, draw_cupboard)
