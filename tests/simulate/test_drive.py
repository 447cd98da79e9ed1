"""Drives: clearance, connection, and poses along the way."""

import numpy as np
import pytest

pytest.importorskip("embreex")
shapely = pytest.importorskip("shapely")

from hilbertvae.simulate.drive import drive, poses_along  # noqa: E402
from hilbertvae.simulate.floor_plan import FloorPlan, draw_floor_plan  # noqa: E402
from hilbertvae.simulate.free_space import find_free_space  # noqa: E402
from hilbertvae.simulate.layouts import LAYOUTS, Floor  # noqa: E402

CLEARANCE_M = 0.2


@pytest.fixture(scope="module", params=LAYOUTS)
def trip(request):
    plan = draw_floor_plan(np.random.default_rng(7), 30.0, request.param)
    return plan, drive(np.random.default_rng(8), plan, find_free_space(plan), CLEARANCE_M, 150.0)


def test_the_way_keeps_its_clearance_from_solids_and_panes(trip):
    plan, way = trip
    things = shapely.STRtree(np.concatenate([plan.solids, plan.glass]))
    _, distance = things.query_nearest(shapely.points(way), return_distance=True, all_matches=False)
    assert len(way) > 20
    assert distance.min() >= CLEARANCE_M - 1e-9


def test_the_way_is_one_piece_and_stays_indoors(trip):
    plan, way = trip
    assert np.linalg.norm(np.diff(way, axis=0), axis=1).max() < 0.6
    floors = shapely.union_all([floor.polygon.buffer(0.6) for floor in plan.floors])
    assert shapely.contains_xy(floors, way).all()


def test_the_way_sees_a_good_part_of_the_building(trip):
    _, way = trip
    assert np.linalg.norm(way.max(axis=0) - way.min(axis=0)) > 12


def test_what_is_open_to_outdoors_is_not_driven_through():
    """A hall and a larger one beside it, whose outer wall has a hole: the drive would lead out of it and around the building."""
    halls = [shapely.box(0, 0, 5, 6), shapely.box(5.2, 0, 14, 6)]
    walls = shapely.box(-0.2, -0.2, 14.2, 6.2) - shapely.union_all([*halls, shapely.box(13.9, 2, 14.3, 4)])
    plan = FloorPlan([Floor(hall, "hall") for hall in halls], np.array([walls]), np.array(["wall"]), np.array([]), np.array([]))
    space = find_free_space(plan)
    closed, opened, outdoors = space.at(np.array([[2.5, 3.0], [9.0, 3.0], [14.7, 3.0]]))
    assert closed > 2 and opened == outdoors == 0
    way = drive(np.random.default_rng(0), plan, space, CLEARANCE_M, 40.0)
    assert len(way) > 5 and shapely.contains_xy(halls[0], way).all()


def test_poses_follow_the_way_and_turn_on_the_spot():
    corner = np.concatenate([np.stack([np.arange(0, 5, 0.2), np.zeros(25)], 1), np.stack([np.full(25, 5.0), np.arange(0, 5, 0.2)], 1)])
    poses = poses_along(np.random.default_rng(0), corner, step_m=0.5, turn_deg=20.0, scans=1000)
    assert 20 <= len(poses) <= 40
    assert np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1).max() <= 0.5 + 1e-9
    assert np.abs(np.diff(poses[:, 2])).max() <= np.deg2rad(20.0) + 1e-9
    assert poses[-1, 2] == pytest.approx(np.pi / 2, abs=0.5)
    assert len(poses_along(np.random.default_rng(0), corner, 0.5, 20.0, scans=7)) == 7
