"""Vehicles with the shapes that lasers see: bonnet, windows, roof, wheels in their arches, and air under the floor."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hilbertvae.simulate.soup import Soup, Surface, boxes_3d, joined, quads, sheet, tubes


@dataclass(frozen=True)
class CarShape:
    """Side view of a car, metres; x ahead from the middle, as shares of the length where it says share.

    screen_foot, roof_front, roof_rear, rear_foot: shares of the length from the nose where windscreen and rear window begin and end.
    bonnet_m, belt_m: heights of the bonnet's front edge and of the windows' lower edge. glazed: share of the sides behind the
    front doors that is window.
    """

    length_m: float
    width_m: float
    height_m: float
    bonnet_m: float
    belt_m: float
    screen_foot: float
    roof_front: float
    roof_rear: float
    rear_foot: float
    wheel_m: float = 0.31
    floor_m: float = 0.2
    wheelbase: float = 0.6
    glazed: float = 1.0


CARS = {
    "hatchback": CarShape(4.0, 1.72, 1.47, 0.72, 0.93, 0.26, 0.43, 0.86, 0.97),
    "saloon": CarShape(4.6, 1.78, 1.44, 0.70, 0.92, 0.29, 0.45, 0.72, 0.85),
    "estate": CarShape(4.7, 1.78, 1.48, 0.72, 0.94, 0.28, 0.43, 0.90, 0.985),
    "suv": CarShape(4.6, 1.86, 1.70, 0.90, 1.08, 0.27, 0.41, 0.88, 0.98, wheel_m=0.36, floor_m=0.24),
    "small": CarShape(3.5, 1.62, 1.50, 0.76, 0.95, 0.22, 0.40, 0.88, 0.98, wheel_m=0.28),
    "minivan": CarShape(4.5, 1.82, 1.68, 0.85, 1.0, 0.18, 0.38, 0.90, 0.98),
    "van": CarShape(5.2, 1.95, 2.1, 1.0, 1.2, 0.17, 0.30, 0.97, 0.995, wheel_m=0.34, glazed=0.0),
    "high van": CarShape(6.0, 2.0, 2.6, 1.05, 1.3, 0.15, 0.27, 0.985, 0.998, wheel_m=0.35, glazed=0.0),
}
KINDS = {
    "hatchback": 0.26,
    "saloon": 0.16,
    "estate": 0.17,
    "suv": 0.11,
    "small": 0.1,
    "minivan": 0.09,
    "van": 0.06,
    "high van": 0.03,
    "lorry": 0.02,
}


def draw_vehicle(rng: np.random.Generator, kind: str | None = None) -> tuple[Soup, float, float]:
    """A vehicle that stands at the origin and faces +x, its length and its width; `kind` is a key of `KINDS`."""
    kind = kind or rng.choice(list(KINDS), p=list(KINDS.values()))
    paint = Surface.DARK if rng.random() < 0.3 else Surface.PAINT
    if kind == "lorry":
        return _lorry(rng, paint)
    model = CARS[kind]
    shape = replace(
        model,
        length_m=model.length_m * rng.uniform(0.93, 1.07),
        width_m=model.width_m * rng.uniform(0.97, 1.04),
        height_m=model.height_m * rng.uniform(0.96, 1.05),
        bonnet_m=model.bonnet_m * rng.uniform(0.95, 1.08),
        screen_foot=model.screen_foot + rng.uniform(-0.02, 0.02),
        roof_rear=model.roof_rear + rng.uniform(-0.02, 0.0),
        wheelbase=model.wheelbase + rng.uniform(-0.02, 0.02),
        glazed=float(rng.random() < 0.4) if kind == "van" else model.glazed,
    )
    return car_soup(shape, paint, Surface.GLASS if rng.random() < 0.65 else Surface.PANE), shape.length_m, shape.width_m


def car_soup(shape: CarShape, paint: Surface = Surface.PAINT, glass: Surface = Surface.GLASS) -> Soup:
    """The car at the origin, facing +x; the ground is z = 0."""
    length, half = shape.length_m, shape.width_m / 2
    axles = np.array([0.5, -0.5]) * shape.wheelbase * length
    parts = [_body(shape, axles, paint), _cabin(shape, paint, glass)]
    for side in (-1, 1):
        inner = np.stack([axles, np.full(2, side * (half - 0.24)), np.full(2, shape.wheel_m)], axis=-1)
        parts.append(tubes(inner, inner + [0, side * 0.2, 0], shape.wheel_m, shape.wheel_m, 12, Surface.DARK, caps=True))
        mirror = [0.5 * length - (shape.screen_foot + 0.07) * length, side * (half + 0.06), shape.belt_m]
        parts.append(boxes_3d(mirror, [0.12, 0.2, 0.14], surface=paint))
    return joined(parts)


def _body(shape: CarShape, axles: np.ndarray, paint: Surface) -> Soup:
    """Everything below the windows, as ribs across the car at some stations along it."""
    length, half = shape.length_m, shape.width_m / 2
    arches = axles[:, None] + 1.2 * shape.wheel_m * np.array([-1, -0.95, -0.7, -0.3, 0.3, 0.7, 0.95, 1])
    x = np.sort(np.concatenate([length * np.linspace(-0.5, 0.5, 15), arches.ravel()]))
    nose = 0.5 - x / length  # 0 at the nose, 1 at the tail
    out = np.abs(x) / (length / 2)
    width = half * (1 - 0.03 * out**2 - 0.14 * out**8)
    deck = np.interp(
        nose,
        [0, 0.015, 0.05, shape.screen_foot, shape.rear_foot, 0.985, 1],
        [
            0.75 * shape.bonnet_m,
            0.93 * shape.bonnet_m,
            shape.bonnet_m,
            shape.belt_m,
            1.06 * shape.belt_m,
            1.04 * shape.belt_m,
            0.9 * shape.belt_m,
        ],
    )
    radius = 1.2 * shape.wheel_m
    over = np.max(np.sqrt(np.maximum(radius**2 - (x[:, None] - axles) ** 2, 0)), axis=1)
    floor = shape.floor_m + 0.08 * np.clip((out - 0.85) / 0.15, 0, 1)
    under = np.where(over > 0, np.maximum(shape.wheel_m * 0.9 + over, floor), floor)
    middle = np.maximum(0.55 * deck + 0.45 * floor, under + 0.05)
    y = np.array([-0.97, -1, -0.95, -0.5, 0.5, 0.95, 1, 0.97])[None] * width[:, None]
    shoulder = deck - 0.06
    z = np.stack([under, middle, shoulder, deck, deck, shoulder, middle, under], axis=-1)
    ribs = np.stack([np.broadcast_to(x[:, None], y.shape), y, z], axis=-1)
    belly = np.stack([np.stack([x, -0.97 * width, floor], -1), np.stack([x, 0.97 * width, floor], -1)], axis=1)
    return joined(
        [
            sheet(ribs, paint),
            *(quads(_across(ribs[end]), paint) for end in (0, -1)),
            sheet(belly[(x > axles[1] + radius) & (x < axles[0] - radius)], Surface.DARK),
        ]
    )


def _across(rib: np.ndarray) -> np.ndarray:
    """(3, 4, 3): bumper and grille: a rib's right and left points joined at each level."""
    right, left = rib[:4], rib[:3:-1]
    return np.stack([right[:-1], right[1:], left[1:], left[:-1]], axis=1)


