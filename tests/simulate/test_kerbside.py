"""What stands along kerbs faces the street."""

from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("shapely")

from hilbertvae.simulate.kerb_lines import Line  # noqa: E402
from hilbertvae.simulate.kerbside import line_pavement  # noqa: E402
from hilbertvae.simulate.shapes import turned  # noqa: E402


def test_traffic_lights_look_out_of_both_ends_of_a_street_and_their_arms_reach_over_it():
    line, lights = Line((0.0, 0.0), 0.0, 20.0, 2.0), []

    def add(kind, soup, line, x, y, turn_rad=0.0):
        if kind == "traffic light":
            corners = soup.triangles.reshape(-1, 3)
            lights.append((x, y, turned(corners[:, :2], turn_rad), corners[:, 2]))

    plan = SimpleNamespace(lots=[], character="park", extent=(-20, -20, 40, 20))
    for seed in range(40):
        line_pavement(np.random.default_rng(seed), SimpleNamespace(plan=plan, add=add, send=id, put=id), line, np.inf)
    assert len(lights) >= 20 and {x for x, *_ in lights} == {1.0, 19.0}
    arms = 0
    for x, y, beside, height in lights:
        head = beside[(height > 2.1) & (height < 2.5)].mean(axis=0)
        assert head[0] * (x - 10) > 0.5, "heads look away from the street's middle, at who comes from a crossing"
        arm = beside[height > 5.2]
        arms += len(arm) > 0
        assert not len(arm) or y + arm[:, 1].min() < -3, "y leads away from the road"
    assert 0.15 * len(lights) < arms < 0.5 * len(lights)
