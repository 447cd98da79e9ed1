"""Sensor presets, and what a turn makes of a scene."""

from dataclasses import replace

import numpy as np
import pytest

from hilbertvae.checks import InputError
from hilbertvae.simulate.laser import mixed_at_edges
from hilbertvae.simulate.soup import Surface, boxes_3d, joined, quads
from hilbertvae.simulate.spinning_lidar import SENSORS, hidden_by_car, rays, sense_turn

pytest.importorskip("embreex")

from hilbertvae.simulate.surfaces import SurfaceCaster, echoes  # noqa: E402

EXACT = replace(SENSORS["hdl64"], azimuths=60, range_noise_m=0.0, laser_bias_m=0.0, miss_share=0.0, edge_mix_share=0.0, faintest=1e-12)


def pane(x, kind, half=50.0):
    return quads([[x, -half, -half], [x, half, -half], [x, half, half], [x, -half, half]], kind)


def test_presets_have_the_lasers_of_the_real_sensors():
    hdl64, hdl32, os1 = (np.array(SENSORS[name].elevations_deg) for name in ("hdl64", "hdl32", "os1"))
    assert (len(hdl64), len(hdl32), len(os1)) == (64, 32, 64)
    np.testing.assert_allclose(np.diff(hdl64[:32]), -1 / 3, atol=0.02)
    np.testing.assert_allclose(np.diff(hdl64[32:]), -1 / 2, atol=0.03)
    assert hdl64[0] == pytest.approx(2, abs=0.1) and hdl64[-1] == pytest.approx(-24.8, abs=0.3)
    assert set(SENSORS["hdl64"].start_heights_m[:32]) == {0.20} and set(SENSORS["hdl64"].start_heights_m[32:]) == {0.12}
    np.testing.assert_allclose([hdl32[0], hdl32[-1]], [10.67, -30.67])
    np.testing.assert_allclose([os1[0], os1[-1]], [16.6, -16.6])


@pytest.mark.parametrize("name", SENSORS)
def test_no_ring_is_held_out_as_a_whole(name):
    """A map is fitted without each tenth beam, and scored by it: next to one that was held out there are others that were not."""
    beam = np.arange(200 * SENSORS[name].lasers).reshape(200, -1)
    assert not (beam % 10 == 0).all(axis=0).any()


def test_rays_have_unit_length_and_turn_clockwise():
    starts, directions = rays(EXACT)
    assert starts.shape == directions.shape == (60, 64, 3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=2), 1)
    np.testing.assert_allclose(directions[15, :, 0], 0, atol=1e-12)
    assert (directions[15, :, 1] < 0).all()


def test_ranges_on_a_wall_are_exact():
    ranges = one_turn(EXACT, pane(10.0, Surface.CLOTH))
    np.testing.assert_allclose(ranges[0], 10 / np.cos(np.deg2rad(EXACT.elevations_deg)))
    assert np.isnan(ranges[20:40]).all()


def one_turn(lidar, scene, laser_bias_m=0.0):
    """(azimuths, lasers) metres: a turn in the middle of the world, no beam of it hidden."""
    none = np.zeros((lidar.azimuths, lidar.lasers), bool)
    return sense_turn(np.random.default_rng(0), lidar, rays(lidar), [SurfaceCaster(scene)], np.eye(4), laser_bias_m, none)


def test_ranges_have_the_noise_of_the_sensor_and_the_bias_of_their_laser():
    around = replace(EXACT, azimuths=600)
    bias = np.linspace(-0.05, 0.05, 64)
    scene = boxes_3d([0, 0, -20], [20, 20, 40], surface=Surface.CLOTH)
    errors = one_turn(replace(around, range_noise_m=0.02), scene, bias) - one_turn(around, scene)
    np.testing.assert_allclose(errors.mean(axis=0), bias, atol=0.004)
    assert (errors - bias).std() == pytest.approx(0.02, rel=0.03)