def _cabin(shape: CarShape, paint: Surface, glass: Surface) -> Soup:
    """Windscreen, roof, rear window, and sides with pillars between panes."""
    length, half = shape.length_m, shape.width_m / 2
    feet = length * (0.5 - np.array([shape.screen_foot, shape.rear_foot]))
    roof = length * (0.5 - np.array([shape.roof_front, shape.roof_rear]))
    along = np.array([0, 0.05, 0.40, 0.45, 0.80, 0.86, 1.0])
    rear = glass if shape.glazed else paint
    side_kinds = np.array([paint, glass, paint, rear, paint, paint], dtype=np.int8)
    bottom, top = np.interp(along, [0, 1], feet), np.interp(along, [0, 1], roof)
    rise = shape.height_m - 0.05 * (2 * along - 0.7) ** 2
    taper = 0.9 if shape.glazed == 0 else 0.76
    belt = shape.belt_m + 0.04 * along
    edge_m = 0.1 + 0.35 * (shape.height_m > 1.9)  # metal above the panes: more of it on vans
    parts = []
    for side in (-1, 1):
        mix = 1 - edge_m / (shape.height_m - shape.belt_m)
        low = np.stack([bottom, np.full(7, side * half * 0.94), belt], -1)
        high = np.stack([top, np.full(7, side * half * taper), rise - 0.03], -1)
        brow = low + mix * (high - low)
        parts.append(sheet(np.stack([low, brow], axis=1), side_kinds[:, None]))
        parts.append(sheet(np.stack([brow, high], axis=1), paint))
    profile = ((-taper, 0.03), (-0.5, 0.0), (0.5, 0.0), (taper, 0.03))
    ridge = np.stack([np.stack([top, np.full(7, half * share), rise - drop], -1) for share, drop in profile], axis=1)
    parts.append(sheet(ridge, paint))
    for end, kind in ((0, glass), (6, rear)):
        foot = np.array([[bottom[end], side * half * 0.94, belt[end]] for side in (-1, 1)])
        head = ridge[end, [0, 3]]
        parts.append(quads(np.stack([foot[0], foot[1], head[1], head[0]]), kind))
        parts.append(quads(ridge[end], paint))  # from there up to the roof, which is higher in the middle
    seats = np.array([[0.02, -0.35, 0.4], [0.02, 0.35, 0.4], [-0.2 * length, -0.35, 0.4], [-0.2 * length, 0.35, 0.4]])
    parts.append(boxes_3d(seats, [0.15, 0.45, min(0.85, shape.height_m - 0.5)], surface=Surface.CLOTH))
    return joined(parts)


