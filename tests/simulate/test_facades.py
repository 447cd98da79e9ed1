"""Houses: what a beam meets of them from each side."""

import numpy as np
import pytest

pytest.importorskip("embreex")

from hilbertvae.simulate.facades import draw_house  # noqa: E402
from hilbertvae.simulate.surfaces import SurfaceCaster  # noqa: E402

WIDTH_M, DEPTH_M, STOREYS = 9.0, 11.0, 2
SIDES = {
    # By where a side is, along it from and to, and how far at most things stand out from it: bays and balconies from the front.
    "front": ([0, 0], [WIDTH_M, 0], 1.6),
    "right": ([WIDTH_M, 0], [WIDTH_M, DEPTH_M], 0.15),
    "back": ([WIDTH_M, DEPTH_M], [0, DEPTH_M], 0.15),
    "left": ([0, DEPTH_M], [0, 0], 0.15),
}
DEEPEST_M = 0.5
"""Doors and panes are set back less."""


@pytest.mark.parametrize("side", SIDES)
def test_a_houses_walls_close_on_each_side(side):
    """Beams straight at them end there, or on what is set back in them or stands out from them; none goes past or in at a corner."""
    start, end, out_m = SIDES[side]
    along = (np.array(end) - start) / np.linalg.norm(np.subtract(end, start))
    inward = np.array([-along[1], along[0], 0.0])
    for seed in range(8):
        rng = np.random.default_rng(seed)
        house = SurfaceCaster(draw_house(rng, WIDTH_M, DEPTH_M, STOREYS))
        share, height_m = rng.uniform(0.002, 0.998, (500, 1)), rng.uniform(-1.0, 2.6 * STOREYS, 500)
        at = np.column_stack([start + share * np.subtract(end, start), height_m])
        found = house.ranges(at - 10 * inward, np.tile(inward, (500, 1)))
        assert found.min() > 10 - out_m and found.max() < 10 + DEEPEST_M, seed
