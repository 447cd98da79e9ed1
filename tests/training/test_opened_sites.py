from dataclasses import replace

import pytest

from hilbertvae.last_few import LastFew
from hilbertvae.training import opened_sites
from hilbertvae.training.opened_sites import KEPT, opened_site
from hilbertvae.training.settings import DataSettings, Settings


@pytest.fixture(autouse=True)
def none_is_open(monkeypatch):
    monkeypatch.setattr(opened_sites, "_opened", LastFew(KEPT))


@pytest.fixture
def settings():
    return Settings(data=DataSettings(train=["aces"], validate="csail", test=[], simulated_scans=8, simulated_extent_m=[8.0, 10.0]))


def test_a_site_is_opened_once_and_the_one_asked_for_longest_ago_is_let_go(settings):
    first, second = (opened_site(f"simulated:{seed}", settings) for seed in (0, 1))
    assert opened_site("simulated:0", settings) is first
    third = opened_site("simulated:2", settings)
    assert opened_site("simulated:0", settings) is first and opened_site("simulated:2", settings) is third
    assert opened_site("simulated:1", settings) is not second
    assert len(opened_sites._opened) == KEPT


def test_another_resolution_or_another_simulator_is_another_site(settings):
    first = opened_site("simulated:0", settings)
    finer = opened_site("simulated:0", replace(settings, resolution_m=0.05))
    assert finer is not first and finer.resolution_m == 0.05
    slower = replace(settings, data=replace(settings.data, simulated_scans=9))
    assert opened_site("simulated:0", slower) is not first
