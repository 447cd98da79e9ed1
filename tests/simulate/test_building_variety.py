"""How much simulated buildings differ."""

from dataclasses import replace

import numpy as np
import pytest

from hilbertvae.simulate.building import BuildingSettings, simulate_building
from hilbertvae.simulate.building_variety import LASERS, OWN, SMALLEST_EXTENT_M, VARIETIES, draw_extent_m, draw_laser
from hilbertvae.simulate.laser import LaserSettings

USUAL, WIDE = VARIETIES["usual"], VARIETIES["wide"]


def drawn(variety, count=2000, own=None):
    rng, for_variety = np.random.default_rng(0), np.random.default_rng(1)
    return [draw_laser(rng, for_variety, variety, own or LaserSettings()) for _ in range(count)]


@pytest.mark.parametrize("variety", VARIETIES.values(), ids=list(VARIETIES))
def test_shares_sum_to_one_and_name_what_there_is(variety):
    assert sum(variety.lasers.values()) == pytest.approx(1) and set(variety.lasers) <= {OWN, *LASERS}
    assert 0 <= variety.small < 1


def test_wide_buildings_have_all_lasers_as_often_as_said():
    kinds = [(laser.beams, laser.field_of_view_deg) for laser in drawn(WIDE)]
    assert set(WIDE.lasers) == {OWN, *LASERS}
    for name, known in LASERS.items():
        share = kinds.count((known["beams"], known["field_of_view_deg"])) / len(kinds)
        assert share == pytest.approx(WIDE.lasers[name], abs=0.03), name


def test_a_laser_of_another_kind_keeps_its_beams_and_its_range_and_the_faults_of_the_settings():
    own = LaserSettings(miss_share=0.1, glass_return_share=0.2, edge_mix_share=0.0)
    by_beams = {known["beams"]: known for known in LASERS.values() if known["beams"] != 360}
    others = [laser for laser in drawn(WIDE, 300, own) if laser.beams in by_beams]
    assert len(others) > 100
    for laser in others:
        known = by_beams[laser.beams]
        assert laser.max_range_m == known["max_range_m"] and laser.range_step_m == known["range_step_m"]
        assert 0.6 <= laser.range_noise_m / known["range_noise_m"] <= 1.8
        assert laser.glass_return_share == 0.2 and laser.edge_mix_share == 0.0
        assert any(laser.miss_share == pytest.approx(share) for share in (0.03, 0.1, 0.3))


def test_usual_lasers_are_of_the_settings_kind():
    own = LaserSettings(beams=100, field_of_view_deg=200.0, max_range_m=20.0)
    lasers = drawn(USUAL, 100, own)
    assert {laser.beams for laser in lasers} == {100, 200}
    assert {laser.max_range_m for laser in lasers} == {17.0, 20.0, 26.0} and {laser.field_of_view_deg for laser in lasers} == {200.0}


def test_only_wide_buildings_are_smaller_than_the_shortest():
    rng, for_variety = np.random.default_rng(0), np.random.default_rng(1)
    usual, wide = (np.array([draw_extent_m(rng, for_variety, variety, 30.0, 95.0) for _ in range(2000)]) for variety in (USUAL, WIDE))
    assert usual.min() >= 30 and usual.max() <= 95 and wide.min() >= SMALLEST_EXTENT_M
    assert (wide < 30).mean() == pytest.approx(WIDE.small, abs=0.03)
    assert draw_extent_m(rng, for_variety, replace(WIDE, small=1.0), 8.0, 9.0) == 8.0


@pytest.mark.parametrize("seed", range(6))
def test_wide_buildings_are_scanned_and_the_same_again(sim, seed):
    settings = BuildingSettings(shortest_extent_m=12, longest_extent_m=16, scans=12, variety="wide")
    scans, again = simulate_building(settings, seed), simulate_building(settings, seed)
    assert len(scans) > 100 and np.isfinite(scans.points).all() and np.isfinite(scans.origins).all()
    assert scans.points.tobytes() == again.points.tobytes()


def test_a_laser_that_is_not_to_be_drawn_is_that_of_the_settings(sim):
    settings = BuildingSettings(shortest_extent_m=12, longest_extent_m=16, scans=12, variety="wide", draw_laser=False)
    assert {int(simulate_building(settings, seed).beam.max()) < 180 for seed in range(6)} == {True}