def _lorry(rng, paint: Surface) -> tuple[Soup, float, float]:
    """A cab, a load box or a flat bed on a frame, and wheels."""
    length, width = rng.uniform(6.5, 10.0), rng.uniform(2.3, 2.5)
    cab_m, cab_height = rng.uniform(1.6, 2.1), rng.uniform(2.3, 2.9)
    load_m = length - cab_m - 0.15
    load_height = rng.choice([rng.uniform(2.0, 2.6), 0.5])
    parts = [
        boxes_3d([length / 2 - cab_m / 2, 0, 0.45], [cab_m, width, 0.85], surface=paint),
        boxes_3d([-length / 2 + load_m / 2, 0, 1.0], [load_m, width, load_height], surface=Surface.PAINT),
        boxes_3d([0, 0, 0.65], [0.96 * length, 0.9, 0.3], surface=Surface.DARK),
    ]
    front, back = length / 2, length / 2 - cab_m
    foot = np.array([[front, -width / 2], [front, width / 2], [back, width / 2], [back, -width / 2]])
    head = foot - [[0.15, 0], [0.15, 0], [0, 0], [0, 0]]
    low, high = np.column_stack([foot, np.full(4, 1.3)]), np.column_stack([head, np.full(4, cab_height)])
    walls = np.stack([low, np.roll(low, -1, 0), np.roll(high, -1, 0), high], axis=1)
    parts += [quads(walls, [Surface.GLASS, Surface.GLASS, paint, Surface.GLASS]), quads(high, paint)]
    axles = np.array([length / 2 - 0.9, -length / 2 + 1.3, *([-length / 2 + 2.4] if length > 8 else [])])
    for side in (-1, 1):
        inner = np.stack([axles, np.full(len(axles), side * (width / 2 - 0.35)), np.full(len(axles), 0.48)], axis=-1)
        parts.append(tubes(inner, inner + [0, side * 0.3, 0], 0.48, 0.48, 12, Surface.DARK, caps=True))
    return joined(parts), length, width