@pytest.mark.parametrize(("kind", "spread_m"), [(Surface.CLOTH, 0.0), (Surface.WALL, 0.012), (Surface.LEAF, 0.03)])
def test_rough_surfaces_spread_ranges(kind, spread_m):
    lidar = replace(EXACT, azimuths=200)
    errors = one_turn(lidar, boxes_3d([0, 0, -20], [20, 20, 40], surface=kind)) - one_turn(
        lidar, boxes_3d([0, 0, -20], [20, 20, 40], surface=Surface.CLOTH)
    )
    assert errors.std() == pytest.approx(spread_m, rel=0.04)


def test_as_many_beams_are_lost_as_asked_for():
    lidar = replace(EXACT, azimuths=300, miss_share=0.1)
    assert np.isnan(one_turn(lidar, boxes_3d([0, 0, -20], [20, 20, 40], surface=Surface.CLOTH))).mean() == pytest.approx(0.1, abs=0.008)


def test_beams_at_small_edges_mix_both_depths():
    """A palisade: posts of 0.5 m, half a metre before a wall, which goes on beside them until beams graze it."""
    lidar = replace(EXACT, azimuths=1200)
    posts = boxes_3d([[10, y, -20] for y in np.arange(-10, 10, 1.0)], [0.02, 0.5, 40], surface=Surface.CLOTH)
    scene = joined([posts, pane(10.5, Surface.CLOTH)])
    truth, found = one_turn(lidar, scene), one_turn(replace(lidar, edge_mix_share=0.3), scene)
    before, at_post = np.roll(truth, 1, axis=0), truth * rays(lidar)[1][..., 0] < 10.25
    with np.errstate(invalid="ignore"):
        jump = np.abs(truth - before)
        edge = (at_post != np.roll(at_post, 1, axis=0)) & (jump > 0.1) & (jump < 1.0)
        mixed = (found != truth) & np.isfinite(truth)
    assert edge.sum() > 1000 and ((jump > 0.1) & ~edge).sum() > 1000 and not (mixed & ~edge).any()
    assert mixed[edge].mean() == pytest.approx(0.3, abs=0.05)
    assert ((found > np.minimum(truth, before)) & (found < np.maximum(truth, before)))[mixed].all()


@pytest.mark.parametrize("first_deeper", [False, True])
def test_edges_mix_where_a_turn_ends_as_anywhere(first_deeper):
    """Half of the bearings at 5 m and half at 5.5 m: the turn begins at one of the two edges."""
    ranges = np.full((60, 400), 5.0)
    ranges[:30] += 0.5 * first_deeper
    ranges[30:] += 0.5 * (not first_deeper)
    found = mixed_at_edges(np.random.default_rng(0), np.pad(ranges, ((2, 1), (0, 0)), mode="wrap"), 1.0, 1.0)
    assert (
        np.flatnonzero((found != ranges).all(axis=1)).tolist() == [0, 30]
        and np.isin(np.flatnonzero((found != ranges).any(axis=1)), [0, 30]).all()
    )


def test_a_pole_where_a_turn_ends_mixes_as_one_elsewhere():
    """A thin board before a wall, at the bearing at which the turn begins, and opposite."""
    lidar = replace(EXACT, azimuths=400, edge_mix_share=1.0)
    board = boxes_3d([[9.5, 0.1, -20], [-9.5, 0.1, -20]], [0.02, 1.0, 40], surface=Surface.CLOTH)
    room = boxes_3d([0, 0, -20], [20, 20, 40], surface=Surface.CLOTH)
    scene = joined([board, room])
    truth, found = one_turn(replace(lidar, edge_mix_share=0.0), scene), one_turn(lidar, scene)
    with np.errstate(invalid="ignore"):
        mixed = (np.abs(found - truth) > 1e-6).any(axis=1)
    assert mixed[-12:].sum() + mixed[:12].sum() == mixed[188:212].sum() > 0


def test_posts_hide_whole_bearings_and_at_most_so_many():
    lidar = replace(SENSORS["os1"], posts=4, car=())
    counts = []
    for seed in range(30):
        hidden = hidden_by_car(np.random.default_rng(seed), lidar)
        assert (hidden.any(axis=1) == hidden.all(axis=1)).all()
        counts.append(np.count_nonzero(hidden[:, 0] & ~np.roll(hidden[:, 0], 1)))
    assert set(counts) <= {0, 1, 2, 3, 4} and len(set(counts)) >= 4
    assert not hidden_by_car(np.random.default_rng(0), replace(lidar, posts=0)).any()


