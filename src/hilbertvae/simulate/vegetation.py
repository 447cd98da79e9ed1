"""Trees, bushes and hedges: trunks and branches, and crowns of many leaf facets that a laser partly gets through."""

from __future__ import annotations

import numpy as np

from hilbertvae.simulate.soup import Soup, Surface, boxes_3d, ellipsoids, facets, joined, tubes


def draw_tree(rng: np.random.Generator, leaf_m: float = 0.2, bare: bool = False, beside_road: bool = False) -> Soup:
    """A broadleaf tree or, now and then, a conifer, at the origin. `leaf_m`: size of its facets; `bare`: without leaves.

    beside_road: cut so that people and cars pass below its crown.
    """
    height = rng.uniform(5.5, 12) if beside_road else rng.uniform(4, 14)
    if rng.random() < 0.12 and not beside_road:
        return _conifer(rng, height, leaf_m)
    clear = rng.uniform(2.3, 3.4) if beside_road else min(rng.uniform(1.4, 3.2), 0.45 * height)
    crown = np.array([1, rng.uniform(0.8, 1.2), 1.0]) * np.clip(height * rng.uniform(0.2, 0.36), 0.8, 4.5)
    crown[2] = (height - clear) / 2
    middle = np.array([*rng.normal(0, 0.15, 2), clear + 0.95 * crown[2]])
    girth = rng.uniform(0.012, 0.022) * height
    fork = np.array([*rng.normal(0, 0.12, 2), clear + 0.15 * crown[2]])
    bend = fork * [0.4, 0.4, 0.5] + [*rng.normal(0, 0.05, 2), 0]
    limbs = middle + _in_ball(rng, rng.integers(6, 12), 0.5) * crown * 0.75
    twigs_from = rng.integers(len(limbs), size=rng.integers(20, 40) * (3 if bare else 1))
    on_limb = fork + rng.uniform(0.4, 1.0, (len(twigs_from), 1)) * (limbs[twigs_from] - fork)
    twigs = on_limb + 0.35 * crown * rng.normal(size=on_limb.shape) * [1, 1, 0.7]
    parts = [
        tubes([[0, 0, -0.1], bend], [bend, fork], [1.3 * girth, girth], [girth, 0.9 * girth], 7),
        tubes(np.repeat(fork[None], len(limbs), 0), limbs, 0.5 * girth, 0.2 * girth, 5),
        tubes(on_limb, twigs, 0.015 + 0.1 * girth, 0.008, 3),
    ]
    if bare:
        ends = rng.integers(len(twigs), size=5 * len(twigs))
        starts = on_limb[ends] + rng.random((len(ends), 1)) * (twigs[ends] - on_limb[ends])
        parts.append(tubes(starts, starts + rng.normal(0, 0.35, starts.shape), 0.008, 0.005, 3))
        return joined(parts)
    clumps = np.concatenate([middle + _in_ball(rng, rng.integers(12, 30), 0.4) * crown, limbs])
    density = rng.uniform(1.2, 3.0)
    area = np.pi * crown[0] * (crown[1] + crown[2]) / 2
    count = int(np.clip(density * area / (0.35 * leaf_m**2), 200, 12000))
    around = rng.normal(size=(count, 3)) * 0.22 * crown * rng.uniform(0.6, 1.3, (count, 1))
    leaves = clumps[rng.integers(len(clumps), size=count)] + around
    high = leaves[:, 2] > (0.9 if beside_road else 0.6) * clear
    return joined([*parts, _sprays(rng, leaves[high], leaf_m, around[high])])


def _sprays(rng, places: np.ndarray, leaf_m: float, outward: np.ndarray) -> Soup:
    return facets(rng, places, leaf_m * rng.uniform(0.6, 1.4, len(places)), outward=outward)


