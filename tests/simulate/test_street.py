"""Simulated streets as a whole."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hilbertvae.checks import InputError
from hilbertvae.simulate import street
from hilbertvae.simulate.spinning_lidar import SENSORS
from hilbertvae.simulate.street import CHARACTERS, StreetSettings, simulate_street

COARSE = {"azimuths": 90, "scans": 3, "max_range_m": 25.0}
TINY = StreetSettings(**COARSE)


@pytest.mark.parametrize("seed", [0, 1])
def test_the_same_seed_gives_the_same_bits(sim, seed):
    first, again = simulate_street(TINY, seed), simulate_street(TINY, seed)
    for name in ("points", "origins", "scan", "beam"):
        assert getattr(first, name).tobytes() == getattr(again, name).tobytes()


def test_another_seed_gives_another_street(sim):
    first, other = simulate_street(TINY, 0), simulate_street(TINY, 1)
    assert len(first) != len(other) or not np.array_equal(first.points, other.points)


@settings(max_examples=6)
@given(seed=st.integers(0, 2**32), character=st.sampled_from(list(CHARACTERS)))
def test_scans_of_any_street_are_finite_and_not_empty(sim_installed, seed, character):
    scans = simulate_street(StreetSettings(character=character, azimuths=40, scans=2, max_range_m=20.0), seed)
    assert len(scans) > 40 * 32 / 4
    assert np.isfinite(scans.points).all() and np.isfinite(scans.origins).all()


@pytest.fixture(scope="module")
def sim_installed():
    pytest.importorskip("embreex")
    pytest.importorskip("shapely")


@pytest.mark.parametrize("sensor", SENSORS)
def test_returns_lie_on_their_beams(sim, sensor):
    still = {"pose_noise_m": 0.0, "heading_noise_deg": 0.0, "single_scan_share": 0.0}
    scans = simulate_street(StreetSettings(sensor=sensor, **COARSE, **still), 2)
    lidar = SENSORS[sensor]
    rays = scans.points - scans.origins
    ranges = np.linalg.norm(rays, axis=1)
    assert scans.dimension == 3 and scans.points.dtype == np.float64 and scans.scan.dtype == scans.beam.dtype == np.int32
    assert (np.diff(scans.scan) >= 0).all() and scans.scan.max() >= 1 and scans.beam.max() < 90 * lidar.lasers
    assert ranges.min() > 2.5 and ranges.max() < 25.0
    # The first scan's sensor frame is the map frame, so that its beams have the lasers' own elevations and starts.
    first = scans.scan == 0
    laser, azimuth = scans.beam[first] % lidar.lasers, scans.beam[first] // lidar.lasers
    elevation = np.rad2deg(np.arcsin(rays[first, 2] / ranges[first]))
    np.testing.assert_allclose(elevation, np.array(lidar.elevations_deg)[laser], atol=1e-6)
    bearing = np.arctan2(rays[first, 1], rays[first, 0])
    np.testing.assert_allclose(np.exp(1j * bearing), np.exp(-2j * np.pi * azimuth / 90), atol=1e-9)
    np.testing.assert_allclose(scans.origins[first, 2], np.array(lidar.start_heights_m)[laser], atol=1e-9)
    np.testing.assert_allclose(scans.origins[first, :2], 0, atol=1e-9)


def test_most_low_returns_lie_on_the_road_under_the_sensor(sim):
    scans = simulate_street(StreetSettings(sensor="hdl64", scans=1, azimuths=200, max_range_m=20.0), 5)
    near = np.linalg.norm(scans.points[:, :2], axis=1) < 8
    assert abs(np.quantile(scans.points[near, 2], 0.2) + SENSORS["hdl64"].height_m) < 0.3


def test_drives_are_as_long_as_wanted(sim):
    one = simulate_street(StreetSettings(single_scan_share=1.0, **COARSE), 1)
    more = simulate_street(StreetSettings(single_scan_share=0.0, shortest_step_m=2, longest_step_m=2, **COARSE), 1)
    assert one.scan.max() == 0 and 1 <= more.scan.max() <= 2
    middles = np.array([more.origins[more.scan == k].mean(axis=0) for k in range(more.scan.max() + 1)])
    np.testing.assert_allclose(np.linalg.norm(np.diff(middles, axis=0), axis=1), 2.0, atol=0.3)


def test_pose_noise_moves_the_map_by_centimetres_only(sim):
    drive = {"single_scan_share": 0.0, "sensor": "os1", **COARSE}
    exact = simulate_street(StreetSettings(pose_noise_m=0, heading_noise_deg=0, **drive), 4)
    noisy = simulate_street(StreetSettings(**drive), 4)
    assert 0 < np.linalg.norm(exact.origins - noisy.origins, axis=1).max() < 0.1


@pytest.mark.parametrize("traffic", [True, False])
def test_traffic_can_be_left_out(sim, monkeypatch, traffic):
    movers = []
    monkeypatch.setattr(street, "scan_scene", lambda rng, scene, *rest: movers.extend(scene.movers))
    for seed in range(4):
        simulate_street(StreetSettings(traffic=traffic, character="town", **COARSE), seed)
    assert bool(movers) == traffic


def test_what_moves_is_further_on_in_the_next_scan(sim):
    """A box of 2 m, 9 m ahead of a car that stands, drives on by 1.5 m from scan to scan."""
    from hilbertvae.simulate.soup import Surface, boxes_3d, joined
    from hilbertvae.simulate.street_scene import Mover, Thing

    flat = SimpleNamespace(place=lambda s, t: np.array([s, t, 0.0]), heading=lambda s: 0.0)
    mover = Mover(Thing("vehicle", boxes_3d([0, 0, -20], [2, 40, 40], surface=Surface.CLOTH), 10.0, 0.0), 1.5)
    scene = SimpleNamespace(plan=SimpleNamespace(ground=flat, extent=(-50, -50, 50, 50)), movers=[mover], soup=lambda: joined([]))
    exact = StreetSettings(pose_noise_m=0.0, heading_noise_deg=0.0)
    lidar = replace(SENSORS["os1"], azimuths=90, range_noise_m=0.0, laser_bias_m=0.0, miss_share=0.0, edge_mix_share=0.0)
    scans = street.scan_scene(np.random.default_rng(0), scene, np.tile(np.eye(4), (3, 1, 1)), lidar, exact)
    fronts = [scans.points[(scans.scan == k) & (np.abs(scans.points[:, 1]) < 5), 0].mean() for k in range(3)]
    np.testing.assert_allclose(fronts, [9.0, 10.5, 12.0], atol=1e-6)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"character": "moon"}, r'street.character: expected "any" or one of residential'),
        ({"variety": "floors", "character": "town"}, "street.character: expected \"any\" where sites are floors, not streets, got 'town'"),
        ({"variety": "any"}, "street.variety: expected one of usual, wide, everywhere, floors, got 'any'"),
        ({"variety": ["wide"]}, r"street.variety: expected one of usual, wide, everywhere, floors, got \['wide'\]"),
        ({"sensor": "radar"}, r'street.sensor: expected "any" or one of hdl64'),
        ({"azimuths": 2}, "street.azimuths: expected a whole number of at least 4"),
        ({"scans": 0}, "street.scans: expected a whole number of at least 1"),
        ({"scans": 1.5}, "street.scans: expected a whole number of at least 1"),
        ({"single_scan_share": 1.5}, "street.single_scan_share: expected a share"),
        ({"shortest_step_m": 4.0}, "street.shortest_step_m: expected at most longest_step_m"),
        ({"shortest_step_m": 0.0}, "street.shortest_step_m: expected a positive number"),
        ({"max_range_m": 2.0}, "street.max_range_m: expected more than nearest_m"),
        ({"max_range_m": float("inf")}, "street.max_range_m: expected a positive number"),
        ({"pose_noise_m": -0.1}, "street.pose_noise_m: expected a number from 0 on"),
        ({"traffic": "no"}, "street.traffic: expected true or false, got 'no'"),
        ({"nearest_m": 500.0}, r"street.nearest_m: expected less than the sensor's longest range \(80.0\), got 500.0"),
        ({"nearest_m": 101.0, "sensor": "os1"}, r"street.nearest_m: expected less than the sensor's longest range \(100.0\)"),
        ({"scans": 200}, "street.longest_step_m: expected a drive of at most 500 m, got 200 scans up to 3.0 m apart"),
        ({"pose_noise_m": None}, "street.pose_noise_m: expected a number from 0 on"),
        ({"range_noise_m": float("nan")}, "street.range_noise_m: expected a number from 0 on"),
    ],
)
def test_bad_settings_are_named(setting, message):
    with pytest.raises(InputError, match=message):
        StreetSettings(**setting)


@pytest.mark.parametrize(("variety", "nearest_m"), [("usual", 2.5), ("floors", 0.5)])
def test_a_site_of_which_nothing_comes_back_is_named(sim, variety, nearest_m):
    blind = StreetSettings(variety=variety, azimuths=90, scans=2, nearest_m=nearest_m, max_range_m=nearest_m + 1e-6)
    with pytest.raises(
        InputError, match=rf"street: expected returns from {nearest_m} to .* m, got none in . scans; allow a longer max_range_m"
    ):
        simulate_street(blind, 0)


def test_sites_of_one_scan_drive_nowhere():
    assert StreetSettings(scans=1000, single_scan_share=1.0).scans == 1000


@pytest.mark.parametrize("seed", [-1, 1.5, None])
def test_a_bad_seed_is_named(seed):
    with pytest.raises(InputError, match="seed: expected a whole number of at least 0"):
        simulate_street(TINY, seed)


def test_a_missing_extra_is_named(no_shapely):
    with pytest.raises(InputError, match=r"shapely is not installed: pip install 'hilbertvae\[sim\]'"):
        simulate_street(TINY, 0)
