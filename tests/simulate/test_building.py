"""Simulated buildings as a whole."""

from dataclasses import replace

import numpy as np
import pytest

from hilbertvae.checks import InputError
from hilbertvae.simulate.building import STYLES, BuildingSettings, simulate_building
from hilbertvae.simulate.laser import LaserSettings

TINY = BuildingSettings(shortest_extent_m=8, longest_extent_m=10, scans=8)


@pytest.mark.parametrize("seed", [0, 1])
def test_the_same_seed_gives_the_same_bits(sim, seed):
    first, again = simulate_building(TINY, seed), simulate_building(TINY, seed)
    for name in ("points", "origins", "scan", "beam"):
        assert getattr(first, name).tobytes() == getattr(again, name).tobytes()


def test_another_seed_gives_another_building(sim):
    first, other = simulate_building(TINY, 0), simulate_building(TINY, 1)
    assert len(first) != len(other) or not np.array_equal(first.points, other.points)


@pytest.mark.parametrize("style", STYLES)
def test_scans_are_what_a_laser_returns(sim, style):
    settings = BuildingSettings(style, 20, 30, scans=60, draw_laser=False, laser=LaserSettings(max_range_m=6.0))
    scans = simulate_building(settings, 3)
    ranges = np.linalg.norm(scans.points - scans.origins, axis=1)
    assert scans.dimension == 2 and scans.points.dtype == np.float64
    assert scans.scan.dtype == np.int32 and (np.diff(scans.scan) >= 0).all() and scans.scan.max() == 59
    assert scans.beam.min() >= 0 and scans.beam.max() < 180
    assert ranges.min() > 0 and ranges.max() < 6.0
    assert len(scans) > 60 * 180 / 3


def test_pose_noise_moves_the_map_by_centimetres_only(sim):
    still = BuildingSettings("corridors", 20, 20, scans=50, pose_noise_m=0, heading_noise_deg=0)
    exact = simulate_building(still, 4)
    noisy = simulate_building(BuildingSettings("corridors", 20, 20, scans=50), 4)
    moved = np.linalg.norm(exact.origins - noisy.origins, axis=1)
    assert 0 < moved.max() < 0.2


def exact(**settings):
    """A hall by a laser and poses without faults, each return by its scan and beam."""
    laser = LaserSettings(
        range_noise_m=0, range_step_m=0, miss_share=0, edge_mix_share=0, glass_return_share=0, glass_pass_share=1, max_range_m=1e3
    )
    faultless = {"pose_noise_m": 0, "heading_noise_deg": 0, "draw_laser": False, "laser": laser}
    scans = simulate_building(BuildingSettings("hall", 12, 12, scans=60, **faultless, **settings), 3)
    lengths = np.full((60, 180), np.inf)
    lengths[scans.scan, scans.beam] = np.linalg.norm(scans.points - scans.origins, axis=1)
    return lengths


def test_passers_by_hide_what_is_behind_them_and_nothing_else(sim):
    alone, among_many = exact(sweeps_per_passer_by=float("inf")), exact(sweeps_per_passer_by=1.0)
    hidden = among_many < alone - 0.05
    assert 0.02 < hidden.mean() < 0.2
    np.testing.assert_allclose(among_many[~hidden], alone[~hidden], atol=0.05)


def test_lasers_vary_from_building_to_building_only_where_asked_for(sim):
    """A half circle of 180 or of 360 beams."""
    drawn = {simulate_building(TINY, seed).beam.max() >= 180 for seed in range(6)}
    kept = {simulate_building(replace(TINY, draw_laser=False), seed).beam.max() >= 180 for seed in range(6)}
    assert drawn == {True, False} and kept == {False}


def test_returns_lie_on_beams_of_the_pose_that_the_robot_believes_it_has(sim):
    settings = BuildingSettings("hall", 12, 16, scans=20, heading_noise_deg=3.0, draw_laser=False)
    scans = simulate_building(settings, 2)
    rays = scans.points - scans.origins
    steps = np.linalg.norm(rays, axis=1) / settings.laser.range_step_m
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    heading = np.exp(1j * (np.arctan2(rays[:, 1], rays[:, 0]) - np.deg2rad(scans.beam)))
    for k in range(20):
        of_scan = scans.scan == k
        np.testing.assert_allclose(heading[of_scan], heading[of_scan][0], atol=1e-9)
        assert (scans.origins[of_scan] == scans.origins[of_scan][0]).all()


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"style": "castle"}, r'building.style: expected "any" or one of corridors'),
        ({"shortest_extent_m": 50.0, "longest_extent_m": 40.0}, "building.shortest_extent_m: expected at least 6 and at most"),
        ({"shortest_extent_m": 2.0}, "building.shortest_extent_m: expected at least 6"),
        ({"longest_extent_m": float("inf")}, "building.longest_extent_m: expected a positive number"),
        ({"scans": 0}, "building.scans: expected a whole number of at least 1"),
        ({"clearance_m": -0.1}, "building.clearance_m: expected a positive number"),
        ({"pose_noise_m": -0.1}, "building.pose_noise_m: expected a number from 0 on"),
        ({"sweeps_per_passer_by": 0.5}, "building.sweeps_per_passer_by: expected at least 1"),
        ({"sweeps_per_passer_by": "6"}, "building.sweeps_per_passer_by: expected at least 1, or inf for nobody, got '6'"),
        ({"sweeps_per_passer_by": float("nan")}, "building.sweeps_per_passer_by: expected at least 1"),
        ({"style": ["hall"]}, 'building.style: expected "any" or one of corridors'),
        ({"variety": "any"}, "building.variety: expected one of usual, wide, got 'any'"),
        ({"draw_laser": "no"}, "building.draw_laser: expected true or false, got 'no'"),
        ({"laser": None}, "building.laser: expected LaserSettings, got None"),
        ({"longest_extent_m": 1e6}, "building.longest_extent_m: expected at most 1000, got 1000000.0"),
    ],
)
def test_bad_settings_are_named(setting, message):
    with pytest.raises(InputError, match=message):
        BuildingSettings(**setting)


@pytest.mark.parametrize("seed", [-1, 1.5, None])
def test_a_bad_seed_is_named(seed):
    with pytest.raises(InputError, match="seed: expected a whole number of at least 0"):
        simulate_building(TINY, seed)


def test_a_building_nobody_can_drive_through_is_named(sim):
    with pytest.raises(InputError, match="no drivable building in"):
        simulate_building(BuildingSettings("corridors", 8, 8, clearance_m=9.0), 0)


@pytest.mark.parametrize("laser", [LaserSettings(max_range_m=0.01), LaserSettings(miss_share=1.0)])
def test_a_building_of_which_nothing_comes_back_is_named(sim, laser):
    with pytest.raises(InputError, match="building.laser: expected returns within .* m, got none in 8 scans; allow a longer max_range_m"):
        simulate_building(replace(TINY, draw_laser=False, laser=laser), 0)


def test_a_missing_extra_is_named(no_shapely):
    with pytest.raises(InputError, match=r"shapely is not installed: pip install 'hilbertvae\[sim\]'"):
        simulate_building(TINY, 0)
