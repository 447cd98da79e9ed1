"""The networks that come with the package: all there, small enough, described as they are, and of use."""

from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir

import hilbertvae
from hilbertvae.commands.configuration import CONF, to_settings
from hilbertvae.gaps import INSIDE, random_gaps
from hilbertvae.mappers.weights import occupied_weight_of
from hilbertvae.reconstruction.reconstructor import Reconstructor
from hilbertvae.reconstruction.shipped import SHIPPED, checkpoint_path
from hilbertvae.reconstruction.training_card import LEARNED_AS, calibrated_on, stages
from hilbertvae.reports.card import card_text
from hilbertvae.scans.sites import CATALOGUE
from hilbertvae.scoring.metrics import score

RESULTS = Path(__file__).parents[1] / "docs/results/shipped"
MOST_BYTES = 20_000_000


def test_they_are_all_there_and_small():
    sizes = {name: checkpoint_path(name).stat().st_size for name in SHIPPED}
    assert sum(sizes.values()) <= MOST_BYTES, sizes


@pytest.mark.parametrize("name", SHIPPED)
def test_the_card_is_what_weights_and_results_give(name):
    found = checkpoint_path(name).with_suffix(".md").read_text(encoding="utf-8")
    assert found == card_text(name, checkpoint_path(name), sorted(RESULTS.glob(f"{name}/**/result.json")))


@pytest.mark.parametrize("name", SHIPPED)
def test_nothing_of_the_test_sites_is_in_it(name):
    learned = stages(Reconstructor.load(name).card)
    sites = {site for stage in learned for site in (*stage["trained_on"], stage["validated_on"], *calibrated_on(stage))}
    tested = {entry.name for entry in CATALOGUE.values() if entry.role == "test"}
    assert tested and not sites & tested
    if name.endswith("-sim"):
        assert all("simulated" in site for site in sites)


def test_the_experiment_learns_a_maps_weights_as_those_that_are_shipped():
    network = Reconstructor.load("2d-sim")
    with initialize_config_dir(str(CONF), version_base="1.3"):
        settings = to_settings(compose("config", overrides=["experiment=shipped_2d_sim"]))
    assert settings.calibration_sites() == calibrated_on(network.card)
    assert settings.calibration_seeds == network.card[LEARNED_AS]["calibration_seeds"]
    assert settings.calibration_occupied_weight == occupied_weight_of(network.map_weights)


@pytest.mark.parametrize("name", SHIPPED)
def test_it_fills_gaps_of_a_room(name, room, box):
    """A place no network was trained on, and no building or street: still far better than a guess."""
    place = box if name.startswith("3d") else room
    gaps = random_gaps(place.fit, 1.2, place.resolution_m, 0)
    shown = gaps.cut(place.fit)
    mapper = hilbertvae.load_mapper(name).fit(shown.points, shown.occupied, shown.weight)
    asked = place.voxels.select(gaps.part(place.voxels.points) == INSIDE)
    found = score(asked.occupied, mapper.predict_proba(asked.points)[:, 1])
    assert found["auc"] > 0.7
