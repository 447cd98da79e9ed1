"""Streets as geometry: what stands where."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from hilbertvae.simulate.soup import Surface

pytest.importorskip("embreex")
shapely = pytest.importorskip("shapely")

from hilbertvae.simulate.land import shrunk  # noqa: E402
from hilbertvae.simulate.people import draw_person  # noqa: E402
from hilbertvae.simulate.spinning_lidar import SENSORS  # noqa: E402
from hilbertvae.simulate.street import CHARACTERS, StreetSettings, draw_poses, scan_scene  # noqa: E402
from hilbertvae.simulate.street_filling import add_traffic, fill  # noqa: E402
from hilbertvae.simulate.street_plan import draw_street_plan  # noqa: E402
from hilbertvae.simulate.street_scene import Mover, Scene, Thing  # noqa: E402
from hilbertvae.simulate.surfaces import SurfaceCaster  # noqa: E402
from hilbertvae.simulate.terrain import ground_soup  # noqa: E402
from hilbertvae.simulate.vehicles import draw_vehicle  # noqa: E402

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


def test_traffic_is_the_same_all_along_a_drive():
    """As many oncoming vehicles lie ahead at its end as at its beginning, and none drives through another."""
    lane_s, ahead = 2.0 * np.arange(40), np.zeros(2)
    for seed in range(40):
        traffic = SimpleNamespace(plan=SimpleNamespace(island=None, lane_t=1.75, other_t=-1.75), movers=[])
        add_traffic(np.random.default_rng(seed), traffic, 2.0, lane_s)
        vehicles = [mover for mover in traffic.movers if mover.thing.kind == "vehicle"]
        for number, k in enumerate((0, len(lane_s) - 1)):
            now = [mover.at_scan(k) for mover in vehicles]
            ahead[number] += sum(0 < thing.s - lane_s[k] < 60 for thing in now if thing.angle_rad)
            inner = np.array([shrunk(thing.footprint()) for thing in now], dtype=object)
            pairs = shapely.STRtree(inner).query(inner, predicate="intersects").T
            assert all(a == b for a, b in pairs), (seed, k)
    assert ahead / 40 == pytest.approx(0.12 * 60 / 11, rel=0.4)


def test_what_is_beyond_the_land_is_not_seen():
    """Oncoming traffic starts there, where it would hang in the air."""
    plan = draw_street_plan(np.random.default_rng(7), "residential", DRIVE_M, BEYOND_M)
    scene = Scene(plan, DRIVE_M)
    pose = np.eye(4)[None].repeat(2, axis=0)
    pose[:, :3, 3] = plan.ground.place(np.array([0.0, 0.0]), np.array([plan.lane_t] * 2), 1.73)
    car = draw_vehicle(np.random.default_rng(0))[0]
    lidar = replace(SENSORS["hdl64"], azimuths=300, range_noise_m=0.0)
    counts = []
    for s in (plan.extent[2] + 1.0, 8.0):
        scene.movers = [Mover(Thing("vehicle", car, s, plan.lane_t), 0.0)]
        scans = scan_scene(np.random.default_rng(1), scene, pose, lidar, StreetSettings(pose_noise_m=0.0, heading_noise_deg=0.0))
        counts.append(len(scans))
    scene.movers = []
    counts.append(len(scan_scene(np.random.default_rng(1), scene, pose, lidar, StreetSettings(pose_noise_m=0.0, heading_noise_deg=0.0))))
    assert counts[0] == counts[2] != counts[1]


def test_kerbs_end_at_side_streets_and_side_streets_have_corners():
    found = 0
    for seed in range(120):
        plan = draw_street_plan(np.random.default_rng([8, seed]), "town", DRIVE_M, BEYOND_M)
        low, _, high, _ = plan.extent
        if not plan.island:  # an open place cuts kerbs, too
            for s in [line.start[0] for line in plan.lines if not line.main]:
                assert low + 5 < s < high - 5
                found += 1
        if seed < 12:
            scene = fill(np.random.default_rng([9, seed]), plan, DRIVE_M)
            for line in [line for line in plan.lines if line.parking in ("along", "on kerb")]:
                for thing in scene.things:
                    x = np.cos(line.angle_rad) * (thing.s - line.start[0]) + np.sin(line.angle_rad) * (thing.t - line.start[1])
                    y = -np.sin(line.angle_rad) * (thing.s - line.start[0]) + np.cos(line.angle_rad) * (thing.t - line.start[1])
                    if (
                        thing.kind == "vehicle"
                        and -1.4 < y < 2.0
                        and line.length_m < x + np.ptp(thing.soup.triangles[..., 0]) / 2 < line.length_m + 3
                    ):
                        raise AssertionError((seed, thing.s, thing.t))
    assert found > 20


def test_wide_signs_stand_beside_the_road_and_not_over_it(streets):
    for scene in streets:
        for thing in scene.things:
            board = thing.soup.triangles[thing.soup.triangles[..., 2].min(axis=1) < 2.0][..., :2].reshape(-1, 2)
            if thing.kind == "sign" and np.ptp(board[:, 1]) > 1.0:
                ends = np.array([thing.s, thing.t]) + np.outer(
                    [board[:, 1].min(), board[:, 1].max()], [-np.sin(thing.angle_rad), np.cos(thing.angle_rad)]
                )
                assert not shapely.contains_xy(shapely.buffer(scene.plan.ground.road, -0.2), ends).any()


def test_movers_move_straight_on(scene):
    assert scene.movers
    for mover in scene.movers:
        a, b = mover.at_scan(0), mover.at_scan(3)
        assert np.hypot(b.s - a.s, b.t - a.t) == pytest.approx(3 * mover.step_m)
        assert b.soup is a.soup


def test_who_turns_back_goes_to_and_fro():
    walker = Thing("person", draw_person(np.random.default_rng(0)), 1.0, 2.0, np.pi / 2)
    way = [Mover(walker, 0.5, turns_after=2).at_scan(k) for k in range(7)]
    assert [thing.t for thing in way] == pytest.approx([2.0, 2.5, 3.0, 2.5, 2.0, 2.5, 3.0])
    assert [thing.angle_rad for thing in way] == pytest.approx(np.pi / 2 + np.pi * np.array([0, 0, 0, 1, 0, 0, 0]))
    assert {Mover(walker, 0.5, turns_after=0).at_scan(k).t for k in range(5)} == {2.0}


def test_nobody_goes_through_anything():
    """Over drives of 60 m with many scans, and many who walk: each place of each of them, on its own."""
    lane_s, sent, left, turned_back = 2.0 * np.arange(30), 0, 0, 0
    for seed, character in enumerate(["town", "park", "town", "residential", "outskirts", "town"]):
        plan = draw_street_plan(np.random.default_rng([11, seed]), character, lane_s[-1], BEYOND_M)
        scene = fill(np.random.default_rng([12, seed]), plan, lane_s[-1])
        add_traffic(np.random.default_rng([13, seed]), scene, 2.0, lane_s)
        sent += len(scene.movers)
        scene.clear_ways(lane_s)
        solid = [shrunk(thing.footprint()) for thing in scene.things if thing.kind != "grass"]
        for k, s in enumerate(lane_s):
            there = [(mover, shrunk(mover.at_scan(k).footprint())) for mover in scene.movers]
            for number, (mover, place) in enumerate(there):
                if mover.thing.kind != "vehicle":
                    others = [
                        *solid,
                        *(other for _, other in there[:number]),
                        shapely.box(s - 2, plan.lane_t - 0.9, s + 2, plan.lane_t + 0.9),
                    ]
                    assert not shapely.intersects(place, others).any(), (mover.thing, k)
        left += len(scene.movers)
        turned_back += sum(mover.turns_after is not None and mover.turns_after < 29 for mover in scene.movers)
    assert left > 0.85 * sent and turned_back > 5


def test_streets_hold_what_streets_hold():
    kinds, surfaces = set(), set()
    for seed, character in enumerate([*CHARACTERS, "residential", "town"]):
        plan = draw_street_plan(np.random.default_rng([1, seed]), character, DRIVE_M, BEYOND_M)
        scene = fill(np.random.default_rng([2, seed]), plan, DRIVE_M)
        kinds |= {str(thing.kind) for thing in scene.things} | {mover.thing.kind for mover in scene.movers}
        surfaces |= set(np.unique(scene.soup().surface).tolist())
    assert {"house", "vehicle", "tree", "bush", "hedge", "wall", "fence", "lamp post", "sign", "bin", "box", "person"} <= kinds
    assert surfaces >= {int(kind) for kind in Surface}


@pytest.fixture(scope="module")
def streets():
    """Two of each character with all that a plan may have; the first of each has a car park."""
    scenes = []
    for character in CHARACTERS:
        for wanted in (True, False):
            seeds = (np.random.default_rng([3, seed]) for seed in range(200))
            plans = (draw_street_plan(rng, character, DRIVE_M) for rng in seeds)
            plan = next(plan for plan in plans if len(plan.car_parks) == wanted)
            scenes.append(fill(np.random.default_rng(4), plan, DRIVE_M))
    return scenes


def test_only_what_drives_stands_on_the_carriageway(streets):
    for scene in streets:
        road = shapely.buffer(scene.plan.ground.road, -0.2)
        for thing in scene.things:
            if thing.kind not in ("vehicle", "person", "grass"):
                assert not shapely.intersects(road, thing.footprint()), (thing.kind, thing.s, thing.t)


def test_nothing_stands_in_anything_else(streets):
    """Houses, cars, poles and trunks: by 0.3 m, as a house's tilt or a hedge's leaves may touch."""
    for scene in streets:
        solid = [thing for thing in scene.things if thing.kind not in ("hedge", "wall", "fence", "rail", "bush", "grass")]
        inner = [shrunk(thing.footprint()) for thing in solid]
        pairs = shapely.STRtree(inner).query(inner, predicate="intersects").T
        assert not [(solid[a].kind, solid[b].kind) for a, b in pairs if a < b]


def test_entrances_of_car_parks_are_kept_free(streets):
    found = 0
    for scene in streets:
        for s0, t0, s1, t1 in scene.plan.car_parks:
            edge = min(abs(t0), abs(t1)) * np.sign(t0 + t1)
            entrance = shapely.box(s0 + 3.3, min(0.5 * edge, edge), s0 + 8.7, max(0.5 * edge, edge))
            assert not any(
                shapely.intersects(entrance, thing.footprint()) for thing in scene.things if thing.kind not in ("grass", "person")
            )
            found += 1
            assert s1 - s0 >= 20
    assert found == len(CHARACTERS)


@pytest.mark.parametrize("parking", ["along", "across"])
def test_what_drives_passes_what_is_parked(parking):
    """The sensor's car, cyclists and other vehicles, beside lorries among parked cars, too: bays are 2.1 and 5 metres deep."""
    plans = (draw_street_plan(np.random.default_rng([5, seed]), "residential", 40.0) for seed in range(60))
    met = 0
    for plan in [plan for plan in plans if any(line.parking == parking for line in plan.lines) and not plan.island][:8]:
        scene = fill(np.random.default_rng(6), plan, 40.0)
        parked = [shrunk(thing.footprint()) for thing in scene.things if thing.kind == "vehicle"]
        for mover in scene.movers:
            assert mover.thing.kind == "person"
        scene.movers.clear()
        for seed in range(6):
            add_traffic(np.random.default_rng(seed), scene, 2.0, np.arange(0, 40.0, 2.0))
        ways = [shapely.box(-5, plan.lane_t - 0.95, 45, plan.lane_t + 0.95)]
        ways += [shapely.convex_hull(shapely.union_all([shrunk(mover.at_scan(k).footprint()) for k in (0, 20)])) for mover in scene.movers]
        assert not shapely.STRtree(parked).query(ways, predicate="intersects").size
        met += len(scene.movers)
    assert met > 10