def _conifer(rng, height: float, leaf_m: float) -> Soup:
    radius, foot = height * rng.uniform(0.14, 0.26), rng.uniform(0.1, 1.2)
    count = int(np.clip(2.2 * radius * height / (0.35 * leaf_m**2), 200, 7000))
    up = 1 - np.sqrt(rng.random(count))
    tiers = np.floor(up * height / 0.5) * 0.5 / height
    out = radius * (1 - up) * np.maximum(rng.random(count), rng.random(count)) * (1 + 0.25 * np.sin(25 * tiers))
    angle = rng.uniform(0, 2 * np.pi, count)
    leaves = np.stack([out * np.cos(angle), out * np.sin(angle), foot + up * (height - foot) - 0.15 * out], axis=-1)
    trunk = tubes([[0, 0, -0.1]], [[0, 0, 0.95 * height]], 0.016 * height, 0.02, 6)
    return joined([trunk, _sprays(rng, np.maximum(leaves, [-99, -99, 0.05]), leaf_m, leaves * [1, 1, 0] + [0, 0, 0.5])])


def _in_ball(rng, count: int, inner: float) -> np.ndarray:
    """(K, 3): places in a ball of radius 1, few of them nearer than `inner` to its middle."""
    way = rng.normal(size=(count, 3))
    return way / np.linalg.norm(way, axis=1, keepdims=True) * rng.uniform(inner**3, 1, (count, 1)) ** (1 / 3)


def draw_bush(rng: np.random.Generator, leaf_m: float = 0.15) -> Soup:
    """A bush at the origin, on the ground: lobes of leaves around a dense heart."""
    size = rng.uniform(0.4, 1.6)
    lobes = rng.normal(0, 0.45 * size, (rng.integers(2, 7), 2))
    tall = size * rng.uniform(0.5, 1.3, len(lobes))
    count = int(np.clip(12 * size**2 / (0.35 * leaf_m**2), 80, 3500))
    which = rng.integers(len(lobes), size=count)
    out = _in_ball(rng, count, 0.75)
    out[:, 2] = np.abs(out[:, 2])
    radii = np.stack([0.5 * size * np.ones(len(lobes)), 0.5 * size * np.ones(len(lobes)), tall], axis=-1) * rng.uniform(
        0.7, 1.2, (len(lobes), 1)
    )
    base = np.column_stack([lobes, np.zeros(len(lobes))])
    leaves = base[which] + out * radii[which] + rng.normal(0, 0.08 * size, (count, 3))
    leaves[:, 2] = np.abs(leaves[:, 2])
    heart = ellipsoids(base, 0.6 * radii, Surface.LEAF)
    return joined([heart, _sprays(rng, leaves, leaf_m, out)])


def hedge_leaves(rng: np.random.Generator, length_m: float, depth_m: float, height_m: float, leaf_m: float) -> Soup:
    """A hedge along x from the origin, |y| up to half its depth: a dense heart behind ragged leaves."""
    count = int(np.clip(3.0 * length_m * (2 * height_m + depth_m) / (0.35 * leaf_m**2), 50, 20000))
    around = rng.uniform(0, 2 * height_m + depth_m, count)
    on_side = np.abs(around - height_m - depth_m / 2) > depth_m / 2
    y = np.where(on_side, np.sign(around - height_m) * depth_m / 2, around - height_m - depth_m / 2)
    z = np.where(on_side, rng.uniform(0, height_m, count), height_m)
    x = rng.uniform(0, length_m, count)
    swell = 1 + 0.12 * np.sin(x * 1.7 + rng.uniform(0, 6)) + 0.08 * np.sin(x * 4.1 + rng.uniform(0, 6))
    leaves = np.stack([x, y * swell, z * swell], axis=-1) + rng.normal(0, 0.09, (count, 3))
    leaves[:, 2] = np.abs(leaves[:, 2])
    outward = np.stack([0 * x, np.where(on_side, np.sign(y), 0.0), np.where(on_side, 0.0, 1.0)], axis=-1)
    heart = boxes_3d([length_m / 2, 0, 0], [length_m, 0.6 * depth_m, 0.85 * height_m], surface=Surface.LEAF)
    return joined([heart, _sprays(rng, leaves, leaf_m, outward)])


def draw_grass(rng: np.random.Generator, places: np.ndarray) -> Soup:
    """Tufts at `places` (K, 3)."""
    return facets(rng, places + [0, 0, 0.06], rng.uniform(0.1, 0.35, len(places)), Surface.GRASS)
