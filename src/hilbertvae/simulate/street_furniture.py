"""What stands beside streets: lamp posts, signs, traffic lights, bollards, bins, benches, boxes, walls, fences and rails.

Everything stands on z = 0 around the origin; walls, fences and rails run along x from the origin.
"""

from __future__ import annotations

import numpy as np

from hilbertvae.simulate.soup import Soup, Surface, boxes_3d, ellipsoids, joined, quads, tubes


def draw_lamp_post(rng: np.random.Generator) -> Soup:
    """A mast with an arm over the road (towards -y) or a lantern on top."""
    height, radius = rng.uniform(3.5, 9.0), rng.uniform(0.05, 0.1)
    parts = [tubes([[0, 0, -0.2], [0, 0, -0.2]], [[0, 0, height], [0, 0, 0.9]], [radius, 1.5 * radius], [0.6 * radius, 1.4 * radius], 8)]
    if height > 5:
        reach = rng.uniform(0.8, 2.0)
        parts += [
            tubes([[0, 0, height]], [[0, -reach, height + 0.3]], 0.04, 0.04, 5),
            boxes_3d([0, -reach, height + 0.2], [0.25, 0.7, 0.12]),
        ]
    else:
        parts.append(ellipsoids([[0, 0, height]], [[0.22, 0.22, 0.3]], Surface.WALL))
    return joined(parts)


def draw_sign(rng: np.random.Generator) -> Soup:
    """A thin post with one or two plates that face along the street, or a wide board on two posts."""
    if rng.random() < 0.12:
        width, low = rng.uniform(1.2, 3.0), rng.uniform(0.7, 2.0)
        posts = np.array([[0, -width / 2.4, -0.2], [0, width / 2.4, -0.2]])
        board = boxes_3d([0, 0, low], [0.05, width, rng.uniform(0.6, 1.5)])
        return joined([tubes(posts, posts * [1, 1, 0] + [0, 0, low + 0.5], 0.05, 0.05, 6), board])
    height = rng.uniform(2.0, 3.2)
    parts = [tubes([[0, 0, -0.2]], [[0, 0, height]], 0.035, 0.035, 6)]
    sides = rng.choice([4, 8, 8])
    for k in range(rng.integers(1, 3)):
        size = rng.uniform(0.45, 0.75)
        middle = np.array([0.05, 0, height - 0.3 - 0.7 * k])
        parts.append(tubes([middle], [middle + [0.02, 0, 0]], size / 2, size / 2, sides, caps=True))
    return joined(parts)


def draw_traffic_light(rng: np.random.Generator, ahead: int = 1) -> Soup:
    """A post with a head on its +x side, or with `ahead` -1 on the other, some with a second one on an arm over the street, towards -y."""
    height = rng.uniform(3.0, 3.8)
    parts = [
        tubes([[0, 0, -0.2]], [[0, 0, height]], 0.06, 0.06, 7),
        boxes_3d([[0.15 * ahead, 0, 2.2], [0.12 * ahead, 0, 1.0]], [[0.22, 0.3, 0.9], [0.1, 0.15, 0.2]], surface=Surface.DARK),
    ]
    if rng.random() < 0.3:
        parts += [tubes([[0, 0, 5.0]], [[0, -4.0, 5.5]], 0.07, 0.05, 6), tubes([[0, 0, height]], [[0, 0, 5.0]], 0.06, 0.06, 7)]
        parts.append(boxes_3d([0, -3.8, 4.6], [0.22, 0.3, 0.9], surface=Surface.DARK))
    return joined(parts)


def draw_bollard(rng: np.random.Generator) -> Soup:
    """A post, as high as a knee or a hip."""
    return tubes([[0, 0, -0.1]], [[0, 0, rng.uniform(0.6, 1.1)]], 0.06, 0.06, 7, caps=True)


def draw_bin(rng: np.random.Generator) -> Soup:
    """A wheeled bin, a big container, or a basket on a post."""
    kind = rng.integers(4)
    if kind == 0:
        return boxes_3d([0, 0, 0.1], [1.3, 0.9, 1.15])
    if kind == 1:
        return joined(
            [tubes([[0, 0, 0]], [[0, 0, 1.1]], 0.03, 0.03, 5), tubes([[0, -0.2, 0.5]], [[0, -0.2, 1.0]], 0.18, 0.2, 8, caps=True)]
        )
    return joined([boxes_3d([0, 0, 0.06], [0.48, 0.5, 0.9]), boxes_3d([0, 0.03, 0.96], [0.54, 0.58, 0.08])])


def draw_box(rng: np.random.Generator) -> Soup:
    """A cabinet of the telephone or power company, a parcel box, a parking meter."""
    if rng.random() < 0.3:
        return joined([tubes([[0, 0, 0]], [[0, 0, 1.0]], 0.05, 0.05, 6), boxes_3d([0, 0, 1.0], [0.25, 0.2, 0.5])])
    return boxes_3d([0, 0, -0.05], [rng.uniform(0.6, 1.6), rng.uniform(0.3, 0.5), rng.uniform(0.9, 1.5)])