def test_the_nearest_of_several_scenes_answers():
    casters = [SurfaceCaster(pane(10.0, Surface.CLOTH)), SurfaceCaster(boxes_3d([6, 0, -5], [2, 2, 10], surface=Surface.CLOTH))]
    echo = echoes(np.random.default_rng(0), casters, np.zeros((2, 3)), np.array([[1.0, 0, 0], [0.8, 0.6, 0]]))
    np.testing.assert_allclose(echo.ranges, [5.0, 12.5])


@pytest.mark.parametrize(
    ("kind", "returned", "passed"), [(Surface.GLASS, 0.015, 0.04), (Surface.PANE, 0.03, 0.85), (Surface.NET, 0.35, 0.65)]
)
def test_panes_and_nets_let_beams_through(kind, returned, passed):
    caster = SurfaceCaster(joined([pane(5.0, kind), pane(8.0, Surface.WALL)]))
    count = 20_000
    echo = echoes(np.random.default_rng(0), [caster], np.zeros((count, 3)), np.tile([1.0, 0, 0], (count, 1)))
    assert np.mean(np.abs(echo.ranges - 5) < 1e-6) == pytest.approx(returned, abs=0.02)
    assert np.mean(np.abs(echo.ranges - 8) < 1e-6) == pytest.approx(passed, abs=0.02)
    assert np.isinf(echo.ranges).mean() == pytest.approx(1 - returned - passed, abs=0.02)


def test_dark_and_slanted_surfaces_are_lost_with_range():
    lidar = replace(SENSORS["hdl64"], azimuths=400)
    shares = []
    for kind, metres in ((Surface.WALL, 60.0), (Surface.DARK, 15.0), (Surface.DARK, 75.0)):
        shares.append(np.isfinite(one_turn(lidar, pane(metres, kind))[:20]).mean())
    assert shares[0] > 0.9 and shares[1] > 0.9 > shares[2]


@pytest.mark.parametrize("name", SENSORS)
def test_the_car_hides_low_beams_ahead_and_behind_only(name):
    lidar = replace(SENSORS[name], posts=0)
    hidden = hidden_by_car(np.random.default_rng(0), lidar)
    aside = lidar.azimuths // 4
    assert hidden.shape == (lidar.azimuths, lidar.lasers)
    assert not hidden[aside - 10 : aside + 10].any() and not hidden[:, 0].any()
    assert hidden[0].any() == bool(lidar.car)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"azimuths": 3}, "lidar.azimuths"),
        ({"elevations_deg": ()}, "lidar.elevations_deg"),
        ({"start_heights_m": (0.0,)}, "lidar.start_heights_m"),
        ({"elevations_deg": (float("nan"),) * 64}, "lidar.elevations_deg: expected angles from -90 to 90"),
        ({"elevations_deg": (100.0,) * 64}, "lidar.elevations_deg: expected angles from -90 to 90"),
        ({"start_heights_m": (float("nan"),) * 64}, "lidar.start_heights_m: expected finite numbers"),
        ({"posts": -1}, "lidar.posts: expected a whole number of at least 0, got -1"),
        ({"car": ((0, -22, 20, 0),)}, "lidar.car: expected rows of bearing, elevation"),
        ({"car": ((0, -22, 20),)}, "lidar.car: expected rows of bearing, elevation"),
        ({"max_range_m": -1.0}, "lidar.max_range_m"),
        ({"range_noise_m": -1.0}, "lidar.range_noise_m"),
        ({"nearest_m": 1000.0}, "lidar.nearest_m: expected less than max_range_m"),
        ({"miss_share": 2.0}, "lidar.miss_share"),
    ],
)
def test_bad_settings_are_named(setting, message):
    with pytest.raises(InputError, match=message):
        replace(EXACT, **setting)
