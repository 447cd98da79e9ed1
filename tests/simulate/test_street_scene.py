"""Streets as geometry: what stands where."""

from types import SimpleNamespace

import numpy as np
import pytest

from hilbertvae.simulate.soup import Surface

pytest.importorskip("embreex")
pytest.importorskip("shapely")

from hilbertvae.simulate.street import CHARACTERS, draw_poses  # noqa: E402
from hilbertvae.simulate.street_filling import add_traffic, fill  # noqa: E402
from hilbertvae.simulate.street_plan import draw_street_plan  # noqa: E402
from hilbertvae.simulate.surfaces import SurfaceCaster  # noqa: E402
from hilbertvae.simulate.terrain import ground_soup  # noqa: E402

DRIVE_M, BEYOND_M = 10.0, 40.0


@pytest.fixture(scope="module", params=list(CHARACTERS))
def scene(request):
    for_plan, for_things = np.random.default_rng(7), np.random.default_rng(8)
    plan = draw_street_plan(for_plan, request.param, DRIVE_M, BEYOND_M)
    scene = fill(for_things, plan, DRIVE_M)
    add_traffic(for_things, scene, 2.0, np.arange(0, DRIVE_M, 2.0))
    return scene


def test_the_ground_has_no_holes(scene):
    plan = scene.plan
    rng = np.random.default_rng(0)
    s, t = rng.uniform([-30, -30], [DRIVE_M + 30, 30], (4000, 2)).T
    above = plan.ground.place(s, t, 1.0)
    found = SurfaceCaster(ground_soup(plan.ground, plan.extent, plan.grass)).ranges(above, np.tile([0, 0, -1.0], (len(s), 1)))
    assert np.isfinite(found).mean() > 0.999
    # Facets of a few metres cut a little off the bumps; a kerb's edge is its height away.
    assert np.mean(np.abs(found - 1.0) < 0.06) > 0.97


def test_the_pavement_is_a_kerb_higher_than_the_road(scene):
    ground = scene.plan.ground
    for line in scene.plan.lines:
        if line.main:
            s, t = line.at(np.linspace(0, line.length_m, 9), 0.5)
            rise = ground.height(s, t) - ground.level(s, t)
            assert (rise >= 0).all() and rise.max() <= ground.kerb_m + 1e-9
            assert ground.kerb_m <= 0.16


def test_nothing_floats_and_nothing_is_buried(scene):
    ground = scene.plan.ground
    for thing in scene.things:
        local = thing.soup.triangles.reshape(-1, 3)
        assert local[:, 2].min() < (0.35 if thing.kind == "rail" else 0.12), thing.kind
        assert local[:, 2].max() > 0.1, thing.kind
        world = thing.in_world(ground).triangles
        assert np.isfinite(world).all()
        if thing.draped:
            assert abs(world[..., 2].min() - ground.height(thing.s, thing.t) - local[:, 2].min()) < 0.15 * (np.ptp(local[:, 0]) + 4), (
                thing.kind
            )


def test_vehicles_stand_on_their_wheels_on_the_ground(scene):
    vehicles = [thing for thing in scene.things if thing.kind == "vehicle"] + [
        mover.thing for mover in scene.movers if mover.thing.kind == "vehicle"
    ]
    for car in vehicles:
        local = car.soup.triangles[..., 2]
        assert -0.02 < local.min() < 0.02
        assert 1.3 < local.max() < 3.6
        assert (local.max(axis=1) < 0.15).mean() < 0.1  # hardly anything but tyres near the ground


def test_the_driven_lane_is_clear(scene):
    ground = scene.plan.ground
    poses = draw_poses(np.random.default_rng(1), scene.plan, np.arange(0, DRIVE_M, 2.0), 1.73)
    things = np.concatenate(
        [
            thing.in_world(ground).triangles.mean(axis=1)
            for thing in scene.things
            if thing.kind not in ("tree", "lamp post", "traffic light")
        ]
    )
    for pose in poses:
        local = (things - pose[:3, 3]) @ pose[:3, :3]
        inside = (np.abs(local[:, 0]) < 2) & (np.abs(local[:, 1]) < 0.8) & (local[:, 2] < 0)
        assert not inside.any()


def test_traffic_keeps_off_the_car_that_carries_the_sensor():
    """Over many drives of other steps: whatever shares its lane is always further from its middle than its nose and tail are."""
    lane_s, met = 2.0 * np.arange(6), 0
    for seed in range(60):
        plan = SimpleNamespace(island=None, lane_t=1.75, other_t=-1.75)
        traffic = SimpleNamespace(plan=plan, movers=[])
        add_traffic(np.random.default_rng(seed), traffic, 2.0, lane_s)
        for mover in traffic.movers:
            if mover.thing.angle_rad == 0:
                met += 1
                half_m = np.abs(mover.thing.soup.triangles[..., 0]).max()
                gaps = [abs(mover.at_scan(k).s - s) - half_m for k, s in enumerate(lane_s)]
                assert min(gaps) > (5.9 if mover.thing.kind == "vehicle" else 2.5), seed
    assert met > 30


def test_movers_move_straight_on(scene):
    assert scene.movers
    for mover in scene.movers:
        a, b = mover.at_scan(0), mover.at_scan(3)
        assert np.hypot(b.s - a.s, b.t - a.t) == pytest.approx(3 * mover.step_m)
        assert b.soup is a.soup


def test_streets_hold_what_streets_hold():
    kinds, surfaces = set(), set()
    for seed, character in enumerate([*CHARACTERS, "residential", "town"]):
        plan = draw_street_plan(np.random.default_rng([1, seed]), character, DRIVE_M, BEYOND_M)
        scene = fill(np.random.default_rng([2, seed]), plan, DRIVE_M)
        kinds |= {str(thing.kind) for thing in scene.things} | {mover.thing.kind for mover in scene.movers}
        surfaces |= set(np.unique(scene.soup().surface).tolist())
    assert {"house", "vehicle", "tree", "bush", "hedge", "wall", "fence", "lamp post", "sign", "bin", "box", "person"} <= kinds
    assert surfaces >= {int(kind) for kind in Surface}
