"""A network's card says how the simulated sites of its training were made."""

import json

import pytest

from hilbertvae.checks import InputError
from hilbertvae.scans.formats import ReadingSettings
from hilbertvae.simulate.street import StreetSettings
from hilbertvae.training.learned_as import KEY, as_made, learned_as, settings_of
from hilbertvae.training.settings import DataSettings, Settings


def test_a_card_brings_back_how_sites_were_made_and_weights_learned():
    read = ReadingSettings(every=2, beam_origin="hdl64", sensor_origin_m=[0.0, 0.0, 1.5])
    data = DataSettings(simulated=3, street=StreetSettings(scans=4), simulated_scans=20, simulated_extent_m=[12.0, 16.0], reading=read)
    data.simulated_variety = "wide"
    made = Settings(dimension=3, data=data, validation_gap_m=1.5, calibration_seeds=[7])
    card = json.loads(json.dumps({KEY: learned_as(made)}))  # as in a file
    found = settings_of(card, 3)
    assert found.source() == made.source() and found.calibration() == made.calibration()
    assert settings_of({}, 3) == Settings(dimension=3)
    del card[KEY]["data"]["simulated_variety"], card[KEY]["calibration_given"]  # as in older cards
    assert settings_of(card, 3).data.simulated_variety == "usual"
    assert settings_of(card, 3).calibration_given == "scans"


def test_a_card_says_whether_maps_were_given():
    card = {KEY: learned_as(Settings(calibration_given="map"))}
    assert settings_of(card, 2).calibration()["given"] == "map"
    card[KEY]["calibration_given"] = "maps"
    with pytest.raises(InputError, match="card.learned_as.calibration_given: expected one of scans, map, fine-map, got 'maps'"):
        settings_of(card, 2)


@pytest.mark.parametrize("damaged", [3, {}, {"data": {"street": {"lanes": 2}}}])
def test_what_no_training_keeps_is_named(damaged):
    with pytest.raises(InputError, match="card.learned_as: expected what a training"):
        settings_of({KEY: damaged}, 3)


def test_a_simulated_site_is_its_number_and_how_it_is_made():
    few, many = (Settings(dimension=3, data=DataSettings(street=StreetSettings(scans=scans))).source() for scans in (4, 30))
    assert as_made(["simulated:07"], few) == as_made(["simulated:7"], few) != as_made(["simulated:7"], many)
    assert as_made(["kitti00_start"], few) == as_made(["kitti00_start"], many)
