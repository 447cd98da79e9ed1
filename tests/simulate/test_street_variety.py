"""How much simulated streets differ."""

from dataclasses import replace

import numpy as np
import pytest

from hilbertvae.simulate.floor import SENSORS_INDOORS
from hilbertvae.simulate.shares import picked
from hilbertvae.simulate.spinning_lidar import SENSORS
from hilbertvae.simulate.street import CHARACTERS, StreetSettings, draw_lidar, simulate_street
from hilbertvae.simulate.street_variety import HILLY, VARIETIES, Mount, draw_character, draw_mount, hilly

USUAL, WIDE = VARIETIES["usual"], VARIETIES["wide"]


@pytest.mark.parametrize("variety", VARIETIES.values(), ids=list(VARIETIES))
def test_shares_sum_to_one_and_name_what_there_is(variety):
    assert sum(variety.characters.values()) == pytest.approx(1) and sum(variety.sensors.values()) == pytest.approx(1)
    assert tuple(variety.characters) == CHARACTERS and set(variety.sensors) <= set(SENSORS) and set(HILLY) <= set(CHARACTERS)
    assert set(variety.where) <= set(variety.sensors) and all(set(where) <= set(CHARACTERS) for where in variety.where.values())


def test_wide_streets_and_floors_have_all_sensors():
    assert set(WIDE.sensors) | set(SENSORS_INDOORS) == set(SENSORS) and sum(SENSORS_INDOORS.values()) == pytest.approx(1)


def test_shares_are_those_that_are_drawn():
    rng = np.random.default_rng(0)
    drawn = [picked(rng, {"a": 1.0, "b": 3.0, "c": 0.0}) for _ in range(2000)]
    assert drawn.count("b") / 2000 == pytest.approx(0.75, abs=0.03) and "c" not in drawn


def test_carriers_are_where_they_are_said_to_be():
    def share(variety, sensor, robot):
        rng = np.random.default_rng(0)
        return np.mean([draw_character(rng, variety, sensor, robot) == "park" for _ in range(2000)])

    assert share(USUAL, "hdl64", False) == pytest.approx(0.07, abs=0.02)
    assert share(USUAL, "os1", False) == pytest.approx(12 * 0.07 / (0.93 + 12 * 0.07), abs=0.04)
    assert share(WIDE, "vlp16", True) == pytest.approx(4 * 0.2 / (0.8 + 4 * 0.2), abs=0.04)


def test_only_wide_streets_mount_sensors_otherwise():
    rng = np.random.default_rng(0)
    assert draw_mount(rng, USUAL) is None
    mounts = [draw_mount(rng, WIDE) for _ in range(500)]
    robots = [mount for mount in mounts if mount.robot]
    assert len(robots) / 500 == pytest.approx(WIDE.robots, abs=0.06)
    assert max(mount.height_m for mount in robots) < min(mount.height_m for mount in mounts if not mount.robot)


def test_a_mount_moves_the_sensor_and_a_robot_hides_no_road():
    lidar, settings = SENSORS["hdl32"], StreetSettings()
    on_robot, on_car = Mount(True, 0.9, 2.5, 2), Mount(False, 2.1, 0.6, 1)
    assert on_robot.carrying(lidar) == replace(lidar, height_m=0.9, azimuths=545, car=(), posts=4)
    assert on_car.carrying(lidar) == replace(lidar, height_m=2.1)
    drawn = draw_lidar(np.random.default_rng(0), "hdl32", settings, on_robot)
    assert abs(drawn.height_m - 0.9) < 0.15 and drawn.azimuths == 545 and drawn.car == ()


def test_only_open_land_gets_hillier():
    pytest.importorskip("shapely")
    from hilbertvae.simulate.street_plan import draw_street_plan

    rng = np.random.default_rng(0)
    for character in CHARACTERS:
        plan = draw_street_plan(rng, character, 5.0, 30.0)
        assert hilly(rng, plan, USUAL) is plan
        steep = hilly(rng, plan, WIDE)
        if character not in HILLY:
            assert steep is plan
            continue
        before, after = plan.ground, steep.ground
        more = after.waves[:, 3] / before.waves[:, 3]
        assert np.ptp(more) < 1e-12 and 1 <= more[0] <= WIDE.most_relief
        np.testing.assert_array_equal(after.waves[:, :3], before.waves[:, :3])
        assert 1 <= after.crossfall / before.crossfall <= WIDE.most_relief
        assert after.road is before.road and steep.lots is plan.lots


@pytest.mark.parametrize("seed", range(6))
def test_wide_streets_are_scanned_and_the_same_again(sim, seed):
    settings = StreetSettings(variety="wide", azimuths=60, scans=2, max_range_m=25.0)
    scans, again = simulate_street(settings, seed), simulate_street(settings, seed)
    assert len(scans) > 100 and np.isfinite(scans.points).all() and np.isfinite(scans.origins).all()
    assert scans.points.tobytes() == again.points.tobytes()