def draw_bench(rng: np.random.Generator) -> Soup:
    """Two legs, a seat and a back."""
    length = rng.uniform(1.4, 2.0)
    legs = [[-0.4 * length, 0, -0.05], [0.4 * length, 0, -0.05]]
    back = np.array([[-length / 2, 0.25, 0.5], [length / 2, 0.25, 0.5], [length / 2, 0.33, 0.85], [-length / 2, 0.33, 0.85]])
    return joined([boxes_3d(legs, [0.06, 0.4, 0.45]), boxes_3d([0, 0, 0.4], [length, 0.45, 0.06]), quads(back, Surface.WALL)])


def draw_shelter(rng: np.random.Generator) -> Soup:
    """A bus shelter: glass walls between posts, and a roof."""
    length, deep = rng.uniform(3.0, 4.5), 1.4
    posts = np.array([[x, y, -0.1] for x in (-length / 2, length / 2) for y in (0, deep)])
    rear = [[-length / 2, deep, 0.3], [length / 2, deep, 0.3], [length / 2, deep, 2.2], [-length / 2, deep, 2.2]]
    side = [[-length / 2, 0, 0.3], [-length / 2, deep, 0.3], [-length / 2, deep, 2.2], [-length / 2, 0, 2.2]]
    seat = boxes_3d([0, deep - 0.3, 0.45], [0.8 * length, 0.35, 0.06])
    roof = boxes_3d([0, deep / 2, 2.35], [length + 0.3, deep + 0.5, 0.1])
    return joined([tubes(posts, posts + [0, 0, 2.45], 0.05, 0.05, 6), quads([rear, side], Surface.GLASS), seat, roof])


def wall_soup(rng: np.random.Generator, length_m: float, height_m: float) -> Soup:
    """A garden wall, some with pillars."""
    parts = [boxes_3d([length_m / 2, 0, -0.5], [length_m, 0.24, height_m + 0.5])]
    if rng.random() < 0.4:
        at = np.arange(0.2, length_m, rng.uniform(2.5, 4.0))
        parts.append(boxes_3d(np.column_stack([at, 0 * at, 0 * at - 0.5]), [0.4, 0.4, height_m + 0.65]))
    if rng.random() < 0.3:
        parts.append(boxes_3d([length_m / 2, 0, height_m], [length_m, 0.32, 0.06]))
    return joined(parts)


def fence_soup(rng: np.random.Generator, length_m: float, height_m: float) -> Soup:
    """Slats or bars with air between them, or wire netting, on posts and rails; some on a low wall."""
    base = rng.choice([0.0, 0.0, 0.35])
    posts = np.arange(0, length_m + 0.1, 2.2)
    parts = [boxes_3d(np.column_stack([posts, 0 * posts, 0 * posts - 0.3]), [0.09, 0.09, height_m + 0.35])]
    if base:
        parts.append(boxes_3d([length_m / 2, 0, -0.5], [length_m, 0.25, base + 0.5]))
    style = rng.integers(3)
    if style == 2:
        parts.append(quads([[0, 0, base], [length_m, 0, base], [length_m, 0, height_m], [0, 0, height_m]], Surface.NET))
        return joined(parts)
    wide, gap = ((0.1, rng.uniform(0.02, 0.08)), (0.02, 0.1))[style]
    at = np.arange(0, length_m, wide + gap)
    slats = [
        np.stack([at + dx, 0 * at - 0.03, 0 * at + z], -1)
        for dx, z in ((0, base + 0.05), (wide, base + 0.05), (wide, height_m), (0, height_m))
    ]
    for z in (base + 0.2, height_m - 0.2):
        parts.append(boxes_3d([length_m / 2, 0, z], [length_m, 0.04, 0.08]))
    return joined([*parts, quads(np.stack(slats, axis=1), Surface.WALL)])


def rail_soup(rng: np.random.Generator, length_m: float) -> Soup:
    """A guard rail on posts."""
    posts = np.arange(0, length_m, rng.choice([2.0, 4.0]))
    profile = np.array([[-0.08, 0.45], [0.0, 0.5], [-0.08, 0.6], [0.0, 0.68], [-0.08, 0.75]])
    band = [
        [[0, a[0], a[1]], [length_m, a[0], a[1]], [length_m, b[0], b[1]], [0, b[0], b[1]]]
        for a, b in zip(profile, profile[1:], strict=False)
    ]
    return joined([boxes_3d(np.column_stack([posts, 0 * posts + 0.1, 0 * posts - 0.3]), [0.1, 0.14, 1.05]), quads(band, Surface.WALL)])
