"""The ground of streets: kerbs, and where they are lowered."""

import numpy as np
import pytest

pytest.importorskip("embreex")
shapely = pytest.importorskip("shapely")

from hilbertvae.simulate.street_plan import draw_street_plan  # noqa: E402
from hilbertvae.simulate.surfaces import SurfaceCaster  # noqa: E402
from hilbertvae.simulate.terrain import ground_soup  # noqa: E402


def rises(plan, places):
    """By how many kerbs the ground at places (N, 2) of a plan lies above the carriageway: what things stand on, and what is seen."""
    ground, (s, t) = plan.ground, places.T
    above = np.stack([*ground.in_world(s, t), ground.level(s, t) + 1], axis=-1)
    down = SurfaceCaster(ground_soup(ground, plan.extent, plan.grass)).ranges(above, np.tile([0, 0, -1.0], (len(s), 1)))
    return (ground.height(s, t) - ground.level(s, t)) / ground.kerb_m, (1 - down) / ground.kerb_m


@pytest.mark.parametrize("seed", range(1, 4))
def test_kerbs_are_a_fifth_as_high_at_drives(seed):
    plan = draw_street_plan(np.random.default_rng(seed), "residential", 10.0, 40.0)
    kerbs = [(*lot.line.at(lot.x_m + lot.drive_m, 0.06),) for lot in plan.lots if lot.drive_m is not None]
    at_drives = np.array([place for place in kerbs if not shapely.contains_xy(plan.ground.road, *place)])
    stands, seen = rises(plan, at_drives)
    assert len(at_drives) > 4
    np.testing.assert_allclose(stands, 0.2, atol=0.02)
    assert seen.max() < 0.6  # its corners lie metres apart
    along = np.concatenate([np.transpose(line.at(np.linspace(3, line.length_m - 3, 60), 0.06)) for line in plan.lines if line.main])
    away = along[np.abs(along[:, :1] - plan.ground.drives[:, 0]).min(axis=1) > 2.7]
    away = away[~shapely.contains_xy(plan.ground.road, *away.T)]
    stands, _ = rises(plan, away)
    assert len(away) > 10
    np.testing.assert_allclose(stands, 1.0)
